"""The adjoint of a substep of bodies that joints and contacts move, by the implicit function theorem, on the host in float64.

    M = kick(p, L) + I(y, f)            momenta behind forces and impulses f (kernels/rigid/joint/steps.py, soft_step.py)
    N = M + s d(p, L)                   those that bodies are placed by; s = 0 of what contacts have touched
    y' = place(y, N)
    0 = r(y, y', M, N, f)               what f was solved for, a row each: of an active set, as it was in the end
    M' = M + I'(y', f')                 behind impulses f' along the same rows at the new places,
    0 = r'(y', M', f', f)

With cotangents of y' and M' the second solve goes first, then the first; each is one linear system, the transposed of what a
step of Newton's method would take for all impulses of an island. Islands are solved by themselves, densely: memory and time of
an island are those of the square and cube of its rows (a humanoid: 90 rows, a stack of ten boxes: 120). What rows do not tell
apart (four points under a box) has the least squares. Poses are x and a small turn before the orientation.
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.physics.rigid.recorded.local import Values, complex_derivatives
from wsim.physics.rigid.recorded.rotation import (
    complex_damped_kick,
    complex_free_rotation,
    complex_quaternion_conjugate,
    complex_quaternion_product,
    skew_symmetric_matrix,
    small_turn_applied,
    transpose_times_vector,
)

RANK = 1.0e-11            # part of the largest singular value below which rows say the same
FORCES = ("push", "torque", "drag", "spin_drag")


@dataclass
class CouplingElements:
    """Joints, or points of contact: bodies (elements, 2), -1: none; what they do by what they read (`complex_derivatives`)."""

    bodies: np.ndarray
    jac: dict[tuple[str, str], np.ndarray]

    @property
    def rows(self) -> int:
        """Number of rows of one element."""
        return self.jac["rest", "f"].shape[1]


@dataclass
class RecordedBodyValues:
    """Values of all bodies: (n, 3) and (n,); q (n, 4). placed (n,): 1 where the kick of the forces is halved, else 0."""

    q: np.ndarray
    q_after: np.ndarray
    momentum: np.ndarray           # (n, 6) where the substep begins
    placing: np.ndarray            # (n, 6)
    w: np.ndarray
    inverse: np.ndarray
    push: np.ndarray
    torque: np.ndarray
    drag: np.ndarray
    spin_drag: np.ndarray
    placed: np.ndarray

    def forces(self, h: float) -> dict:
        """Derivatives of the kick and of what is taken back of it."""
        def half_and_whole_kick(v: Values) -> Values:
            def kick_over_time(t: float) -> np.ndarray:
                p, L = v["momentum"][..., :3], v["momentum"][..., 3:]
                return np.concatenate([complex_damped_kick(p, v["push"], v["drag"][..., 0], t),
                                       complex_damped_kick(L, v["torque"], v["spin_drag"][..., 0], t)], axis=-1)
            whole = kick_over_time(h)
            return {"kick": whole, "back": self.placed[:, None] * (kick_over_time(0.5 * h) - whole)}
        given = {"momentum": self.momentum, "push": self.push, "torque": self.torque, "drag": self.drag[:, None],
                 "spin_drag": self.spin_drag[:, None]}
        return complex_derivatives(half_and_whole_kick, given)

    def places(self, h: float) -> dict:
        """Derivatives of places by places, momenta, w and 1 / I."""
        def place_after_substep(v: Values) -> Values:
            x = v["pose"][..., :3] + h * v["w"] * v["placing"][..., :3]
            q = complex_free_rotation(small_turn_applied(self.q, v["pose"][..., 3:]), v["placing"][..., 3:], v["inverse"], h)
            return {"pose": np.concatenate([x,
                            2.0 * complex_quaternion_product(q, complex_quaternion_conjugate(self.q_after))[..., :3]], axis=-1)}
        given = {"pose": np.zeros((len(self.w), 6)), "placing": self.placing, "w": self.w[:, None], "inverse": self.inverse}
        return complex_derivatives(place_after_substep, given)


@dataclass
class BodyCotangents:
    """Cotangents of all bodies (n, 6): poses, momenta; by tables of bodies, and by what elements read (`by`: kind, name)."""

    pose: np.ndarray
    momentum: np.ndarray
    bodies: dict[str, np.ndarray] = field(default_factory=dict)
    by: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)

    def add(self, name: str, more: np.ndarray) -> None:
        self.bodies[name] = self.bodies.get(name, 0.0) + more

    def add_by(self, kind: str, name: str, more: np.ndarray) -> None:
        self.by[kind, name] = self.by.get((kind, name), 0.0) + more


def element_islands(kinds: dict[str, CouplingElements], n: int) -> list[np.ndarray]:
    """Bodies that elements connect, those of each island."""
    label = np.arange(n)
    pairs = np.concatenate([np.zeros((0, 2), int), *(e.bodies[(e.bodies >= 0).all(axis=1)] for e in kinds.values())])
    while len(pairs):
        least = label[pairs].min(axis=1)
        before = label.copy()
        np.minimum.at(label, pairs.ravel(), np.repeat(least, 2))
        label = label[label]
        if np.array_equal(before, label):
            break
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


class IslandBlocks:
    """Dense blocks of an island's elements: columns of bodies stand by six."""

    def __init__(self, kinds: dict[str, CouplingElements], bodies: np.ndarray, n: int):
        self.kinds, self.bodies = kinds, bodies
        place = np.full(n + 1, -1)
        place[bodies] = np.arange(len(bodies))
        self.own: dict[str, np.ndarray] = {}
        self.place: dict[str, np.ndarray] = {}
        self.first: dict[str, int] = {}
        self.count = 0
        for name, e in kinds.items():
            places = place[e.bodies]
            self.own[name] = np.flatnonzero((places >= 0).any(axis=1))
            self.place[name] = places[self.own[name]]
            self.first[name] = self.count
            self.count += e.rows * len(self.own[name])

    def rows(self, name: str) -> np.ndarray:
        """(elements, rows) of a kind in the island's system."""
        size = self.kinds[name].rows
        return self.first[name] + np.arange(size * len(self.own[name])).reshape(-1, size)

    def columns(self, name: str) -> np.ndarray:
        """(elements, 12) of the two bodies of a kind's elements, -1 where there is none."""
        p = np.repeat(self.place[name], 6, axis=1)
        return np.where(p >= 0, 6 * p + np.tile(np.arange(6), 2), -1)

    def block(self, out: str, into: str) -> np.ndarray:
        """Dense, of impulses or rests by f or by something of bodies; 0 where nothing reads it."""
        size = self.count if out == "rest" else 6 * len(self.bodies)
        width = self.count if into in ("f", "before") else 6 * len(self.bodies)
        found = np.zeros((size + 1, width + 1))
        for name, e in self.kinds.items():
            if (out, into) in e.jac and len(self.own[name]):
                r = self.rows(name) if out == "rest" else self.columns(name)
                c = self.rows(name) if into in ("f", "before") else self.columns(name)
                shape = np.broadcast_shapes(r[:, :, None].shape, c[:, None, :].shape)
                shape = (shape[0], r.shape[1], c.shape[1])
                np.add.at(found, (np.broadcast_to(r[:, :, None], shape), np.broadcast_to(c[:, None, :], shape)),
                          e.jac[out, into][self.own[name]])
        return found[:-1, :-1]

    def others(self, into: BodyCotangents, **by: np.ndarray) -> None:
        """Adds what elements read besides, of the cotangents of impulses and shifts of bodies (6 n,) and of rests."""
        for name, e in self.kinds.items():
            own = self.own[name]
            parts = {out: b[self.rows(name)] if out == "rest" else np.append(b, 0.0)[self.columns(name)]
                     for out, b in by.items()}
            for given in {given for _, given in e.jac if given not in KNOWN} if len(own) else ():
                more = np.zeros((len(e.bodies), e.jac["rest", given].shape[2]))
                more[own] = sum(np.einsum("eoi,eo->ei", e.jac[out, given][own], b) for out, b in parts.items()
                                if (out, given) in e.jac)
                into.add_by(name, given, more)


KNOWN = ("pose", "then", "momentum", "placing", "entering", "f", "before")


def solve_transposed(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """x with A^T x = b, of least size; rows of A are scaled by their largest number."""
    if len(b) == 0:
        return b
    size = np.abs(A).max(axis=1)
    size = np.where(size > 0.0, size, 1.0)
    return np.linalg.lstsq((A / size[:, None]).T, b, rcond=RANK)[0] / size


def velocity_vjp(kinds: dict[str, CouplingElements], n: int, cot: BodyCotangents, place: str = "then",
                 turn: np.ndarray | None = None, first: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Adjoint of M' = M + I'(y', f'), 0 = r'(y', M', f', f): cot is that of y' and M', and becomes that of y' and M. Of
    impacts, which shift bodies: of y and M, turned by `turn` (n, 3), where I' and r' read other poses, whose cotangents `first`
    takes. Returns what each kind's f has of it, (elements, rows)."""
    given = {name: np.zeros((len(e.bodies), e.rows)) for name, e in kinds.items()}
    by_shift, into = cot.pose.copy(), cot.pose if first is None else first
    if turn is not None:
        by_shift[:, 3:], cot.pose[:, 3:] = (transpose_times_vector(left_rotation_jacobian(turn), cot.pose[:, 3:]),
                                            transpose_times_vector(rotation_vector_matrix(turn), cot.pose[:, 3:]))
    for bodies in element_islands(kinds, n) if kinds else ():
        one = IslandBlocks(kinds, bodies, n)
        if one.count == 0:
            continue
        M, Y = cot.momentum[bodies].ravel(), by_shift[bodies].ravel()
        by_M, parts = one.block("rest", "momentum"), [("impulse", M), ("shift", Y)]
        rest = solve_transposed(one.block("rest", "f") + by_M @ one.block("impulse", "f"),
                                -sum(b @ one.block(out, "f") for out, b in parts))
        M = M + rest @ by_M
        parts = [("impulse", M), ("rest", rest), ("shift", Y)]
        into[bodies] += sum(b @ one.block(out, place) for out, b in parts).reshape(-1, 6)
        cot.momentum[bodies] = (M + sum(b @ one.block(out, "entering") for out, b in parts)).reshape(-1, 6)
        f = sum(b @ one.block(out, "before") for out, b in parts)
        for name in kinds:
            given[name][one.own[name]] = f[one.rows(name)]
        one.others(cot, **dict(parts))
    return given


def rotation_vector_matrix(turn: np.ndarray) -> np.ndarray:
    """R (..., 3, 3) of rotation vectors."""
    X, t = skew_symmetric_matrix(turn), np.linalg.norm(turn, axis=-1)[..., None, None]
    return np.eye(3) + np.sinc(t / np.pi) * X + 0.5 * np.sinc(0.5 * t / np.pi)**2 * (X @ X)


def left_rotation_jacobian(turn: np.ndarray) -> np.ndarray:
    """Derivative with respect to a change of a rotation vector, the turn before the rotation: the left Jacobian."""
    X, t = skew_symmetric_matrix(turn), np.linalg.norm(turn, axis=-1)[..., None, None]
    third = np.where(t > 1.0e-2, (1.0 - np.sinc(t / np.pi)) / np.where(t > 1.0e-2, t * t, 1.0), 1.0 / 6.0 - t * t / 120.0)
    return np.eye(3) + 0.5 * np.sinc(0.5 * t / np.pi)**2 * X + third * (X @ X)


def substep_vjp(kinds: dict[str, CouplingElements], b: RecordedBodyValues, h: float, cot: BodyCotangents,
                given: dict[str, np.ndarray]) -> np.ndarray:
    """Adjoint of the substep up to M and y', of whose cotangents cot becomes that of y and (p, L); given: that of f. Returns
    the cotangents of poses that elements read, which are not in that of y."""
    n, forces, places = len(b.w), b.forces(h), b.places(h)
    pose, first, momentum = np.zeros((n, 6)), np.zeros((n, 6)), np.zeros((n, 6))
    placing, after = np.zeros((n, 6)), cot.pose.copy()
    by_N = places["pose", "placing"]
    for bodies in element_islands(kinds, n):
        one = IslandBlocks(kinds, bodies, n)
        Y, M = cot.pose[bodies], cot.momentum[bodies]
        rest = np.zeros(one.count)
        if one.count:
            C, by_place = one.block("impulse", "f"), np.zeros((6 * len(bodies),) * 2)
            for k, body in enumerate(bodies):
                by_place[6 * k:6 * k + 6, 6 * k:6 * k + 6] = by_N[body]
            R_M, R_N, R_T = (one.block("rest", name) for name in ("momentum", "placing", "then"))
            f = np.zeros(one.count)
            for name in kinds:
                f[one.rows(name)] = given[name][one.own[name]]
            f = f + (M.ravel() + Y.ravel() @ by_place) @ C
            rest = solve_transposed(one.block("rest", "f") + (R_M + R_N + R_T @ by_place) @ C, -f)
            Y = Y + (rest @ R_T).reshape(-1, 6)
        N = np.einsum("noi,no->ni", by_N[bodies], Y)
        if one.count:
            N = N + (rest @ R_N).reshape(-1, 6)
            M = M + (rest @ R_M).reshape(-1, 6)
        M = M + N
        pose[bodies] = np.einsum("noi,no->ni", places["pose", "pose"][bodies], Y)
        if one.count:
            first[bodies] = (M.ravel() @ one.block("impulse", "pose") + rest @ one.block("rest", "pose")).reshape(-1, 6)
            one.others(cot, impulse=M.ravel(), rest=rest)
        momentum[bodies], placing[bodies], after[bodies] = M, N, Y
    cot.pose = pose
    cot.momentum = sum(np.einsum("noi,no->ni", forces[out, "momentum"], by) for out, by in (("kick", momentum),
                                                                                          ("back", placing)))
    for name in FORCES:
        cot.add(name, sum(np.einsum("noi,no->ni", forces[out, name], by)
                          for out, by in (("kick", momentum), ("back", placing))))
    for name in ("w", "inverse"):
        cot.add(name, np.einsum("noi,no->ni", places["pose", name], after))
    return first
