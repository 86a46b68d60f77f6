"""Contacts of points with colliders on a device: tables, launches, growth, indicators. Equations: kernels/contact/search.py,
kernels/contact/project.py.

    contacts = Contacts(bodies, device=..., real=wp.float32, substeps=10, dt=1 / 24)
    before each frame     contacts.prepare(t)                    t [s] at the frame's start: poses of what moves
    after predict         contacts.search(k, x, d, a)            launches; may be captured
    in each iteration     contacts.project(g, d, a)              after all other constraints
    BDF2 only             contacts.settle(g, e, d, a, v)         after the last iteration; needs `struck`
    after the frame       contacts.wanted: 0, or the room that a point lacked: contacts.grow(), repeat the frame
                          contacts.indicators(x), contacts.impulses(g)

Nothing here outlives a frame but `mark` (whether a point touched or was inside), a field of the state. Colliders
push and are not pushed; `impulses` says what they received.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.contact import project as kernels
from wsim.kernels.contact import search
from wsim.kernels.contact.collide import collider_kind_code
from wsim.kernels.contact.collider import shape
from wsim.kernels.math.real import types
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.mesh import ColliderMesh, deforming_mesh_kernels
from wsim.physics.contact.collider.rows import fill_collider_table
from wsim.physics.contact.colliders import ColliderRowTable, check_collider_values
from wsim.physics.contact.poses import ColliderPoses
from wsim.scene import Collider, Motion, Problem, Scene, SceneError, Surface, solids
from wsim.scene.values.table import FRICTION

SKIN = 2e-3            # [m] least margin of the search: what constraints may move a point that predicts no motion
RECOVERY = 0.5         # [m/s] at which points leave an overlap: 10 cm in 0.2 s; faster tears at the cloth around them
MANY = 64              # balls of an object; a CPU core, 1024 points, ms a frame: 2.3 without a tree, 1.4 with; even at 24 balls


@dataclass
class CollidablePoints:
    """Points of objects that may touch something. Device arrays are shared, NumPy arrays are uploaded."""

    colliders: list[list[Collider]]      # of each object
    origins: np.ndarray                  # [m], (objects, 3) float64
    object: object                       # object of each point, (points,) int
    w: object                            # inverse mass [1/kg], (points,)
    reach: object                        # distance kept by each point [m], (points,)
    friction: object                     # static, dynamic, (points, 2)
    faces: np.ndarray                    # points of triangles, of springs (i, j, j), (t, 3): what `indicators` measures
    breadth: np.ndarray                  # of each object's faces [m], (objects,), see `wsim.scene.check.chord`
    thin: np.ndarray                     # least `reach` of each object's points [m], (objects,)
    whole: np.ndarray | None = None  # whether all of its triangles meet meshes (`wsim.physics.contact.selfcontact`), (objects,)
    edged: np.ndarray | None = None      # whether its edges meet sharp colliders, (objects,)


class ColliderContacts:
    """See the head of this file. Raises SceneError for a collider that makes no sense."""

    def __init__(self, bodies: CollidablePoints, *, device, real, module="unique", substeps: int, dt: float,
                 struck: wp.array | None = None, turned: bool = False):
        """turned: joints that move meshes may be set. struck: (points,) real, becomes not 0 where a point
        leaves an overlap: its step is no motion, and a multistep integrator forgets it."""
        self.device, self.real, self.types = wp.get_device(device), real, types(real)
        self.launch: Callable = partial(wp.launch, device=self.device)    # (kernel, dim, inputs, outputs)
        self.launch_blocks: Any = None                     # (kernel, blocks, threads, inputs, outputs), of a model on CUDA
        self.zero: Callable = wp.array.zero_
        self.cleared = False                             # `wsim.physics.contact.broad.skip_far_meshes`
        self.search_kernel: Any = None                   # see `make_search_kernel`
        self.adjoint: Any = None                         # `wsim.physics.contact.contacts_adjoint.ContactAdjoint`
        self.edges: Any = None                           # `wsim.physics.cloth.edge_contacts.EdgeContacts`
        self.spins: tuple = ()                           # table of balls that turn (wsim/physics/position_based/rolling.py)
        self.dtype = np.float32 if real is wp.float32 else np.float64
        surfaces = {id(c.shape): c for group in bodies.colliders for c in group if isinstance(c.shape, Surface)}
        self.meshes = {key: ColliderMesh.build(c, turned) for key, c in surfaces.items()}
        self.rows = ColliderRowTable.build(bodies.colliders, bodies.origins, self.meshes, not turned)
        self.kinds = _ordered_shape_kinds(self.rows.kind)
        self.gap, self.friction = self.rows.live(bodies.breadth, bodies.thin, bodies.whole, self.rows.sharp(bodies.edged))
        self.owner = np.full(len(self.rows.collider), -1)     # rigid body of each row
        self.restitution = np.array([self.rows.colliders[k].restitution for k in self.rows.collider], np.float64)
        self.wanted = wp.zeros(1, dtype=int, device=self.device)
        self.substeps, self.dt = 0, dt
        self.time: float | None = None
        self.struck, self.changed, self.redrawn = struck, True, True    # what poses, what outlines of frames are made of
        self.owed = self.tied = False                    # poses of a frame that has asked for none so far; bodies hold points
        self.table = kernels.contact_tables(real)[0]()
        self.tree: Any = None                            # `wsim.physics.contact.broad.ColliderTree`
        if self.rows.balls >= MANY:
            from wsim.physics.contact.broad import ColliderTree
            self.tree = ColliderTree(self.rows, self.table, self.device, real, module)
        self.poses = ColliderPoses(self.rows, self.table, self.device, real)
        self._load(module, struck is not None)
        self._points(bodies)
        self._frame(substeps, dt)
        self.make_slots(min(2, max(self.rows.most, 1)))

    # tables

    def _load(self, module, multistep: bool) -> None:
        self.module = module
        self.project_kernel = kernels.contact_projection_kernel(self.real, module)
        self.settle_kernel = kernels.contact_velocity_kernel(self.real, module) if multistep else None
        self.pose_kernel, self.refit_kernel = deforming_mesh_kernels(self.meshes.values(), module, self.device.is_cpu)

    def make_search_kernel(self, listed: bool = False) -> None:
        """Makes the kernel of the search, which reads lists of faces (`wsim.physics.contact.broad.use_face_lists`) or none."""
        self.search_kernel = search.contact_search_kernel(self.kinds, self.real, self.module, self.tree is not None, listed,
                                                          self.cleared)

    def _array(self, given, dtype) -> wp.array:
        return given if isinstance(given, wp.array) else wp.array(np.ascontiguousarray(given), dtype=dtype, device=self.device)

    def _points(self, bodies: CollidablePoints) -> None:
        t, p = self.types, kernels.contact_tables(self.real)[1]()
        self.points, p.object, p.w = p, self._array(bodies.object, int), self._array(bodies.w, t.scalar)
        p.reach, p.friction = self._array(bodies.reach, t.scalar), self._array(bodies.friction, t.vec2)
        self.count, self.faces = len(p.object), self._array(bodies.faces, int)
        self.mark = wp.zeros(self.count, dtype=int, device=self.device)
        self.table.deep, self.deep = wp.ones(1, dtype=int, device=self.device), True
        self.table.chord = wp.zeros(len(self.rows.collider), dtype=t.scalar, device=self.device)
        self.table.skin, self.table.recovery = SKIN, RECOVERY

    def smooth(self, scene: Scene, explicit: bool) -> None:
        """Puts a potential of the scene's `contact_width` in front of contacts, where that is > 0. Raises SceneError where an
        open mesh keeps less than that."""
        if scene.contact_width > 0.0:
            from wsim.physics.contact.barrier import contact_energy_scale
            c, reach = self.table, float(self.points.reach.numpy().min(initial=np.inf))
            for gap, number in zip(self.gap, self.rows.collider, strict=True):
                if self.rows.kind[number] == "sheet" and gap + reach < 2.0 * scene.contact_width:
                    raise SceneError(Problem(self.rows.colliders[number].path, f"is an open mesh and keeps {gap + reach:g} m, "
                                             f"contact_width is {scene.contact_width:g} m; allowed is up to half of what it "
                                             "keeps: give it a larger wsim:thickness, or a smaller wsim:contactWidth"))
            c.width, c.energy, c.lead, c.skin = (scene.contact_width, contact_energy_scale(scene), int(explicit),
                                                 SKIN + scene.contact_width)

    def _frame(self, substeps: int, dt: float) -> None:
        """Everything that depends on rows or on the number of substeps."""
        self.substeps, self.dt = substeps, dt
        for mesh in self.meshes.values():
            mesh.place(self.device, substeps)
        self._constants()
        self.poses.frame(substeps)
        self.table.h = dt / substeps
        self.changed = self.redrawn = True

    def _constants(self) -> None:
        rows, of = self.rows, self.rows.collider
        mesh = np.array([0 if m is None else m.id for m in rows.meshes], np.uint64)
        self.table.first = self._array(rows.first, int)
        self.table.of = fill_collider_table(self.real, self.device, [rows.kind[k] for k in of], size=rows.size[of],
                                            mesh=mesh[of], thick=self.gap, friction=self.friction, owner=self.owner,
                                            restitution=self.restitution)

    def make_slots(self, capacity: int) -> None:
        t, n = self.types, self.count
        s = self.slots = kernels.slot_type(self.real)()
        s.points, s.capacity = n, capacity
        s.mark, s.count, s.wanted = self.mark, wp.zeros(n, dtype=int, device=self.device), self.wanted

        def zeros(dtype):
            return wp.zeros(n * capacity, dtype=dtype, device=self.device)
        s.row, s.n, s.b, s.u, self.push = zeros(int), zeros(t.vec3), zeros(t.scalar), zeros(t.vec3), zeros(t.vec3)
        none = wp.zeros(0, dtype=int, device=self.device)
        s.site, s.tie = zeros(int) if self.edges else none, zeros(int) if self.tied else none

    def tell(self, wanted: wp.array) -> None:
        """Takes the word (first entry of an int array) for the room that a point wants."""
        self.wanted = self.slots.wanted = wanted

    # frames

    def prepare(self, time: float, *, substeps: int | None = None, deep: bool | None = None, free: bool = False) -> None:
        """Prepares the frame that starts at `time` [s]: colliders at its substeps, in float64.

        deep: points may start inside of closed meshes; None: yes at first and after a jump in time. free: the frame has no
        contacts, and poses are worked out when something asks for them, see `place`."""
        again, before = time == self.time, self.time
        if deep is None:
            deep = self.deep if again else not (before is not None and before < time < before + 1.5 * self.dt)
        if deep or self.deep:                            # `search` may have put it back
            self.table.deep.fill_(int(deep))
        self.deep, self.time = deep, time
        if substeps is not None and substeps != self.substeps:
            self._frame(substeps, self.dt)
        self.owed = self.changed or self.rows.moves
        if not free:
            self.place()

    def place(self) -> None:
        """Places colliders at the substeps of the frame prepared last, where that is not done."""
        if self.owed and self.time is not None:
            self.poses.place(self.time, self.dt, self.gap, self.changed)
            if self.tree:
                self.tree.build(self.launch)
            self.changed = self.owed = False

    def move(self, path: str, motion: Motion) -> bool:
        """Gives the collider of that path another motion, from the next frame on. False: there is none."""
        for collider in (found := [c for c in self.rows.colliders if c.path == path]):
            check_collider_values(replace(collider, motion=motion))
            collider.motion = motion
            self.changed = self.redrawn = True
        return bool(found)

    def set_value(self, path: str, name: str, value: float, objects: list[int]) -> list[int]:
        """Gives the collider of that path a friction or thickness among these objects, and returns its rows."""
        rows = self.rows.of(path, objects)
        if not rows:
            return rows
        for number in {int(self.rows.collider[r]) for r in rows}:
            check_collider_values(replace(self.rows.colliders[number], **{name: value}))  # type: ignore[arg-type]
        for r in rows if name == "thickness" else ():
            mesh = self.rows.meshes[self.rows.collider[r]]
            self.gap[r] = max(value, mesh.least_gap if mesh else 0.0)
            self.changed = self.redrawn = True
        if name == "thickness" and self.edges:
            self.edges.keep()
        if name in FRICTION:
            self.friction[rows, FRICTION.index(name)] = value
        self.table.of.thick.assign(self.gap.astype(self.dtype))
        self.table.of.friction.assign(self.friction.astype(self.dtype))
        return rows

    def shape(self, k: int, loop=None) -> None:
        """Launches the shapes of meshes at the end of substep k, and the tree of that substep. loop: as `search`."""
        for mesh in self.meshes.values():
            if mesh.moves:
                mesh.launch(self, k, loop)
        if self.tree:
            self.tree.fit(self.launch, k)

    def search(self, k: int, x: wp.array, d: wp.array, a: wp.array, loop=None) -> None:
        """Launches the search of substep k; writes d and a where points leave an overlap. loop: as `Clock.loop`."""
        self.adjoint.shaped(k) if self.recorded else self.shape(k, loop)
        if k == 1 and self.adjoint is None and "solid" in self.kinds:
            self.zero(self.table.deep)                   # what started inside is marked, and looked for as deep as before
        if k == 0 and self.cleared:
            self.zero(self.points.radius)                # distances of a frame before
        if self.search_kernel is None:
            self.make_search_kernel()
        at = self.read(x=x, d=d, a=a, **({"k": 0, "now": loop.number} if loop else {"k": k}))
        self.launch(self.search_kernel, self.count, [self.table, self.points, at], [self.slots, d, a, self.push, self.struck])
        if self.edges:
            self.edges.search(at, d, a)

    def read(self, **arrays):
        return fill_struct(kernels.read_type(self.real), **arrays)

    def project(self, g: float, d: wp.array, a: wp.array) -> None:
        """Launches one iteration; g [s] is the integrator's effective step, v = (d - a) / g."""
        at = self.read(d=d, a=a, push=self.push)
        self.launch(self.project_kernel, self.count, [self.table, self.points, self.slots, at, g, *self.spins], [d, self.push])

    @property
    def recorded(self) -> bool:
        """True if a tape records."""
        return self.adjoint is not None and self.adjoint.model.tape is not None

    def settle(self, g: float, e: wp.array, d: wp.array, a: wp.array, v: wp.array, push: wp.array | None = None) -> None:
        """Settles the last iteration of a multistep integrator: a, v of points in contact forget what was. push: or of some."""
        at = self.read(v=v, e=e, d=d, a=a, push=self.push if push is None else push)
        self.launch(self.settle_kernel, self.count, [self.table, self.slots, at, g], [a, v])

    def grow(self, wanted: int | None = None) -> bool:
        """Makes room for as many contacts of a point as were wanted; False where nothing was lacking."""
        wanted = int(self.wanted.numpy()[0]) if wanted is None else wanted
        if wanted <= self.slots.capacity:
            return False
        self.make_slots(wanted)
        self.wanted.zero_()
        return True

    def indicators(self, x: wp.array) -> dict[str, float]:
        """penetration: greatest depth of a point, a triangle or a spring in a solid [m], see kernels/contact/penetration.py and
        depth.py; too_near: of a point inside the distance kept [m]; contacts: points in contact. Where the last frame ends."""
        if self.owed:
            self.place()
            self.shape(self.substeps - 1)
        from wsim.physics.contact import depth
        return depth.penetration_indicators(self, x)

    def impulses(self, g: float) -> dict[str, np.ndarray]:
        """Impulse [N s], (3,), that each collider received in the last substep, by path, in float64."""
        count, n = self.slots.count.numpy(), self.count
        row = self.slots.row.numpy().reshape(-1, n)
        w, push = (a.numpy().astype(np.float64) for a in (self.points.w, self.push))
        slot, point = np.nonzero(np.arange(len(row))[:, None] < count)
        given = push.reshape(-1, n, 3)[slot, point] / (np.where(w > 0.0, w, np.inf)[point, None] * g)    # ties: of bodies
        number = self.rows.collider[row[slot, point]]
        np.subtract.at(total := np.zeros((len(self.rows.colliders), 3)), number, given)
        return {c.path: total[i] for i, c in enumerate(self.rows.colliders)}


def _ordered_shape_kinds(found: list[str]) -> tuple[str, ...]:
    """Those that there are, in the order of their numbers. Formulas of shapes that have a place of their own are made known."""
    shape.make_known(solids.SOLIDS, found)
    return tuple(sorted(set(found), key=collider_kind_code))
