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
from wsim.usd.new.colliders import author_colliders
from wsim.usd.new.material import bind_material
from wsim.usd.new.mesh import BareMesh, NewSceneOptions, find_bare_mesh, new_scene_over_mesh, warn_unlikely_size
from wsim.usd.new.pins import author_pins
from wsim.usd.new.place import author_ground, author_physics_scene, free_path_below_root, set_default_prim
from wsim.usd.prims.cloth import apply_cloth
from wsim.usd.prims.fabric import author_fabric, load_fabric
from wsim.usd.stage import StageReading, open_stage

TALL = 4.0                         # [m]: a garment beyond is probably in other units than its file says
THIN = 1e-4                        # thickness of a flat mesh against its extent; what is thicker was shaped


def author_cloth(mesh_file, out, fabric: Fabric | str | None = None, prim: str | None = None, *, weld: float | None = None,
                 self_collision: bool = False, **wanted) -> list[Problem]:
    """Writes a scene `out` (.usda, .usdc, .usd) in which a mesh of `mesh_file` is cloth. Returns warnings.

    fabric          a Fabric (taken to seven digits), or the name of a preset of `wsim.scene.fabric`; None: the physics material
                    that the mesh is bound to, else cotton
    weld            points closer than this [m] become one particle
    self_collision  whether the cloth touches itself
    prim, wanted    ground, meters_per_unit, frames, pins, colliders, bound: see `wsim.usd.new.mesh.NewSceneOptions`

    Raises SceneError: no such file or mesh, an unknown fabric, a mesh that cannot be simulated, a place that cannot be
    written.
    """
    material, name = _resolve_fabric("cotton" if fabric is None else fabric)
    material = replace(material, **{f.name: float(f"{getattr(material, f.name):.7g}") for f in fields(Fabric)})
    asked, notes = NewSceneOptions(prim, **wanted), []
    source = open_stage(mesh_file, notes=notes)
    bare = find_bare_mesh(source, mesh_file, out, ("Mesh",), asked, "cloth")
    notes += warn_unlikely_size(source, bare, asked, TALL, "a garment")
    del source
    documentation = f"{os.path.basename(bare.file)} with {bare.path} as cloth ({name})"
    with new_scene_over_mesh(bare, out, documentation, notes) as stage:
        bare = set_default_prim(stage, bare)
        mesh = stage.OverridePrim(bare.path)
        made = bind_material(stage, bare, mesh, asked, fabric is not None,
                             lambda: author_fabric(stage, free_path_below_root(stage, f"materials/{name}"), material,
                                                   bare.units))
        own = material if made else load_fabric(StageReading(stage, bare.units), mesh, None, None)
        _author_new_cloth(mesh, bare, own, weld or 0.0, self_collision)
        author_physics_scene(stage, Scene().substeps, Scene().iterations)
        author_pins(stage, bare, mesh, asked.pins)
        author_colliders(stage, bare, out, asked.colliders, notes)
        if asked.ground is not None:
            author_ground(stage, bare.units, bare.bounds, asked.ground, notes)
    return notes


def _resolve_fabric(fabric: Fabric | str) -> tuple[Fabric, str]:
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


def _author_new_cloth(mesh: Usd.Prim, bare: BareMesh, material: Fabric, weld: float, self_collision: bool) -> None:
    none = np.zeros(0)
    sheet = Cloth(str(bare.path), none, none, none, material=material, weld=weld, flat=_is_flat(bare.world),
                  self_collision=self_collision)
    apply_cloth(mesh, sheet, bare.units)
