"""Implicit substeps with gradients: solved to a residual, and differentiated by one adjoint solve. See
kernels/solver/newton_adjoint.py.

The solve is Newton's method of `wsim.physics.solver.newton`, with full steps at its end; the adjoint is a method of conjugate
residuals (kernels/solver/gcr.py) whose products are adjoints of the forces (exact, with damping and all second derivatives) and
whose preconditioner is the solver of `wsim.physics.solver.linear` for the positive part. Among contacts
(kernels/contact/coulomb.py) the steps at the end are those of the active set, with Coulomb's law, by the same products and
residuals; simulations, which project contacts between Newton steps instead, end there too when they take many.

Tethers and strain limits are projected behind the solve (`wsim.physics.solver.xpbd_adjoint`), as many sweeps as simulations
take, which do so too; contacts once more behind each, from the pushes of the solve, which have an adjoint then
(kernels/contact/coulomb_adjoint.py).

What is left is measured:

    missed    forces that the worst solve has left, over those of inertia, |own (d - a)|
    left      residual of the worst adjoint solve, over its right side
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver import newton_adjoint
from wsim.model.tape import without_gradient
from wsim.physics.motion.forces import ForceGather
from wsim.physics.motion.forces_adjoint import Forces
from wsim.physics.motion.soft_pins.soft_pin_adjoint import PinsAdjoint
from wsim.physics.solver.assembly import newton_module
from wsim.physics.solver.contact.active_set_adjoint import ActiveSetAdjoint
from wsim.physics.solver.gcr import Directions

CLOSE = {"float32": 1e-5, "float64": 1e-13}     # forces left over those of inertia, |own (d - a)|
AMONG = {"float32": 1e-5, "float64": 1e-15}     # among contacts, whose steps gain less: to where rounding ends it
EXACT = {"float32": 1e-6, "float64": 1e-12}     # of the adjoint solve, over its right side
MOST = 60              # full Newton steps, and iterations of the adjoint solve, at most
INNER, CAP = 1e-2, 300
NEAR, FEW = 1e-2, 20   # of a Newton step among contacts
CONTACTS = 6           # Newton steps with a line search, at least, before those without, which may go in circles from afar
AGAIN = 24             # of them where it did: a sheet that a ball strikes at 4 m/s was left with forces thrice those of inertia
LOST = 1e-4            # residual, as CLOSE, beyond which a solve went in circles


class ImplicitAdjoint(Forces):
    """The implicit solve of a substep, forward to its residual and backward."""

    def __init__(self, method, rows: list):
        """method: `wsim.physics.solver.newton.Implicit`; rows: its springs, hinges and triangles, of all worlds."""
        self.method, self.assembly, model = method, method.assembly, method.model
        super().__init__(model, ForceGather(model, self.assembly.points.constants, rows, None, shared=False), model.module)
        n, real, t = model.points, model.real, types(model.real)
        module = newton_module(model, ("adjoint",)) or model.module
        both = zip(self.pull.tables, self.assembly.solids, strict=True)
        self.plastic = [self.share(own, live) for own, live in both if live.plastic]
        names = ("pairs", "residual", "product", "free", "spread", "dot", "add", "going", "falling", "worst", "weigh")
        self.kernels = {name: getattr(newton_adjoint, name)(real, module) for name in names}

        def zero_vectors(count):
            return wp.zeros(count, dtype=t.vec3, device=model.device)
        self.d, self.a, self.b, self.y, self.sum = (zero_vectors(n) for _ in range(5))
        self.p, self.q, self.r, self.scale = (zero_vectors(n) for _ in range(4))
        lanes = 1024 if model.device.is_cuda else 1
        self.sums = [wp.zeros(lanes, dtype=wp.float64, device=model.device) for _ in range(4)]
        self.directions = Directions(model, lanes, module)
        self.count, self.on, self.turns, self.turning, self.rounds, self.again = (
            wp.zeros(1, dtype=int, device=model.device) for _ in range(6))
        self.best, self.tried = (wp.zeros(2, dtype=wp.float64, device=model.device) for _ in range(2))
        self.missed, self.left = (wp.zeros(1, dtype=wp.float64, device=model.device) for _ in range(2))
        self.name = "float32" if real is wp.float32 else "float64"
        self.pins: PinsAdjoint | None = None
        self.contacts: ActiveSetAdjoint | None = None

    @staticmethod
    def share(own, live):
        """The flow of a table of `method`, whose shapes at rest the forces here read too."""
        live.plastic.adjoint.join(own.plastic.adjoint.net, own.plastic.adjoint.first)
        own.plastic, own.flows, own.data.edge, own.data.gradient = live.plastic, False, live.data.edge, live.data.gradient
        return live.plastic

    def enter(self, kind: str, *given) -> None:
        """Takes what is a term of Newton steps: "pins" or "contacts", and what their adjoint is made of."""
        if kind == "pins":
            self.pins = PinsAdjoint(self.model, *given)
        else:
            self.contacts = ActiveSetAdjoint(self.model, *given)

    def spring_tables(self) -> list:
        from wsim.physics.cloth.nets.springs import SpringTable
        return [SpringTable(self.pull.springs, self.pull.table.rest, self.pull.entry, self.pull.given)]

    def forget(self) -> None:
        """Rotations, here and in the method, are sought anew."""
        for table in (*self.pull.tables, *self.assembly.solids):
            if table.q:
                table.q.zero_()

    def forces(self, clock) -> None:
        """f at d, with velocities (d - a) / g, and of soft pins."""
        self.run("pairs", [self.d, self.a, 1.0 / clock.effective_step], [self.pair])
        self.evaluate()
        if self.pins:
            self.pins.add(self.x, self.pair, clock.k, self.f)

    def turned(self, p: wp.array, whole: bool, clock) -> None:
        """Product as `transposed` has it, of soft pins too."""
        self.transposed(p, whole)
        if self.pins:
            self.pins.transposed(self.x, self.pair, p, clock.k, whole)

    def run(self, name: str, inputs: list, outputs: list, dim: int = 0) -> None:
        self.model.launch(self.kernels[name], dim or self.model.points, inputs, outputs)

    def dot(self, u: wp.array, v: wp.array, into: int) -> wp.array:
        self.run("dot", [u, v], [self.sums[into]], len(self.sums[into]))
        return self.sums[into]

    # forward

    def solve(self, clock) -> None:
        """The state's d, from the prediction to where no force is left."""
        s, contacts = self.assembly.state, self.contacts
        self.method.c.zero_()                                      # a substep depends on nothing but its own start
        self.forget()
        wp.copy(self.b, s.d)
        if contacts:
            contacts.begin()
        self.converge_newton(clock, max(clock.iterations, CONTACTS if contacts else 0))
        if contacts and clock.iterations < AGAIN:
            self.rounds.zero_()
            self.judge()
            wp.capture_while(self.again, lambda: self.restart(clock))
        self.run("worst", self.sums[:2], [self.missed], 1)

    def converge_newton(self, clock, steps: int) -> None:
        """So many Newton steps with a line search, then full ones while they gain."""
        m, s, contacts = self.assembly, self.assembly.state, self.contacts
        for i in range(steps):
            clock.i = i
            self.method.newton(clock)
        self.count.zero_()
        wp.copy(self.a, m.points.anchor)
        wp.copy(self.x, s.x)
        if contacts:
            m.linearise(1.0 / clock.effective_step)
            for term in self.method.terms:
                term.adjust_system(clock.effective_step, fresh=True)
            contacts.turn(s.d, self.a, clock.effective_step, first=True)
        self.look(clock)
        wp.capture_while(self.on, lambda: self.step(clock))

    def judge(self) -> None:
        """Notes if the solve is to begin once more: it has left more than LOST, the first time."""
        self.run("falling", [self.sums[0], self.sums[1], LOST, 1, self.rounds, self.tried], [self.again], 1)

    def restart(self, clock) -> None:
        """The solve once more, from the prediction, by more steps with a line search."""
        self.method.c.zero_()
        wp.copy(self.assembly.state.d, self.b)
        self.converge_newton(clock, AGAIN)
        self.judge()

    def look(self, clock) -> None:
        """Residual at the state's d, and whether that is too much."""
        wp.copy(self.d, self.assembly.state.d)
        self.forces(clock)
        miss, rate, close = self.r, 1.0 / clock.effective_step, CLOSE
        if self.contacts:
            miss, close = self.contacts.left.miss, AMONG
            self.bear(rate)
        else:
            self.run("residual", [self.assembly.rows.w, self.f, self.d, self.b, self.a, rate], [self.r, self.scale])
        self.run("falling", [self.dot(miss, miss, 0), self.dot(self.scale, self.scale, 1), close[self.name], MOST, self.count,
                             self.best], [self.on], 1)

    def step(self, clock) -> None:
        """A full Newton step, and contacts after it."""
        m, s = self.assembly, self.assembly.state
        self.system(1.0 / clock.effective_step)
        if self.contacts:
            self.solve_krylov(self.tangent, NEAR, FEW, clock)
            self.run("add", [s.d, self.sum, self.sums[3], self.sums[3], 1.0], [s.d])
            self.contacts.turn(s.d, self.a, clock.effective_step)
        else:
            m.solve(self.r, INNER, CAP)
            self.run("add", [s.d, m.v.y, self.sums[1], self.sums[1], 1.0], [s.d])
        self.look(clock)

    def system(self, rate: float) -> None:
        """The positive part of the Jacobian at the state's d, of what is free there."""
        self.assembly.linearise(rate)
        if self.contacts:
            self.contacts.screen(self.assembly.A.P)

    def bear(self, rate: float, found: bool = False):
        """State of contacts at d, and what they leave free there."""
        assert self.contacts is not None
        state = self.contacts.state(self.d, self.a, self.b, self.f, rate)
        self.contacts.bear(state, self.r, self.scale, found)
        return state

    # backward

    def back(self, clock, d: wp.array, b: wp.array, x: wp.array, a: wp.array) -> None:
        """Passes from the gradient of d to those of b, x, a and all parameters; each array with its gradient, which is added
        to."""
        m, s, contacts = self.assembly, self.assembly.state, self.contacts
        rate, w = 1.0 / clock.effective_step, self.assembly.rows.w
        for into, source in ((self.d, d), (self.a, a), (self.b, b), (self.x, x), (s.d, d), (s.x, x), (m.points.anchor, a),
                             (self.y, d.grad)):
            wp.copy(into, without_gradient(source))      # a copy takes gradients along where both have them
        self.method.add_prediction(b, clock)
        m.A.aside.zero_()
        self.forget()
        self.forces(clock)
        if contacts:
            state = self.bear(rate, found=True)
            self.seed(contacts, state, a.grad, clock)
        else:
            self.run("free", [w, self.y], [self.r])
        self.system(rate)
        self.solve_krylov(self.product, EXACT[self.name], MOST, clock)
        self.run("worst", self.sums[2:], [self.left], 1)
        if contacts and contacts.after:
            contacts.run("joined", [contacts.frame.W, self.sum, contacts.given], [self.p])
        elif contacts:
            contacts.run("spread_out", [contacts.frame.W, self.sum], [self.p])
        else:
            wp.copy(self.p, self.sum)
        self.turned(self.p, True, clock)
        self.run("spread", [w, self.p, self.y, self.pair.grad, rate, b.grad, a.grad], [])
        self.run("weigh", [w, self.p, self.d, self.b, rate, w.grad], [])
        if contacts:
            self.run("product", [w, self.p, self.pair.grad, rate], [self.q])
            contacts.back(state, self.q, self.sum, self.y, a.grad)
        self.model.launch(newton_adjoint.gradient_transfer_kernel(self.x.dtype), self.model.points, [self.x.grad, x.grad], [])

    def seed(self, contacts: ActiveSetAdjoint, state, by_a: wp.array, clock) -> None:
        """r becomes the right side, from y: with what pushes give, where something reads them behind the solve."""
        if not contacts.after:
            contacts.run("spread_out", [contacts.frame.S, self.y], [self.r])
            return
        w, rate = self.assembly.rows.w, 1.0 / clock.effective_step
        contacts.pushed(state, self.y, by_a, w.grad)
        self.turned(contacts.given, False, clock)
        self.run("product", [w, contacts.given, self.pair.grad, rate], [self.q])
        contacts.run("remainder", [contacts.frame.S, self.y, self.q], [self.r])

    def solve_krylov(self, product, tolerance: float, most: int, clock) -> None:
        """sum becomes B^-1 r, q = product(z) = B z; the last sums are those of r then, and as it was."""
        m = self.assembly
        rq, qq, rr, first = self.sums
        self.sum.zero_()
        self.directions.begin()
        wp.copy(first, self.dot(self.r, self.r, 2))
        self.turns.zero_()

        def test_krylov_residual() -> None:
            self.run("going", [rr, first, tolerance, most, self.turns], [self.turning], 1)

        def step_krylov() -> None:
            m.solve(self.r, INNER, CAP)
            product(m.v.y, clock)
            self.directions.turn(m.v.y, self.q)
            self.dot(self.r, self.q, 0)
            self.dot(self.q, self.q, 1)
            self.run("add", [self.sum, m.v.y, rq, qq, 1.0], [self.sum])
            self.run("add", [self.r, self.q, rq, qq, -1.0], [self.r])
            self.directions.keep(m.v.y, self.q, qq, self.turns)
            self.dot(self.r, self.r, 2)
            test_krylov_residual()
        test_krylov_residual()
        wp.capture_while(self.turning, step_krylov)

    def tangent(self, z: wp.array, clock) -> None:
        """q = B z of what is left, as if the Jacobian were symmetric: so it is but for damping."""
        contacts = self.contacts
        assert contacts is not None
        self.turned(z, False, clock)
        self.run("product", [self.assembly.rows.w, z, self.pair.grad, 1.0 / clock.effective_step], [self.q])
        contacts.run("given", [contacts.frame, self.q, z], [self.q])

    def product(self, z: wp.array, clock) -> None:
        """q = B z, of the transposed Jacobian."""
        w, rate, contacts = self.assembly.rows.w, 1.0 / clock.effective_step, self.contacts
        p = z
        if contacts:
            p = self.p
            contacts.run("spread_out", [contacts.frame.W, z], [p])
        self.turned(p, False, clock)
        self.run("product", [w, p, self.pair.grad, rate], [self.q])
        if contacts:
            contacts.run("taken_back", [contacts.frame, self.q, z], [self.q])
