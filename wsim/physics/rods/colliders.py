"""Rows of the table of colliders that strands meet (kernels/rods/contact.py)."""

import numpy as np
import warp as wp

from wsim.geometry.rotation import matrix_quat
from wsim.kernels.contact.collider import shape
from wsim.kernels.rods.contact import STIFF
from wsim.physics.contact.collider.mesh import ColliderMesh
from wsim.physics.contact.collider.rows import fill_collider_table
from wsim.physics.rods.shape import longest_tight_step
from wsim.scene import Surface, solids
from wsim.scene.bodies import DefaultCount
from wsim.scene.solids import shape_row

LONGEST = 1.0 / 240.0         # [s] of a substep: BDF2 is off by (omega h)^2 / 3 of a frequency, 1e-3 at 2 Hz
SUNK, MOST = 0.1, 400         # part of a diameter that tight strands may sink; substeps a frame that they get for it at most


def longest_strand_substep(table, scene, dt: float) -> float:
    """[s]; shorter where strands are tight round colliders at the start, and the scene leaves substeps free."""
    if not scene.colliders or not isinstance(scene.substeps, DefaultCount):
        return LONGEST
    tight = longest_tight_step(table.x, table.values, table.hold >= 0, table.own_counts, float(STIFF), SUNK)
    return max(min(LONGEST, tight), dt / MOST)


def deforms_for_strands(of) -> bool:
    """Whether strands meet a shape as it deforms; joints that rigid bodies drive are known on the device alone."""
    poses = of.poses if isinstance(of, Surface) else None
    return poses is not None and poses.moves and not (hasattr(poses, "skeleton") and poses.skeleton.bodies)


def strand_collider_kinds(meshes: list[ColliderMesh | None], colliders: list) -> list[str]:
    """Kind of each collider: a convex shape's, "solid" of a closed mesh, "sheet" of another."""
    found = [shape_row(c.shape).kind if m is None else "solid" if m.closed else "sheet"
             for m, c in zip(meshes, colliders, strict=True)]
    shape.make_known(solids.SOLIDS, found)
    return found


class StrandObstacles:
    """Colliders of a scene, and where they are at the starts and ends of substeps."""

    def __init__(self, colliders: list, device, substeps: int):
        self.colliders, self.device = colliders, device
        self.meshes = [ColliderMesh.build(c) if isinstance(c.shape, Surface) else None for c in colliders]
        for mesh in filter(None, self.meshes):
            mesh.place(device, substeps)                 # the shape where it starts
        self.shapes: dict[int, list[wp.Mesh]] = {}       # of meshes that deform, at the starts and ends of substeps
        names = strand_collider_kinds(self.meshes, colliders)
        self.kinds = tuple(sorted(set(names)))
        self.table = fill_collider_table(
            wp.float64, device, names, thick=[c.thickness or 0.0 for c in colliders],
            size=[(0.0, 0.0, 0.0) if isinstance(c.shape, Surface) else shape_row(c.shape).size(c.shape) for c in colliders],
            friction=[(c.static_friction, c.dynamic_friction) for c in colliders],
            restitution=[c.restitution for c in colliders])
        self.resize_pose_table(substeps)

    def resize_pose_table(self, substeps: int) -> None:
        """Room for so many substeps, 0: for shapes alone, which something else places."""
        self.table.pose = wp.zeros((substeps + 1, len(self.colliders)), dtype=wp.transformd, device=self.device)
        times = max(substeps, 1) + 1
        ids = np.tile(np.array([m.id if m else 0 for m in self.meshes], np.uint64), (times, 1))
        for c in (c for c, collider in enumerate(self.colliders) if deforms_for_strands(collider.shape)):
            self.shapes[c] = [self._copy(c) for _ in range(times)]
            ids[:, c] = [mesh.id for mesh in self.shapes[c]]
        self.table.mesh = wp.array(ids.ravel(), dtype=wp.uint64, device=self.device)
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
        self.table.pose.assign(np.concatenate([found[..., :3, 3], matrix_quat(found[..., :3, :3])], axis=-1))
        self.posed = True
