"""Problems with known answers: a scene, a run, and how far its end is from what mathematics says. suite.py times them.

    fall           a net that nothing holds:  x = x0 + v t + g t^2 / 2                               [m] after 0.5 s
    oscillator     a mass on a spring:        x = A cos(w t)                                         over A after 0.5 s
    damped         the same with damping c:   x = A exp(-c t / 2) (cos(w' t) + c / (2 w') sin(w' t)), w'^2 = w^2 - c^2 / 4
    stretch        hanging chain at rest, each spring's stretch          reference.chain_stretch     relative
    frequency      first frequency of a chain                            reference.chain_frequency   relative
    cloth16, 32    spring cloth, RMS over the points                     reference.exact             [m] at 0.25 s
    strip          hanging membrane under a load F: strain F / (b E t)                               relative
    cantilever     strip clamped at one end, its tip                     reference.cantilever        relative, see below
    ball, slope    cloth at rest on a ball, and on a plane of 15 degrees under friction 0.5 (tan 15 = 0.27): the larger of
                   penetration and what points moved in the last half second, RMS                    [m], exactly 0
    energy         cloth let go at two corners, no damping: change of its energy over what gravity turned over, exactly 0

fall, oscillator and damped are linear, so that every integrator has a closed form of its own too: `discrete` is the
distance from that, which only rounding and what a solver leaves unsolved make. Strain in `strip` is that of its middle half,
two widths from the clamp (Saint-Venant). The cantilever's error is the tip's distance from its place over its drop.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, exp, pi, radians, sin, sqrt

import numpy as np

from tools.bench.nets import reference
from wsim.scene import Plane, Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.scene.integrator import GAMMA
from wsim.simulation.simulation import Simulation

FPS, GRAVITY = 60.0, 9.81
Judged = dict[str, float]                    # "error", and whatever else was measured


@dataclass(frozen=True)
class Problem:
    """`make` gives the scene; `judge(sim, cache)` runs it and says how wrong it is; `cache`: folder for exact answers."""

    name: str
    make: Callable[[], Scene]
    judge: Callable[[Simulation, str | None], Judged]
    unit: str                                # of the error, "m" or "1" (relative)
    stable: int                              # substeps a frame with which leapfrog is stable
    substeps: tuple[int, ...]                # of the methods that are stable at any step
    quick: bool = True
    solvers: tuple[str, ...] = ()            # those that have what it takes; (): all
    known: float = 1e-7                      # errors below it say nothing: how well the answer is known, or float32's rounding


# closed forms in one dimension: x'' = g - c x' - w^2 x

def discrete(integrator: str, x: float, v: float, h: float, steps: int, *, w=0.0, c=0.0, g=0.0) -> float:
    """x [m] after so many steps of h [s] solved exactly. ValueError for an integrator without a row here."""
    A, b, I = np.array([[0.0, 1.0], [-w * w, -c]]), np.array([0.0, g]), np.eye(2)  # noqa: E741
    y, before = np.array([x, v]), np.array([x, v])
    for step in range(steps):
        now = y
        if integrator == "backward_euler" or (integrator == "bdf2" and step == 0):
            y = np.linalg.solve(I - h * A, y + h * b)
        elif integrator == "bdf2":
            y = np.linalg.solve(I - h / 1.5 * A, (4.0 * y - before) / 3.0 + h / 1.5 * b)
        elif integrator == "implicit_midpoint":
            y = np.linalg.solve(I - 0.5 * h * A, y + 0.5 * h * (A @ y) + h * b)
        elif integrator == "sdirk3":
            one = np.linalg.solve(I - GAMMA * h * A, A @ y + b)
            y = y + 0.5 * h * (one + np.linalg.solve(I - GAMMA * h * A, A @ (y + (1.0 - 2.0 * GAMMA) * h * one) + b))
        elif integrator == "symplectic_euler":
            y = y + [0.0, h * (A @ y + b)[1]]
            y = y + [h * y[1], 0.0]
        elif integrator == "leapfrog" and c == 0.0:
            y = y + [0.0, 0.5 * h * (A @ y + b)[1]]
            y = y + [h * y[1], 0.0]
            y = y + [0.0, 0.5 * h * (A @ y + b)[1]]
        elif integrator == "rk4":
            k1 = A @ y + b
            k2 = A @ (y + 0.5 * h * k1) + b
            k3 = A @ (y + 0.5 * h * k2) + b
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + A @ (y + h * k3) + b)
        else:
            raise ValueError(f"no closed form of {integrator} here")
        before = now
    return float(y[0])


def beside(sim: Simulation, found: float, wanted: float, size: float, start: tuple[float, float], **equation) -> Judged:
    """Distance of a coordinate from its closed form, and from the integrator's own, over `size`."""
    n = sim.plan.clock.steps
    out = {"error": abs(found - wanted) / size}
    try:
        own = discrete(sim.plan.integrator, *start, 1.0 / FPS / n, n * sim.frame, **equation)
    except ValueError:
        return out
    return out | {"discrete": abs(found - own) / size}


FALLING = (0.5, 1.0, 0.0)                    # [m/s]


def falling() -> Scene:
    scene = Scene(fps=FPS)
    scene.net("/net", *shapes.spring_sheet(1.0, 8), velocities=np.tile(FALLING, (64, 1)))
    return scene


def fall(sim: Simulation, cache) -> Judged:
    start = sim.positions()
    sim.run(30)
    moved, t = sim.positions() - start, sim.time
    y = float(moved[:, 1].mean())
    out = beside(sim, y, FALLING[1] * t - 0.5 * GRAVITY * t * t, 1.0, (0.0, FALLING[1]), g=-GRAVITY)
    wanted = np.asarray(FALLING) * t - np.array([0.0, 0.5 * GRAVITY * t * t, 0.0])
    return out | {"error": reference.rms(moved - wanted)}


# [rad/s], [m], [s]; damping c = TAU k / m = 1.56 / s. All are float32 numbers; after 0.5 s the phase is 5 rad, where x
# changes fast: at a turning point an error of phase would not be seen
OMEGA, AMPLITUDE, TAU = 10.0, 0.125, 1.0 / 64.0


def oscillating(tau: float) -> Scene:
    """1 kg on a spring of 1 m, pulled out by AMPLITUDE. Along its line it is linear."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=FPS)
    net = scene.net("/net", [[0, 0, 0], [1.0 + AMPLITUDE, 0, 0]], [[0, 1]], [OMEGA**2], [1.0], lengths=[1.0], damping=tau)
    scene.pin("/pin", net, [0])
    return scene


def swing(sim: Simulation, tau: float) -> Judged:
    sim.run(30)
    t, c = sim.time, tau * OMEGA**2
    w = sqrt(OMEGA**2 - 0.25 * c * c)
    wanted = AMPLITUDE * exp(-0.5 * c * t) * (cos(w * t) + 0.5 * c / w * sin(w * t))
    return beside(sim, float(sim.positions()[1, 0]) - 1.0, wanted, AMPLITUDE, (AMPLITUDE, 0.0), w=OMEGA, c=c)


# chains

LINKS, LINK, STIFFNESS, MASS = 8, 0.1, 200.0, 0.01    # springs of [m], [N/m]; masses [kg]


def chain(gravity: float, drag: float = 0.0, speed: float = 0.0) -> Scene:
    """A chain that hangs from a pinned point; `speed` [m/s] of its tip in the first mode."""
    points, v = np.zeros((LINKS + 1, 3)), np.zeros((LINKS + 1, 3))
    points[:, 1] = -LINK * np.arange(LINKS + 1)
    v[:, 1] = speed * np.sin(np.arange(LINKS + 1) * pi / (2 * LINKS + 1))
    scene = Scene(gravity=(0.0, -gravity, 0.0), fps=FPS, air_drag=drag)
    net = scene.net("/chain", points, [[i, i + 1] for i in range(LINKS)], [STIFFNESS], [MASS], velocities=v)
    scene.pin("/pin", net, [0])
    return scene


def stretch(sim: Simulation, cache) -> Judged:
    sim.run(180)                             # drag 12 / s: what is left of the motion is exp(-18)
    wanted = reference.chain_stretch(np.full(LINKS, STIFFNESS), np.full(LINKS, MASS), GRAVITY)
    return {"error": float(np.abs((-np.diff(sim.positions()[:, 1]) - LINK) / wanted - 1.0).max())}


def frequency(sim: Simulation, cache) -> Judged:
    """From the tip's upward zero crossings in 2 s; nan where damping has left none."""
    tip: list[float] = []
    start = sim.positions()[-1, 1]
    sim.run(120, lambda s: tip.append(s.positions()[-1, 1] - start))
    y, t = np.array(tip), np.arange(1, 121) / FPS
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    if len(up) < 2:
        return {"error": float("nan")}
    zeros = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    wanted = reference.chain_frequency(np.full(LINKS, STIFFNESS), np.full(LINKS, MASS)) / (2.0 * pi)
    return {"error": float(abs((len(zeros) - 1) / (zeros[-1] - zeros[0]) / wanted - 1.0))}


# cloths

def trajectory(sim: Simulation, cache) -> Judged:
    where, _ = reference.exact(reference.net(sim.given), (0.25, 0.5), 1e-7, folder=cache)
    errors = []
    for wanted in where:
        sim.run(15)
        errors.append(reference.rms(sim.positions() - wanted))
    return {"error": errors[0], "error_05": errors[1]}


STRIP, LOAD, LIGHT = 1000.0, 2.0, 2e-4                # E t [N/m], [N], mass of a point [kg]


def hung_strip() -> Scene:
    """0.2 m x 1 m, hanging by its top edge with LOAD on its bottom edge."""
    rows, share, masses = np.arange(105).reshape(21, 5), np.array([1, 2, 2, 2, 1]) / 8.0, np.full(105, LIGHT)
    masses[rows[-1]] = share * LOAD / GRAVITY
    scene = Scene(fps=FPS, air_drag=50.0)
    cloth = scene.cloth("/cloth", *shapes.sheet(0.2, 1.0, 4, 20), masses=masses, material=Fabric(
        stretch=STRIP, shear=0.5 * STRIP / 1.3, bend=0.0, poisson=0.3))
    scene.pin("/pin", cloth, rows[0])
    return scene


def strip(sim: Simulation, cache) -> Judged:
    sim.run(60)
    x, gaps = sim.positions()[np.arange(105).reshape(21, 5)], range(6, 15)
    held = np.mean([LOAD + GRAVITY * LIGHT * 5 * (20 - r - 1) for r in gaps])       # by the gap under row r
    strain = (x[6, 2, 1] - x[15, 2, 1]) / (9 * 0.05) - 1.0
    return {"error": float(abs(strain / (held / 0.2 / STRIP) - 1.0))}


CELL, LENGTH, WEIGHT = 0.02, 0.2, 2.0                 # [m], [m], [N/m^2]
BEND = 0.5 * WEIGHT * LENGTH**3                       # [N m]


def clamped() -> Scene:
    """Two columns are pinned, and it begins at the second."""
    scene, columns = Scene(fps=FPS, air_drag=30.0), np.arange(84).reshape(7, 12).T
    cloth = scene.cloth("/cloth", *shapes.sheet(LENGTH + CELL, 6 * CELL, 11, 6, horizontal=True), material=Fabric(
        stretch=2e3, shear=8e2, bend=BEND, thickness=1e-3, density=WEIGHT / GRAVITY / 1e-3))
    scene.pin("/pin", cloth, columns[:2].ravel())
    return scene


def cantilever(sim: Simulation, cache) -> Judged:
    sim.run(60)
    columns, x = np.arange(84).reshape(7, 12).T, sim.positions()
    found, ends = (x[columns[-1]] - x[columns[1]]).mean(axis=0), np.array(reference.cantilever(BEND, WEIGHT, LENGTH))
    return {"error": float(np.linalg.norm(found[:2] * (1.0, -1.0) - ends) / ends[1])}


SOFT = Fabric(stretch=100.0, shear=50.0, bend=1e-4, damping=1e-3)


def on_ball() -> Scene:
    scene = Scene(fps=FPS, air_drag=3.0)
    scene.cloth("/cloth", *shapes.sheet(0.3, 0.3, 6, 6, horizontal=True), material=SOFT)
    scene.collider("/ball", Sphere(0.5), at=(0.0, -0.51, 0.0), static_friction=1.0, dynamic_friction=1.0)
    return scene


def on_slope() -> Scene:
    """The plane is level and gravity slants, which is the same."""
    a = radians(15.0)
    scene = Scene(fps=FPS, up="Z", gravity=(GRAVITY * sin(a), 0.0, -GRAVITY * cos(a)))
    scene.cloth("/cloth", *shapes.sheet(0.3, 0.3, 6, 6, horizontal=True, up="Z", at=(0.0, 0.0, 2e-3)), material=SOFT)
    scene.collider("/plane", Plane())
    return scene


def rest(sim: Simulation, cache) -> Judged:
    sim.run(180)
    before = sim.positions()
    sim.run(30)
    drift, inside = reference.rms(sim.positions() - before), sim.indicators()["penetration"]
    return {"error": max(drift, inside), "drift": drift, "penetration": inside}


def let_go() -> Scene:
    scene = Scene(fps=FPS)
    cloth = scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 12, 12, horizontal=True),
                        material=Fabric(stretch=500.0, shear=200.0, bend=1e-4))
    scene.pin("/pin", cloth, [0, 12])
    return scene


def energy(sim: Simulation, cache) -> Judged:
    start = sim.indicators()
    sim.run(30)
    end = sim.indicators()
    return {"error": abs(end["energy"] - start["energy"]) / abs(start["gravity_energy"] - end["gravity_energy"])}


PROBLEMS = (
    Problem("fall", falling, fall, "m", 24, (4, 16)),
    Problem("oscillator", lambda: oscillating(0.0), lambda sim, cache: swing(sim, 0.0), "1", 4, (4, 16)),
    Problem("damped", lambda: oscillating(TAU), lambda sim, cache: swing(sim, TAU), "1", 4, (4, 16)),
    Problem("stretch", lambda: chain(GRAVITY, drag=12.0), stretch, "1", 4, (4, 16), known=1e-4),   # 6e-8 m of 5e-4 m
    Problem("frequency", lambda: chain(0.0, speed=1e-2), frequency, "1", 8, (8, 32), known=2e-5),
    Problem("cloth16", lambda: reference.spring_cloth(16), trajectory, "m", 40, (4, 16)),
    Problem("cloth32", lambda: reference.spring_cloth(32), trajectory, "m", 80, (4, 16), quick=False),
    Problem("strip", hung_strip, strip, "1", 80, (10, 50), known=1e-4),
    Problem("cantilever", clamped, cantilever, "1", 128, (25, 100), quick=False, known=1e-2),
    Problem("ball", on_ball, rest, "m", 64, (10, 40)),
    Problem("slope", on_slope, rest, "m", 64, (10, 40)),
    Problem("energy", let_go, energy, "1", 24, (8, 32)),
)
