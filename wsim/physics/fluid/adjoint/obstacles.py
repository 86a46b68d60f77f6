"""Adjoint of the velocities of obstacles that move: kernels/fluid/adjoint/obstacles.py."""

from typing import Any

from wsim.kernels.fluid.adjoint import covering, obstacles
from wsim.physics.fluid.adjoint.launches import AdjointLaunches


class ObstaclesAdjoint:
    """numbers: of each obstacle, what its velocity and its turning got, summed over the steps of a frame, float64."""

    def __init__(self, launches: AdjointLaunches, by_solid: Any):
        self.launches, domain = launches, launches.domain
        self.obstacles, self.by = domain.obstacles, by_solid
        dim, real, module = domain.layout.dim, launches.real, launches.module
        kinds = self.obstacles.shapes.kinds
        self.covers = [obstacles.cover_adjoint_kernel(dim, a, kinds, real, module) for a in range(dim)]
        self.gather = covering.number_sum_kernel(module)
        self.part = domain.threads.zeros(launches.parts, covering.Numbers)
        self.numbers = domain.threads.zeros(len(self.obstacles.shapes.things), covering.Numbers)

    def back(self) -> None:
        """Takes what the step has left in `by`."""
        run, table = self.launches, self.obstacles.shapes.table
        for a, by in run.each(self.by):
            for k in range(self.numbers.size):
                run.blocks(self.covers[a], run.parts, [run.domain.grid, table, k, run.domain.clock, by], [self.part])
                run.over(self.gather, 1, [self.part, k], [self.numbers])
