"""Masses of the author's points. NumPy only."""

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import topology

if TYPE_CHECKING:
    from wsim.scene import Cloth, Soft

THIN = 1.0 / 64.0      # least part of a cage's tet that counts: with less, light points hang on nothing and want small steps


def cloth_masses(cloth: "Cloth", triangles: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Mass of each author's point [kg]: authored, or rest area times thickness times density, a third to each corner. Points of
    no triangle, which nothing holds, have the mean of the others."""
    if cloth.masses is not None:
        return cloth.masses.astype(np.float64)
    n = len(cloth.points)
    thickness = np.full(n, cloth.material.thickness) if cloth.thicknesses is None else cloth.thicknesses
    area = topology.triangle_areas(rest, triangles)
    share = area * np.asarray(thickness, np.float64)[triangles].mean(axis=1) * cloth.material.density / 3.0
    masses = np.bincount(triangles.ravel(), np.repeat(share, 3), n)
    if cloth.mass is not None:
        masses *= cloth.mass / masses.sum()
    used = np.bincount(triangles.ravel(), minlength=n) > 0
    masses[~used] = masses.sum() / max(used.sum(), 1)
    return masses


def fill_loose_masses(masses: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Masses of particles [kg], (n,), with the mean where there is none, and the particles that are no corner: no force acts on
    them, and they stay where they are."""
    alone = np.setdiff1d(np.arange(len(masses)), corners)
    none = alone[masses[alone] <= 0.0]
    if len(none):
        masses = masses.copy()
        masses[none] = masses.sum() / len(masses) or 1.0
    return masses, alone


def soft_masses(soft: "Soft", rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass of each author's point [kg], and the points that no tet has (which get some mass, and stay where they are).

    Authored, or the volume of the tets at rest times density; of tets that are partly body at least THIN of it."""
    from wsim.geometry.tetra.tets import lumped_tet_masses as shared
    n, idle = len(rest), np.setdiff1d(np.arange(len(rest)), soft.tets)
    if soft.masses is not None:
        return soft.masses.astype(np.float64), idle
    masses = shared(rest, soft.tets, soft_weights(soft))
    if soft.mass is not None:
        masses *= soft.mass / masses.sum()
    masses[idle] = masses.sum() / n
    return masses, idle


def soft_weights(soft: "Soft") -> np.ndarray:
    """Mass of each tet over its volume [kg/m^3], (t,)."""
    density = np.array([m.density for m in soft.materials])[0 if soft.which is None else soft.which]
    return np.broadcast_to(density * soft_share(soft), len(soft.tets))


def soft_share(soft: "Soft") -> np.ndarray | float:
    """Factor of mass and stiffness of each tet [1], (t,) or 1."""
    return 1.0 if soft.filled is None else np.maximum(soft.filled.astype(np.float64), THIN)


def single_density(source) -> float | None:
    """The one density [kg/m^3] that all masses of a body follow; None where masses are authored or materials differ."""
    if len(source.materials) != 1 or source.masses is not None or source.mass is not None:
        return None
    return source.materials[0].density
