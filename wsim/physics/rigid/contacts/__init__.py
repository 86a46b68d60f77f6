"""Contacts of rigid bodies with each other and with colliders: tables of shapes, lists that grow, and the launches of a frame.

Pairs that may meet are listed LISTED times a second, and when a body goes farther than the list allows for. In every substep,
manifolds that their bodies' motion has made stale are made again (kernels/rigid/lists), and passes over bodies and manifolds
follow (kernels/rigid/passes.py), in the form of wsim/physics/rigid/forms.py. Impulses at the start of a substep are state.
Friction is the mean of both colliders, restitution the larger.
"""

from math import ceil
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.rotation import angular_velocity_between, matrix_quat
from wsim.kernels.math.real import types
from wsim.kernels.rigid import contact
from wsim.kernels.rigid.kinds import SERIAL
from wsim.kernels.rigid.lists import collide, collide_mesh, flush, rows
from wsim.kernels.rigid.narrow.shape import KINDS
from wsim.model.stage import Clock, Remedy
from wsim.model.state import StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.model.structs import fill_struct
from wsim.physics.rigid import forms, meetings, surfaces
from wsim.physics.rigid.contacts.pair_list import PairList, manifold_table
from wsim.physics.rigid.solids import body_contact_parts, contact_shape_of, fall_accelerations, scene_contact_colliders
from wsim.scene import Collider, Sphere

LISTED = 60.0                # [1/s]: seldom enough for a pile at rest, often enough that few pairs are listed which never meet
FEW = 256                    # pairs that there is room for at first, if so many shapes there are may meet
WORD, IN_TURN = "rigid pairs", "rigid manifolds without a colour"
PAIRS = (StateField("a", "", True, "shape of a manifold, -1 for none", "int"), StateField("b", "", True, "the other", "int"),
         StateField("count", "", True, "its points", "int"), StateField("colour", "", True, "its colour, -1 for none", "int"))
POINTS = (StateField("push", "N s", True, "impulse of a point in the last substep", "scalar"),
          StateField("rub", "N s", True, "that of friction"),
          StateField("drift", "m", True, "how far it has parted across n since friction held it"),
          StateField("key", "", True, "features that touch", "int"))


class RigidContactTables:
    """bodies: (Body, world) of each row of the method's part."""

    def __init__(self, b, method):
        self.model, self.status, self.method = b.model, b.status, method
        self.colliders, self.real, self.device = scene_contact_colliders(b.scene.colliders), b.model.real, b.model.device
        parts = {id(body): body_contact_parts(body) for body in b.scene.things("Body")}
        self.owners = [(k, world, c) for k, (body, world) in enumerate(method.bodies) for c in parts[id(body)]]
        if not self.owners:                       # strands alone hold them: tables need a row, which meets nothing
            self.owners, self.colliders = [(0, 0, Collider("", Sphere(1e-3)))], []
        self.still_first, self.frames = len(method.bodies), len(method.bodies) + len(self.colliders)
        self.bouncing, self.sweeps = meetings.has_restitution(b.scene), b.scene.iterations
        self.moves = any(c.motion.moves for c in self.colliders)
        self._upload_shape_table()
        self.filters: Any = None
        if any(b.scene.things(name) for name in ("Joint", "Group", "FilteredPairs")):
            from wsim.physics.rigid.joints.filters.groups import contact_filters
            self.filters = contact_filters(b.scene, [(method.bodies[k][0].path, of, c.path) for k, of, c in self.owners])
        real, module, shared = self.real, b.model.module, b.model.shared_module
        self.keeping = rows.list_memory_kernel(real, module)
        met = meetings.meeting_shape_kinds(b.scene.things("Body"), self.colliders)
        on_meshes = frozenset(one for one, other in met if other == "mesh")
        self.pairs = frozenset(p for p in met if p[1] != "mesh")
        pairs, tiles = self.pairs | meetings.ball_core_pairs(self.pairs), meetings.flush_collider_kinds(b.scene)
        self.collide = collide.pair_manifold_kernel(pairs, real, shared("rigid_pairs", *sorted(pairs)))
        self.lanes = lanes = 32 if self.device.is_cuda else 1                         # threads of a pair with a mesh
        own = shared("rigid_meshes", *sorted(on_meshes), lanes, *["of bodies"] * self.mesh_bodies) if on_meshes else None
        self.on_meshes = own and collide_mesh.collide_mesh(on_meshes, real, own, lanes, self.mesh_bodies)
        self.flush = flush.flush_seam_kernels(tiles - {"mesh"}, real, shared("rigid_seams", *sorted(tiles))) if tiles else []
        form = method.joints.contact_form(self) if method.joints else None
        self.form: forms.ContactPassForm = form or forms.choose_pass_form(b.model.device, self.shapes)
        self.form.make(b.model, self.bouncing, method.joints.islands if method.joints else 0)
        if method.sleep:
            method.sleep.make(self.form.sleep_form())
        b.status.reserve(WORD)
        b.status.reserve(IN_TURN)
        self.parts = (StatePart.allocate("rigid pairs", PAIRS, 0, real, self.device, self._pair_room()),
                      StatePart.allocate("rigid touches", POINTS, 0, real, self.device, 4 * self._pair_room()))
        b.state.add(*self.parts)
        self.broad, self.poses_of = PairList(self, module), ()      # type: PairList, tuple
        self._make_lists(self._pair_room())
        self._clear_pair_rows(0)

    def _pair_room(self) -> int:
        return max(16 + 4 * (n := len(self.owners)), min(FEW, n * (n - 1) // 2 + n * len(self.colliders)))

    def _upload_shape_table(self) -> None:
        method, real = self.method, self.real
        self.still_origin = np.array([c.motion.at(0.0)[:3, 3] for c in self.colliders]).reshape(-1, 3)
        owned = list(zip(*zip(*self.owners, strict=True), meetings.body_contact_shapes(self.owners), strict=True))
        owned += [(self.still_first + s, -1, c, contact_shape_of(c, False)) for s, c in enumerate(self.colliders)]
        rows_of = [(k, world, c, met) for k, world, c, met in owned if met is not None]
        self.named = [(method.bodies[k][0].path if k < self.still_first else c.path, world) for k, world, c, _ in rows_of]
        mine, (self.shape_colliders, forms_of) = len(self.owners), zip(*[row[2:] for row in rows_of], strict=True)
        centers = np.array([met.center for met in forms_of]).reshape(-1, 3)
        cores, sizes, balls, skins = meetings.contact_shape_figures(list(forms_of))
        places = np.concatenate([meetings.collider_places_in_body([method.masses[k] for k, _, _ in self.owners],
                                                         [c for _, _, c in self.owners], centers[:mine]),
                                 np.hstack([centers[mine:], np.tile([0.0, 0, 0, 1], (len(forms_of) - mine, 1))])])
        self.shapes, with_worlds = len(rows_of), rows_of + rows_of[mine:] * (self.model.worlds - 1)
        solid = {k: met.hull for k, met in enumerate(forms_of) if met.hull is not None}
        meshes = {k: met.mesh for k, met in enumerate(forms_of) if met.mesh is not None}
        self.mesh_bodies, (copies, own) = any(k < mine for k in meshes), surfaces.equal_meshes(list(meshes.values()))
        number = dict(zip([*solid, *meshes], [*range(len(solid)), *copies], strict=True))
        self.hulls = surfaces.hull_tables(list(solid.values()), real, self.device)
        if meshes:
            self.surfaces, self.trees = surfaces.mesh_surface_tables(own, real, self.device, self.mesh_bodies)
        t = types(real)
        Shapes, self.Still, self.Contacts, self.Work = contact.rigid_contact_structs(real)

        def array(values, dtype):
            return self.model.upload(np.array(values, np.int32 if dtype is int else self.model.dtype), dtype)
        self.table = fill_struct(
            Shapes, frame=array([k for k, *_ in rows_of], int), world=array([w for _, w, *_ in rows_of], int),
            kind=array([KINDS[met.kind] for met in forms_of], int), core=array(cores, t.vec4),
            row=array([number.get(k, 0) for k in range(len(rows_of))], int),
            size=array(sizes, t.vec3), place=array(places, t.transform), ball=array(balls, real), skin=array(skins, real),
            friction=array([(c.static_friction, c.dynamic_friction) for _, _, c, _ in with_worlds], t.vec2),
            restitution=array([c.restitution for *_, c, _ in with_worlds], real), still=mine,
            origin=wp.array(np.concatenate([method.origin, self.still_origin]), dtype=wp.vec3d, device=self.device))

    def _make_lists(self, room: int) -> None:
        """Arrays for so many pairs, and those of bodies and shapes."""
        t, real, n, method, joints = types(self.real), self.real, self.frames, self.method, self.method.joints

        def zeros(length, dtype):
            return wp.zeros(length, dtype=dtype, device=self.device)
        self.room = room
        self.list = self.aside = manifold_table(self.Contacts, room, real, self.device)
        if self.model.worlds > 1:
            self.aside = manifold_table(self.Contacts, room, real, self.device)
        self.work = fill_struct(self.Work, **self.broad.arrays, spread=zeros(n, t.mat33), turn=zeros(n, t.mat33),
                                **{name: zeros(4 * room, t.vec3) for name in ("r_a", "r_b", "K", "scrape")},
                                **{name: zeros(4 * room, real) for name in ("now", "goal", "hit", "when")},
                                p0=zeros(n, t.vec3), L0=zeros(n, t.vec3), touched=zeros(n, int), first=zeros(n, int),
                                **{name: zeros(room, int) for name in ("renewed", "order")},
                                **{name: zeros(SERIAL + 2, int) for name in ("starts", "place")},
                                A=zeros(room, t.mat44), given=zeros(n, wp.float64), taken=zeros(n, wp.int64),
                                node=self.model.upload((joints.colour_nodes if joints else np.int32)(np.arange(n)), int),
                                **(joints.contact_arrays(room) if joints else {}),
                                colours=zeros(1, int), flags=zeros(2 + 2 * self.model.worlds, int), residual=zeros(2, real),
                                g=self.model.upload(fall_accelerations(method.gravity), real))
        for name, array in (self.method.sleep.arrays(n) if self.method.sleep else {"asleep": zeros(n, int)}).items():
            setattr(self.work, name, array)

    def _clear_pair_rows(self, first: int) -> None:
        """No pairs from this row on, and in the snapshot; rows of the parts are those of the first body, for a restart."""
        for array in (self.parts[0].every, self.parts[0].aside):
            array[first:self.parts[0].capacity].fill_(-1)
        body, world = self.method.bodies[0]
        for part in self.parts:
            part.rows, part.common = {(body.written, world): np.arange(part.capacity)}, True

    def before_frame(self, time: float, clock: Clock) -> None:
        """Uploads the poses of colliders at the substeps of a frame; still ones once."""
        known = (clock.substeps, tuple([id(c.motion) for c in self.colliders]))
        if self.poses_of == known and not self.moves:
            return
        self.method.evaluates["poses"] = [c.path for c in self.colliders if c.motion.moves]
        self.moves = moves = bool(self.method.evaluates["poses"])
        if self.method.sleep and self.poses_of and self.poses_of != known:
            self.method.sleep.wake_bodies()
        rows, h, n = clock.substeps + 1 if moves else 1, clock.h, len(self.colliders)
        M = np.array([c.motion.sampled(time + h * np.arange(rows + moves)) for c in self.colliders])
        M = M.reshape(n, rows + moves, 4, 4).swapaxes(0, 1)
        x, q = M[:, :, :3, 3] - self.still_origin, matrix_quat(M[:, :, :3, :3])
        v, omega = np.zeros_like(x), np.zeros_like(x)
        if moves:
            v, omega = (x[1:] - x[:-1]) / h, angular_velocity_between(q[:-1], q[1:], h)
        if self.poses_of != known:
            t = types(self.real)
            arrays = [wp.zeros((rows, n), dtype=each, device=self.device) for each in (t.vec3, t.quat, t.vec3, t.vec3)]
            self.still = fill_struct(self.Still, moving=int(moves), x=arrays[0], q=arrays[1], v=arrays[2], omega=arrays[3])
            self.poses_of = known
        for name, value in zip(("x", "q", "v", "omega"), (x[:rows], q[:rows], v[:rows], omega[:rows]), strict=True):
            getattr(self.still, name).assign(np.ascontiguousarray(value, self.model.dtype))
        if not moves:
            self.broad.place_colliders(0, 0.0)

    def advance(self, clock: Clock) -> None:
        if (sleep := self.method.sleep) and self.device.is_cpu and not (self.still.moving or sleep.stirs):
            wp.capture_if(sleep.awake, self.awake, clock=clock)
        else:
            self.awake(clock)

    def awake(self, clock: Clock) -> None:
        if self.form.tolerance > 0.0:
            self.work.residual.zero_()
        for k in range(clock.substeps):
            self.renew(clock, k)
            joints = self.method.joints
            sweeps, more = (joints.sweeps, [joints.with_contacts(self.work)]) if joints else (self.sweeps, [])
            self.form.advance((k, k + 1, sweeps), clock.h, self.rig(), *more)
        self.keep()

    def ends(self, clock: Clock) -> list[int]:
        """Substeps before which pairs are listed, and the number of substeps."""
        times = clock.substeps if self.exact else max(1, min(clock.substeps, ceil(clock.dt * LISTED - 1e-6)))
        return [round(i * clock.substeps / times) for i in range(times + 1)]

    @property
    def exact(self) -> bool:
        """The converged mode: all manifolds are made in every substep, for the poses where it begins."""
        return self.form.tolerance > 0.0

    def keep(self) -> None:
        """Puts the list into the state, of all bodies, also of those asleep."""
        if self.method.sleep:
            self.method.sleep.end(self.room, self.rig())
        self.model.launch(self.keeping, self.room, [self.list], [fill_struct(rows.last_list_type(self.real), **self.arrays())])

    def launches(self, clock: Clock) -> int:
        times = len(self.ends(clock)) - 1
        slept = bool(self.method.sleep)
        listed, each = 7 + 2 * (self.moves + slept), 1 + bool(self.on_meshes) + len(self.flush) + slept
        return listed * times + each * clock.substeps + self.form.launches(clock.substeps, self.sweeps)

    def set_value(self, path: str, name: str, value, world: int | None) -> bool:
        return meetings.set_surface_value(self, path, name, value, world)

    def arrays(self) -> dict[str, wp.array]:
        """Arrays of the state: the last list."""
        return {name: array for part in self.parts for name, array in part.arrays.items()}

    def renew(self, clock: Clock, k: int) -> None:
        """Manifolds of substep k, with their colours: those that are stale, all where pairs are listed."""
        rig, ends, sleep = self.rig(), self.ends(clock), self.method.sleep
        listing = k in ends[:-1]                     # else where a body has gone farther than was foreseen
        i = max(i for i, end in enumerate(ends[:-1]) if end <= k)
        time = clock.h * (ends[i + 1] - ends[i])     # of colliders the same in a list made anew, which worlds share
        before, h = fill_struct(rows.last_list_type(self.real), **self.arrays()), 0.0 if self.exact else clock.h
        made = k, h, before, self.aside
        if listing:
            if k > 0:
                self.keep()
            self.broad.list_near_pairs(k, time, self.status.word(WORD))
        else:
            wp.capture_if(self.broad.stray, self.list_anew, k=k, time=time)
        self.make_manifolds(*made)
        if sleep and listing:
            sleep.settle(k, time, rig)
        elif sleep:
            sleep.wake_met(self, time, made)
        self.form.colour(rig, self.status.word(IN_TURN))

    def make_manifolds(self, k: int, *more) -> None:
        """Manifolds of substep k: those that are stale, all of a list made anew."""
        launch, rig = self.model.launch, self.rig()
        launch(self.collide, self.room, [rig, self.hulls, k, *more], [])
        if self.on_meshes:
            launch(self.on_meshes, self.room * self.lanes, [rig, self.hulls, self.surfaces, k, *more], [])
        for kernel in self.flush:
            launch(kernel, self.room, [rig, self.hulls, k] if kernel is self.flush[0] else [rig], [])

    def list_anew(self, k: int, time: float) -> None:
        """Lists pairs within a frame, after a body has gone farther than was foreseen."""
        self.keep()
        self.broad.list_near_pairs(k, time, self.status.word(WORD), anew=False)

    def rig(self) -> Any:
        return fill_struct(contact.rig_type(self.real), s=self.table, b=self.method.table, now=self.method.moving(),
                           still=self.still, c=self.list, work=self.work)

    def indicators(self) -> dict[str, float]:
        """Depth to which shapes overlap [m]; in the converged mode the residual that the last frame left, at most [m/s]; bodies
        asleep, and manifolds that found no colour, if any."""
        from wsim.physics.rigid.contacts.measure import contact_overlap
        found = {"rigid_overlap": contact_overlap(self)}
        if self.form.tolerance > 0.0 and self.method.touch is None:
            found["rigid_residual"] = float(self.work.residual.numpy()[1])
        if self.method.sleep:
            found["rigid_asleep"] = float(self.method.part.arrays["asleep"].numpy().sum())
        return found | ({"rigid_in_turn": float(self.in_turn)} if self.in_turn else {})

    def frame_warnings(self) -> list[tuple[tuple, float, str]]:
        """Warnings of the converged mode: a frame that ended over its residual."""
        left = float(self.work.residual.numpy()[1]) if self.form.tolerance > 0.0 and self.method.touch is None else 0.0
        said = f"contacts of bodies were left with a residual of {{worst}} m/s; contact_tolerance is {self.form.tolerance:g}"
        return [(("rigid residual",), left, said)] if left > self.form.tolerance else []

    def grow(self, room: int) -> None:
        """Room for so many pairs; what the state has of them stays."""
        before = self.parts[0].capacity
        self.parts[0].enlarge_part(room, self.real, self.device)
        self.parts[1].enlarge_part(4 * room, self.real, self.device)
        self._make_lists(room)
        self._clear_pair_rows(before)

    @property
    def in_turn(self) -> int:
        """Manifolds without a colour in the last frame, solved in turn."""
        return int(self.status.said(IN_TURN)[0])

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        wanted = int(status.said(WORD)[0])

        def grow_pair_list() -> str:
            self.grow(wanted + wanted // 4)
            return f"{wanted} pairs of rigid shapes were near each other, more than there was room for"
        return [Remedy("grow", grow_pair_list)] if wanted > self.room else []
