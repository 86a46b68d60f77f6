"""The table of colliders on the device (kernels/contact/collider/table.py): which rows there are, and where they are in each
frame.

Fluids fill one with all that they meet. A method from outside takes `build.colliders`, of the scene's colliders, poses it where
a frame begins, and asks it in its kernels:

    self.colliders = b.colliders
    ask = queries(self.colliders.kinds, real)                       # kernels/contact/collider/table.py: signed, closest, rate,
    ... def before_frame(self, time, clock): self.colliders.pose(time, clock.dt)
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.kernels.contact.collider import shape as convex
from wsim.kernels.contact.collider.table import mesh_follow_kernel, mesh_rate_kernel
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.physics.contact.collider.mesh import outward_triangles
from wsim.physics.contact.collider.point_cloud import PointCloud, device_points
from wsim.physics.contact.collider.rows import fill_collider_table, foot_of_planes
from wsim.scene import Surface, solids
from wsim.scene.solids import shape_row


def collider_shape_kind(shape: Any) -> str:
    """Name of a kind of shape: a convex one's, "solid" of a closed mesh, "sheet" of an open one, "balls" of a cloud."""
    if isinstance(shape, PointCloud):
        return "balls"
    if not isinstance(shape, Surface):
        return shape_row(shape).kind
    return "solid" if outward_triangles(shape)[1] else "sheet"


def is_deforming_collider(thing: Any) -> bool:
    """True of a mesh whose points move."""
    poses = getattr(thing.shape, "poses", None)
    return getattr(thing, "rows", None) is not None or poses is not None and (poses.moves or hasattr(poses, "skeleton"))


def kind_names(things: list) -> tuple[str, ...]:
    """Kinds of their shapes, "forming" among them where a mesh's points move."""
    return tuple(sorted({collider_shape_kind(thing.shape) for thing in things} | {"forming" for thing in things
                                                                                  if is_deforming_collider(thing)}))


def mesh_size(shape: Any) -> tuple[float, float, float]:
    """Sizes of a mesh or cloud on the device: of a cloud its largest and its smallest radius [m]."""
    if not isinstance(shape, PointCloud):
        return 0.0, 0.0, 0.0
    return float(shape.radius_of.max()), float(shape.radius_of.min()), 0.0


def screw_jacobians(turn: np.ndarray) -> np.ndarray:
    """J of rotation vectors (n, 3) [rad], see kernels/contact/collider/table.py, (n, 3, 3)."""
    x, y, z = turn.T
    o = np.zeros_like(x)
    cross = np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(-1, 3, 3)
    f = np.linalg.norm(turn, axis=1)[:, None, None]
    small, square = f < 0.03, f * f
    f = np.where(small, 1.0, f)
    a = np.where(small, 0.5 - square * (1.0 / 24.0 - square / 720.0), 0.5 * (np.sin(0.5 * f) / (0.5 * f)) ** 2)
    b = np.where(small, 1.0 / 6.0 - square * (1.0 / 120.0 - square / 5040.0), (f - np.sin(f)) / f ** 3)
    return np.eye(3) + a * cross + b * cross @ cross


class ColliderTable:
    """`rows` of things that have a `shape` and a `motion`; and of colliders friction, restitution and thickness, of bodies the
    `body` that owns them. Places count from a corner, world (3,) [m]."""

    def __init__(self, model: Model, things: list, corner: Any = (0.0, 0.0, 0.0), thick: list[float] | None = None,
                 screw: bool = True):
        self.things, self.corner, self.model = things, np.asarray(corner, np.float64), model
        t, n, device = types(model.real), len(things), model.device
        self.kinds = kind_names(things)
        self.meshes = [self._mesh(thing) if isinstance(thing.shape, (Surface, PointCloud)) else None for thing in things]
        self.state: Any = None                                 # that meshes with `rows` of its points follow
        self.shift = np.zeros((n, 3))                          # [m] added to where motions say that they are
        size = [mesh_size(thing.shape) if mesh else shape_row(thing.shape).size(thing.shape)
                for thing, mesh in zip(things, self.meshes, strict=True)]
        kept = [getattr(thing, "thickness", None) or 0.0 for thing in things] if thick is None else thick
        rub = [[getattr(thing, f"{name}_friction", 0.0) for name in ("static", "dynamic")] for thing in things]
        names = self.names = [collider_shape_kind(thing.shape) for thing in things]
        convex.make_known(solids.SOLIDS, names)
        self.rows = fill_collider_table(model.real, device, names, size=size, thick=kept, friction=rub,
                                        restitution=[getattr(thing, "restitution", 0.0) for thing in things],
                                        mesh=np.array([m.id if m else 0 for m in self.meshes], np.uint64),
                                        owner=[getattr(thing, "body", -1) for thing in things])
        self.rows.screw = int(screw)
        self.rows.speed, self.rows.spin = (wp.zeros(n, dtype=t.vec3, device=device) for _ in range(2))
        self.points = {k: model.upload(thing.rows.astype(np.int32), int) for k, thing in enumerate(things)
                       if getattr(thing, "rows", None) is not None}      # of the state, of each mesh that is made of such
        if self.points:
            self.follow, self.rates = (make(model.real, model.module) for make in (mesh_follow_kernel, mesh_rate_kernel))
        self.posed: tuple = ()                                 # what was uploaded last
        self.pose(0.0, 1.0)

    def _mesh(self, thing: Any) -> wp.Mesh:
        shape, device = thing.shape, self.model.device
        triangles = shape.faces if isinstance(shape, PointCloud) else outward_triangles(shape)[0]
        points = device_points(shape, shape.points)
        rates = wp.zeros(len(points), dtype=wp.vec3f, device=device) if is_deforming_collider(thing) else None
        return wp.Mesh(wp.array(points, dtype=wp.vec3f, device=device),
                       wp.array(triangles.ravel(), dtype=int, device=device), rates)

    def _deform_mesh_points(self, time: float, dt: float) -> None:
        """Points of meshes where the frame begins, and how fast they move through it."""
        for k, (thing, mesh) in enumerate(zip(self.things, self.meshes, strict=True)):
            if mesh is None or not is_deforming_collider(thing):
                continue
            if k not in self.points:
                first, last = (np.asarray(thing.shape.poses.at(t), np.float64) for t in (time, time + dt))
                mesh.points.assign(device_points(thing.shape, first))
                rates = np.zeros(mesh.points.shape + (3,), np.float32)
                rates[:len(first)] = (last - first) / dt
                mesh.velocities.assign(rates)
            elif self.state is not None:
                self.model.launch(self.follow, len(thing.rows), [self.points[k], self.state.x, self.state.v],
                                  [mesh.points, mesh.velocities])
            mesh.refit()

    def reach_points(self, dt: float) -> None:
        """Lets meshes that are made of points of the state go, in this frame, to where these are now, once they have moved:
        there the next frame begins. Launches alone."""
        for k, rows in self.points.items():
            mesh: Any = self.meshes[k]
            self.model.launch(self.rates, rows.shape[0], [rows, self.state.x, float(dt), mesh.points], [mesh.velocities])

    @property
    def moving(self) -> bool:
        return any(thing.motion.moves or is_deforming_collider(thing) for thing in self.things) or self.bodies

    @property
    def moved(self) -> list[str]:
        """Paths of those that go by a motion, which is evaluated before frames."""
        return [thing.path for thing in self.things if thing.motion.moves]

    @property
    def bodies(self) -> bool:
        """Some are of rigid bodies (`wsim.physics.contact.collider.shells`)."""
        return any(getattr(thing, "body", -1) >= 0 for thing in self.things)

    def pose(self, time: float, dt: float) -> None:
        """Uploads where the frame from `time` [s] begins, and how fast all moves through it, dt [s] long."""
        self._deform_mesh_points(time, dt)
        if not self.things:
            return
        now = dt, self.shift.tobytes(), [id(thing.motion) for thing in self.things]
        if self.posed == now and not any(thing.motion.moves or is_deforming_collider(thing) for thing in self.things):
            return
        self.posed = now
        M = np.array([thing.motion.sampled([time, time + dt]) for thing in self.things]).reshape(-1, 2, 4, 4)
        first, last = M[:, 0], M[:, 1]
        axis, angle = rotation.axis_angle(last[:, :3, :3] @ first[:, :3, :3].swapaxes(1, 2))
        turn = angle[:, None] * axis
        speed = (last[:, :3, 3] - first[:, :3, 3]) / dt
        if self.rows.screw:
            speed = np.linalg.solve(screw_jacobians(turn), speed[:, :, None])[:, :, 0]
        R, flat = first[:, :3, :3], np.array([kind == "plane" for kind in self.names]) & (M[:, 0] == M[:, 1]).all(axis=(1, 2))
        place = np.concatenate([foot_of_planes(first[:, :3, 3] - self.corner + self.shift, R, flat), rotation.matrix_quat(R)],
                               axis=1)
        for name, value in {"pose": place[None], "speed": speed, "spin": turn / dt}.items():
            getattr(self.rows, name).assign(np.ascontiguousarray(value, self.model.dtype))
