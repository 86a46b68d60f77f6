"""A leaning coin of finite thickness that rolls steadily in a circle.

Axes: h outward from the middle of the circle, t along the way, z up. The coin's own axis is e3 = sin(th) h + cos(th) z;
eu = -cos(th) h + sin(th) z points up in its plane; a radius, c half the thickness, rho the circle of the centre of mass.
The rim of the lower face touches at r = -a eu - c e3 from the centre. With w = W z + s e3, no slip gives
w3 = W (c sin - rho) / a, and
dL/dt = W z x L = r x F with F = -m W^2 rho h + m g z gives the rate of precession W:

    W^2 [(a sin + c cos) m rho - sin (I3 (c sin - rho) / a - I1 cos)] = m g (a cos - c sin)

`integrate` solves the same motion without the assumption that it is steady: the rolling constraint v = -w x r is differentiated
once and put into Newton's and Euler's equations (I + m (r.r - r r^T)) dw/dt = ..., by the classical Runge-Kutta method.
"""

from functools import partial
from math import cos, radians, sin, sqrt

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.stage import G, Stage
from wsim.scene import Cylinder, Plane

SUBSTEPS = (8, 16, 32, 64)
COINS = {"thin": (0.1, 0.001, 70.0, 0.5), "thick": (0.1, 0.01, 70.0, 0.5), "low": (0.1, 0.01, 50.0, 0.3),
         "small": (0.0125, 0.001, 75.0, 0.06)}
SECONDS = 2.0


def moments(a: float, c: float) -> np.ndarray:
    """Of a solid coin per mass: across, across, along the axis [m^2]."""
    across = 0.25 * a * a + c * c / 3.0
    return np.array([across, across, 0.5 * a * a])


def steady(a: float, c: float, degrees: float, rho: float) -> dict:
    """Rate W [rad/s], place, axis e3, velocity and angular velocity of the coin where h = x, t = y."""
    S, C = sin(radians(degrees)), cos(radians(degrees))
    I1, _, I3 = moments(a, c)
    W = sqrt(G * (a * C - c * S) / ((a * S + c * C) * rho - S * (I3 * (c * S - rho) / a - I1 * C)))
    e3, eu = np.array([S, 0.0, C]), np.array([-C, 0.0, S])
    return {"W": W, "x": np.array([rho, 0.0, a * S + c * C]), "e3": e3, "v": np.array([0.0, W * rho, 0.0]),
            "w": W * S * eu + W * (c * S - rho) / a * e3}


def integrate(a: float, c: float, x, e3, w, seconds: float, steps: int = 20000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, e3, w of a rolling coin after a time, from any start that does not slip."""
    I1, _, I3 = moments(a, c)
    up = np.array([0.0, 0.0, 1.0])

    def rate(y):
        e3, w = y[3:6], y[6:9]
        de3 = np.cross(w, e3)
        S = sqrt(1.0 - e3[2]**2)
        eu = (up - e3[2] * e3) / S
        dS = -e3[2] * de3[2] / S
        deu = (-de3[2] * e3 - e3[2] * de3 - dS * eu) / S
        r, dr = -a * eu - c * e3, -a * deu - c * de3
        inertia = I1 * np.eye(3) + (I3 - I1) * np.outer(e3, e3)
        A = inertia + np.dot(r, r) * np.eye(3) - np.outer(r, r)
        push = G * up - np.cross(w, dr)
        return np.concatenate([-np.cross(w, r), de3, np.linalg.solve(A, np.cross(r, push) - np.cross(w, inertia @ w))])
    y, h = np.concatenate([x, e3, w]), seconds / steps
    for _ in range(steps):
        k1 = rate(y)
        k2 = rate(y + 0.5 * h * k1)
        k3 = rate(y + 0.5 * h * k2)
        y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(y + h * k3))
    return y[:3], y[3:6], y[6:]


def reference(precision: str, name: str) -> tuple[list[Figure], float]:
    """The closed form beside the integration."""
    a, c, degrees, rho = COINS[name]
    s = steady(a, c, degrees, rho)
    seconds = 1.0 / s["W"]
    x, e3, _ = integrate(a, c, s["x"], s["e3"], s["w"], seconds, 800)
    return [Figure("angle after 1 rad", abs(np.arctan2(e3[1], e3[0]) - 1.0), 1e-8),
            Figure("radius of the circle", abs(float(np.hypot(x[0], x[1])) / rho - 1.0), 1e-8)], 0.0


def roll(precision: str, name: str, substeps: int) -> tuple[float, float, float, float]:
    """Relative errors of the rate over all of the run and of the lean [rad], CPU seconds."""
    a, c, degrees, rho = COINS[name]
    s = steady(a, c, degrees, rho)
    stage = Stage(60.0, substeps)
    stage.collider("/floor", Plane())
    turn = np.stack([np.cross((0.0, 1.0, 0.0), s["e3"]), (0.0, 1.0, 0.0), s["e3"]], axis=1)
    stage.body("/coin", Cylinder(a, c), s["x"], turn, s["v"], s["w"])
    track = stage.run(SECONDS, precision)
    e3 = track.R[:, 0, :, 2]
    angle = np.unwrap(np.arctan2(e3[:, 1], e3[:, 0]))
    lean = np.degrees(np.arccos(np.clip(e3[:, 2], -1.0, 1.0)))
    return (abs(angle[-1] / track.t[-1] / s["W"] - 1.0), float(np.abs(lean - degrees).max()),
            float(np.linalg.norm(track.x[-1, 0, :2]) / rho - 1.0), track.cpu)


def coin(precision: str, name: str) -> tuple[list[Figure], float]:
    """At 60 x 16 within 2 %, and at most a third of that error at 60 x 64."""
    found = {n: roll(precision, name, n) for n in SUBSTEPS}
    ratio = found[64][0] / found[16][0] if found[64][0] > 3e-4 else 0.0
    return [*(Figure(f"rate of precession at 60 x {n}", found[n][0], 0.02 * max(1.0, 16.0 / n)) for n in SUBSTEPS),
            Figure("lean at 60 x 16", found[16][1], 1.0, "deg"),
            Figure("error at 60 x 64 over that at 60 x 16", ratio, 0.35)], sum(f[3] for f in found.values())


def spun(precision: str, a: float, c: float, degrees: float) -> tuple[list[Figure], float]:
    """An Euler's disc: its centre stays, W grows without bound as it lies lower. Energy is kept: as it begins it loses about
    (h W)^2 / 2 of what moves, which is of second order, and then no more."""
    s, lost, cpu = steady(a, c, degrees, 0.0), {}, 0.0
    for substeps in (10, 20):
        stage = Stage(24.0, substeps)
        stage.collider("/floor", Plane())
        turn = np.stack([np.cross((0.0, 1.0, 0.0), s["e3"]), (0.0, 1.0, 0.0), s["e3"]], axis=1)
        stage.body("/disc", Cylinder(a, c), s["x"], turn, s["v"], s["w"])
        track = stage.run(SECONDS, precision)
        spin = np.einsum("tji,tj->ti", track.R[:, 0], track.w[:, 0])
        kinetic = 0.5 * ((track.v[:, 0]**2).sum(axis=1) + spin**2 @ moments(a, c))
        lost[substeps] = float(np.abs(kinetic + G * track.x[:, 0, 2] - kinetic[0] - G * track.x[0, 0, 2]).max() / kinetic[0])
        cpu += track.cpu
    return [Figure(f"energy lost or gained at 24 x {n}", lost[n], 0.65 * (s["W"] / 24.0 / n)**2) for n in lost], cpu


def cases() -> list[Case]:
    return ([Case(f"coin/reference/{name}", partial(reference, name=name)) for name in COINS]
            + [Case(f"coin/{name}", partial(coin, name=name)) for name in COINS]
            + [Case(f"coin/spun/{a:g}x{c:g}/{degrees:g}", partial(spun, a=a, c=c, degrees=degrees))
               for a, c, degrees in ((0.1, 0.001, 5.0), (0.1, 0.001, 40.0), (0.1, 0.01, 20.0), (0.0125, 0.001, 20.0))])
