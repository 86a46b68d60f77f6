"""Tables of constraints in the order of their colours, as XPBD projects them. See kernels/solver/xpbd.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.sheet_ordering import lowest_point_of_constraint
from wsim.geometry.topology import order_of
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver import xpbd as kernels
from wsim.model.model import Model
from wsim.model.stage import Clock
from wsim.model.structs import fill_struct
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import SHEET
from wsim.physics.cloth.table import ConstraintTable

FUSE = 512            # constraints of a world's largest colour up to which one block takes all its colours in a launch. H200:
                      # 1k points 9.9 us against 18.6; a shirt with 1.3k hinges a colour 4.1 ms a frame against 1.3. H100, 4096
                      # worlds of 1k points, a frame of one: 2.9 us by blocks of 512 threads, 3.1 of 256, 4.6 of 128
PACKED = True          # membranes and hinges by eights on a CPU: tests compare


class ColouredBatch(ConstraintTable):
    """All constraints of one kind, on the device, by colour."""

    def __init__(self, kind: str, rows: list[Constraints], model: Model, clock: Clock):
        colors = np.concatenate([r.colors for r in rows if r.colors is not None])
        ids = np.concatenate([r.ids for r in rows]).astype(np.int32)
        super().__init__(model, kind, rows,
                         order_of(colors.astype(np.int64) * (model.points + 1) + lowest_point_of_constraint(ids)))
        self.hard, sheet = self.row.hard, self.row.gather == SHEET
        self.starts = np.concatenate([[0], np.cumsum(np.bincount(colors))])
        self.multipliers = clock.iterations > 1 or clock.watched or model.gradients
        self.damped = any(r.tau > 0.0 for r in rows)
        paths = {r.body.path for r in rows if r.body is not None}
        self.uniform = len(paths) == model.worlds == 1 and self.one() and not model.gradients and not sheet
        self.worlds = 1 if model.gradients else model.worlds          # blocks of a sweep; with adjoints there is one
        largest = int(np.diff(self.starts).max()) // self.worlds
        self.fused = FUSE > 0 and not model.fuser and (not model.device.is_cuda or largest <= FUSE)
        self.packed = PACKED and self.fused and model.device.is_cpu and self.row.packets and self.kind != "distance"
        self.packed = self.packed and not model.gradients             # eight constraints at a time
        self.remade = False
        self.adjoint: Any = None
        _, self.kernel = self.make()
        self.begin = model.upload(self.starts.astype(np.int32), int)
        each = np.diff(self.starts) // self.worlds
        self.colours = model.upload(np.stack([self.starts[:-1], each], 1).astype(np.int32), wp.vec2i)
        self.add_compliances()
        if self.damped:
            self.relax()
        value = types(model.real).vec3 if self.matrices else model.real
        self.lam = wp.zeros(self.size if self.multipliers else 0, dtype=value, device=model.device)
        if sheet:
            self.curve()
        self.adjoint = beside(model, "wsim.physics.solver.xpbd", "SweepAdjoint", self, model)

    def one(self) -> bool:
        """True if all have the same compliance and relaxation time."""
        alpha, tau = self.values()
        return bool(np.all(alpha == alpha[0]) and np.all(tau == tau[0]))

    def curve(self) -> None:
        """Hinges get angles at rest from the curvatures of their sheets, each time that they are swept."""
        from wsim.kernels.cloth import curvature
        from wsim.physics.cloth.curvature import Curvature
        model, data = self.model, self.data
        self.lengths, data.rest = data.rest, wp.zeros_like(data.rest)
        self.curvature = Curvature(model, self.rows, self.order, apart=self.packed)
        if self.packed:
            from wsim.kernels.solver.sweeps import packets
            self.targets = packets.rest_angle_kernel(model.real, model.module, self.damped)
            self.curvature.room()
            return
        self.angles = curvature.hinge_angle_kernel(model.real, model.module, self.damped)
        self.targets = curvature.target_angle_kernel(model.real, model.module)

    def left(self, x: wp.array, e: wp.array, rate: float) -> float:
        """Largest residual that sweeps have left at x + e, by the host in float64; rate: 1 / h [1/s]. `aim` has said before
        what hinges want."""
        from wsim.physics.cloth.kinds import swept
        ids, data = self.data.point.numpy(), self.data
        places = x.numpy().astype(np.float64) + e.numpy()
        rest, alpha, lam, w = (a.numpy().astype(np.float64) for a in (data.rest, data.alpha, self.lam, data.w))
        return swept.KINDS[self.kind](places[ids], rest, rate * rate * alpha, lam, w[ids])

    def aim(self, x: wp.array, d: wp.array, a: wp.array | None, rate: float) -> None:
        """Angles at rest for what stands at x + d now: see kernels/cloth/curvature.py."""
        launch, cur = self.model.launch, self.curvature
        if cur and self.packed:
            at = fill_struct(point_states(self.model.real), x=x, d=d, a=a)
            launch(self.targets, 1, [self.data, self.lengths, at, rate, cur.data], [self.data.rest])
        elif cur:
            launch(self.angles, self.size, [self.data, self.lengths, x, d, a, rate, cur.data], [])
            cur.launch_sums()
            launch(self.targets, self.size, [self.data, self.lengths, cur.data], [self.data.rest])

    def make(self) -> tuple:
        """Struct of the table, and the kernel."""
        model = self.model
        kind = {"real": model.real, "multipliers": self.multipliers, "damped": self.damped, "uniform": self.uniform,
                "exact": model.gradients}
        if not self.fused:
            return kernels.xpbd_projection_kernel(self.row.equation, module=model.module, **kind)
        if self.packed:
            from wsim.kernels.solver.sweeps import packets
            return packets.simd_sweep_kernel(self.row.equation, module=model.sweep_module, **kind)
        return kernels.xpbd_sweep_kernel(self.row.equation, module=model.sweep_module, **kind)

    def omega(self, clock: Clock) -> float:
        """Over-relaxation of this iteration."""
        return 1.0 if self.hard else clock.omega

    def given(self, lengths: wp.array) -> None:
        super().given(lengths)
        if self.adjoint:
            self.adjoint.refresh()

    def refresh(self) -> None:
        """Makes other arrays and kernel where all compliances were one and are no more."""
        self.remade = False
        super().refresh()

    def renew(self) -> None:
        self.remade = self.uniform and not self.one()
        if self.remade:
            self.uniform, self.data.alpha, self.data.tau = False, None, None
            _, self.kernel = self.make()
            self.add_compliances().relax()
        super().renew()
        if self.adjoint:
            self.adjoint.refresh()

    @property
    def bytes(self) -> int:
        """Bytes moved by one iteration, when every gather hits the cache once: tables, multipliers, x, d, w, d out."""
        real = np.dtype(self.model.dtype).itemsize
        k = self.rows[0].ids.shape[1]
        return self.size * (4 * k + real * (1 + (not self.uniform) + 2 * self.multipliers)
                            + k * real * (10 + 3 * self.damped))
