"""Blows without friction and without loss. What is struck leaves along the normal where the surfaces first touch.

    balls of radii r1, r2, the blow b off centre: at asin(b / (r1 + r2)) to it, at 2 m1 / (m1 + m2) v times the cosine
    any two bodies:  J = -(1 + e) n.(v1 - v2) / (1/m1 + 1/m2 + sum (r x n).I^-1 (r x n)),  n the normal, r from the centres

Balls, capsules and boxes are cores (a point, a segment, a box) with a radius: `first_touch` finds the time at which cores that
move straight are as near as their radii are long, by bisection; none of them turns before the blow.
"""

from functools import partial
from math import asin, cos, degrees, sqrt

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import named
from tools.bench.rigid.answers.stage import RATES, Stage, turned
from wsim.scene import Box, Capsule, Plane, Sphere

OFFSETS = (0.2, 0.6, 1.0, 1.4, 1.8)                          # over r1 + r2, twice
SPEEDS = (1.0, 3.0, 10.0)                                    # [m/s]
MASSES = (1.0, 0.3, 4.0)                                     # of the struck ball over the other's
ANGLE, SHARE = 0.5, 1e-2                                     # [degrees], of what is right
MISS = 1.01                                                  # offsets over r1 + r2 that miss


def between(got: np.ndarray, exact: np.ndarray) -> float:
    """Angle [degrees]; 180 for a vector of no length."""
    long = np.linalg.norm(got) * np.linalg.norm(exact)
    return degrees(np.arctan2(np.linalg.norm(np.cross(got, exact)), got @ exact)) if long > 0.0 else 180.0


def balls(precision: str, rate, r: float, floor: bool, ratio: float = 1.0) -> tuple[list[Figure], float]:
    """ratio: radius of the struck ball over r. Lanes for every offset, speed and mass; gaps of several lengths."""
    stage, rng = Stage(*rate, gravity=9.81 if floor else 0.0), np.random.default_rng(3)
    if floor:
        stage.collider("/floor", Plane(), rub=0.0)
    lanes = [(o, v, m) for v in SPEEDS for o in (*OFFSETS, 2.0 * MISS) for m in MASSES]
    reach, slick = r * (1.0 + ratio), {"rub": 0.0, "rest": 1.0}
    for k, (offset, v, m) in enumerate(lanes):
        away = np.array([0.0, (40.0 * r + 8.0) * k, r])
        gap = reach * sqrt(max(1.0 - 0.25 * offset**2, 0.0)) + v * (0.1 + rng.uniform(0.0, 1.0 / rate[0]))
        stage.body(f"/cue{k}", Sphere(r), away + (-gap, 0.5 * offset * reach, 0.0), velocity=(v, 0.0, 0.0), mass=1.0, **slick)
        stage.body(f"/struck{k}", Sphere(ratio * r), away, mass=m, **slick)
    track = stage.run(0.4, precision)
    worst = {"angle": 0.0, "speed": 0.0, "speed of the other": 0.0, "missed, but moved": 0.0}
    at = {"angle": "", "speed": ""}
    for k, (offset, v, m) in enumerate(lanes):
        cue, struck = track.v[-1, 2 * k], track.v[-1, 2 * k + 1]
        if floor:
            cue, struck = cue * (1.0, 1.0, 0.0), struck * (1.0, 1.0, 0.0)
        if offset > 2.0:
            worst["missed, but moved"] = max(worst["missed, but moved"], float(np.linalg.norm(struck) / v))
            continue
        turn = asin(0.5 * offset)
        n = np.array([cos(turn), -0.5 * offset, 0.0])
        exact = 2.0 / (1.0 + m) * v * cos(turn) * n
        found = {"angle": between(struck, exact), "speed": abs(np.linalg.norm(struck) / np.linalg.norm(exact) - 1.0),
                 "speed of the other": float(np.linalg.norm(cue - ((v, 0.0, 0.0) - m * exact)) / v)}
        for name, error in found.items():
            if error > worst[name]:
                worst[name], at[name] = error, f" (b {offset:g} r, {v:g} m/s)"
    return [Figure("angle" + at["angle"], worst["angle"], ANGLE, "deg"), Figure("speed" + at["speed"], worst["speed"], SHARE),
            Figure("speed of the other", worst["speed of the other"], SHARE),
            Figure("missed by 1 %, but moved", worst["missed, but moved"], 1e-6)], track.cpu


class Solid:
    """A convex body of mass 1 at rest in turn and place: a core with a radius."""

    def __init__(self, kind: str, size: float, at: np.ndarray, turn: np.ndarray):
        self.kind, self.size, self.at, self.turn = kind, size, at, turn
        self.shape = {"ball": Sphere(size), "capsule": Capsule(size, 2.0 * size), "box": Box((size, size, size))}[kind]
        self.radius = 0.0 if kind == "box" else size
        across = {"ball": 0.4, "box": 2.0 / 3.0, "capsule": 2.0}[kind] * size * size
        self.inertia = np.array([across, across, across if kind != "capsule" else 0.5 * size * size])

    def nearest(self, p: np.ndarray) -> np.ndarray:
        """Point of the core nearest to a point."""
        own = self.turn.T @ (p - self.at)
        half = {"ball": (0.0, 0.0, 0.0), "capsule": (0.0, 0.0, 2.0 * self.size), "box": (self.size,) * 3}[self.kind]
        return self.turn @ np.clip(own, np.negative(half), half) + self.at


def closest(a: Solid, b: Solid) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points of two cores, of which one at most is a box beside a ball: in turns, which converges for convex cores."""
    q = b.at
    for _ in range(400):
        p = a.nearest(q)
        q, before = b.nearest(p), q
        if np.abs(q - before).max() < 1e-14 * a.size:
            break
    return p, q


def first_touch(a: Solid, b: Solid, v: np.ndarray, most: float) -> float | None:
    """Time at which a, going at v, touches b; None: it does not within a time."""
    def gap(t: float) -> float:
        p, q = closest(Solid(a.kind, a.size, a.at + t * v, a.turn), b)
        return float(np.linalg.norm(p - q)) - a.radius - b.radius
    times = np.linspace(0.0, most, 120)
    for low, high in zip(times[:-1], times[1:], strict=True):
        if gap(high) < 0.0:
            for _ in range(50):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if gap(middle) > 0.0 else (low, middle)
            return 0.5 * (low + high)
    return None


def struck(a: Solid, b: Solid, v: np.ndarray, masses, when: float) -> dict[str, np.ndarray]:
    """Velocities and spins of both after the blow."""
    a = Solid(a.kind, a.size, a.at + when * v, a.turn)
    p, q = closest(a, b)
    n = (q - p) / np.linalg.norm(q - p)
    touch = q - b.radius * n
    arms = [np.cross(touch - each.at, n) for each in (a, b)]
    spins = [each.turn @ ((each.turn.T @ arm) / (m * each.inertia)) for each, arm, m in zip((a, b), arms, masses, strict=True)]
    J = 2.0 * (n @ v) / (1.0 / masses[0] + 1.0 / masses[1] + arms[0] @ spins[0] + arms[1] @ spins[1])
    return {"v1": v - J / masses[0] * n, "v2": J / masses[1] * n, "w1": -J * spins[0], "w2": J * spins[1],
            "cosine": n @ v / np.linalg.norm(v)}


def again(a: Solid, b: Solid, v: np.ndarray, known: dict, when: float, most: float) -> bool:
    """Whether they touch once more within a time after the blow: long bodies do, as they turn. Spins stay as they are."""
    for t in np.linspace(0.02, 1.0, 50) * most:
        ends = []
        for each, at, k in ((a, a.at + when * v, 1), (b, b.at, 2)):
            w = known[f"w{k}"]
            turn = turned(w, degrees(np.linalg.norm(w) * t)) if np.linalg.norm(w) > 0.0 else np.eye(3)
            ends.append(Solid(each.kind, each.size, at + t * known[f"v{k}"], turn @ each.turn))
        p, q = closest(*ends)
        if np.linalg.norm(p - q) < a.radius + b.radius:
            return True
    return False


def random_turn(rng) -> np.ndarray:
    Q, S = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(S))
    return Q if np.linalg.det(Q) > 0.0 else -Q


def draw(rng, kinds: tuple[str, str], size: float, rate) -> tuple:
    """Two solids, a velocity, masses and what comes of it; not a graze, at which the normal is ill conditioned."""
    while True:
        masses = (1.0, float(rng.choice((0.5, 1.0, 3.0))))
        b = Solid(kinds[1], size, np.zeros(3), random_turn(rng))
        speed, way = float(rng.choice(SPEEDS)), random_turn(rng)
        off = way @ np.array([0.0, *rng.uniform(-2.0, 2.0, 2)]) * size
        gap = 6.5 * size + speed * (0.1 + rng.uniform(0.0, 1.0 / rate[0]))
        a = Solid(kinds[0], size, off - gap * way[:, 0], random_turn(rng))
        v = speed * way[:, 0]
        when = first_touch(a, b, v, 0.1 + (gap + 7.0 * size) / speed)
        if when is None:
            continue
        known = struck(a, b, v, masses, when)
        if known["cosine"] > 0.3 and not again(a, b, v, known, when, 1.0 / rate[0]):
            return a, b, v, masses, when, known


def solids(precision: str, kinds: tuple[str, str], rate, size: float, count: int = 24) -> tuple[list[Figure], float]:
    """Draws in free space, a lane each; read in the first frame after the blow, before anything can turn back and hit again."""
    stage, rng = Stage(*rate, gravity=0.0), np.random.default_rng(11)
    draws = [draw(rng, kinds, size, rate) for _ in range(count)]
    for k, (a, b, v, masses, *_) in enumerate(draws):
        away = np.array([0.0, 0.0, (30.0 * size + 10.0) * k])
        for name, each, m, speed in (("a", a, masses[0], v), ("b", b, masses[1], np.zeros(3))):
            stage.body(f"/{name}{k}", each.shape, each.at + away, each.turn, speed, rub=0.0, rest=1.0, mass=m,
                       center=np.zeros(3), inertia=m * each.inertia)
    track = stage.run(max(when for *_, when, _ in draws) + 2.0 / rate[0], precision)
    worst = {"angle": (0.0, ""), "impulse": (0.0, ""), "spin": (0.0, "")}
    for k, (_a, _b, v, _, when, known) in enumerate(draws):
        f = int(np.floor(when * rate[0])) + 1
        speed = np.linalg.norm(v)
        got = track.v[f, 2 * k + 1]
        far = np.linalg.norm(known["v2"])
        spin = np.concatenate([track.w[f, 2 * k + j] - known[f"w{j + 1}"] for j in (0, 1)])
        found = {"angle": between(got, known["v2"]), "impulse": abs(np.linalg.norm(got) / far - 1.0),
                 "spin": float(np.linalg.norm(spin)) * size / speed}
        for name, error in found.items():
            if error > worst[name][0]:
                worst[name] = error, f" (lane {k}, {speed:g} m/s)"
    return [Figure("angle" + worst["angle"][1], worst["angle"][0], ANGLE, "deg"),
            Figure("impulse" + worst["impulse"][1], worst["impulse"][0], SHARE),
            Figure("spin, over v / size" + worst["spin"][1], worst["spin"][0], SHARE)], track.cpu


def cases() -> list[Case]:
    rates = (RATES[0], RATES[1], RATES[2])
    found = [Case(f"blow/balls/{where}/r{r:g}/{named(rate)}", partial(balls, rate=rate, r=r, floor=where == "floor"))
             for where in ("floor", "free") for r in (0.0285, 0.1, 0.5) for rate in rates]
    found += [Case(f"blow/balls/free/r{r:g}x{ratio:g}/{named(rate)}", partial(balls, rate=rate, r=r, floor=False, ratio=ratio))
              for r, ratio in ((0.1, 0.4), (0.1, 3.0)) for rate in rates[:2]]
    return found + [Case(f"blow/{a}-{b}/{named(rate)}/{size:g}", partial(solids, kinds=(a, b), rate=rate, size=size))
                    for a, b in (("ball", "box"), ("ball", "capsule"), ("capsule", "capsule"), ("capsule", "ball"))
                    for rate in rates for size in (0.05, 0.5) if (rate, size) != (RATES[2], 0.5)]
