"""Shapes in a fluid on the device: obstacles and sources, and where they are in each frame."""

from math import sqrt
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import rotation
from wsim.geometry.triangulate import triangulate
from wsim.kernels.contact import shape as convex
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.fluid import shapes as kernels
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.model.structs import filled
from wsim.scene import Surface
from wsim.scene.solids import row


def kind(shape: Any) -> str:
    """Name of a kind of shape: a convex one's, "solid" of a closed mesh, "sheet" of an open one."""
    if not isinstance(shape, Surface):
        return row(shape).kind
    triangles = triangulate(shape.points, shape.counts, shape.indices)[0]
    return "solid" if closed(triangles) else "sheet"


def closed(triangles: np.ndarray) -> bool:
    """True if every edge is of two triangles."""
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all()) and len(triangles) > 0


def forms(thing: Any) -> bool:
    """True of a mesh whose points move."""
    poses = getattr(thing.shape, "poses", None)
    return getattr(thing, "rows", None) is not None or poses is not None and (poses.moves or hasattr(poses, "skeleton"))


def kinds(things: list) -> tuple[str, ...]:
    """Kinds of their shapes, "forming" among them where a mesh's points move."""
    return tuple(sorted({kind(thing.shape) for thing in things} | {"forming" for thing in things if forms(thing)}))


def half_thickness(shape: Any) -> float:
    """Half the thickness of the thinnest part [m], about: volume over area of a mesh."""
    if not isinstance(shape, Surface):
        found = row(shape)
        return min(found.lengths(shape), default=np.inf) * (0.5 if found.kind == "cone" else 1.0)
    triangles = triangulate(shape.points, shape.counts, shape.indices)[0]
    if not closed(triangles):
        return 0.0
    a, b, c = (shape.points[triangles[:, k]].astype(np.float64) for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return float(abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum()) / 6.0 / max(area, 1e-300))


class Shapes:
    """Shapes of things that have a `shape` and a `motion`, places relative to a corner [m]; thin ones are thickened where
    they must keep air apart (`walls`)."""

    def __init__(self, model: Model, things: list, corner: np.ndarray, axes: tuple[int, ...], cell: float, walls: bool):
        self.things, self.corner, self.model, self.cell = things, np.asarray(corner, np.float64), model, cell
        t, n = types(model.real), len(things)
        self.kinds = kinds(things)
        self.meshes = [self._mesh(thing) if isinstance(thing.shape, Surface) else None for thing in things]
        self.state: Any = None                                 # that `Sheet`s follow (`wsim.physics.fluid.shells`)
        least = 0.5 * sqrt(len(axes)) * cell if walls else 0.0
        self.thick = thick = [max(0.0, least - half_thickness(thing.shape)) for thing in things]
        size = [(0.0, 0.0, 0.0) if isinstance(thing.shape, Surface) else row(thing.shape).size(thing.shape) for thing in things]
        dtype = model.dtype
        self.table = filled(
            kernels.structs(model.real).Shapes, kind=model.upload(np.array([*map(self._code, things)], np.int32), int),
            size=model.upload(np.array(size, dtype), t.vec3), thick=model.upload(np.array(thick, dtype), model.real),
            mesh=model.upload(np.array([m.id if m else 0 for m in self.meshes], np.uint64), wp.uint64),
            place=wp.zeros(n, dtype=t.vec3, device=model.device), turn=wp.zeros(n, dtype=t.quat, device=model.device),
            speed=wp.zeros(n, dtype=t.vec3, device=model.device), spin=wp.zeros(n, dtype=t.vec3, device=model.device),
            body=model.upload(np.array([getattr(thing, "body", -1) for thing in things], np.int32), int),
            axes=wp.vec3i(*axes, *(0,) * (3 - len(axes))), dx=model.real(cell))
        self.follow = kernels.follow(model.real, model.module) if any(hasattr(thing, "rows") for thing in things) else None
        self.shift = np.zeros((n, 3))                          # [m] added to where motions say that they are
        self.posed: tuple = ()                                 # what was uploaded last
        self.pose(0.0, 1.0)

    def _code(self, thing: Any) -> int:
        name = kind(thing.shape)
        return {"solid": SOLID, "sheet": SHEET}[name] if name in ("solid", "sheet") else convex.code(name)

    def _mesh(self, thing: Any) -> wp.Mesh:
        shape, device = thing.shape, self.model.device
        triangles = triangulate(shape.points, shape.counts, shape.indices)[0]
        rates = wp.zeros(len(shape.points), dtype=wp.vec3f, device=device) if forms(thing) else None
        return wp.Mesh(wp.array(shape.points, dtype=wp.vec3f, device=device),
                       wp.array(triangles.ravel(), dtype=int, device=device), rates)

    def _form(self, time: float, dt: float) -> None:
        """Points of meshes where the frame begins, and how fast they move through it."""
        for thing, mesh in zip(self.things, self.meshes, strict=True):
            if mesh is None or not forms(thing):
                continue
            if getattr(thing, "rows", None) is None:
                first, last = (np.asarray(thing.shape.poses.at(t), np.float64) for t in (time, time + dt))
                mesh.points.assign(first.astype(np.float32))
                mesh.velocities.assign(((last - first) / dt).astype(np.float32))
            elif self.state is not None:
                rows = self.model.upload(thing.rows.astype(np.int32), int)
                self.model.launch(self.follow, len(thing.rows), [rows, self.state.x, self.state.v],
                                  [mesh.points, mesh.velocities])
            mesh.refit()

    def ball(self, k: int) -> float:
        """Radius about its own origin that holds a shape [m]."""
        shape = self.things[k].shape
        own = np.linalg.norm(shape.points, axis=1).max(initial=0.0) if isinstance(shape, Surface) else row(shape).ball(shape)
        return float(own) + self.thick[k]

    @property
    def moving(self) -> bool:
        return any(thing.motion.moves or forms(thing) for thing in self.things) or self.bodies

    @property
    def moved(self) -> list[str]:
        """Paths of those that go by a motion, which is evaluated before frames."""
        return [thing.path for thing in self.things if thing.motion.moves]

    @property
    def bodies(self) -> bool:
        """Some are of rigid bodies (`wsim.physics.fluid.shells`)."""
        return any(getattr(thing, "body", -1) >= 0 for thing in self.things)

    def pose(self, time: float, dt: float) -> None:
        """Uploads where the frame from `time` [s] begins, and how fast all moves through it, dt [s] long."""
        self._form(time, dt)
        now = dt, self.shift.tobytes(), [id(thing.motion) for thing in self.things]
        if self.posed == now and not self.moving:
            return
        self.posed = now
        M = np.array([thing.motion.sampled([time, time + dt]) for thing in self.things]).reshape(-1, 2, 4, 4)
        first, last = M[:, 0], M[:, 1]
        axis, angle = rotation.axis_angle(last[:, :3, :3] @ first[:, :3, :3].swapaxes(1, 2))
        turn = angle[:, None] * axis
        values = {"place": first[:, :3, 3] - self.corner + self.shift, "turn": rotation.quaternion(first[:, :3, :3]),
                  "speed": (last[:, :3, 3] - first[:, :3, 3]) / dt, "spin": turn / dt}
        for name, value in values.items():
            getattr(self.table, name).assign(np.ascontiguousarray(value, self.model.dtype))

