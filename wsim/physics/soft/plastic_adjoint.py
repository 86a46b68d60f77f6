"""Adjoint of plastic flow (`wsim.physics.soft.plastic`): kernels/soft/plastic_adjoint.py."""

import warp as wp

from wsim.kernels.cloth import corner_gradients as gathers
from wsim.kernels.math.real import types
from wsim.kernels.soft import plastic_adjoint as maths
from wsim.model.tape import adjoint_of
from wsim.model.vjp import Backward, fixed_adjoint


class FlowAdjoint:
    """The adjoint of the flow of plastic tets, and of their shapes at rest."""

    def __init__(self, flow):
        """flow: a `wsim.physics.soft.plastic.PlasticFlow`. `join` says where points find the corners of its tets."""
        self.flows, self.model = flow, flow.model
        real, module = self.model.real, self.model.module
        self.kernels = maths.flow_adjoint(real, module), maths.shape_adjoint(real, module)
        self.take = gathers.corner_range_kernel(real, module)
        self.corners = wp.zeros(4 * flow.table.size, dtype=types(real).vec3, device=self.model.device)
        self.vjp = {flow.flow_kernel: fixed_adjoint(self.flow)}

    def join(self, net, first: int) -> None:
        self.net, self.first = net, first

    def flow(self, read: list, wrote: list) -> None:
        """Adjoint of the launch of the flow; what of a version has not flowed is left to the copy that it began as."""
        (data, table, x, d, q, F), (after,) = read, wrote
        self.flows.shape_from_flow(F)
        seen = maths.flow_gradients(self.model.real)()
        seen.x, seen.d, seen.q, seen.F, seen.by_F, seen.by_F_out, seen.corners = x, d, q, F, F.grad, after.grad, self.corners
        self.model.launch(self.kernels[0], self.flows.table.size, [data, table, seen, adjoint_of(data)], [])
        last = self.first + self.corners.size
        self.model.launch(self.take, self.model.points,
                          [self.net, self.corners, self.first, last, self.first, d.grad, x.grad], [])

    def shape(self, F: wp.array) -> None:
        """Passes from the gradients of edges at rest to those of a version of F_p."""
        data = self.flows.data
        self.model.launch(self.kernels[1], self.flows.table.size,
                          [data, F, self.flows.table.data.edge.grad, adjoint_of(data), F.grad], [])

    def around(self, backward: Backward) -> Backward:
        """The adjoint of forces at the edges and gradients that they have read; these hand on what they get."""
        F = self.model.tape.read(self.flows.F)

        def hand_back_shape(read: list, wrote: list) -> None:
            self.flows.shape_from_flow(F)
            backward(read, wrote)
            self.shape(F)
        return hand_back_shape
