"""Contacts in a plan: a search in phase collide, a projection at the end of every iteration."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.model.stage import MET, Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import SimulationState, StateField
from wsim.model.vjp import beside
from wsim.physics.contact.contacts import CollidablePoints, ColliderContacts
from wsim.scene import Motion, Problem, SceneError
from wsim.scene.check import chord, sharp
from wsim.scene.nodal.touching import collides_with_surfaces
from wsim.scene.values.table import FRICTION

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.model.status import FrameStatus
    from wsim.simulation.methods import Build

LISTS = 2048           # triangles of meshes up to which a GPU lists the faces near points: H200, us a search with lists and
                       # without: worn_shirt (1280) 44 and 56, bone_cape (1280) 78 and 131, caped_man (4672) 54 and 36
CLEARED = 16           # substeps of a frame from which points pass over meshes that they are known to be far from
ROOM = "contacts wanted by a point"       # status word, where there was not room for as many
FACES = "faces near a point"              # status word, of a mesh collider, where lists have not room for as many


def contact_triangles(body) -> np.ndarray:
    """Places of the corners of a body's triangles, (t, 3); a spring is a triangle (i, j, j)."""
    return (body.triangles if len(body.triangles) else body.edges[:, [0, 1, 1]]).astype(np.int32)


def build(b: Build) -> ContactMethod:
    """Raises SceneError where a smoothed contact is wanted of Newton's method, and gradients of what has none."""
    movers = b.ports.moving_bodies
    if b.scene.contact_width > 0.0 and movers is None and b.choice.solver == "implicit":
        raise SceneError(Problem("/", f"contact_width is {b.scene.contact_width:g} m, and Newton's method has hard contacts; "
                                 "set it to 0, or wsim:solver = explicit or xpbd"))
    if b.model.gradients and b.clock.integrator.beyond:
        from wsim.scene.values.coverage import gradient_refusal
        raise gradient_refusal("ends", b.scene.colliders[0].path, integrator=b.clock.integrator.name)
    contact = ContactMethod(b.model, b.state, b.ports.points, b.status, b.clock, movers, b.edges)
    if "contact" in (b.ports.fused_effects or ()):
        contact.stages.clear()  # explicit steps know contacts themselves, see kernels/motion/fused/contact.py
    if not b.edges and sharp.has_edge_contacts(b.scene):
        warn = sharp.warn_of_gradients if b.model.gradients else sharp.warn_of_newton
        contact.offers.start_warnings = [warn(b.scene)]
    if b.free:
        from wsim.physics.contact.free_flight_test import FreeFlightTest
        contact.part(FreeFlightTest(contact, b.clock, bool(b.ports.whole_frames)))
    return contact


class ContactMethod(Method):
    """Points of every body against every collider. Raises SceneError for a collider that makes no sense. trailed: points are
    moved after the Newton steps of each substep."""

    trailed = False

    def __init__(self, model: Model, state: SimulationState, points, status: FrameStatus, clock: Clock, movers=None,
                 edged: bool = False):
        """points: the method that owns inverse masses and objects and the anchor; movers: what has colliders of its
        own and takes what they are pushed by (`wsim.physics.rigid.touch.points.BodyPointContacts`), or None; edged: edges
        meet."""
        super().__init__("contact")
        self.solved = self.after = False                 # in a recording: by an implicit solve, and once behind it
        self.within = False                              # of a Newton step
        self.reproject_contacts: Callable[[Clock, float], None] | None = None        # for what moves points after Newton steps
        self.model, self.state, self.anchor, self.points, self.movers = model, state, points.anchor, points, movers
        colliders = model.scene.colliders
        own = points.constants.object
        if model.by_point:                               # there each point has a row of its own
            own = np.repeat(np.arange(len(model.bodies)), [b.count for b in model.bodies]).astype(np.int32)
        each = [contact_triangles(b) for b in model.bodies]
        of = [[*colliders, *movers.colliders(b.world)] for b in model.bodies] if movers else [colliders] * len(model.bodies)
        bodies = CollidablePoints(of, np.stack([b.origin for b in model.bodies]), own, points.constants.w, model.stack("reach"),
                                  np.repeat([b.friction for b in model.bodies], [b.count for b in model.bodies], axis=0),
                                  model.shared(np.concatenate(each)), np.array([chord.triangle_breadth(b.rest, f - b.first)
                                            for b, f in zip(model.bodies, each, strict=True)]),
                                  np.array([b.reach.min() for b in model.bodies]),
                                  np.array([collides_with_surfaces(b.source, model.scene) for b in model.bodies]),
                                  np.array([sharp.has_edges(b.source) for b in model.bodies]) if edged else None)
        self.contacts = ColliderContacts(bodies, device=model.device, real=model.real, module=model.module,
                                         substeps=clock.substeps, dt=clock.dt, struck=points.struck, turned=model.gradients)
        self.contacts.launch, self.contacts.zero, self.contacts.launch_blocks = model.launch, model.zero, model.launch_blocks
        self.short(points.integrator.explicit, edged)
        self.contacts.adjoint = beside(model, ColliderContacts.__module__, "ContactAdjoint", self.contacts, model)
        state.points.take(StateField("mark", "", True, "whether a point touched or was inside", "int"), self.contacts.mark)
        self.status = status
        status.reserve(ROOM)
        status.reserve(FACES)
        n, size, moving = model.points, np.dtype(model.dtype).itemsize, 2 * sum(
            m.moves for m in self.contacts.meshes.values())
        tree, more = self.contacts.tree is not None, self.contacts.edges is not None
        kinds = f"{len(colliders)} x {n} points: {', '.join(self.contacts.kinds)}{'; by a tree' * tree}{'; edges' * more}"
        self.stages = [Stage("find contacts", "collide", self.search, 1 + moving + 2 * tree + 3 * more, n * (20 + 8 * size),
                             what=kinds),
                       Stage("contacts", "solve", self.project, 1, n * 4, "iteration", "points that touch")]
        if points.struck is not None:
            self.stages.append(Stage("settle", "solve", self.settle, 1, n * 4, what="points that touch: no history"))
        self.clearance: Any = None                       # `wsim.physics.contact.free_flight_test.FreeFlightTest`
        self.prolonged: Any = None                       # `wsim.physics.contact.prolonged.MidpointContacts`
        self.bounce: Any = None
        self.ends(clock)
        if movers:
            movers.join(self)
        self.offers = Ports(contact=self, contacts=self.contacts, restitution=self.bounce)

    def ends(self, clock: Clock) -> None:
        """Stages behind the last iteration, where a step goes on to its end, and where colliders throw back."""
        if clock.integrator.beyond:
            from wsim.physics.contact.prolonged import MidpointContacts
            self.prolonged = MidpointContacts(self)
            self.stages.append(self.prolonged.stage)
        if any(c.restitution > 0.0 for c in self.model.scene.colliders):
            from wsim.physics.contact.restitution import RestitutionStage
            self.bounce = RestitutionStage(self.model, self.state, self.points, self.contacts, self.prolonged)
            self.stages += self.bounce.stages

    def short(self, explicit: bool, edged: bool) -> None:
        """Parts that explicit steps have, which are many and short, and contacts of edges."""
        self.alike = self.movers is None and not edged and self.contacts.tree is None
        if self.alike and not explicit and self.model.device.is_cuda and any(m.moves for m in self.contacts.meshes.values()):
            from wsim.physics.contact.collider import mesh
            mesh.make_trees(self.model, self.contacts.meshes.values())
        if self.movers is None:
            self.contacts.smooth(self.model.scene, explicit)
        if explicit and self.contacts.meshes and not self.model.gradients:
            from wsim.physics.contact import broad
            broad.use_face_lists(self.contacts)
        elif self.contacts.meshes and self.movers is None and not self.model.gradients and self.contacts.substeps >= CLEARED:
            from wsim.physics.contact import broad
            if self.model.device.is_cuda and max(len(m.triangles) for m in self.contacts.meshes.values()) <= LISTS:
                broad.use_face_lists(self.contacts, broad.WIDE, broad.OFTEN)
            else:
                broad.skip_far_meshes(self.contacts)
        if self.contacts.search_kernel is None:
            self.contacts.make_search_kernel()
        if edged:
            from wsim.physics.cloth.edge_contacts import EdgeContacts
            EdgeContacts(self.model, self.contacts, explicit)

    def part(self, clearance) -> None:
        """Frames with contacts from those without."""
        self.clearance = clearance
        for stage in self.stages:
            stage.frames = MET
        self.stages += clearance.stages

    def kept_distances(self) -> list[dict]:
        """Distances [m] that colliders keep from the bodies of world 0, besides half of their thickness, where the scene leaves
        them open and chords need some."""
        rows, bodies, found = self.contacts.rows, [b for b in self.model.bodies if b.world == 0], []
        for body in bodies:
            for r in range(rows.first[body.number], rows.first[body.number + 1]):
                c, gap = rows.colliders[rows.collider[r]], float(self.contacts.gap[r])
                if c.thickness is None and gap > 0.0:
                    found.append({"collider": c.path, "body": body.path, "thickness": gap})
        return found

    def search(self, clock: Clock) -> None:
        if self.movers:
            self.movers.place(clock)
        if self.prolonged and self.prolonged.asked(clock):
            return self.prolonged.search(clock)
        self.contacts.search(clock.k, self.state.x, self.state.d, self.anchor, clock.loop)
        if self.movers:
            self.movers.listed(clock)

    def project(self, clock: Clock, beside: bool = False) -> None:
        """Contacts at the end of an iteration. beside: in turn with contacts of surfaces, which push points too."""
        g = self.step(clock)
        if self.movers:
            self.movers.project(clock, beside)
        elif self.within and not self.contacts.recorded:
            if self.reproject_contacts and (self.trailed or beside):
                self.reproject_contacts(clock, g)
        elif self.after or not (self.solved and self.contacts.recorded):
            if self.contacts.edges and not clock.integrator.explicit:
                self.contacts.edges.renew(self.contacts.read(x=self.state.x, d=self.state.d, k=clock.k))
            self.contacts.project(g, self.state.d, self.anchor)

    def step(self, clock: Clock) -> float:
        """Effective step of contacts, v = (d - a) / step [s]."""
        return clock.h if self.prolonged and self.prolonged.ended else clock.effective_step

    def settle(self, clock: Clock) -> None:
        s = self.state
        if clock.integrator.memory:
            others = self.movers.others() if self.movers else None
            self.contacts.settle(clock.effective_step, s.e, s.d, self.anchor, s.v, others)

    def behind(self, clock: Clock) -> None:
        """Velocities behind the sweeps of surfaces, where these come last: what colliders throw back, and what bodies give."""
        if self.bounce and self.bounce.behind(clock):
            self.bounce.launch(clock)
        if self.movers:
            self.movers.behind(clock)

    def choose_frame_form(self, clock: Clock) -> None:
        if self.clearance:
            self.clearance.choose_frame_form(clock)

    def before_frame(self, time: float, clock: Clock) -> None:
        deep = True if clock.starting or self.model.gradients else None
        if self.contacts.changed:
            self.evaluates = self.contacts.poses.on_host()
        self.contacts.prepare(time, substeps=clock.substeps, deep=deep, free=clock.free and self.clearance is not None)
        if self.clearance:
            self.clearance.outline.frame(time)

    def connect_ports(self, others: Methods) -> None:
        self.contacts.tell(self.status.word(ROOM))
        self.contacts.points.wanted = self.status.word(FACES)
        if self.bounce:
            self.bounce.connect_ports(others)
        if self.prolonged:
            self.prolonged.connect_ports(others)
        terms, adjoint = others.ports.newton_terms, others.ports.solve_adjoint
        surfaces = others.ports.self_contact is not None          # which Newton steps solve for, but beside strands
        trailed = bool(others.ports.xpbd_batches or others.ports.shape_matching or surfaces and others.ports.strands)
        if terms is None:
            return
        from wsim.physics.solver.contact.active_set import ActiveSet  # Newton steps hold contacts themselves
        active = ActiveSet(others.ports.newton_assembly, self.contacts)
        terms.append(active)
        self.within, self.trailed = True, trailed
        self.reproject_contacts = active.observe_displacement if trailed or surfaces else None
        if adjoint:
            self.solved, self.after = True, trailed
            adjoint.enter("contacts", self.contacts, trailed)

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        if self.clearance and self.clearance.missed_contacts():
            return [Remedy("meet")]
        wanted, faces, points = int(status.said(ROOM)[0]), int(status.said(FACES)[0]), self.contacts.points

        def grow_contact_slots() -> str:
            room = self.contacts.slots.capacity                      # twice as much: each time takes a capture
            grown = self.contacts.grow(max(wanted, 2 * room) if wanted > room else wanted)
            if self.prolonged:
                self.prolonged.room()
            return f"a point touches {wanted} colliders at once, more than there was room for" if grown else ""

        def grow_listed_faces() -> str:
            from wsim.physics.contact.broad import grow_face_lists
            grown = grow_face_lists(points, 2 * faces)
            return f"at least {faces} faces of meshes are near a point, more than there was room for" if grown else ""
        return [Remedy("grow", act) for act, some in ((grow_contact_slots, wanted), (grow_listed_faces, faces > points.room))
                if some]

    def lengthen_lists(self) -> None:
        from wsim.physics.contact.broad import MOST, grow_face_lists
        if self.contacts.points.room:
            grow_face_lists(self.contacts.points, MOST)

    def resume_run(self, time: float) -> None:
        self.contacts.time, self.contacts.owed = time, True
        if self.clearance:
            self.clearance.said = None

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        return self.contacts.indicators(self.state.x) if self.contacts.time is not None else {}

    def contact_points(self, clock: Clock) -> list:
        from wsim.physics.contact.collider.contact_points import collider_contact_points
        return [collider_contact_points(self, clock.effective_step)] if not clock.free else []

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """static_friction, dynamic_friction of a body or a collider; thickness [m] and restitution of a collider, the latter
        where one throws back from the start; motion of a collider, a Motion or a (4, 4) matrix, which worlds share."""
        if name == "motion":
            return world is None and self.move(path, value if isinstance(value, Motion) else Motion.still(value))
        if name not in (*FRICTION, "thickness", "restitution") or (name == "restitution" and not self.bounce):
            return False
        objects = [k for k, b in enumerate(self.model.bodies) if world in (None, b.world)]
        rows = self.contacts.set_value(path, name, value, objects)
        if rows and name == "restitution":
            self.bounce.set_value(rows, objects, value)
        return bool(rows) or (name in FRICTION and self.rub(path, name, value, world))

    def move(self, path: str, motion: Motion) -> bool:
        """A collider's motion, and in the scene, which results and `Simulation.poses` read."""
        moved = self.contacts.move(path, motion)
        for collider in self.model.scene.colliders if moved else ():
            if collider.path == path:
                collider.motion = motion
        return moved

    def rub(self, path: str, name: str, value: float, world: int | None) -> bool:
        """Friction of a body."""
        bodies = [b for b in self.model.bodies if b.path == path and world in (None, b.world)]
        values = self.contacts.points.friction.numpy()
        for b in bodies:
            values[b.first:b.last, FRICTION.index(name)] = value
        self.contacts.points.friction.assign(values)
        return bool(bodies)
