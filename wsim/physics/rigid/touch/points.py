"""Contact of rigid bodies with points of cloth, nets and soft bodies, both ways.

Their shapes are rows of the table of colliders that points have (`wsim.physics.contact.contacts`), placed on the device from
the state of the bodies. In a substep bodies first take their forces, then points are predicted and meet them; at the end of
every iteration of points a star is solved around each body (kernels/rigid/touch/body_point_solve.py) in turn with the contacts
that bodies have among themselves; then both go where they go. Equations: kernels/rigid/touch/points.py.

A block of threads solves a world of few bodies in one launch (worlds.py). More of them take a block each, and more launches.
"""

from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.touch import body_point_solve as stars
from wsim.kernels.rigid.touch import exchange, rebound
from wsim.kernels.rigid.touch import points as touch
from wsim.model.stage import Clock, Methods, Stage
from wsim.model.structs import fill_struct
from wsim.physics.rigid.meetings import collider_places_in_body
from wsim.physics.rigid.solids import touching_colliders
from wsim.physics.rigid.touch.half_step import HalfStepMomenta
from wsim.physics.rigid.touch.substeps import RigidSubsteps, make_point_ties
from wsim.physics.rigid.touch.worlds import WorldBlocks, few_bodies
from wsim.scene import Collider, Motion

LANES = 64                   # threads of a block that sum over the contacts of a body
ROUNDS = 8                   # of stars and sweeps in a substep, at least, where bodies touch more than points
SLOW = 0.05                  # [m/s] of approach below which nothing is thrown back


class BodyPointContacts(RigidSubsteps):
    """The offer of bodies to those who make contacts of points, as "movers"."""

    def __init__(self, b, rigid):
        """rigid: the method, whose `contacts` are made."""
        super().__init__(b, rigid, swept=not (few := few_bodies(b.model, rigid)))
        self.state, self.real, self.status, self.clock = b.state, b.model.real, b.status, b.clock
        if b.choice.solver == "implicit":
            from wsim.physics.rigid.touch.newton import UNFORESEEN
            b.status.reserve(UNFORESEEN)
        self.owners = [(k, world, c) for k, (body, world) in enumerate(rigid.bodies) for c in touching_colliders(body)]
        self.copies = {world: [replace(c, motion=Motion.still(rigid.bodies[k][0].motion.at(0.0) @ c.motion.at(0.0)),
                                       restitution=0.0) for k, of, c in self.owners if of == world]
                       for world in range(b.model.worlds)}
        bouncing = any(c.restitution > 0.0 for *_, c in self.owners)
        self.memory = b.clock.integrator.memory > 0.0
        self.rises, self.alone = bouncing or self.memory, len(self.copies[0]) == 1 and not (b.scene.colliders or self.trees)
        self.rounds = 1 if self.alone else max(1, ceil(ROUNDS / b.clock.iterations))
        self.lanes = LANES if b.model.device.is_cuda else 1
        self.kernels: dict[str, Any] = {}
        self.need(place=touch.body_place_kernel)
        self.stars = self.trees.make_stars(self) if self.trees else None
        self.worlds: Any = self.stars or (WorldBlocks(self) if few else None)
        if not few:
            self.need(keys=touch.contact_key_kernel, begin=touch.touch_begin_kernel, found=touch.found_contact_kernel,
                      gather=exchange.star_row_kernel, hubs=exchange.star_hub_kernel, tell=exchange.contact_plane_kernel,
                      bounds=touch.group_bound_kernel, star=stars.star_solve_kernel, take=exchange.point_impulse_kernel)
        if self.rises:
            self.need(rise=rebound.star_velocity_kernel, thrown=rebound.bounce_impulse_kernel, hubs=exchange.star_hub_kernel,
                      remember=rebound.impulse_memory_kernel, star=stars.star_solve_kernel, take=exchange.point_impulse_kernel)
        if self.memory:
            self.need(carry=rebound.overlap_carry_kernel, others=rebound.other_push_kernel)
        self.before: Any = wp.zeros_like(b.state.x) if self.memory else None     # anchors before a search
        self.start = self.ties = self.half = None    # type: Any        # ties: `wsim.physics.rigid.touch.point_ties.PointTies`
        self.surfaces = False            # True: their sweeps come behind the last iteration

    def need(self, **factories: Any) -> None:
        """Makes kernels that are launched by name."""
        for name, make in factories.items():
            wide = make in (stars.star_solve_kernel, exchange.point_impulse_kernel) and self.lanes > 1
            if name not in self.kernels:
                self.kernels[name] = (make(self.model.module) if make is touch.group_bound_kernel else
                                      self.make_kernel(make, self.lanes if wide else 0))

    def starts(self) -> Any:
        """e where substeps begin, kept from now on for who asks; None where it is e itself, which no memory changes."""
        if self.memory and self.start is None:
            self.start = wp.zeros_like(self.before)
        return self.start

    def colliders(self, world: int) -> list[Collider]:
        """Shapes of the bodies of a world, where they start."""
        return self.copies[world]

    def connect_ports(self, others: Methods) -> None:
        """Enters Newton steps, before the contacts of points do."""
        terms = others.ports.newton_terms
        if terms is not None:
            from wsim.physics.rigid.touch.newton import ForeseenBodies
            self.need(hubs=exchange.star_hub_kernel, tell=exchange.contact_plane_kernel, star=stars.star_solve_kernel)
            self.foreseen = ForeseenBodies(self, others.ports.newton_assembly, others.ports.line_search_lanes)
            terms.append(self.foreseen)
        if (surfaces := others.ports.self_contact) is not None:
            self.surfaces = not surfaces.within
        if "ph" in self.rigid.part.arrays:
            self.need(take=exchange.point_impulse_kernel)
            self.half = HalfStepMomenta(self)
            others.ports.before_half_kick.append(self.half.before)

    def join(self, contact) -> None:
        """Takes the table of contacts that have the rows of bodies in them (`wsim.physics.contact.method.ContactMethod`)."""
        self.contact, self.contacts, model, device = contact, contact.contacts, self.model, self.model.device
        rows, several = self.contacts.rows, len(model.scene.colliders)
        numbers = {world: [n for n, (_, of, _) in enumerate(self.owners) if of == world] for world in self.copies}
        found = [(rows.first[o] + several + place, n, o) for o, body in enumerate(model.bodies)
                 for place, n in enumerate(numbers[body.world])]
        bodies = np.array([self.owners[n][0] for _, n, _ in found], np.int32)
        own = [self.owners[n][2] for _, n, _ in found]
        places = collider_places_in_body([self.rigid.masses[k] for k in bodies], own, np.zeros((len(own), 3)))
        row, table = np.array([r for r, *_ in found], np.int32), self.contacts.table.of
        self.contacts.owner[row], self.contacts.restitution[row] = bodies, [c.restitution for c in own]
        table.owner.assign(self.contacts.owner.astype(np.int32))
        table.restitution.assign(self.contacts.restitution.astype(self.contacts.dtype))
        radius = rows.radius[rows.collider[row]] + self.contacts.gap[row]
        origins = np.stack([body.origin for body in model.bodies])

        def array(values, dtype):
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)
        Shapes, self.Found, self.Points = touch.touch_structs(self.real)
        self.shapes = fill_struct(
            Shapes, row=array(row, int), body=array(bodies, int), place=array(places, wp.transformd),
            ball=array(np.concatenate([rows.centers()[rows.collider[row]], radius[:, None]], 1), wp.vec4d),
            origin=array(rows.origin[row], wp.vec3d), begin=array(self.rigid.origin, wp.vec3d),
            object=array(origins, wp.vec3d), of=table.owner, restitution=table.restitution)
        self.ties = make_point_ties(self, row, bodies)
        self.room()
        listing, solving = self.worlds.launches if self.worlds else (4, (6 + (not self.alone)) * self.rounds)
        contact.stages[0].launches += 1 + listing + bool(self.ties)
        contact.stages[1].launches += solving - 1
        if self.rises:
            contact.stages.append(Stage("touch: velocities", "solve", self.first, 6, 100 * self.room_for, what="by bodies"))

    def room(self) -> None:
        """Arrays for as many contacts as there are slots."""
        t, n, device = types(self.real), len(self.rigid.bodies), self.model.device
        room = self.room_for = self.contacts.slots.points * self.contacts.slots.capacity

        def zeros(length, dtype):
            return wp.zeros(length, dtype=dtype, device=device)
        Rows, Hubs = stars.star_structs(self.real)
        self.numbers, slot = zeros(2 * room, int), zeros(2 * room, int)
        slots = {name: zeros(room, self.real) for name in ("base", "least", "mu", "f")}
        slots |= {name: zeros(room, t.vec3) for name in ("n", "r", "slip", *["ball", "psi"] * self.rolling)}
        self.rows = fill_struct(Rows, first=zeros(n + 1, int), slot=slot, **slots)
        slots = {name: zeros(room, self.real) for name in ("b", "before", "q")} | {"u": zeros(room, t.vec3)}
        slots |= {"roll": self.roll, "rolled": zeros(n, wp.vec3d)} if self.roll else {}
        self.found = fill_struct(self.Found, **slots, **{k: zeros(2 * n, wp.vec3d) for k in ("ahead", "still", "total")})
        table, work = self.rigid.table, self.rigid.contacts.work
        self.hubs = fill_struct(Hubs, w=table.w, inverse=table.inverse, turn=work.turn, q=zeros(2 * n, wp.vec3d))
        self.V, self.left, self.aside = zeros(2 * n, wp.vec3d), zeros(n, self.real), zeros(room, t.vec3)    # aside: colliders'
        if self.worlds:
            self.worlds.room()
        else:
            wp.utils.radix_sort_pairs(self.numbers, slot, room)          # takes its memory, which a capture cannot

    def before_frame(self) -> None:
        if self.room_for != self.contacts.slots.points * self.contacts.slots.capacity:
            self.room()
        self.hubs.turn = self.rigid.contacts.work.turn   # another array where lists have grown
        if self.worlds:
            self.worlds.table.hubs = self.hubs

    def run(self, name: str, dim: int, inputs: list, outputs: list) -> None:
        self.model.launch(self.kernels[name], dim, inputs, outputs)

    def blocks(self, kernel, inputs: list, outputs: list, count: int = 0, threads: int = 0) -> None:
        """A block of threads for each body, or so many blocks."""
        count, threads = count or len(self.rigid.bodies), threads or self.lanes
        if threads > 1:
            self.model.launch_blocks(kernel, count, threads, inputs, outputs)
        else:
            wp.launch(kernel, count, inputs, outputs, device=self.model.device, block_dim=1)

    def points(self, clock: Clock) -> Any:
        s, of, memory = self.state, self.contact.points, clock.integrator.memory > 0.0
        c, own = clock.effective_step if memory else clock.effective_step * clock.effective_step / clock.h, self.contacts.points
        return fill_struct(self.Points, w=of.constants.w, object=own.object, friction=own.friction, x=s.x, v=s.v, e=s.e,
                             d=s.d, a=of.anchor, push=self.contacts.push, h=clock.h, g=clock.effective_step, c=c, slow=SLOW)

    def end(self, clock: Clock) -> None:
        """Bodies go where they go."""
        super().end(clock)
        if self.foreseen:
            self.foreseen.keep()
        if self.half and clock.k + 1 == clock.substeps:
            self.half.read(clock)
        if clock.k + 1 == clock.substeps:                # where measures look
            self.place(clock, 1)

    def place(self, clock: Clock, arrived: int = 0) -> None:
        """Rows of the table as bodies are, and where momenta lead them."""
        c = self.contacts.table
        if self.memory and not arrived:
            self.model.copy(self.before, self.contact.anchor)
        self.run("place", len(self.shapes.row), [self.shapes, self.rigid.contacts.rig(), clock.k, arrived, clock.h],
                 [c.of.pose, c.of.step, c.ball])

    def listed(self, clock: Clock) -> None:
        """Lists contacts in the order of bodies, behind a search."""
        slots = self.contacts.slots
        if self.ties:
            self.ties.write(clock)
        if self.start is not None:
            self.model.copy(self.start, self.state.e)
        if self.memory:
            self.run("carry", self.model.points, [self.shapes.of, slots, self.contact.anchor, self.before, self.state.e],
                     [self.state.e, self.contacts.struck])
        if self.worlds:
            self.worlds.list(clock)
        else:
            self.sort(clock)
        if self.foreseen:
            self.foreseen.recall(clock)

    def sort(self, clock: Clock) -> None:
        """The list of many bodies."""
        own, n, rig, slots = self.rows, len(self.rigid.bodies), self.rigid.contacts.rig(), self.contacts.slots
        self.run("begin", n, [rig], [self.found])
        self.run("keys", self.room_for, [slots, self.shapes.of, n], [self.numbers, own.slot])
        wp.utils.radix_sort_pairs(self.numbers, own.slot, self.room_for)
        self.run("bounds", n + 1, [self.numbers, self.room_for], [own.first])
        self.run("found", self.room_for, [self.shapes, rig, slots, self.points(clock)], [own, self.found])

    def solve(self, clock: Clock, given: float, k: float, g: float) -> None:
        """The stars of `rows`. given: 1 where they are of all impulses of the substep, 0 of such as come on top."""
        if self.stars:
            return self.stars.solve_stars(given, k, g)
        self.run("hubs", len(self.rigid.bodies), [self.rigid.contacts.rig(), self.found, given], [self.hubs])
        self.blocks(self.kernels["star"], [self.rows, self.hubs, k, g, self.lanes], [self.V, self.left])

    def tell(self, clock: Clock) -> None:
        """Planes go with the bodies."""
        self.run("tell", self.room_for, [self.rows, self.found, self.V, self.shapes.of, clock.h], [self.contacts.slots])

    def project(self, clock: Clock, beside: bool = False) -> None:
        """Contacts at the end of an iteration; beside: momentum is not balanced, as surfaces push points too."""
        if self.foreseen and not (self.contact.trailed or beside):     # else all Newton steps are done in the first iteration
            if clock.i < clock.iterations - 1:
                self.foreseen.lean(clock)
                return
            self.foreseen.owe(clock)
        if self.worlds:
            self.worlds.solve(clock)
        else:
            self.solve_bodies(clock)
        if self.foreseen and clock.i == clock.iterations - 1 and not beside:
            self.foreseen.balance(clock)
            if not self.contact.trailed:
                self.foreseen.miss()

    def solve_bodies(self, clock: Clock) -> None:
        """The rounds of a substep, launch by launch."""
        n, rig, c = len(self.rigid.bodies), self.rigid.contacts.rig(), self.contacts
        for _ in range(self.rounds):
            self.run("gather", self.room_for, [c.table, c.slots, self.points(clock), self.found, n], [self.rows])
            self.solve(clock, 1.0, clock.h, clock.effective_step)
            self.tell(clock)
            c.project(clock.effective_step, self.state.d, self.contact.anchor)
            self.blocks(self.kernels["take"], [self.rows, c.push, self.found, 0, self.lanes], [rig])
            if not self.alone:
                self.sweep(clock)
            else:
                self.joined(clock)

    def indicators(self) -> dict[str, float]:
        """touches: contacts of points with bodies, open ones too, in the last substep; touch_residual: what was left there
        of how points change a body's motion, at most (kernels/rigid/touch: body_point_solve.py, of Newton lean.py)."""
        left = self.foreseen.missed if self.foreseen else self.left
        return {"touches": int(self.rows.first.numpy()[-1]), "touch_residual": float(left.numpy().max())}

    def others(self) -> wp.array:
        """Pushes of the colliders that are no bodies: what velocities of points follow from without them."""
        self.run("others", self.room_for, [self.shapes.of, self.contacts.slots, self.contacts.push], [self.aside])
        return self.aside

    def first(self, clock: Clock) -> None:
        """Velocities behind the last iteration, unless surfaces push points and bodies once more behind it."""
        if not self.surfaces or clock.free:
            self.rise(clock)

    def behind(self, clock: Clock) -> None:
        """Velocities behind surfaces: a memory is told of all that bodies push points by."""
        if self.rises and self.surfaces:
            self.rise(clock)

    def rise(self, clock: Clock) -> None:
        """Velocities behind the last push."""
        n, rig, slots, s = len(self.rigid.bodies), self.rigid.contacts.rig(), self.contacts.slots, self.state
        at, memory = self.points(clock), int(clock.integrator.memory > 0.0)
        self.run("rise", self.room_for, [self.shapes, slots, at, self.found, memory, n], [self.rows])
        self.solve(clock, 0.0, 1.0, 0.0)
        self.run("thrown", self.room_for, [self.rows, self.V, self.shapes.of, slots], [self.found])
        self.blocks(self.kernels["take"], [self.rows, self.contacts.push, self.found, 1, self.lanes], [rig])
        self.run("remember", self.model.points, [self.shapes.of, slots, at, self.found, memory],
                 [self.contact.anchor, s.v, s.e])
