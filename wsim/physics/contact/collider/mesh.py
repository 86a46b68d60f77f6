"""Triangle meshes as colliders: what is solid, how deep it is, and meshes that deform.

A mesh is closed when, with coincident points counted as one, every edge is passed as often in one direction as in the
other, and its triangles enclose a volume: its inside is solid. Any other mesh is a sheet that keeps points away on both
sides.
"""

import ctypes
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wsim.geometry.triangulate import flat_triangles, triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.model.structs import fill_struct
from wsim.scene import Collider, Problem, SceneError, Surface
from wsim.scene.check.signed_distance import is_closed_mesh

SHEET_GAP = 2e-6       # part of a sheet's radius kept free at least: a point exactly on it would have no side (float32)


def enclosed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Enclosed volume [m^3], positive when the triangles are counter-clockwise seen from outside."""
    a, b, c = (points[triangles[:, k]] - points.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def outward_triangles(surface: Surface) -> tuple[np.ndarray, bool]:
    """Triangles (t, 3) int32 that have an area, wound alike, and whether they enclose a volume; then they face outward."""
    points = np.asarray(surface.points, np.float64)
    triangles = wound_alike(points, triangulate_polygons(surface.points, surface.counts, surface.indices, True)[0])
    enclosed = enclosed_volume(points, triangles) if is_closed_mesh(points, triangles) else 0.0
    if enclosed < 0.0:
        triangles = triangles[:, ::-1]
    return np.ascontiguousarray(triangles[~flat_triangles(points, triangles)], np.int32), enclosed != 0.0


def _bounding_ball_shapes(poses) -> np.ndarray:
    """Shapes (k, n, 3) [m] that the bounding ball is of; of one that joints move, where it begins: the device sees the rest."""
    return poses.at(0.0)[None] if hasattr(poses, "skeleton") else poses.values


@dataclass
class ColliderMesh:
    """A Surface made ready: NumPy first, then (`place`) on a device."""

    surface: Surface
    triangles: np.ndarray                # (t, 3) int32, outward where closed
    closed: bool
    center: np.ndarray                   # of the bounding ball [m], (3,)
    radius: float                        # [m]
    depth: float                         # no inside point is further from the surface [m]; 0: no inside
    device: dict = field(default_factory=dict)           # Warp objects: mesh, track, skin
    turned: bool = False                 # whether its joints may be set, so that it moves in any case

    @staticmethod
    def build(collider: Collider, turned: bool = False) -> "ColliderMesh":
        """turned: joints that move it may be set. Raises SceneError where a mesh has no triangle with an area, a bad index or a
        point that is no number."""
        surface = collider.shape
        assert isinstance(surface, Surface)
        points = surface.points.astype(np.float64)
        poses = points[None] if surface.poses is None else np.asarray(_bounding_ball_shapes(surface.poses), np.float64)
        if poses.shape[1:] != points.shape or not np.isfinite(poses).all() or not np.isfinite(points).all():
            raise SceneError(Problem(collider.path, f"the mesh has points of shape {poses.shape[1:]} over time and "
                                     f"{points.shape} at rest; they must be equal in shape and finite"))
        if len(surface.indices) and not (surface.indices.min() >= 0 and surface.indices.max() < len(points)):
            raise SceneError(Problem(collider.path, f"a face names a point outside of 0 to {len(points) - 1}"))
        triangles, solid = outward_triangles(surface)
        if len(triangles) == 0:
            raise SceneError(Problem(collider.path, "the mesh has no triangle with an area; give it faces, or remove "
                                     "the collider"))
        low, high = poses.min(axis=(0, 1)), poses.max(axis=(0, 1))
        center = 0.5 * (low + high)
        radius = float(np.linalg.norm(poses - center, axis=-1).max())
        inside = (high - low).min() if surface.poses is None or not hasattr(surface.poses, "skeleton") else 4.0 * radius
        return ColliderMesh(surface, triangles, solid, center, radius, 0.5 * float(inside) if solid else 0.0,
                            turned=turned and hasattr(surface.poses, "skeleton"))

    @property
    def moves(self) -> bool:
        return self.surface.poses is not None and (self.surface.poses.moves or self.turned)

    @cached_property
    def fastest(self) -> float:
        """Greatest speed [m/s] of a point of a mesh whose points have keys, straight between them."""
        times, values = self.surface.poses.times, self.surface.poses.values
        return max((float(np.linalg.norm(values[k + 1] - values[k], axis=-1).max() / (times[k + 1] - times[k]))
                    for k in range(len(times) - 1)), default=0.0)

    @property
    def least_gap(self) -> float:
        """Distance [m] that a sheet keeps in any case."""
        return 0.0 if self.closed else SHEET_GAP * self.radius

    def place(self, device, substeps: int) -> None:
        """Makes the Warp mesh and, where it deforms, room for its shapes over a frame."""
        import warp as wp
        if "mesh" not in self.device:
            start = self.surface.points if self.surface.poses is None else self.surface.poses.at(0.0)
            points = wp.array(np.asarray(start, np.float32), dtype=wp.vec3, device=device)
            still = wp.zeros(len(points), dtype=wp.vec3, device=device) if self.moves else None
            corners = wp.array(self.triangles.ravel(), dtype=wp.int32, device=device)
            self.device["wound"] = wp.zeros(1, dtype=int, device=device)
            self.device["box"] = [wp.zeros_like(points) for _ in range(2 * self.moves)]
            self.device["mesh"] = wp.Mesh(points, corners, still, support_winding_number=self.closed)
        if self.moves and (self.device.get("track") is None or self.device["track"].shape[0] != substeps + 1):
            self.device["track"] = wp.zeros((substeps + 1, len(self.surface.points)), dtype=wp.vec3, device=device)

    @property
    def id(self) -> int:
        return int(self.device["mesh"].id)

    def launch(self, of, k: int, loop=None) -> None:
        """The shape at the end of substep k, its motion and its tree; capturable. of:
        `wsim.physics.contact.contacts.ColliderContacts`, which has a kernel for the tree on a CPU; loop: as `Clock.loop`."""
        mesh, track = self.device["mesh"], self.device["track"]
        if loop and of.refit_kernel is None:
            self.fit_tree(of, loop)
            return
        of.launch(of.pose_kernel, track.shape[1], [track, 0, loop.number] if loop else [track, k, None],
                  [mesh.points, mesh.velocities])
        if of.refit_kernel is None:
            mesh.refit()
        else:
            function = ctypes.cast(mesh.runtime.core.wp_mesh_refit_host, ctypes.c_void_p).value
            of.launch(of.refit_kernel, 1, [function, mesh.id, int(of.adjoint is not None), of.table.deep, of.mark], [])

    def fit_tree(self, of, loop) -> None:
        """As `launch`, in the body of a loop on a GPU."""
        from wsim.kernels.math import mesh_refit as kernels
        mesh, track, threads = self.device["mesh"], self.device["track"], len(self.triangles)
        low, high = self.device["box"]
        tree = fill_struct(kernels.FittedTree, mesh=mesh.id, track=track, low=low, high=high, deep=of.table.deep, mark=of.mark,
                           wound=self.device["wound"], first=loop.first, span=kernels.span_of(track.shape[0] - 1))
        shape = [mesh.points, mesh.velocities]
        if threads <= kernels.SMALL:
            of.launch_blocks(kernels.fit_block(), 1, kernels.BLOCK, [tree, loop.number], shape)
            return
        of.launch(kernels.pose_point_kernel(), track.shape[1], [tree, loop.number], shape)
        of.launch(kernels.triangle_bound_kernel(), threads, [tree, threads, loop.number], [])
        of.launch(kernels.tree_fit_kernel(), threads, [tree, threads, loop.number], [])


def deforming_mesh_kernels(meshes, module, cpu: bool) -> tuple:
    """(kernel of shapes, kernel of trees on a CPU) for those of the meshes that deform; None where there are none."""
    if not any(mesh.moves for mesh in meshes):
        return None, None
    from wsim.kernels.animation import deformed
    return deformed.mesh_pose_kernel(module), deformed.mesh_refit_kernel(module) if cpu else None


def make_trees(model, meshes) -> None:
    """Makes the kernels by which a loop on a GPU fits the trees of meshes that deform."""
    from wsim.kernels.math import mesh_refit
    small = {len(mesh.triangles) <= mesh_refit.SMALL for mesh in meshes if mesh.moves}
    if True in small:
        model.modules[mesh_refit.BLOCK_MODULE] = mesh_refit.BLOCK
        mesh_refit.fit_block()
    if False in small:
        model.modules[mesh_refit.MODULE] = model.block
        mesh_refit.pose_point_kernel(), mesh_refit.triangle_bound_kernel(), mesh_refit.tree_fit_kernel()
