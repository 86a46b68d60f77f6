"""What points of contact do in a substep, as functions of all that they read (see kernels/rigid/contact.py).

    rest along n     u_n + bias + soft A_ii P = 0 of what pushes, else P
    rest across n    u_t = 0 of what sticks; rub + mu P u_t / |u_t| = 0 of what slips
    impact           u_n' - u_n - (1 + e) U = 0; bodies go back by the time until then

f of a point: its impulse along n, and along two tangents of n. pose, then: x, theta of a, and of b, as in
wsim/physics/rigid/recorded/joint_formulas.py. geo (24) of a point: n, core_a, core_b, first_a, first_b, gap, from_a, from_b,
rim of both.
"""

from dataclasses import dataclass

import numpy as np

from wsim.kernels.rigid.soft_step import GIVES, RATE
from wsim.physics.rigid.recorded.local import Values
from wsim.physics.rigid.recorded.rotation import (
    complex_rotation_matrix,
    complex_vector_length,
    matrix_times_vector,
    small_turn_applied,
    transpose_times_vector,
)

NONE, STICKS, SLIPS = 0, 1, 2
GEO = {"n": slice(0, 3), "core_a": slice(3, 6), "core_b": slice(6, 9), "first_a": slice(9, 12), "first_b": slice(12, 15),
       "gap": slice(15, 16), "from_a": slice(16, 19), "from_b": slice(19, 22), "rim": slice(22, 24)}


@dataclass
class ContactShapes:
    """Shapes of points: skin (points, 2) [m]; axis and center of each shape in its body's frame, (points, 2, 3); fastest: at
    which the shapes of a point are pushed apart, (points,) [m/s]."""

    skin: np.ndarray
    axis: np.ndarray
    center: np.ndarray
    fastest: np.ndarray


@dataclass
class ContactPointState:
    """Points where bodies are: gap now (...,), arms, axes n, t1, t2, (..., 3), I^-1 of both."""

    gap: np.ndarray
    r: tuple[np.ndarray, np.ndarray]
    axes: tuple[np.ndarray, np.ndarray, np.ndarray]
    S: tuple[np.ndarray, np.ndarray]


def contact_tangents(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tangents as `tangent` of kernels/rigid/impulse.py."""
    size, zero = np.abs(n.real), np.zeros_like(n[..., 0])
    first = (size[..., 0] > size[..., 1]) & (size[..., 0] > size[..., 2])
    x = np.where(first[..., None], np.stack([-n[..., 2], zero, n[..., 0]], -1), np.stack([zero, -n[..., 2], n[..., 1]], -1))
    t = x / complex_vector_length(x)[..., None]
    return t, np.cross(n, t)


def rim_direction(R: np.ndarray, axis: np.ndarray, n: np.ndarray, rolls: np.ndarray) -> np.ndarray:
    """e of kernels/rigid/contact.py, (..., 3); 0 where nothing rolls."""
    z = matrix_times_vector(R, axis)
    d = n - (n * z).sum(-1)[..., None] * z
    return np.where(rolls[..., None], d / complex_vector_length(np.where(rolls[..., None], d, np.ones(3)))[..., None], 0.0)


def contact_point_state(pose: np.ndarray, geo: np.ndarray, q: tuple, surface: ContactShapes,
                        mass: np.ndarray) -> ContactPointState:
    g = {name: geo[..., s] for name, s in GEO.items()}
    n, skin, sides = g["n"], surface.skin, []
    for s, side in enumerate("ab"):
        R = complex_rotation_matrix(small_turn_applied(q[s], pose[..., 6 * s + 3:6 * s + 6]))
        rim = g["rim"][..., s]
        out = rim_direction(R, surface.axis[:, s], n, rim.real > 0.0) * rim[..., None]
        arm = matrix_times_vector(R, g[f"core_{side}"]) + (out if s else -out)
        way = pose[..., 6 * s:6 * s + 3] - g[f"from_{side}"] + arm - g[f"first_{side}"]
        sides.append((arm, way, (R * mass[..., None, 4 * s + 1:4 * s + 4]) @ np.swapaxes(R, -1, -2)))
    (arm_a, way_a, S_a), (arm_b, way_b, S_b) = sides
    gap = g["gap"][..., 0] + (n * (way_a - way_b)).sum(-1)
    return ContactPointState(gap, (arm_a - skin[:, :1] * n, arm_b + skin[:, 1:] * n), (n, *contact_tangents(n)), (S_a, S_b))


def relative_contact_velocity(t: ContactPointState, momentum: np.ndarray, mass: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(u_n, u_1, u_2) of a against b (..., 3); given (points, 12): velocities of sides that are no body."""
    u = 0.0
    for s, sign in ((0, 1.0), (1, -1.0)):
        v = mass[..., 4 * s:4 * s + 1] * momentum[..., 6 * s:6 * s + 3] + given[:, 6 * s:6 * s + 3]
        o = matrix_times_vector(t.S[s], momentum[..., 6 * s + 3:6 * s + 6]) + given[:, 6 * s + 3:6 * s + 6]
        u = u + sign * (v + np.cross(o, t.r[s]))
    return np.stack([(axis * u).sum(-1) for axis in t.axes], axis=-1)


def contact_impulse(t: ContactPointState, f: np.ndarray) -> np.ndarray:
    """(P, T) on a, and on b."""
    P = sum(f[..., k:k + 1] * axis for k, axis in enumerate(t.axes))
    return np.concatenate([P, np.cross(t.r[0], P), -P, -np.cross(t.r[1], P)], axis=-1)


def normal_effective_mass(t: ContactPointState, mass: np.ndarray) -> np.ndarray:
    """A_ii (...,)."""
    found = mass[..., 0] + mass[..., 4]
    for s in (0, 1):
        c = np.cross(t.r[s], t.axes[0])
        found = found + (c * matrix_times_vector(t.S[s], c)).sum(-1)
    return found


@dataclass
class ContactFormulas:
    """Constants of all points in a substep: given (points, 12); pushes (points,): what has an impulse along n; way (points,):
    NONE, STICKS or SLIPS."""

    h: float
    q: tuple[np.ndarray, np.ndarray]
    Q: tuple[np.ndarray, np.ndarray]
    surface: ContactShapes
    given: np.ndarray
    pushes: np.ndarray
    way: np.ndarray

    def tangential_residual(self, f: np.ndarray, u: np.ndarray, mu: np.ndarray) -> np.ndarray:
        """Rest across n (..., 2)."""
        t = u[..., 1:]
        size = complex_vector_length(t)
        none = np.abs(size) == 0.0
        slips = f[..., 1:] + mu * f[..., :1] * t / np.where(none, 1.0, size)[..., None]
        way = self.way[:, None]
        return np.where(way == STICKS, t, np.where(way == SLIPS, slips, f[..., 1:]))

    def soft_contact_bias(self, t: ContactPointState, mass: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Bias of what gives way: the velocity that it is to have, and what it gives way by."""
        pull, most = float(RATE) * t.gap / self.h, -self.surface.fastest
        soft = np.where(pull.real > most, pull, most) + float(GIVES) * normal_effective_mass(t, mass) * push
        return np.where(t.gap.real > 0.0, t.gap / self.h, soft)

    def held(self, v: Values) -> Values:
        """impulse (12) and rest (3), of pose, momentum, f, geo, mass, mu."""
        t, f = contact_point_state(v["pose"], v["geo"], self.q, self.surface, v["mass"]), v["f"]
        u = relative_contact_velocity(t, v["momentum"], v["mass"], self.given)
        along = np.where(self.pushes, u[..., 0] + self.soft_contact_bias(t, v["mass"], f[..., 0]), f[..., 0])
        return {"impulse": contact_impulse(t, f),
                "rest": np.concatenate([along[..., None], self.tangential_residual(f, u, v["mu"])], axis=-1)}

    def loosed(self, v: Values) -> Values:
        """The same behind the places, of then, momentum, f, before, geo, mass, mu."""
        t, f = contact_point_state(v["then"], v["geo"], self.Q, self.surface, v["mass"]), v["f"]
        u = relative_contact_velocity(t, v["momentum"], v["mass"], self.given)
        far = np.where(t.gap.real > 0.0, t.gap / self.h, 0.0)
        along = np.where(self.pushes, u[..., 0] + far, f[..., 0])
        rest = np.concatenate([along[..., None], self.tangential_residual(f, u, v["mu"])], axis=-1)
        return {"impulse": contact_impulse(t, f - v["before"]), "rest": rest}

    def thrown(self, v: Values) -> Values:
        """Residual of an impact: pose, entering (momenta before), momentum, f, geo, mass, mu, force (6), e (1)."""
        t, f = contact_point_state(v["pose"], v["geo"], self.q, self.surface, v["mass"]), v["f"]
        u = relative_contact_velocity(t, v["momentum"], v["mass"], self.given)
        before = relative_contact_velocity(t, v["entering"], v["mass"], self.given)[..., 0]
        pull = v["mass"][..., :1] * v["force"][..., :3] - v["mass"][..., 4:5] * v["force"][..., 3:]
        drop = -2.0 * (t.axes[0] * pull).sum(-1) * np.where(t.gap.real > 0.0, t.gap, 0.0)
        square = before * before + drop
        speed = np.sqrt(np.where(square.real > 0.0, square, 1.0e-300))
        along = np.where(self.pushes, u[..., 0] - before - (1.0 + v["e"][..., 0]) * speed, f[..., 0])
        given = contact_impulse(t, f)
        near = self.pushes & (t.gap.real > 0.0)
        when = np.where(near, 2.0 * t.gap / np.where(near, speed - before, 1.0), 0.0)[..., None]
        way = [-when * v["mass"][..., 4 * s:4 * s + 1] * given[..., 6 * s:6 * s + 3] for s in (0, 1)]
        turn = [-when * matrix_times_vector(t.S[s], given[..., 6 * s + 3:6 * s + 6]) for s in (0, 1)]
        return {"impulse": given, "rest": np.concatenate([along[..., None], self.tangential_residual(f, u, v["mu"])], axis=-1),
                "shift": np.concatenate([way[0], turn[0], way[1], turn[1]], axis=-1)}


def manifold_geometry(v: Values, q: tuple[np.ndarray, np.ndarray], surface: ContactShapes, rolls: np.ndarray,
                      apart: np.ndarray) -> Values:
    """geo of points as their manifold is made, of n (3), x (3) (the midpoint from where a's centre stands), gap, pose; rolls
    (points, 2): those with a rim; apart: b's centre from a's, (points, 3) [m] (kernels/rigid/lists/rows.py)."""
    n, half, p, skin = v["n"], 0.5 * v["gap"], v["pose"], surface.skin
    arms = (v["x"] + (half + skin[:, :1]) * n - p[..., :3], v["x"] - (half + skin[:, 1:]) * n - apart - p[..., 6:9])
    cores, rims = [], []
    for s, arm in enumerate(arms):
        R = complex_rotation_matrix(small_turn_applied(q[s], p[..., 6 * s + 3:6 * s + 6]))
        out = rim_direction(R, surface.axis[:, s], n, rolls[:, s]) * (1.0 if s else -1.0)
        rim = (out * (arm - matrix_times_vector(R, surface.center[:, s]))).sum(-1)[..., None]
        cores.append(transpose_times_vector(R, arm - rim * out))
        rims.append(rim)
    return {"geo": np.concatenate([n, *cores, *arms, v["gap"], p[..., :3], p[..., 6:9], *rims], axis=-1)}
