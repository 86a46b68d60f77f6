"""Adjoints of `wsim.physics.motion.forces` and of a leap, by hand: see kernels/motion/explicit_adjoint.py."""

from functools import partial
from typing import Any

import warp as wp

from wsim.kernels.cloth import corner_gradients as gathers
from wsim.kernels.cloth import curvature
from wsim.kernels.cloth import curvature_adjoint as bent
from wsim.kernels.cloth import element_adjoint as flat
from wsim.kernels.math.real import types
from wsim.kernels.motion import explicit_adjoint as kernels
from wsim.kernels.soft import fem_adjoint as tets
from wsim.kernels.solver import newton_adjoint
from wsim.model.model import Model
from wsim.model.tape import adjoint_of, without_gradient
from wsim.model.vjp import fixed_adjoint, of_table, taken_along


class ForceAdjoint:
    """The adjoint of the forces of a `Pull`: `p` is the gradient by the forces on points."""

    def __init__(self, model: Model, pull, masses: bool, module: str = ""):
        """pull: a `wsim.physics.motion.forces.ForceGather`; masses: p is that by accelerations times inverse masses, which have
        gradients too."""
        self.model, self.pull, self.p, module = model, pull, pull.p, module or model.module
        flags = pull.flags() if not pull.direct else tuple((dict(pull.flags()) | {"corners": False}).items())
        self.kernels = [kernels.force_adjoint(model.real, module, flags, parameters, masses)
                        for parameters in (False, True)] if pull.springs or not pull.direct else []
        self.lanes = pull.lanes if pull.direct else 1
        self.leap_adjoint = kernels.leap_adjoint(model.real, module, pull.direct, self.lanes) if masses else None

    def into(self, x: wp.array, pair: wp.array, force: wp.array | None):
        """Arrays where gradients go."""
        g = kernels.point_gradients(self.model.real)()
        g.p, g.x, g.pair, g.corner = self.p, x.grad, pair.grad, None if force is None else force.grad
        return g

    def launch(self, x: wp.array, pair: wp.array, force: wp.array | None, source: int, parameters: bool = True) -> None:
        """Passes from `p` to the gradients of all arrays that the forces are made of; parameters: those of springs and x too.
        Corners that know p by themselves are left out."""
        if self.kernels:
            self.model.launch(self.kernels[parameters], self.model.points * self.pull.lanes,
                              [self.pull.net, force, x, pair, source, adjoint_of(self.pull.net), self.into(x, pair, force)],
                              [])

    def leap(self, read: list, wrote: list) -> None:
        """Adjoint of the launch of a leap, of the arrays that it has read and written."""
        (net, force, at, step), (pair_out, v_out, _) = read, wrote
        out = kernels.leap_gradients(self.model.real)()
        out.pair, out.v = pair_out.grad, v_out.grad
        self.model.launch(self.leap_adjoint, self.model.points * self.lanes,
                          [net, force, at.d, step, out, at.v.grad, adjoint_of(net), self.into(at.x, at.d, force)], [])
        self.launch(at.x, at.d, force, step.source)


class LeapAdjoint(ForceAdjoint):
    """The adjoint of the launches of a leap."""

    def __init__(self, pull, leap):
        """leap: the kernel."""
        super().__init__(pull.model, pull, masses=True)
        self.vjp = {leap: fixed_adjoint(self.leap)}


def element_adjoint(pull, element):
    """Adjoint of the forces of an element of a `wsim.physics.motion.forces.ForceGather`."""
    if hasattr(element, "kind"):
        return (BentAdjoint if element.curvature else FlatAdjoint)(pull.model, element, pull)
    table = element.table
    if table.plastic:
        table.plastic.adjoint.join(pull.net, element.first)
    return CornerAdjoint(pull.model, table, pull)


class Forces:
    """Forces f of a `Pull` with gradients at x and at `pair`, displacements and velocities; products with their derivatives."""

    def __init__(self, model: Model, pull, module: str):
        self.model, self.pull, vec3 = model, pull, types(model.real).vec3

        def zero_gradient_vectors(count, grad=True):
            return wp.zeros(count, dtype=vec3, device=model.device, requires_grad=grad)
        n = model.points
        self.x, self.pair, self.f = zero_gradient_vectors(n), zero_gradient_vectors(4 * n), zero_gradient_vectors(n, False)
        self.corner = None if pull.force is None else zero_gradient_vectors(pull.force.size, not pull.direct)
        flags = dict(pull.flags()) | {"lanes": 1, "sums": 1}                   # a thread a point
        self.force = newton_adjoint.implicit_force_kernel(model.real, module, tuple(flags.items()))
        self.back_force = ForceAdjoint(model, pull, False, module)
        self.launches: list[tuple] = []                  # of forces of corners

    def evaluate(self) -> None:
        """f."""
        if not self.launches:
            self.model.tape, before = self, self.model.tape          # collects what is launched
            try:
                for e in self.pull.elements:
                    for run in e.passes(self.x, self.pair, 0, self.corner):
                        run()
            finally:
                self.model.tape = before
        for kernel, dim, inputs, outputs, _, _, how in self.launches:
            wp.launch(kernel, dim, inputs, outputs, **how)
        self.model.launch(self.force, self.model.points, [self.pull.net, self.corner, self.x, self.pair], [self.f])

    def launch(self, kernel, dim: int, inputs: list, outputs: list, **how) -> None:
        """Launch that `Model.launch` calls while this collects."""
        backward = self.model.vjp[kernel](inputs) if kernel in self.model.vjp else None
        self.launches.append((kernel, dim, inputs, outputs, [self.bare(a) for a in inputs], backward, how))

    def bare(self, a):
        """An argument without its gradient, but for pair and the forces on the way: an adjoint finds it by the array itself."""
        if hasattr(a, "_cls"):
            found = a._cls()
            for name in a._cls.vars:
                value = getattr(a, name)
                setattr(found, name, without_gradient(value) if isinstance(value, wp.array) else value)
            return found
        return without_gradient(a) if a is self.x else a

    def transposed(self, p: wp.array, whole: bool) -> None:
        """(df/d..)^T p into the gradients of pair and, if whole, of x and all parameters, to which it adds."""
        wp.copy(self.back_force.p, p)
        self.pair.grad.zero_()
        if self.corner is not None and not self.pull.direct:
            self.corner.grad.zero_()
        self.back_force.launch(self.x, self.pair, self.corner, 0, whole)
        for kernel, dim, inputs, outputs, bare, backward, how in reversed(self.launches):
            there = inputs if whole else bare
            if backward:
                backward(there, outputs)
                continue
            wp.launch(kernel, dim, there, outputs, adj_inputs=[adjoint_of(a) for a in there],
                      adj_outputs=[adjoint_of(a) for a in outputs], adjoint=True, **how)


class CornerAdjoint:
    """The adjoint of the forces of a table of tets, or of pressure."""

    def __init__(self, model: Model, table, pull):
        """table: of `wsim.physics.soft.fem`; pull: says which corners each point has, and whether p is all that is to be
        known."""
        nodes = table.ids.shape[1]
        make = {3: tets.pressure_adjoint_kernel, 4: tets.linear_adjoint_kernel, 10: tets.quadratic_adjoint_kernel}[nodes]
        kind = () if nodes == 3 else (table.material, table.damped)
        self.table, self.gathering = table, Gathering(model, pull, table, table.damped)
        self.kernels = [make(*kind, model.real, model.module, parameters, pull.direct) for parameters in (False, True)]
        self.vjp = of_table(model, table.pull, table.data, self.record)

    def record(self, inputs: list):
        """Adjoint of a launch to come; where tets flow before it, it hands on what their shapes at rest get."""
        flows = self.table.plastic and self.table.flows
        return self.table.plastic.adjoint.around(self.backward) if flows else self.backward

    def backward(self, read: list, wrote: list) -> None:
        """Adjoint of the launch of the forces, of the arrays that it has read and written; parameters only where x has a
        gradient."""
        (data, x, d, *others), g = read, self.gathering
        corners = g.corners(wrote[0])
        inputs = [data, x, d, *others, g.work(corners), adjoint_of(data)]
        g.model.launch(self.kernels[x.grad is not None], len(self.table.ids), inputs, [])
        g.gather(self.table.data.force, corners, d.grad, x.grad, others[0].grad if others else None)


class FlatAdjoint:
    """The adjoint of the forces of membranes, or of any kind that is known by its formula alone."""

    def __init__(self, model: Model, elements, pull):
        """elements, pull: of `wsim.physics.motion.forces`."""
        self.elements, self.gathering = elements, Gathering(model, pull, elements, elements.damped)
        make: Any = flat.membrane_adjoint_kernel
        if elements.row.equation.rows == 1:
            from wsim.kernels.cloth.general import corners_adjoint
            make = partial(corners_adjoint, elements.row.equation)
        self.kernels = [make(model.real, model.module, elements.damped, parameters, pull.direct)
                        for parameters in (False, True)]
        self.vjp = of_table(model, elements.kernel, elements.data, fixed_adjoint(self.backward))

    def backward(self, read: list, wrote: list) -> None:
        """Backward pass, as that of `CornerAdjoint`."""
        (data, x, pair, source, first), g, n = read, self.gathering, self.gathering.model.points
        corners = g.corners(wrote[0])
        inputs = [*read, g.work(corners), adjoint_of(data)]
        g.model.launch(self.kernels[x.grad is not None], len(self.elements.ids), inputs, [])
        rows = [pair.grad[k * n:(k + 1) * n] for k in (source, 2 + source)]
        g.gather(first, corners, rows[0], x.grad, rows[1])


class BentAdjoint:
    """The adjoint of the forces of hinges."""

    def __init__(self, model: Model, elements, pull):
        """elements, pull: of `wsim.physics.motion.forces`."""
        how = model.real, model.module, elements.damped
        self.elements, self.gathering = elements, Gathering(model, pull, elements, elements.damped)
        self.products, self.sums = (bent.bending_product_kernel(*how, pull.direct),
                                    curvature.curvature_sum_kernel(model.real, model.module, both=True))
        self.kernels = [bent.bending_adjoint_kernel(*how, parameters, pull.direct) for parameters in (False, True)]
        self.values = bent.curvature_adjoint_kernel(model.real, model.module)
        along = (elements.strained, elements.curvature.sums)
        self.vjp = (of_table(model, elements.kernel, elements.data, fixed_adjoint(self.backward))
                    | dict.fromkeys(along, fixed_adjoint(taken_along)))

    def backward(self, read: list, wrote: list) -> None:
        """Backward pass, as that of `CornerAdjoint`."""
        (data, x, pair, source, first, cur), g, e = read, self.gathering, self.elements
        model, n, whole, corners = g.model, g.model.points, x.grad is not None, g.corners(wrote[0])
        work = g.work(corners)
        model.launch(self.products, len(e.ids), [*read, work], [])
        model.launch(self.sums, e.curvature.triangles, [cur], [])
        model.launch(self.kernels[whole], len(e.ids), [*read, work, adjoint_of(data)], [])
        if whole:
            model.launch(self.values, e.curvature.triangles, [cur, adjoint_of(cur)], [])
        rows = [pair.grad[k * n:(k + 1) * n] for k in (source, 2 + source)]
        g.gather(first, corners, rows[0], x.grad, rows[1])


class Gathering:
    """The sum of what corners have into points: of all kinds at once where p is all that is to be known, else of each by
    itself."""

    def __init__(self, model: Model, pull, kind, damped: bool):
        """kind: what has `ids`, the points of its corners."""
        self.model, self.pull, self.damped, self.size = model, pull, damped, kind.ids.size
        first = pull.elements[0]
        self.last = kind in (first, getattr(first, "table", None))              # backwards
        self.take = (gathers.corner_gather_kernel(model.real, model.module, pull.lanes, pull.rates is not None)
                     if pull.direct else gathers.corner_range_kernel(model.real, model.module))

    def corners(self, force: wp.array) -> wp.array:
        """Arrays where their gradients go: those by these forces, or in their place."""
        return self.pull.by_corners or force.grad

    def work(self, corners: wp.array):
        found = gathers.adjoint_works(self.model.real)()
        found.p, found.corners, found.rates = self.pull.p if self.pull.direct else None, corners, self.pull.rates
        return found

    def gather(self, first: int, corners: wp.array, by: wp.array, also: wp.array | None, rate: wp.array | None) -> None:
        """Adds to the gradients by displacements, by x and by velocities. first: place of this kind's first corner."""
        net, n = self.pull.net, self.model.points
        if not self.pull.direct:
            self.model.launch(self.take, n, [net, corners, first, first + self.size, 0, by, also], [])
            if self.damped:
                self.model.launch(self.take, n, [net, self.pull.rates, first, first + self.size, 0, rate, None], [])
        elif self.last:                                           # corners of all kinds are written
            self.model.launch(self.take, n * self.pull.lanes, [net, corners, self.pull.rates, by, also, rate], [])
