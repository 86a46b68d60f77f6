"""A bare mesh -> a small scene layer in which it is cloth. See mesh.py for what that has in common with other bodies.

Its rest angles are its own, since a garment is modelled in its folds and not sewn from a flat pattern; those of a flat mesh
are flat.
"""

import os
from dataclasses import fields, replace

import numpy as np
from pxr import Usd

from wsim.scene import Cloth, Problem, Scene, SceneError
from wsim.scene.fabric import FABRICS, Fabric
from wsim.scene.fabric import fabric as preset
from wsim.usd.new.mesh import (
    Bare,
    Wanted,
    author_ground,
    author_settings,
    bare_mesh,
    free,
    scene_over,
    size_notes,
)
from wsim.usd.prims.cloth import apply_cloth
from wsim.usd.prims.fabric import author_fabric, bind
from wsim.usd.stage import open_stage

TALL = 4.0                         # [m]: a garment beyond is probably in other units than its file says
THIN = 1e-4                        # thickness of a flat mesh against its extent; what is thicker was shaped


def author_cloth(mesh_file, out, fabric: Fabric | str = "cotton", prim: str | None = None, *, weld: float | None = None,
                 ground: float | None = None, meters_per_unit: float | None = None,
                 frames: int | None = None) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a mesh of `mesh_file` is cloth. Returns warnings.

    fabric          a Fabric (taken to seven digits), or the name of a preset of `wsim.scene.fabric`
    weld            points closer than this [m] become one particle
    prim, ground, meters_per_unit, frames    see `wsim.usd.new.mesh.Wanted`

    Raises SceneError: no such file or mesh, an unknown fabric, a mesh that cannot be simulated, a place that cannot be
    written.
    """
    material, name = _fabric(fabric)
    material = replace(material, **{f.name: float(f"{getattr(material, f.name):.7g}") for f in fields(Fabric)})
    wanted, notes = Wanted(prim, ground, meters_per_unit, frames), []
    source = open_stage(mesh_file, notes=notes)
    bare = bare_mesh(source, mesh_file, out, ("Mesh",), wanted, "cloth")
    notes += size_notes(source, bare, wanted, TALL, "a garment")
    del source
    documentation = f"{os.path.basename(bare.file)} with {bare.path} as cloth ({name})"
    with scene_over(bare, out, documentation, notes) as stage:
        _author(stage, bare, material, name, weld or 0.0)
        author_settings(stage, Scene().substeps, Scene().iterations)
        if ground is not None:
            author_ground(stage, bare.units, bare.bounds, ground)
    return notes


def _fabric(fabric: Fabric | str) -> tuple[Fabric, str]:
    if isinstance(fabric, Fabric):
        return fabric, next((name for name, known in FABRICS.items() if known == fabric), "fabric")
    try:
        return preset(fabric), fabric.lower()
    except ValueError as error:
        raise SceneError(Problem("fabric", str(error))) from None


def _is_flat(points: np.ndarray) -> bool:
    """Whether points (n, 3) lie in one plane, to THIN of their extent."""
    away = points[np.isfinite(points).all(axis=1)]
    away = away - away.mean(axis=0) if len(away) else np.zeros((1, 3))
    spread = np.linalg.eigvalsh(away.T @ away)                 # squared, ascending
    return bool(spread[0] <= THIN**2 * spread[2])


def _author(stage: Usd.Stage, bare: Bare, material: Fabric, name: str, weld: float) -> None:
    mesh = stage.OverridePrim(bare.path)
    none = np.zeros(0)
    sheet = Cloth(str(bare.path), none, none, none, material=material, weld=weld, flat=_is_flat(bare.world))
    apply_cloth(mesh, sheet, bare.units)
    bind(mesh, author_fabric(stage, free(stage, f"/materials/{name}"), material, bare.units))
