"""Errors of a motion of rigid bodies against closed forms and against float64 solutions of the same equations.

    stack      how far the top has sunk, how fast anything moves, how far anything has slid, at the end; fallen or not
    pile       how deep boxes overlap at the end, worst and mean of those that do; the speed; bodies below the floor
    racket     energy and momentum (worst of all frames), angle at the end to a Runge-Kutta solution
    bounces    heights of three bounces over e^2, e^4, e^6 of the first
    sliding    distance over v^2 / 2 mu g
    chain      place of the last rod's end against generalised coordinates; energy; gaps of joints
"""

from math import cos, degrees, pi, sin

import numpy as np

from tools.bench.rigid.overlap import overlaps


def field(scene: dict, name: str) -> np.ndarray:
    return np.array([b[name] for b in scene["bodies"]], float)


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """v (..., 3) turned by quaternions (..., 4), (x, y, z, w)."""
    u, w = q[..., :3], q[..., 3:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def conjugate(q: np.ndarray) -> np.ndarray:
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def stack(scene: dict, states: dict) -> dict[str, float]:
    """[mm], [m/s], [mm]; fallen where a box has sunk by half its height."""
    first, x = field(scene, "at"), states["x"][-1]
    sunk = first[:, 2] - x[:, 2]
    top = first[:, 2].argmax()
    return {"sag": 1e3 * float(sunk[top]), "speed": float(np.linalg.norm(states["v"][-1], axis=1).max()),
            "slid": 1e3 * float(np.linalg.norm((x - first)[:, :2], axis=1).max()), "fallen": bool(np.abs(sunk).max() > 0.5)}


def pile(scene: dict, states: dict) -> dict[str, float]:
    """[mm]; [m/s]; [J/kg] of motion; below: bodies whose centre is under the floor."""
    x, q, v = (states[name][-1] for name in "xqv")
    deep = overlaps(x, q, field(scene, "size"))
    return {"overlap": 1e3 * float(deep.max(initial=0.0)), "mean_overlap": 1e3 * float(deep.mean() if len(deep) else 0.0),
            "speed": float(np.linalg.norm(v, axis=1).max()), "rms_speed": float(np.sqrt((v * v).sum(1).mean())),
            "below": int((x[:, 2] < 0.0).sum())}


def turned(moments, spin, seconds: float, steps: int = 80000) -> np.ndarray:
    """Quaternion after a free turn from (0, 0, 0, 1), by the classical Runge-Kutta method: 1e-9 for ten seconds of a racket."""
    I1, I2, I3 = moments
    h = seconds / steps

    def rate(s):
        x, y, z, w, a, b, c = s
        return (0.5 * (w * a + y * c - z * b), 0.5 * (w * b + z * a - x * c), 0.5 * (w * c + x * b - y * a),
                -0.5 * (x * a + y * b + z * c), (I2 - I3) * b * c / I1, (I3 - I1) * c * a / I2, (I1 - I2) * a * b / I3)

    def ahead(s, k, t):
        return tuple(u + t * d for u, d in zip(s, k, strict=True))
    s = (0.0, 0.0, 0.0, 1.0, *spin)
    for _ in range(steps):
        k1 = rate(s)
        k2 = rate(ahead(s, k1, 0.5 * h))
        k3 = rate(ahead(s, k2, 0.5 * h))
        k4 = rate(ahead(s, k3, h))
        s = tuple(u + h / 6.0 * (a + 2.0 * b + 2.0 * c + d) for u, a, b, c, d in zip(s, k1, k2, k3, k4, strict=True))
    q = np.array(s[:4])
    return q / np.linalg.norm(q)


def racket(scene: dict, states: dict) -> dict[str, float]:
    """Energy and momentum relative to the start; degrees."""
    one = scene["bodies"][0]
    moments, spin = np.array(one["moments"]), np.array(one["spin"])
    q, w = states["q"][:, 0], states["w"][:, 0]
    own = rotated(conjugate(q), w)
    energy, L = 0.5 * (own * own * moments).sum(1), rotated(q, own * moments)
    L0 = moments * spin
    exact = turned(moments, spin, scene["frames"] / scene["fps"])
    away = abs(float(q[-1] @ exact) / np.linalg.norm(q[-1]))
    return {"angle": degrees(2.0 * np.arccos(min(away, 1.0))),
            "energy": float(np.abs(energy / (0.5 * spin @ L0) - 1.0).max()),
            "momentum": float(np.linalg.norm(L - L0, axis=1).max() / np.linalg.norm(L0))}


def bounces(scene: dict, states: dict) -> dict[str, float]:
    """Worst of three, in percent of what the height should be; 100 where there is no bounce."""
    h = states["x"][:, 0, 2] - scene["bodies"][0]["size"][0]
    first, e = scene["bodies"][0]["at"][2] - scene["bodies"][0]["size"][0], scene["restitution"]
    peaks = []
    for k in range(1, len(h) - 1):
        a, b = 0.5 * (h[k + 1] + h[k - 1]) - h[k], 0.5 * (h[k + 1] - h[k - 1])
        if h[k - 1] < h[k] >= h[k + 1] and a < 0.0:
            peaks.append(h[k] - b * b / (4.0 * a))
    peaks = [*peaks, 0.0, 0.0, 0.0][:3]
    return {"height": 100.0 * max(abs(p / (first * e**(2 * k)) - 1.0) for k, p in enumerate(peaks, 1))}


def sliding(scene: dict, states: dict) -> dict[str, float]:
    """[%]; the speed at the end [m/s]."""
    one = scene["bodies"][0]
    exact = np.dot(one["velocity"], one["velocity"]) / (2.0 * scene["friction"] * -scene["gravity"][2])
    went = states["x"][-1, 0, 0] - one["at"][0]
    return {"distance": 100.0 * float(abs(went / exact - 1.0)), "speed": float(np.linalg.norm(states["v"][-1, 0]))}


def swung(scene: dict, seconds: float, steps: int = 5000) -> np.ndarray:
    """Angles of rods under the horizontal after a swing from rest, by the Lagrangian of a chain in a plane and Runge-Kutta."""
    n, g = len(scene["bodies"]), -scene["gravity"][2]
    m, length = scene["bodies"][0]["mass"], 1.0
    across = scene["bodies"][0]["moments"][1]
    i, j = np.indices((n, n))
    c = (n - 0.5 - np.maximum(i, j)) * m * length**2                 # of rods below, and half of the lower of the two
    np.fill_diagonal(c, [(n - 1 - k + 0.25) * m * length**2 + across for k in range(n)])
    weight = m * g * length * (n - 0.5 - np.arange(n))

    def rate(s):
        a, w = s[:n], s[n:]
        d = a[:, None] - a[None]
        return np.concatenate([w, np.linalg.solve(c * np.cos(d), weight * np.cos(a) - (c * np.sin(d)) @ (w * w))])
    s, h = np.zeros(2 * n), seconds / steps
    for _ in range(steps):
        k1 = rate(s)
        k2 = rate(s + 0.5 * h * k1)
        k3 = rate(s + 0.5 * h * k2)
        s = s + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(s + h * k3))
    return s[:n]


def chain(scene: dict, states: dict) -> dict[str, float]:
    """[mm] of the last rod's centre at half the time and at the end; [mm] that joints open; energy over that turned over."""
    x, q, v, w = (states[name] for name in "xqvw")
    half = np.array([0.5, 0.0, 0.0])
    mass, moments = field(scene, "mass"), field(scene, "moments")
    start, end = x - rotated(q, np.broadcast_to(half, x.shape)), x + rotated(q, np.broadcast_to(half, x.shape))
    ends = np.concatenate([np.zeros_like(x[:, :1]), end[:, :-1]], axis=1)
    own = rotated(conjugate(q), w)
    kinetic = 0.5 * (mass * (v * v).sum(-1)).sum(1) + 0.5 * (own * own * moments).sum((1, 2))
    potential = -scene["gravity"][2] * (mass * x[..., 2]).sum(1)
    off = []
    for k in (len(x) // 2, len(x)):
        a = swung(scene, k / scene["fps"])
        along = np.array([[cos(t), 0.0, -sin(t)] for t in a])
        off.append(np.linalg.norm(along[:-1].sum(0) + 0.5 * along[-1] - x[k - 1, -1]))
    return {"place": 1e3 * float(off[0]), "place_end": 1e3 * float(off[1]),
            "gap": 1e3 * float(np.linalg.norm(ends - start, axis=-1).max()),
            "energy": float(np.abs(kinetic + potential).max() / np.abs(potential).max())}


def damping_ratio(e: float) -> float:
    """Of a linear spring and damper that throws back e of the speed: e = exp(-pi zeta / sqrt(1 - zeta^2))."""
    return -np.log(e) / np.hypot(pi, np.log(e)) if e > 0.0 else 1.0
