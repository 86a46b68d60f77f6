"""Colliders of strands on the device (kernels/rods/contact.py)."""

import numpy as np
import warp as wp

from wsim.kernels.contact import shape
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.rods.contact import Colliders
from wsim.model.structs import filled
from wsim.physics.contact.mesh import Mesh
from wsim.physics.rods.tables import Table
from wsim.scene import Surface, solids
from wsim.scene.solids import row

CODES = {"solid": SOLID, "sheet": SHEET}


def forms(of) -> bool:
    """Whether strands meet a shape as it deforms; joints that rigid bodies drive are known on the device alone."""
    poses = of.poses if isinstance(of, Surface) else None
    return poses is not None and poses.moves and not (hasattr(poses, "skeleton") and poses.skeleton.bodies)


def kinds(meshes: list[Mesh | None], colliders: list) -> list[str]:
    """Kind of each collider: a convex shape's, "solid" of a closed mesh, "sheet" of another."""
    found = [row(c.shape).kind if m is None else "solid" if m.closed else "sheet"
             for m, c in zip(meshes, colliders, strict=True)]
    shape.make_known(solids.SOLIDS, found)
    return found


class Obstacles:
    """Colliders of a scene, and where they are at the starts and ends of substeps."""

    def __init__(self, colliders: list, table: Table, device, substeps: int):
        self.colliders, self.device = colliders, device
        self.meshes = [Mesh.build(c) if isinstance(c.shape, Surface) else None for c in colliders]
        for mesh in filter(None, self.meshes):
            mesh.place(device, substeps)                 # the shape where it starts
        self.shapes: dict[int, list[wp.Mesh]] = {}       # of meshes that deform, at the starts and ends of substeps
        n, names = len(colliders), kinds(self.meshes, colliders)
        self.kinds = tuple(sorted(set(names)))
        size = [(0.0, 0.0, 0.0) if isinstance(c.shape, Surface) else row(c.shape).size(c.shape) for c in colliders]
        friction = np.zeros((n, table.strands, 2))
        for own, (rods, _) in zip(table.own, table.pairs, strict=True):
            mine = np.array([rods.static_friction, rods.dynamic_friction])
            for j, c in enumerate(colliders):
                friction[j, own] = 0.5 * (mine + (c.static_friction, c.dynamic_friction))
        def up(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)
        self.table = filled(
            Colliders, kind=up(np.array([CODES[k] if k in CODES else shape.code(k) for k in names], np.int32), int),
            size=up(np.array(size, np.float64).reshape(-1, 3), wp.vec3d), friction=up(friction, wp.vec2d),
            thick=up(np.array([c.thickness or 0.0 for c in colliders], np.float64), wp.float64))
        self.resize(substeps)

    def resize(self, substeps: int) -> None:
        for name in ("frame", "back"):
            setattr(self.table, name, wp.zeros((substeps + 1, len(self.colliders)), dtype=wp.mat44d, device=self.device))
        times = max(substeps, 1) + 1
        ids = np.tile(np.array([m.id if m else 0 for m in self.meshes], np.uint64), (times, 1))
        for c in (c for c, collider in enumerate(self.colliders) if forms(collider.shape)):
            self.shapes[c] = [self._copy(c) for _ in range(times)]
            ids[:, c] = [mesh.id for mesh in self.shapes[c]]
        self.table.mesh = wp.array(ids, dtype=wp.uint64, device=self.device)
        self.posed = False

    def _copy(self, c: int) -> wp.Mesh:
        own = self.meshes[c].device["mesh"]     # type: ignore[union-attr]
        return wp.Mesh(wp.clone(own.points), own.indices)

    def pose(self, times: np.ndarray) -> None:
        """Uploads where they are at some times [s], (substeps + 1,)."""
        for c, meshes in self.shapes.items():
            for mesh, time in zip(meshes, times, strict=True):
                mesh.points.assign(self.colliders[c].shape.poses.at(float(time)).astype(np.float32))
                mesh.refit()
        if self.posed and not any(c.motion.moves for c in self.colliders):
            return
        found = np.stack([c.motion.sampled(times) for c in self.colliders], axis=1)
        self.table.frame.assign(found)
        self.table.back.assign(np.linalg.inv(found))
        self.posed = True
