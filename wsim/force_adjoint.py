"""Adjoints of `wsim.gather` and of a leap, by hand: see kernels/force_adjoint.py."""

import warp as wp

from wsim.kernels import force_adjoint as kernels
from wsim.kernels.real import types
from wsim.model import Model
from wsim.tape import adjoint_of


class ForceAdjoint:
    """Of the forces of a `Pull`: `p` is the gradient by the forces on points."""

    def __init__(self, model: Model, pull, masses: bool):
        """pull: a `wsim.gather.Pull`; masses: p is that by accelerations times inverse masses, which have gradients too."""
        self.model, self.pull = model, pull
        self.p = wp.zeros(model.points, dtype=types(model.real).vec3, device=model.device)
        self.kernels = [kernels.force_adjoint(model.real, model.module, pull.flags(), parameters, masses)
                        for parameters in (False, True)]
        self.leap_adjoint = kernels.leap_adjoint(model.real, model.module) if masses else None

    def into(self, x: wp.array, pair: wp.array, force: wp.array | None):
        """Where gradients go."""
        g = kernels.grads(self.model.real)()
        g.p, g.x, g.pair, g.corner = self.p, x.grad, pair.grad, None if force is None else force.grad
        return g

    def launch(self, x: wp.array, pair: wp.array, force: wp.array | None, source: int, parameters: bool = True) -> None:
        """From `p` to the gradients of all arrays that the forces are made of; parameters: those of springs and x too."""
        self.model.launch(self.kernels[parameters], self.model.points,
                          [self.pull.net, force, x, pair, source, adjoint_of(self.pull.net), self.into(x, pair, force)], [])

    def leap(self, read: list, wrote: list) -> None:
        """Adjoint of the launch of a leap, of the arrays that it has read and written."""
        (net, force, x, pair, v, _, step), (pair_out, v_out, _) = read, wrote
        out = kernels.outs(self.model.real)()
        out.pair, out.v = pair_out.grad, v_out.grad
        self.model.launch(self.leap_adjoint, self.model.points,
                          [net, pair, step, out, v.grad, adjoint_of(net), self.into(x, pair, force)], [])
        self.launch(x, pair, force, step.source)


class TetAdjoint:
    """Of the forces of a table of linear tets without damping."""

    def __init__(self, model: Model, table, net):
        """table: a `wsim.fem.Tetrahedra`; net: which corners each point has."""
        from wsim.kernels import tet_adjoint
        self.model, self.table, self.net = model, table, net
        self.kernels = [tet_adjoint.tet_adjoint(table.material, model.real, model.module, parameters)
                        for parameters in (False, True)]
        self.take = tet_adjoint.take(model.real, model.module)

    def backward(self, read: list, wrote: list) -> None:
        """Adjoint of the launch of the forces, of the arrays that it has read and written; parameters only where x has a
        gradient."""
        (tets, x, d, _, q), corners = read, wrote[0].grad
        first = self.table.data.force
        self.model.launch(self.kernels[x.grad is not None], self.table.size, [tets, x, d, q, corners, adjoint_of(tets)], [])
        self.model.launch(self.take, self.model.points, [self.net, corners, first, first + 4 * self.table.size, d.grad, x.grad],
                          [])
