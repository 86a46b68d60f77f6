"""Colours of what a body bears: strain, stress or contact of each point, on one scale for all frames.

    strain     of cloth the larger principal strain of a triangle (eigenvalues of U - 1, U^2 = F^T F); of a tet |U - 1|, the
               Frobenius norm; of a spring its strain. Red: TOP.
    stress     of cloth von Mises of the membrane stress [N/m], of a tet of the Cauchy stress [Pa], by Hooke's law on U - 1;
               of a spring as strain. Red: TOP times stretch or Young's modulus.
    contact    the gap to the nearest collider. Red: touching; blue: NEAR of the scene's size away, or more.

Points have the mean of their elements, weighed by area or volume at rest. Positions alone decide: what viscosity and plastic
flow add is not seen. NumPy in float64 (distances to meshes: kernels/picture/distance.py).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry.tetra.tets import signed_tet_volumes
from wsim.model.model import PointBody
from wsim.physics.cloth.kinds.membrane import flat_edge_matrices
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.nodal.skin import SkinEmbedding, embed_all_skins
from wsim.scene.samples import ColourSample

if TYPE_CHECKING:
    from wsim.scene import Cloth, Soft, Springs

KINDS = ("strain", "stress", "contact")
TOP = 0.1                      # strain at the end of the scale
NEAR = 0.01                    # of the scene's size: gap at the other end of that of contact
SCALE = np.array([(0.02, 0.05, 0.30), (0.02, 0.30, 0.45), (0.12, 0.46, 0.10), (0.80, 0.50, 0.03), (0.62, 0.02, 0.02)])


def colour_scale(values: np.ndarray) -> np.ndarray:
    """Linear colours (n, 3) float32 of values (n,), 0 blue to 1 red; what is outside has the colour of the end."""
    at = np.clip(np.nan_to_num(values, nan=1.0), 0.0, 1.0) * (len(SCALE) - 1)
    low = np.minimum(at.astype(int), len(SCALE) - 2)
    part = (at - low)[:, None]
    return ((1.0 - part) * SCALE[low] + part * SCALE[low + 1]).astype(np.float32)


def point_strain_or_stress(body: PointBody, positions: np.ndarray, kind: str) -> np.ndarray:
    """strain or stress of each author's point over the end of its scale, (n,); positions (n, 3) [m], author's order."""
    x = np.zeros((body.count, 3))
    x[body.index - body.first] = positions
    source: Any = body.source
    if source.is_solid:
        corners, weights, values = _tet_strain_or_stress(body, source, x, kind)
    elif source.is_sheet:
        corners, weights, values = _triangle_strain_or_stress(body, source, x, kind)
    else:
        corners, weights, values = _spring_strain_values(body, source, x, kind)
    k = corners.shape[1]
    total = np.bincount(corners.ravel(), np.repeat(weights * values, k), body.count)
    whole = np.bincount(corners.ravel(), np.repeat(weights, k), body.count)
    return (total / np.where(whole > 0.0, whole, 1.0))[body.index - body.first]


def _triangle_strain_or_stress(body: PointBody, cloth: "Cloth", x: np.ndarray, kind: str) -> tuple[np.ndarray, ...]:
    corners = body.triangles - body.first
    Dm, areas = flat_edge_matrices(body.rest[corners])
    good = areas > 0.0
    corners, areas, p = corners[good], areas[good], x[corners[good]]
    F = np.stack([p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]], axis=2) @ np.linalg.inv(Dm[good])
    C = np.swapaxes(F, 1, 2) @ F
    root = np.sqrt(np.maximum(np.linalg.det(C), 0.0))             # U = (C + root 1) / (tr C + 2 root)^1/2
    size = np.sqrt(np.maximum(np.trace(C, axis1=1, axis2=2) + 2.0 * root, 1e-300))
    E = (C + root[:, None, None] * np.eye(2)) / size[:, None, None] - np.eye(2)
    if kind == "strain":
        return corners, areas, np.abs(np.linalg.eigvalsh(E)).max(axis=1) / TOP
    k = {name: np.array([getattr(cloth.material, name)]) for name in ("stretch", "shear", "weft", "poisson")}
    if cloth.stretches is not None:
        from wsim.physics.cloth.painted import of_triangles
        k = of_triangles(body, cloth, good, k)
    warp, nu = k["stretch"], k["poisson"]
    weft = np.where(k["weft"] > 0.0, k["weft"], warp)
    cross = nu * np.sqrt(warp * weft)
    uu = (warp * E[:, 0, 0] + cross * E[:, 1, 1]) / (1.0 - nu * nu)
    vv = (weft * E[:, 1, 1] + cross * E[:, 0, 0]) / (1.0 - nu * nu)
    uv = k["shear"] * 2.0 * E[:, 0, 1]
    return corners, areas, np.sqrt(uu * uu - uu * vv + vv * vv + 3.0 * uv * uv) / (TOP * cloth.material.stretch)


def _tet_strain_or_stress(body: PointBody, soft: "Soft", x: np.ndarray, kind: str) -> tuple[np.ndarray, ...]:
    corners = body.tets[:, :4] - body.first
    rest, now = (np.swapaxes(p[corners[:, 1:]] - p[corners[:, :1]], 1, 2) for p in (body.rest, x))
    E = np.linalg.svd(now @ np.linalg.inv(rest), compute_uv=False) - 1.0
    weights = signed_tet_volumes(body.rest, corners)
    if kind == "strain":
        return corners, weights, np.linalg.norm(E, axis=1) / TOP
    which = np.zeros(len(corners), int) if soft.which is None else soft.which
    mu = np.array([0.5 * m.young / (1.0 + m.poisson) for m in soft.materials])[which]
    shape = E - E.mean(axis=1, keepdims=True)
    return corners, weights, 2.0 * mu * np.sqrt(1.5) * np.linalg.norm(shape, axis=1) / (TOP * soft.material.young)


def _spring_strain_values(body: PointBody, net: "Springs", x: np.ndarray, kind: str) -> tuple[np.ndarray, ...]:
    from wsim.simulation.measure.indicators import edge_lengths, edge_strain
    rest = edge_lengths(body)
    return (body.edges - body.first)[rest > 0.0], rest[rest > 0.0], np.abs(edge_strain(body, x)) / TOP


def colours_of_simulation(sim, kind: str) -> list[ColourSample]:
    """Colours of the bodies of a running simulation, and of their skins, now: samples for a recorder."""
    values = {b.path: point_strain_or_stress(sim.model.body(b.path, 0), sim.positions(b.path), kind)
              for b in bodies_sampled_by_point(sim.scene)}
    values |= {path: values_on_skin(skin, values[skin.body]) for path, skin in embed_all_skins(sim.scene).items()}
    return [ColourSample(path, colour_scale(each)) for path, each in values.items()]


def values_on_skin(skin: SkinEmbedding, values: np.ndarray) -> np.ndarray:
    """Values (m,) of a skin's points from those of its body's, (n,)."""
    return skin.of(np.repeat(values[:, None], 3, axis=1))[:, 0]
