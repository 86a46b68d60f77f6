"""Contacts of rigid bodies with each other and with colliders: tables of shapes, lists that grow, and the launches of a frame.

Manifolds are made at least COLLIDE times a second, by balls that may meet, then pair by pair (kernels/rigid/lists), and
the substeps until the next time are passes over bodies and manifolds (kernels/rigid/passes.py), in the form that device and
size ask for (wsim/physics/rigid/forms.py). Impulses that substeps begin with are a part of the state, so that a repeated frame
and a restart have them. Friction is the mean of both colliders, restitution the larger.
"""

from math import ceil
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import angular_velocity, quaternion
from wsim.kernels.math.real import types
from wsim.kernels.rigid import contact
from wsim.kernels.rigid.kinds import SERIAL
from wsim.kernels.rigid.lists import collide, collide_mesh, pairs, rows
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.stage import Clock, Remedy
from wsim.model.state import Field, Part
from wsim.model.status import Status
from wsim.model.structs import filled
from wsim.physics.rigid import forms, surfaces
from wsim.physics.rigid.meetings import bounces, kinds, places_of, put
from wsim.physics.rigid.solids import as_met, meeting, standing
from wsim.scene import Collider

COLLIDE = 60.0               # [1/s]: a ball at 5 m/s goes 8 cm meanwhile
WORD, IN_TURN = "rigid pairs", "rigid manifolds without a colour"
PAIRS = (Field("a", "", True, "shape of a manifold, -1 for none", "int"), Field("b", "", True, "the other", "int"),
         Field("count", "", True, "its points", "int"), Field("colour", "", True, "its colour, -1 for none", "int"))
POINTS = (Field("push", "N s", True, "impulse of a point in the last substep", "scalar"),
          Field("rub", "N s", True, "that of friction"), Field("key", "", True, "features that touch", "int"))


class Contacts:
    """bodies: (Body, world) of each row of the method's part."""

    def __init__(self, b, method):
        self.model, self.status, self.method = b.model, b.status, method
        self.colliders: list[Collider] = standing(b.scene.colliders)
        self.real, self.device = b.model.real, b.model.device
        self.owners = [(k, world, c) for k, (body, world) in enumerate(method.bodies) for c in meeting(body)]
        self.still_first = len(method.bodies)
        self.bouncing, self.sweeps = bounces(b.scene), b.scene.iterations
        self.moves = any(c.motion.moves for c in self.colliders)
        self._shapes()
        self.filters: Any = None
        if any(b.scene.things(name) for name in ("Joint", "Group", "Parted")):
            from wsim.physics.rigid.joints.filters.groups import of_contacts
            self.filters = of_contacts(b.scene, [(method.bodies[k][0].path, of, c.path) for k, of, c in self.owners])
        real, module = self.real, b.model.module
        filtered = self.filters is not None
        self.reach, self.listed = pairs.reach(real, module, filtered), pairs.listed(real, module, filtered)
        self.keeping = rows.keeping(real, module)
        met = kinds(b.scene.things("Body"), self.colliders)
        on_meshes = frozenset(one for one, other in met if other == "mesh")
        self.pairs = frozenset(p for p in met if p[1] != "mesh")
        self.collide = collide.collide(self.pairs, real, module)
        self.on_meshes = collide_mesh.collide_mesh(on_meshes, real, module) if on_meshes else None
        self.form = forms.chosen(b.model.device, self.shapes)
        self.form.make(b.model, self.bouncing, method.joints.islands if method.joints else 0)
        if method.sleep:
            method.sleep.make(self.form)
        b.status.reserve(WORD)
        b.status.reserve(IN_TURN)
        self.parts = (Part.allocate("rigid pairs", PAIRS, 0, real, self.device, self._room()),
                      Part.allocate("rigid touches", POINTS, 0, real, self.device, 4 * self._room()))
        b.state.add(*self.parts)
        self._boxes()
        self._lists(self._room())
        self._empty(0)
        self.poses_of: tuple = ()

    def _room(self) -> int:
        return 16 + 4 * len(self.owners)

    def _shapes(self) -> None:
        method, real = self.method, self.real
        self.still_origin = np.array([c.motion.at(0.0)[:3, 3] for c in self.colliders]).reshape(-1, 3)
        owned = [(k, world, c, as_met(c, True)) for k, world, c in self.owners]
        owned += [(self.still_first + s, -1, c, as_met(c, False)) for s, c in enumerate(self.colliders)]
        rows_of = [(k, world, c, met) for k, world, c, met in owned if met is not None]
        self.named = [(method.bodies[k][0].path if k < self.still_first else c.path, world) for k, world, c, _ in rows_of]
        mine, forms_of = len(self.owners), [met for *_, met in rows_of]         # shapes of bodies come first
        centers = np.array([met.center for met in forms_of]).reshape(-1, 3)
        places = np.concatenate([places_of([method.masses[k] for k, _, _ in self.owners], [c for _, _, c in self.owners],
                                           centers[:mine]),
                                 np.hstack([centers[mine:], np.tile([0.0, 0, 0, 1], (len(forms_of) - mine, 1))])])
        self.shapes = len(rows_of)
        solid = {k: met.hull for k, met in enumerate(forms_of) if met.hull is not None}
        meshes = {k: met.mesh for k, met in enumerate(forms_of) if met.mesh is not None}
        number = {k: place for of in (solid, meshes) for place, k in enumerate(of)}
        self.hulls = surfaces.hull_tables(list(solid.values()), real, self.device)
        if meshes:
            self.surfaces, self.trees = surfaces.tables(list(meshes.values()), real, self.device)
        t = types(real)
        Shapes, self.Still, self.Contacts, self.Work = contact.structs(real)

        def array(values, dtype):
            return self.model.upload(np.array(values, np.int32 if dtype is int else self.model.dtype), dtype)
        self.table = filled(
            Shapes, frame=array([k for k, *_ in rows_of], int), world=array([w for _, w, *_ in rows_of], int),
            kind=array([KINDS[met.kind] for met in forms_of], int),
            row=array([number.get(k, 0) for k in range(len(rows_of))], int),
            size=array([met.size for met in forms_of], t.vec3), place=array(places, t.transform),
            ball=array([met.ball for met in forms_of], real), skin=array([met.skin for met in forms_of], real),
            friction=array([(c.static_friction, c.dynamic_friction) for _, _, c, _ in rows_of], t.vec2),
            restitution=array([c.restitution for _, _, c, _ in rows_of], real),
            origin=wp.array(np.concatenate([method.origin, self.still_origin]), dtype=wp.vec3d, device=self.device))

    def _lists(self, room: int) -> None:
        """Arrays for so many pairs, and those of bodies and shapes."""
        t, real, n = types(self.real), self.real, self.still_first + len(self.colliders)

        def zeros(length, dtype):
            return wp.zeros(length, dtype=dtype, device=self.device)
        self.room = room
        self.list = filled(self.Contacts, n=zeros(room, t.vec3), skin=zeros(room, t.vec2), key=zeros(4 * room, int),
                           gap=zeros(4 * room, real), push=zeros(4 * room, real), rub=zeros(4 * room, t.vec3),
                           **{name: zeros(room, int) for name in ("a", "b", "count", "colour")},
                           **{name: zeros(4 * room, t.vec3) for name in ("core_a", "core_b", "first_a", "first_b")})
        self.work = filled(self.Work, **self.seen, spread=zeros(n, t.mat33), turn=zeros(n, t.mat33), p0=zeros(n, t.vec3),
                           L0=zeros(n, t.vec3), touched=zeros(n, int), given=zeros(n, wp.float64), r_a=zeros(4 * room, t.vec3),
                           r_b=zeros(4 * room, t.vec3), now=zeros(4 * room, real), K=zeros(4 * room, t.vec3),
                           A=zeros(room, t.mat44), scrape=zeros(4 * room, t.vec3),
                           goal=zeros(4 * room, real), hit=zeros(4 * room, real), when=zeros(4 * room, real),
                           order=zeros(room, int), starts=zeros(SERIAL + 2, int), place=zeros(SERIAL + 2, int),
                           colours=zeros(1, int), flags=zeros(2, int), taken=zeros(n, wp.int64), first=zeros(n, int))
        self.work.listed = self.first[len(self.owners) - 1:]
        self.work.residual = zeros(2, real)
        for name, array in (self.method.sleep.arrays(n) if self.method.sleep else {"asleep": zeros(n, int)}).items():
            setattr(self.work, name, array)

    def _boxes(self) -> None:
        """Trees of the broad phase, and where shapes are: built anew whenever manifolds are made, of colliders if they move."""
        t, n, mine = types(self.real), self.still_first + len(self.colliders), len(self.owners)

        def zeros(length, dtype):
            return wp.zeros(length, dtype=dtype, device=self.device)
        low, high, up = (zeros(self.shapes, wp.vec3f) for _ in range(3))
        self.bvh = wp.Bvh(low[:mine], high[:mine])
        endless = np.flatnonzero(self.table.ball.numpy() < 0.0).astype(np.int32)
        self.bvh_still = wp.Bvh(low[mine:], high[mine:]) if self.shapes - mine > len(endless) else None
        more = {n: wp.array(v, dtype=int, device=self.device) for n, v in (self.filters.tables if self.filters else {}).items()}
        self.tree = filled(pairs.trees(bool(more)), **more, id=self.bvh.id, still=self.bvh_still.id if self.bvh_still else 0,
                           low=low, high=high, up=up, endless=wp.array(endless, dtype=int, device=self.device))
        self.seen = {"center": zeros(self.shapes, wp.vec3d), "span": zeros(self.shapes, t.vec2), "from_x": zeros(n, t.vec3)}
        self.number, self.first = zeros(mine, int), zeros(mine, int)

    def _empty(self, first: int) -> None:
        """No pairs from this row on, and in the snapshot; rows of the parts are those of the first body, for a restart."""
        for array in (self.parts[0].every, self.parts[0].aside):
            array[first:self.parts[0].capacity].fill_(-1)
        body, world = self.method.bodies[0]
        for part in self.parts:
            part.rows = {(body.written, world): np.arange(part.capacity)}

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads the poses of colliders at the substeps of a frame; still ones once."""
        known = (clock.substeps, tuple([id(c.motion) for c in self.colliders]))
        if self.poses_of == known and not self.moves:
            return
        self.moves = moves = any(c.motion.moves for c in self.colliders)
        if self.method.sleep and self.poses_of and self.poses_of != known:
            self.method.sleep.wake()
        rows, h, n = clock.substeps + 1 if moves else 1, clock.h, len(self.colliders)
        M = np.array([[c.motion.at(time + h * k) for c in self.colliders] for k in range(rows + moves)])
        M = M.reshape(rows + moves, n, 4, 4)
        x, q = M[:, :, :3, 3] - self.still_origin, quaternion(M[:, :, :3, :3])
        v, omega = np.zeros_like(x), np.zeros_like(x)
        if moves:
            v, omega = (x[1:] - x[:-1]) / h, angular_velocity(q[:-1], q[1:], h)
        values = (x[:rows], q[:rows], v[:rows], omega[:rows])
        if self.poses_of != known:
            t = types(self.real)
            arrays = [wp.zeros((rows, n), dtype=each, device=self.device) for each in (t.vec3, t.quat, t.vec3, t.vec3)]
            self.still = filled(self.Still, moving=int(moves), x=arrays[0], q=arrays[1], v=arrays[2], omega=arrays[3])
            self.poses_of = known
        for name, value in zip(("x", "q", "v", "omega"), values, strict=True):
            getattr(self.still, name).assign(np.ascontiguousarray(value, self.model.dtype))
        if not moves:
            self._stand(0, 0.0)

    def _stand(self, k: int, time: float) -> None:
        """Where colliders are at substep k, and how far they go within a time [s]."""
        mine = len(self.owners)
        self.model.launch(self.reach, self.shapes - mine, [self.rig(), mine, k, time], [self.tree])
        if self.bvh_still:
            self.bvh_still.rebuild()

    def advance(self, clock: Clock) -> None:
        """All substeps of a frame."""
        sleep = self.method.sleep
        if sleep and self.device.is_cpu and not (self.still.moving or sleep.stirs):
            wp.capture_if(sleep.awake, self.awake, clock=clock)
        else:
            self.awake(clock)

    def awake(self, clock: Clock) -> None:
        """A frame in which something may move."""
        if self.form.tolerance > 0.0:
            self.work.residual.zero_()
        ends = self.ends(clock)
        for first, last in zip(ends[:-1], ends[1:], strict=True):
            self.manifolds(clock, first, last)
            joints = self.method.joints
            sweeps, more = (joints.sweeps, [joints.with_contacts(self.work)]) if joints else (self.sweeps, [])
            self.form.advance((first, last, sweeps), clock.h, self.rig(), *more)
            if self.method.sleep:
                self.method.sleep.end(self.room, self.rig())
            self.keep()

    def ends(self, clock: Clock) -> list[int]:
        """Substeps before which manifolds are made, and the number of substeps."""
        times = max(1, min(clock.substeps, ceil(clock.dt * COLLIDE - 1e-6)))
        return [round(i * clock.substeps / times) for i in range(times + 1)]

    def keep(self) -> None:
        """Puts the list into the state."""
        self.model.launch(self.keeping, self.room, [self.list], [filled(rows.lasts(self.real), **self.arrays())])

    def launches(self, clock: Clock) -> int:
        times = len(self.ends(clock)) - 1
        made = 7 + bool(self.on_meshes) + 2 * self.moves + 2 * bool(self.method.sleep)
        return made * times + self.form.launches(clock.substeps, self.sweeps, times)

    def set(self, path: str, name: str, value, world: int | None) -> bool:
        return put(self, path, name, value, world)

    def arrays(self) -> dict[str, wp.array]:
        """Arrays of the state: the last list."""
        return {name: array for part in self.parts for name, array in part.arrays.items()}

    def manifolds(self, clock: Clock, first: int, last: int) -> None:
        """Manifolds of substeps first .. last, with their colours."""
        launch, rig, n = self.model.launch, self.rig(), len(self.owners)
        if self.moves:
            self._stand(first, clock.h * (last - first))
        launch(self.reach, n, [rig, 0, first, clock.h * (last - first)], [self.tree])
        self.bvh.rebuild()
        for write in (0, 1):
            launch(self.listed, n, [rig, self.tree, self.first, write], [self.number, self.status.word(WORD)])
            if not write:
                wp.utils.array_scan(self.number, self.first, True)
        before = filled(rows.lasts(self.real), **self.arrays())
        launch(self.collide, self.room, [rig, self.hulls, first, before], [])
        if self.on_meshes:
            launch(self.on_meshes, self.room, [rig, self.hulls, self.surfaces, first, before], [])
        if self.method.sleep:
            self.method.sleep.settle(first, clock.h * (last - first), rig)
        self.form.colour(rig, self.status.word(IN_TURN))

    def rig(self) -> Any:
        return filled(contact.whole(self.real), s=self.table, b=self.method.table, now=self.method.moving(), still=self.still,
                      c=self.list, work=self.work)

    def overlap(self) -> float:
        """Depth to which the points of manifolds lie in each other now, at most [m]."""
        used = np.arange(4) < self.list.count.numpy()[:, None]
        return max(0.0, -float(self.work.now.numpy().reshape(-1, 4)[used].min(initial=0.0)))

    def indicators(self) -> dict[str, float]:
        """Depth to which shapes overlap [m]; in the converged mode the residual that the last frame left, at most [m/s]; bodies
        asleep, and manifolds that found no colour, if any."""
        found = {"rigid_overlap": self.overlap()}
        if self.form.tolerance > 0.0 and self.method.touch is None:
            found["rigid_residual"] = float(self.work.residual.numpy()[1])
        if self.method.sleep:
            found["rigid_asleep"] = float(self.method.part.arrays["asleep"].numpy().sum())
        return found | ({"rigid_in_turn": float(self.in_turn)} if self.in_turn else {})

    def notes(self) -> list[tuple[tuple, float, str]]:
        """Warnings of the converged mode: a frame that ended over its residual."""
        left = float(self.work.residual.numpy()[1]) if self.form.tolerance > 0.0 and self.method.touch is None else 0.0
        said = f"contacts of bodies were left with a residual of {{worst}} m/s; contact_tolerance is {self.form.tolerance:g}"
        return [(("rigid residual",), left, said)] if left > self.form.tolerance else []

    def grow(self, room: int) -> None:
        """Room for so many pairs; what the state has of them stays."""
        before = self.parts[0].capacity
        self.parts[0].enlarge(room, self.real, self.device)
        self.parts[1].enlarge(4 * room, self.real, self.device)
        self._lists(room)
        self._empty(before)

    @property
    def in_turn(self) -> int:
        """Manifolds that found no colour in the last frame: they are solved, but in turn."""
        return int(self.status.said(IN_TURN)[0])

    def retry(self, status: Status) -> list[Remedy]:
        wanted = int(status.said(WORD)[0])

        def more() -> str:
            self.grow(wanted + wanted // 4)
            return f"{wanted} pairs of rigid shapes were near each other, more than there was room for"
        return [Remedy("grow", more)] if wanted > self.room else []
