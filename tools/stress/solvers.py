"""Solvers and integrators that rows run with, as data, and what is said of them beforehand."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

from tools.stress.energy import fastest
from wsim.scene import Scene
from wsim.scene.integrator import INTEGRATORS

MOST = 20_000         # substeps a second beyond which an explicit solver may refuse
GROWTH = 2e-3         # [1/s] at which the amplitude of an undamped spring may grow: 1 % of its energy in five seconds
COARSE = 10.0         # h omega from which on a mode of the midpoint decays 1 + (h omega / 2)^2 = 26 times slower than its drag
                      # says: exp(-10/s 3 s / 2 / 26) = 0.56 of it is left when a row has settled
SOLID = 1.5           # as COARSE, for soft bodies, whose forces are far from linear: from here on energy is seen to go up
STRETCHED = 1.5       # a soft body that is stretched by a tenth and more is stiffer than at rest, where `fastest` looks at it
UNRESOLVED = ("the midpoint hardly damps what its step does not resolve (h omega > 10), and keeps the energy of linear systems "
              "only")


@dataclass(frozen=True)
class Solver:
    """solver and integrator as `Scene` has them. needs: steps a second of an explicit one for omega [rad/s]."""

    solver: str
    integrator: str
    needs: Callable[[float], float] | None = None
    sweeps: bool = False         # coloured sweeps: strain left under load goes with h^2 / iterations

    @property
    def name(self) -> str:
        return f"{self.solver}/{self.integrator}"


def symplectic(omega: float) -> float:
    """h omega < 2 (Hairer, Lubich, Wanner 2006, I.1.4)."""
    return omega / 2.0


def runge_kutta_4(omega: float) -> float:
    """h omega < 2.83 (Hairer, Wanner 1996, IV.2)."""
    return omega / 2.83


def midpoint(omega: float) -> float:
    """Grows by (h omega)^4 / 8 a step: h^3 <= 8 GROWTH / omega^4."""
    return (omega**4 / (8.0 * GROWTH))**(1.0 / 3.0)


def euler(omega: float) -> float:
    """Grows by (h omega)^2 / 2 a step: h <= 2 GROWTH / omega^2."""
    return omega**2 / (2.0 * GROWTH)


SOLVERS = (
    Solver("auto", "auto"),
    Solver("xpbd", "backward_euler", sweeps=True),
    Solver("xpbd", "bdf2", sweeps=True),
    Solver("xpbd", "implicit_midpoint", sweeps=True),
    Solver("xpbd", "sdirk3", sweeps=True),
    Solver("implicit", "backward_euler"),
    Solver("implicit", "bdf2"),
    Solver("implicit", "implicit_midpoint"),
    Solver("implicit", "sdirk3"),
    Solver("explicit", "auto", symplectic),
    Solver("explicit", "symplectic_euler", symplectic),
    Solver("explicit", "leapfrog", symplectic),
    Solver("explicit", "rk4", runge_kutta_4),
    Solver("explicit", "midpoint", midpoint),
    Solver("explicit", "explicit_euler", euler),
)


def available() -> list[Solver]:
    """Solvers of which this version of wsim has the integrator."""
    return [s for s in SOLVERS if s.integrator in INTEGRATORS]


def limit(scene: Scene, solver: Solver) -> float:
    """Substeps a second that an explicit solver needs by the row sums of its springs; 0 for any other."""
    return solver.needs((STRETCHED if scene.softs else 1.0) * fastest(scene)) if solver.needs else 0.0


def given(scene: Scene, solver: Solver) -> Scene:
    """The scene with this solver; an explicit one gets the substeps that it needs, unless those are beyond MOST."""
    need = limit(scene, solver)
    substeps = max(scene.substeps, ceil(1.05 * need / scene.fps)) if need <= MOST else scene.substeps
    return replace(scene, solver=solver.solver, integrator=solver.integrator, substeps=substeps)


def listed(scene: Scene, solver: Solver) -> dict[str, str]:
    """What an explicit solver may do where it needs more than MOST substeps a second: refuse; those that grow at any
    step may grow. And what the midpoint may do where it does not resolve the stiffness."""
    need = limit(scene, solver)
    coarse = (SOLID if scene.softs else COARSE) * scene.fps * scene.substeps
    if solver.name == "implicit/implicit_midpoint" and fastest(scene) > coarse:
        return dict.fromkeys(("energy", "strain"), UNRESOLVED)
    if need <= MOST:
        return {}
    why = f"beyond the explicit limit: {need:.3g} substeps a second are needed, at most {MOST} are asked for"
    kinds = ("refusal",) if solver.needs in (symplectic, runge_kutta_4) else ("refusal", "energy", "strain")
    return dict.fromkeys(kinds, why)
