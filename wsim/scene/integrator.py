"""Time integrators as data: the coefficients by which one driver steps x' = v, v' = a(x, v), and how far each can go.

    explicit, stages (c, b):     x_s = x + c h v_(s-1),  v_s = v + c h a_(s-1),  a_s = a(x_s, v_s)
                                 x' = x + h sum b v_s,   v' = v + h sum b a_s        (Runge-Kutta of low storage)
    explicit, kicks and drifts:  v += kick h a(x, v),    x += drift h v              (one of each, or a kick before and one
                                 behind a whole drift, which is one with the next step's)
    implicit, g over h:          v' = v~ + g a(x', v'),  x' = a~ + g v', see kernels/motion/points.py, at the `nodes` of a
                                 step, one solve each; a single node before its end is prolonged to it (`beyond`); with
                                 `memory`, v~ and a~ carry on a part of the step before

`order` is that of the error in x and v after a fixed time, with damping too. The largest step h of the explicit ones is for
the mode x'' = -omega^2 x - c x'; `wsim.physics.motion.stability` computes it for any omega and c.

Hairer, Lubich, Wanner 2006, Geometric Numerical Integration, I.1 and VI.3; Hairer, Norsett, Wanner 1993, II.1 and III.1.
sdirk3: Norsett 1974, Crouzeix 1975; Hairer, Wanner 1996, Solving Ordinary Differential Equations II, IV.6, eq. 6.18.
"""

from dataclasses import dataclass
from math import inf

GAMMA = (3.0 + 3.0**0.5) / 6.0           # diagonal of sdirk3: the one that makes it stable for every h


@dataclass(frozen=True)
class Integrator:
    """One method; `stable` says for which steps, `limit_undamped` is h omega of the explicit ones at c = 0."""

    name: str
    order: int
    stable: str
    stages: tuple[tuple[float, float], ...] = ()      # (c, b)
    steps: tuple[tuple[float, float], ...] = ()       # (kick, drift)
    g: float = 0.0                                    # effective step over h; 0: explicit
    nodes: tuple[float, ...] = ()                     # where in a step each of its solves finds positions
    memory: float = 0.0                               # part of the step before, and of its change of velocity
    met: tuple[float, float] = (inf, inf)             # largest residuals with which it goes on, see below; inf: any
    title: str = ""                                   # in a sentence
    motion: str = "wsim.physics.motion.points.Euler"  # the class that predicts, and ends a substep
    limit_undamped: float = 0.0                       # 0: grows at any h

    def __post_init__(self) -> None:
        if self.steps and [drift for _, drift in self.steps] not in ([1.0], [1.0, 0.0]):
            raise ValueError(f"integrator {self.name}: steps are {self.steps}; allowed: one kick and a drift of 1, or two "
                             "kicks with drifts of 1 and 0; write other methods as stages")

    @property
    def explicit(self) -> bool:
        return self.g == 0.0

    @property
    def solves(self) -> int:
        """Systems a step, each a substep of the clock."""
        return len(self.nodes) or 1

    @property
    def beyond(self) -> bool:
        """True if a step is prolonged from its one node to its end."""
        return self.nodes != (1.0,) and len(self.nodes) == 1

    @property
    def rebounds(self) -> bool:
        """True if what is found at nodes says too little of bodies that give way, at the end of a step."""
        return self.beyond or self.solves > 1

    @property
    def watched(self) -> bool:
        """True if it may go on only while its residual is met; else backward Euler takes over."""
        return min(self.met) < inf

    @property
    def lags(self) -> bool:
        """True if a lasting push at the end of explicit steps gives half of its velocity: what rests is read so."""
        return self.explicit and self.order > 1

    @property
    def forces(self) -> int:
        """Evaluations of a(x, v) a step."""
        return len(self.stages) or 1

    @property
    def moments(self) -> tuple[float, ...]:
        """Parts of an explicit step at which forces see prescribed points: those of its stages, and its end."""
        return (*sorted({c for c, _ in self.stages if 0.0 < c < 1.0}), 1.0)

    @property
    def after(self) -> tuple[float, ...]:
        """Part of an explicit step at which points are after each evaluation of the forces."""
        return (*(c for c, _ in self.stages[1:]), 1.0)


# `met`: of Newton's method (kernels/solver/line_search.py, `left`), and of XPBD's sweeps (strain, radians).
# BDF2       Newton: 32 x 32 cloth, 1e3 N/m, 1 to 8 substeps: runs that left up to 1.5 were as right as solved ones, with 8 or
#            more not; float32 leaves 1e-3 at best, 0.2 with 1e5 N/m. XPBD: on a 32 x 32 cloth of 1e3 to 1e6 N/m the runs that
#            gained energy had a median of 8e-2 to 1.7e-1, those of 10 substeps or more that did not, at most 2.1e-2. Larger
#            cloths stayed calm at 3e-2 too and give way all the same: on the safe side
# midpoint   it damps nothing of what is left. Newton: rows of tools/stress (nets scattered, or in one place) gained energy with
#            0.1, and did not with this. XPBD: others (folded net and sheet, gravity that turns) with 5e-3, and not with this
# sdirk3     a scrambled bar of nu 0.49 stayed so with 0.5, and came back with this; XPBD as BDF2
TABLE = {m.name: m for m in (
    Integrator("explicit_euler", 1, "h c < 2 of what decays; any oscillation grows by (h omega)^2 / 2 a step",
               stages=((0.0, 1.0),)),
    # the same map as leapfrog, read half a step off
    Integrator("symplectic_euler", 1, "h omega < 2", steps=((1.0, 1.0),), limit_undamped=2.0),
    # symplectic (velocity Verlet); damping acts on v~ = v + h a_before / 2, so that it is of order 2 as well
    Integrator("leapfrog", 2, "h omega < 2, h c < 1", steps=((0.5, 1.0), (0.5, 0.0)), limit_undamped=2.0),
    Integrator("midpoint", 2, "h c < 2; any oscillation grows by (h omega)^4 / 8 a step", stages=((0.0, 0.0), (0.5, 1.0))),
    Integrator("rk4", 4, "h omega < 2.828, h c < 2.785",
               stages=((0.0, 1 / 6), (0.5, 1 / 3), (0.5, 1 / 3), (1.0, 1 / 6)), limit_undamped=8.0**0.5),
    # damps: the amplitude of a mode falls by 1 / sqrt(1 + h^2 omega^2) a step
    Integrator("backward_euler", 1, "every h", g=1.0, nodes=(1.0,), title="backward Euler"),
    # keeps the energy of linear systems, does not damp what it does not resolve
    Integrator("implicit_midpoint", 2, "every h, if the step is solved to its residual", g=0.5, nodes=(0.5,),
               met=(1e-2, 1e-3), title="the implicit midpoint", motion="wsim.physics.motion.points.ProlongedEuler"),
    # damps only what it does not resolve
    Integrator("bdf2", 2, "every h, if the step is solved to its residual", g=2.0 / 3.0, nodes=(1.0,), memory=1.0 / 3.0,
               met=(0.5, 2e-2), title="BDF2", motion="wsim.physics.motion.points.Multistep"),
    # damps what it does not resolve, by up to 0.73 a step; first frequency of h omega = 0.14 within 3.4e-5 (midpoint 1.6e-3)
    Integrator("sdirk3", 3, "every h, if both stages of a step are solved to their residual", g=GAMMA,
               nodes=(GAMMA, 1.0 - GAMMA), met=(0.1, 2e-2), title="sdirk3", motion="wsim.physics.motion.points.Staged"),
)}
SOLVERS = ("auto", "explicit", "xpbd", "implicit")
INTEGRATORS = ("auto", *TABLE)
EXPLICIT = tuple(name for name, m in TABLE.items() if m.explicit)
IMPLICIT = tuple(name for name, m in TABLE.items() if not m.explicit)
