"""All constraints of one kind on the device by colour, as XPBD projects them. See kernels/solver/xpbd.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.geometry.sheet_ordering import lowest
from wsim.geometry.topology import order_of
from wsim.kernels.math.real import types
from wsim.kernels.solver import xpbd as kernels
from wsim.model.model import Model
from wsim.model.stage import Clock
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import HARD, Constraints

FUSE = 512            # constraints of the largest colour up to which one block takes all colours in a launch. H200: 1k points
                      # 9.9 us against 18.6; a shirt with 1.3k hinges a colour 4.1 ms a frame against 1.3


class Batch:
    """All constraints of one kind, on the device, by colour."""

    def __init__(self, kind: str, rows: list[Constraints], model: Model, clock: Clock):
        self.kind, self.rows, self.model = kind, rows, model
        colors = np.concatenate([r.colors for r in rows if r.colors is not None])
        ids = np.concatenate([r.ids for r in rows]).astype(np.int32)
        self.order = order_of(colors.astype(np.int64) * (model.points + 1) + lowest(ids))
        self.starts = np.concatenate([[0], np.cumsum(np.bincount(colors))])
        self.size = len(ids)
        self.multipliers = clock.iterations > 1 or clock.watched or model.gradients
        self.stale = False
        self.damped = any(r.tau > 0.0 for r in rows)
        alpha, tau = self.values()
        paths = {r.body.path for r in rows if r.body is not None}
        self.uniform = len(paths) == model.worlds == 1 and bool(np.all(alpha == alpha[0]) and np.all(tau == tau[0])) \
            and not model.gradients and kind != "dihedral"
        self.fused = FUSE > 0 and (not model.device.is_cuda or int(np.diff(self.starts).max()) <= FUSE)
        self.remade = False
        table, self.kernel = self.make()
        self.first = model.upload(self.starts.astype(np.int32), int)
        t = types(model.real)
        self.data = table()
        self.data.point = model.upload(ids[self.order], wp.types.vector(ids.shape[1], int))
        rest = self.rest()
        self.data.rest = model.upload(rest, t.mat22 if rest.ndim == 3 else t.scalar)
        self.entry = t.vec4 if alpha.ndim == 2 else t.scalar
        self.data.alpha = self.send(alpha, self.entry)
        self.data.tau = self.send(tau, t.scalar) if self.damped else None
        self.lam = wp.zeros(self.size if self.multipliers else 0, dtype=t.vec3 if alpha.ndim == 2 else t.scalar,
                            device=model.device)
        self.lengths: wp.array | None = None          # rest values before muscles or curvatures change them
        self.curvature: Any = None                    # of hinges
        if kind == "dihedral":
            self.bend()
        self.adjoint = beside(model, "wsim.physics.solver.xpbd", "SweepAdjoint", self, model)

    def bend(self) -> None:
        """Hinges get angles at rest from the curvatures of their sheets, each time that they are swept."""
        from wsim.kernels.cloth import curvature
        from wsim.physics.cloth.curvature import Curvature
        model, data = self.model, self.data
        self.lengths, data.rest = data.rest, wp.zeros_like(data.rest)
        self.curvature = Curvature(model, self.rows, self.order)
        self.angles = curvature.angles(model.real, model.module, self.damped)
        self.targets = curvature.targets(model.real, model.module)

    def aim(self, x: wp.array, d: wp.array, a: wp.array | None, rate: float) -> None:
        """Angles at rest for what stands at x + d now: see kernels/cloth/curvature.py."""
        launch, cur = self.model.launch, self.curvature
        if cur:
            launch(self.angles, self.size, [self.data, self.lengths, x, d, a, rate, cur.data], [])
            cur.launch_sums()
            launch(self.targets, self.size, [self.data, self.lengths, cur.data], [self.data.rest])

    def make(self) -> tuple:
        """Struct of the table, and the kernel."""
        model = self.model
        make, module = (kernels.sweep, model.sweep_module) if self.fused else (kernels.projection, model.module)
        return make(self.kind, real=model.real, module=module, multipliers=self.multipliers, damped=self.damped,
                    uniform=self.uniform, exact=model.gradients)

    def rest(self) -> np.ndarray:
        """Rest values in the order of the table."""
        return np.concatenate([r.rest for r in self.rows])[self.order]

    def omega(self, clock: Clock) -> float:
        """Over-relaxation of this iteration."""
        return 1.0 if self.kind in HARD else clock.omega

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Compliance and relaxation time of each constraint in the order of the rows."""
        return (np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows]),
                np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows]))

    def send(self, values: np.ndarray, dtype) -> wp.array:
        return self.model.upload(values[:1] if self.uniform else values[self.order], dtype)

    def given(self, lengths: wp.array) -> None:
        """Rest lengths as they are without muscles."""
        self.lengths = lengths
        if self.adjoint:
            self.adjoint.refresh()

    def refresh(self) -> None:
        """Uploads the rows' rest values, compliances and relaxation times anew, into the same arrays. Where all compliances
        were one and are no more, arrays and kernel are others."""
        if not self.stale:
            return
        self.stale = self.remade = False
        (self.lengths or self.data.rest).assign(self.rest().astype(self.model.dtype))
        if self.curvature:
            self.curvature.refresh()
        if self.adjoint:
            self.adjoint.refresh()
        alpha, tau = self.values()
        if self.uniform and not (np.all(alpha == alpha[0]) and np.all(tau == tau[0])):
            self.uniform, self.remade = False, True
            _, self.kernel = self.make()
            self.data.alpha, self.data.tau = self.send(alpha, self.entry), self.send(tau, self.model.real)
            return
        self.data.alpha.assign(self.send(alpha, self.entry))
        if self.damped:
            self.data.tau.assign(self.send(tau, self.model.real))

    @property
    def bytes(self) -> int:
        """Moved by one iteration, when every gather hits the cache once: tables, multipliers, x, d, w, d out."""
        real = np.dtype(self.model.dtype).itemsize
        k = self.rows[0].ids.shape[1]
        return self.size * (4 * k + real * (1 + (not self.uniform) + 2 * self.multipliers)
                            + k * real * (10 + 3 * self.damped))
