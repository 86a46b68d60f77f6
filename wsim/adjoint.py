"""Implicit substeps with gradients: solved to a residual, and differentiated by one adjoint solve. See kernels/adjoint.py.

The solve is Newton's method of `wsim.implicit`, with full steps at its end; the adjoint is a conjugate gradient method whose
products are adjoints of the forces (exact, with damping and all second derivatives) and whose preconditioner is the solver of
`wsim.linear` for the positive part. With damping the Jacobian is not symmetric where a force depends on velocities in
another way than on positions; stiffness-proportional damping keeps it nearly so, and what is left is measured:

    missed    forces that the worst solve has left, over those of inertia, |own (d - a)|
    left      residual of the worst adjoint solve, over its right side
"""

import warp as wp

from wsim.force_adjoint import Forces
from wsim.gather import Pull
from wsim.kernels import adjoint
from wsim.kernels.real import types
from wsim.tape import without
from wsim.touching_adjoint import PinsAdjoint

CLOSE = {"float32": 1e-5, "float64": 1e-13}     # forces left over those of inertia, |own (d - a)|
EXACT = {"float32": 1e-6, "float64": 1e-12}     # of the adjoint solve, over its right side
MOST = 60              # full Newton steps, and iterations of the adjoint solve, at most
INNER, CAP = 1e-2, 300


class ImplicitAdjoint(Forces):
    """The implicit solve of a substep, forward to its residual and backward."""

    def __init__(self, method, rows: list):
        """method: `wsim.implicit.Implicit`; rows: its springs, hinges and triangles, of all worlds."""
        self.method, model = method, method.model
        super().__init__(model, Pull(model, method.points.constants, rows, None), model.module)
        module, n, real, t = model.module, model.points, model.real, types(model.real)
        both = zip(self.pull.tables, method.solids, strict=True)
        self.plastic = [self.share(own, live) for own, live in both if live.plastic]
        self.kernels = {f.__name__: f(real, module) for f in (adjoint.pairs, adjoint.residual, adjoint.product, adjoint.free,
                                                              adjoint.spread, adjoint.dot, adjoint.add, adjoint.going,
                                                              adjoint.worst, adjoint.weigh)}

        def over(count):
            return wp.zeros(count, dtype=t.vec3, device=model.device)
        self.d, self.a, self.b, self.y, self.sum = (over(n) for _ in range(5))
        self.p, self.q, self.r, self.z, self.old, self.scale = (over(n) for _ in range(6))
        lanes = 1024 if model.device.is_cuda else 1
        self.sums = [wp.zeros(lanes, dtype=wp.float64, device=model.device) for _ in range(5)]
        self.count, self.on = (wp.zeros(1, dtype=int, device=model.device) for _ in range(2))
        self.missed, self.left = (wp.zeros(1, dtype=wp.float64, device=model.device) for _ in range(2))
        self.name = "float32" if real is wp.float32 else "float64"
        self.pins: PinsAdjoint | None = None

    @staticmethod
    def share(own, live):
        """The flow of a table of `method`, whose shapes at rest the forces here read too."""
        live.plastic.adjoint.join(own.plastic.adjoint.net, own.plastic.adjoint.first)
        own.plastic, own.flows, own.data.edge, own.data.gradient = live.plastic, False, live.data.edge, live.data.gradient
        return live.plastic

    def join(self) -> None:
        """Takes what the method has taken into its system."""
        if self.method.pins:
            self.pins = PinsAdjoint(self.model, self.method.pins, self.method.soft)

    def forces(self, clock) -> None:
        """f at d, with velocities (d - a) / g, and of soft pins."""
        self.run("pairs", [self.d, self.a, 1.0 / clock.g], [self.pair])
        self.evaluate()
        if self.pins:
            self.pins.add(self.x, self.pair, clock.k, self.f)

    def turned(self, p: wp.array, whole: bool, clock) -> None:
        """As `transposed`, of soft pins too."""
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
        m, s = self.method, self.method.state
        rate, w = 1.0 / clock.g, m.rows.w
        m.c.zero_()                                      # a substep depends on nothing but its own start
        wp.copy(self.b, s.d)
        for i in range(clock.iterations):
            clock.i = i
            m.newton(clock)
        self.count.zero_()

        def look() -> None:
            wp.copy(self.d, s.d)
            self.forces(clock)
            self.run("residual", [w, self.f, self.d, self.b, self.a, rate], [self.r, self.scale])
            self.run("going", [self.dot(self.r, self.r, 0), self.dot(self.scale, self.scale, 1), CLOSE[self.name], MOST,
                               self.count], [self.on], 1)

        def step() -> None:
            m.linearise(rate)
            m.system.solve(self.r, INNER, CAP, (s.x, s.d))
            self.run("add", [s.d, m.v.y, self.sums[1], self.sums[1], 1.0], [s.d])
            look()
        wp.copy(self.a, m.points.anchor)
        wp.copy(self.x, s.x)
        look()
        wp.capture_while(self.on, step)
        self.run("worst", self.sums[:2], [self.missed], 1)

    # backward

    def back(self, clock, d: wp.array, b: wp.array, x: wp.array, a: wp.array) -> None:
        """From the gradient of d to those of b, x, a and all parameters; each array with its gradient, which is added to."""
        m, s = self.method, self.method.state
        rate, w, system = 1.0 / clock.g, self.method.rows.w, self.method.system
        for into, source in ((self.d, d), (self.a, a), (self.b, b), (self.x, x), (s.d, d), (s.x, x), (m.points.anchor, a),
                             (self.y, d.grad)):
            wp.copy(into, without(source))               # a copy takes gradients along where both have them
        m.prepare(b, clock)
        m.A.aside.zero_()
        m.linearise(rate)
        self.forces(clock)
        self.run("free", [w, self.y], [self.r])
        system.solve(self.r, INNER, CAP, (s.x, s.d))
        self.sum.zero_()
        for into in (self.z, self.p):
            wp.copy(into, m.v.y)
        rz, pq, rr, first, change = self.sums
        self.dot(self.r, self.z, 0)
        self.dot(self.r, self.r, 2)
        wp.copy(first, rr)
        self.count.zero_()

        def look() -> None:
            self.run("going", [rr, first, EXACT[self.name], MOST, self.count], [self.on], 1)

        def step() -> None:
            self.turned(self.p, False, clock)
            self.run("product", [w, self.p, self.pair.grad, rate], [self.q])
            self.dot(self.p, self.q, 1)
            self.run("add", [self.sum, self.p, rz, pq, 1.0], [self.sum])
            wp.copy(self.old, self.r)
            self.run("add", [self.r, self.q, rz, pq, -1.0], [self.r])
            self.dot(self.r, self.r, 2)
            system.solve(self.r, INNER, CAP, (s.x, s.d))
            wp.copy(self.z, m.v.y)
            self.run("add", [self.r, self.old, first, first, -1.0], [self.old])
            self.dot(self.z, self.old, 4)                # flexible: the preconditioner differs from step to step
            self.run("add", [self.z, self.p, change, rz, 1.0], [self.p])
            self.dot(self.r, self.z, 0)
            look()
        look()
        wp.capture_while(self.on, step)
        self.run("worst", [rr, first], [self.left], 1)
        self.turned(self.sum, True, clock)
        self.run("spread", [w, self.sum, self.y, self.pair.grad, rate, b.grad, a.grad], [])
        self.run("weigh", [w, self.sum, self.d, self.b, rate, w.grad], [])
        self.model.launch(adjoint.give(self.x.dtype), self.model.points, [self.x.grad, x.grad], [])
