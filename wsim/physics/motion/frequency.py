"""How stiff a scene is: the highest frequency of its points, which bounds the step of explicit integrators. NumPy.

    bound       omega^2 <= max over points i of (1 / m_i) sum_c g_ci sum_l g_cl,   g_ck = |alpha_c^-1/2 G_ck|
                the row sums of M^-1 K at rest (Gershgorin 1931): safe at rest, and cautious by 38 % on a square net
                of tets: the highest eigenvalue of any one with its share of its points' masses (Irons, Treharne 1971), as
                safe, and less cautious: by 20 to 30 %, against 80 % by row sums (linear), 210 % (quadratic)
    estimate    the highest eigenvalue of M^-1 K at rest by power iteration (von Mises 1929), from below
    slopes      G of every constraint at rest (`wsim.physics.cloth.kind`); of hinges, curvatures of triangles have J

K keeps the material part G^T alpha^-1 G, and what smoothed contacts add (`wsim.physics.contact.barrier`); what tension adds is
not in it. Points that are pinned do not count.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wsim.model.model import Model, PointBody, hard_places
from wsim.physics.cloth.constraints import Constraints, of_body
from wsim.physics.motion.stability import substeps_needed
from wsim.scene.integrator import Integrator

ITERATIONS = 40        # of the power method: within 2 % on nets of 1e2 to 1e5 points
SOME = 20_000          # tets at a time: a quadratic one has 6 kB of J


@dataclass
class Stiffness:
    """Stiffness of one kind on one body: ids (m, k) from the body's first point, J = alpha^-1/2 G, (m, rows, k, 3), tau [s]."""

    ids: np.ndarray
    J: np.ndarray
    tau: float


def constraint_stiffness(rows: list[Constraints], body: PointBody) -> Iterator[Stiffness]:
    """Every soft constraint of a body at rest, of sheets some triangles at a time."""
    for r in rows:
        if r.hard:
            continue
        G, alpha = r.row.slopes(r, body), r.alpha
        if alpha.ndim == 2:
            A = np.zeros((len(G), 3, 3))
            A[:, 0, 0], A[:, 1, 1] = alpha[:, 0], alpha[:, 3]
            A[:, 0, 1] = A[:, 1, 0] = alpha[:, 1]
            A[:, 2, 2] = alpha[:, 2]
            root = np.linalg.cholesky(np.linalg.inv(A))
            J = np.einsum("mrs,mrki->mski", root, G)
        else:
            J = G / np.sqrt(np.broadcast_to(alpha, len(G)))[:, None, None, None]
        ids = r.ids - body.first
        if r.coupling is None:
            yield Stiffness(ids, J, r.tau)
            continue
        for first in range(0, len(r.coupling.slot), SOME):
            some = slice(first, first + SOME)
            yield Stiffness(*point_curvatures(r.coupling.slot[some], r.coupling.value[some], ids, J[:, 0]), r.tau)


def point_curvatures(slot: np.ndarray, value: np.ndarray, ids: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of triangles (t, k), and J (t, 3, k, 3) of C, from those of hinges, (m, 4) and (m, 4, 3); slot, value: of
    `wsim.physics.cloth.bending.Coupling`. A point that several hinges of a triangle have stands once; places that are left have
    J = 0."""
    there, slot = (slot >= 0)[..., None], np.maximum(slot, 0)
    value, points = np.where(there, value, 0.0), np.where(there, ids[slot], ids[slot[:, :1]]).reshape(len(slot), -1)
    order = np.argsort(points, axis=1, kind="stable")
    new = np.diff(np.take_along_axis(points, order, axis=1), axis=1, prepend=-1) != 0
    place = np.empty(points.shape, np.int64)
    np.put_along_axis(place, order, np.cumsum(new, axis=1) - 1, axis=1)
    width = int(place.max(initial=0)) + 1
    place += width * np.arange(len(slot))[:, None]
    each = (value[:, :, None, :, None] * J[slot][:, :, :, None, :]).reshape(-1, 9)
    whole, found = np.zeros((len(slot), width), points.dtype), np.empty((len(slot) * width, 9))
    whole.ravel()[place] = points
    for k in range(9):
        found[:, k] = np.bincount(place.ravel(), each[:, k], len(found))
    return whole, found.reshape(*whole.shape, 3, 3).swapaxes(1, 2)


def tet_stiffness(body: PointBody, parts: list | None) -> Iterator[Stiffness]:
    """Every tet of a soft body at rest, some at a time; parts: `wsim.physics.soft.parts.Region` of all as they are, None: as in
    the scene."""
    if not len(body.tets):
        return
    from wsim.physics.soft.parts import parts_of, strain_rows
    from wsim.scene.solid import MODELS
    mine = [p for name in MODELS for p in parts_of(body, name)] if parts is None else [p for p in parts if p.body is body]
    for some in (s for p in mine for s in p.cut(SOME)):
        yield Stiffness(body.tets[some.rows] - body.first, strain_rows(some), float(some.lame()[2].max()))


def stiffest_tet(body: PointBody, parts: list | None, w: np.ndarray) -> tuple[float, float]:
    """The highest eigenvalue of M^-1 K and of M^-1 sum tau K of the tets of a body, from above: that of one tet alone. Tets
    share a point's mass by |J_k|^2, its part of the diagonal. (tr A^8)^(1/8) stands for A's highest eigenvalue: a little above
    it."""
    total, top, decay = np.zeros(body.count), 0.0, 0.0
    for s in tet_stiffness(body, parts):
        total += np.bincount(s.ids.ravel(), np.einsum("mrki,mrki->mk", s.J, s.J).ravel(), body.count)
    for s in tet_stiffness(body, parts):
        share = np.einsum("mrki,mrki->mk", s.J, s.J) / total[s.ids]
        B = (s.J * np.sqrt(w[s.ids] / np.maximum(share, 1e-30))[:, None, :, None]).reshape(*s.J.shape[:2], -1)
        A = B @ B.transpose(0, 2, 1)
        size = max(float(np.trace(A, axis1=1, axis2=2).max()), 1e-300)
        A = np.linalg.matrix_power(A / size, 8)
        square = size * float(np.trace(A, axis1=1, axis2=2).max())**0.125
        top, decay = max(top, square), max(decay, s.tau * square)
    return top, decay


def _inverse_masses(model: Model, body: PointBody, pinned: np.ndarray) -> np.ndarray:
    """Inverse masses of a body's points; one that another body shares has the mass of both."""
    w = 1.0 / (body.masses if model.alias is None else model.stack("masses")[model.alias[body.first:body.last]])
    w[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = 0.0
    return w


def in_world(model: Model, world: int) -> Model:
    """The model with masses and constraints of that world in world 0: live values may differ."""
    masses = {b.path: b.masses for b in model.bodies if b.world == world}
    bodies = {b.path: replace(b, masses=masses[b.path]) for b in model.bodies if b.world == 0}
    rows = [r.moved(bodies[r.body.path]) for r in model.constraints if r.body.world == world]
    return replace(model, bodies=[bodies[b.path] if b.world == 0 else b for b in model.bodies], constraints=rows)


def _part_norms(J: np.ndarray) -> np.ndarray:
    """Norms of the parts of J (m, rows, k, 3) of each point, (m, k); of curvatures, which a sheet that is flat has of one
    direction only, Frobenius', which costs little."""
    if J.shape[1] == 1 or J.shape[2] > 3:
        return np.sqrt(np.einsum("mrki,mrki->mk", J, J))
    return np.sqrt(largest_eigenvalue(np.einsum("mrki,mrkj->mkij", J, J)))


def largest_eigenvalue(A: np.ndarray) -> np.ndarray:
    """The highest eigenvalue of symmetric matrices (..., 3, 3), by angles (Smith 1961); to 1e-8 of it where two are equal."""
    mean = np.trace(A, axis1=-2, axis2=-1) / 3.0
    B = A - mean[..., None, None] * np.eye(3)
    p = np.sqrt(np.sum(B * B, axis=(-2, -1)) / 6.0)
    r = np.linalg.det(B / np.where(p > 0.0, p, 1.0)[..., None, None]) / 2.0
    return mean + 2.0 * p * np.cos(np.arccos(np.clip(r, -1.0, 1.0)) / 3.0)


class RowSums:
    """Row sums of the stiffness of bodies at rest, which do not depend on their masses, kept for whoever asks next."""

    def __init__(self, model: Model):
        self.model, self.kept = model, {}
        self.pinned = np.setdiff1d(hard_places(model), model.gone)

    def of(self, body: PointBody) -> tuple[np.ndarray, np.ndarray]:
        """Row sums over the free points [N/m], and of tau K [N s/m], (points,) each."""
        if body.first not in self.kept:
            free = np.ones(body.count, bool)
            free[self.pinned[(self.pinned >= body.first) & (self.pinned < body.last)] - body.first] = False
            sums, damped = np.zeros(body.count), np.zeros(body.count)
            for s in constraint_stiffness(of_body(self.model, body), body):
                g = np.where(free[s.ids], _part_norms(s.J), 0.0)
                each = np.bincount(s.ids.ravel(), (g * g.sum(1, keepdims=True)).ravel(), body.count)
                sums += each
                damped += s.tau * each
            self.kept[body.first] = sums, damped
        return self.kept[body.first]


def frequency_bound(model: Model, parts: list | None = None, rows: RowSums | None = None) -> tuple[float, float]:
    """The highest frequency omega [rad/s] and highest decay rate c [1/s] of the points of world 0, from above. parts:
    `tet_stiffness`. rows: of this model, where they are kept."""
    rows, tops, decays = rows or RowSums(model), [0.0], [0.0]
    for body in (b for b in model.bodies if b.world == 0):
        w = _inverse_masses(model, body, rows.pinned)
        sums, damped = rows.of(body)
        square, rate = stiffest_tet(body, parts, w)
        tops.append(float((w * sums).max(initial=0.0)) + square)
        decays.append(float((w * damped).max(initial=0.0)) + rate)
    most = max if model.alias is None else sum                         # a point that two share has the forces of both
    return (most(tops) + _contact_frequency(model))**0.5, most(decays) + model.scene.air_drag


def _contact_frequency(model: Model) -> float:
    """What smoothed contacts add [1/s^2]."""
    if model.scene.contact_width == 0.0 or not model.scene.colliders:
        return 0.0
    from wsim.physics.contact.barrier import barrier_stiffness
    return barrier_stiffness(model.scene)


def frequency_estimate(model: Model, iterations: int = ITERATIONS) -> float:
    """The highest frequency [rad/s] of the points of world 0 at rest, from below."""
    pinned, top = hard_places(model), 0.0
    for body in (b for b in model.bodies if b.world == 0):
        parts = [*constraint_stiffness(of_body(model, body), body), *tet_stiffness(body, None)]
        root = np.sqrt(_inverse_masses(model, body, pinned))[:, None]
        y, value = np.random.default_rng(7).normal(size=(body.count, 3)) * root, 0.0
        for _ in range(iterations):
            size = np.linalg.norm(y)
            if size == 0.0 or not parts:
                break
            x, f = root * y / size, np.zeros_like(y)
            for s in parts:
                strain = np.einsum("mrki,mki->mr", s.J, x[s.ids])
                force = np.einsum("mrki,mr->mki", s.J, strain)
                for k in range(3):
                    f[:, k] += np.bincount(s.ids.ravel(), force[:, :, k].ravel(), body.count)
            value, y = float(np.linalg.norm(root * f)), root * f
        top = max(top, value)
    return (top + _contact_frequency(model))**0.5


def least_substeps(model: Model, integrator: Integrator, tables: list) -> int:
    """Substeps a frame that keep the present stiffness stable, in every world. tables: of tets."""
    bounds = []
    for world in range(model.worlds):
        one = in_world(model, world)
        firsts = [b for b in one.bodies if b.world == 0]
        bounds.append(frequency_bound(one, [replace(p, body=b) for table in tables for p in table.parts for b in firsts
                                            if (p.body.path, p.body.world) == (b.path, world)]))
    tops = [b for b in set(bounds) if not any(b != o and b[0] <= o[0] and b[1] <= o[1] for o in bounds)]
    return max(substeps_needed(model.scene, integrator, omega, c) for omega, c in tops)
