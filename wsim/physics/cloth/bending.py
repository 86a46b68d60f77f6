"""Curvature of a triangulated sheet from the angles of its hinges, convergent on any mesh. NumPy only.

Morley's plate element (1968; as a shape operator: Grinspun, Gingold, Reisman, Zorin 2006, section 4) has a normal of its own
at the middle of each edge. With alpha_tk the angle from the normal of triangle t to that of its edge k, n_k in the plane
across the edge, l_k its length and A_t the area,

    S_t = (1 / A_t) sum_k l_k alpha_tk n_k n_k^T,     E_0 = 1/2 bend sum_t A_t |S_t|^2,     alpha_tk + alpha_t'k = theta

theta the angle of the hinge. Here an edge has no unknown of its own: theta is shared between its two triangles in a way that is
exact on every quadratic surface. With h the heights of the triangles over the edge,

    alpha_tk = f theta + sum_i c_i theta_i,     f = h_t / (h_t + h_t'),     alpha_t'k = theta - alpha_tk

over the hinge and the four others of its triangles. A triangle with its apex at (p, h) over an edge from 0 to L gives, on a
surface of curvatures nn, nt, tt (n across the edge, t along it),

    a = h/2 nn + (p - L/2) nt + p (p - L) / (2 h) tt,     so that theta = R . S,  R = a_t + a_t'

and c is the combination of the angles that is (a_t - f R) . S, of least squares: c = G A (A^2 + e^2)^-1 (a_t - f R), rows of G
those R of the five hinges, A = G^T G, e = SHARP tr A (a direction of S that they do not tell is left out, smoothly).

Whatever the split, E_0 is not below what Morley's element has at these points: no mode has an energy of 0 but those that
bend nothing. Forces of a constant moment cancel, and S of a quadratic surface is right: E_0 converges with the square of the
size of triangles (tools/results/data/bending.json). The free border of a sheet bears no moment across: the angle there makes
E_0 least. A triangle with three hard pins is a clamp: it does not bend, and a hinge beside it belongs to the other
triangle, so that a strip begins where its pins end. S has no Poisson's ratio: a strip of any width bends with `bend`. Hinges of
an edge with three triangles and more, or of a triangle without height, stand alone: E = 1/2 bend l^2 / A theta^2, A the area of
both.

What hinges share must not change sign where one folds through itself, from pi to -pi: E is E_0 of f = s + s^3 / 6, s sine of
theta, and 1/2 K_hh (theta_h^2 - f_h^2) of each hinge, K second derivatives of E_0. At 0.1 rad f is theta to 1e-5.

    F   (triangles, SLOTS, 3): A_t^1/2 S_t = sum_s F_ts theta_s, by (tt, 2^1/2 nt, nn) of the axes of edge 0
    D   (hinges,): E <= 1/2 bend sum D theta^2. The eigenvalues of B = sum_s F_s F_s^T / |F_s| of one triangle are at most
        lam = (tr B^POWER)^(1/POWER), and D = sum_t lam_t |F_ts|; any other weights than |F_s| would do

`Coupling` has F / D^1/2, and compliances are 1 / (bend D): those of hinges that, alone, are at least as stiff.
"""

from dataclasses import dataclass

import numpy as np

SLOTS = 9              # hinges that the curvature of a triangle depends on: its own, and two of each neighbour
SHARP = 3e-3           # of A: smaller eigenvalues are directions of S that five hinges do not tell. Coefficients stay below 10
LOW = 1e-6             # height of a triangle over its longest edge, below which it has no curvature
POWER = 32             # the bound is above the highest eigenvalue by 3^(1/32) at most, 3.5 %
SMOOTH = 1e-4          # of the squares of a triangle's F: what is added to each, so that D has a gradient where F is 0
TINY = 1e-30           # step of complex differences
ANY = np.eye(3)        # corners in the place of those of triangles that bear nothing: nothing is divided by 0
ROOT2 = 2.0**0.5


@dataclass
class Patches:
    """The hinges and triangles of a sheet. Edge k of triangle t goes from corner k + 1 to k + 2; its place is 3 t + k.

    hinge (t, 3)      hinge of each edge, -1 without a whole one     sign (t, 3)    1 where it goes round as the triangle, or -1
    side (h, 2)       places of a hinge, whole ones only              way (h, 2)     signs there
    near (h, 4)       places of the four other edges of its triangles, the next and the one before of each, as it goes round
    points (h, 8)     of the hinge, then the apexes across from `near`, its own where there is none
    bends (h, 6)      whether the triangles of the hinge and those beyond `near` bend
    whole, alone      rows of hinges with two triangles, and of those that stand alone
    slot (t + alone, SLOTS)   hinge of each F, -1 without
    """

    ids: np.ndarray
    triangles: np.ndarray
    hinge: np.ndarray
    sign: np.ndarray
    side: np.ndarray
    way: np.ndarray
    near: np.ndarray
    points: np.ndarray
    bends: np.ndarray
    whole: np.ndarray
    alone: np.ndarray
    slot: np.ndarray


def sheet_patches(points: np.ndarray, triangles: np.ndarray, ids: np.ndarray, pinned: np.ndarray) -> Patches:
    """points (n, 3) at rest [m]; triangles (t, 3); ids (m, 4) of `wsim.geometry.topology.hinges_of_triangles`; pinned (n,)."""
    t, ids, n = triangles.astype(np.int64), ids.astype(np.int64), len(points)
    key = _triangle_key(t, n)
    order = np.argsort(key)
    of = np.stack([order[np.searchsorted(key[order], _triangle_key(ids[:, c], n))] for c in ([0, 1, 2], [0, 1, 3])], axis=1)
    k = (t[of] == ids[:, 2:, None]).argmax(axis=2)
    side = 3 * of + k
    ahead = np.take_along_axis(t[of], (k[..., None] + 1) % 3, axis=2)[..., 0]
    way = np.where(ahead == ids[:, :2], 1, -1)
    single = (np.bincount(side.ravel(), minlength=3 * len(t))[side] == 1).all(axis=1) & _has_height(points[t])[of].all(axis=1)
    whole, alone = np.flatnonzero(single), np.flatnonzero(~single)
    side, way = side[whole], way[whole]
    hinge, sign, across = np.full(3 * len(t), -1), np.ones(3 * len(t), np.int64), np.full(3 * len(t), -1)
    for c in (0, 1):
        hinge[side[:, c]], sign[side[:, c]], across[side[:, c]] = whole, way[:, c], side[:, 1 - c]
    near = np.stack([side[:, c] // 3 * 3 + (side[:, c] + step * way[:, c]) % 3 for c in (0, 1) for step in (1, 2)], axis=1)
    beyond = across[near]
    apex = np.where(beyond >= 0, t.ravel()[beyond], ids[whole][:, [0, 1, 1, 0]])
    soft = np.logical_not(pinned[t].all(axis=1))
    bends = np.concatenate([soft[side // 3], np.where(beyond >= 0, soft[beyond // 3], False)], axis=1)
    slot = np.full((len(t) + len(alone), SLOTS), -1)
    slot[:len(t), :3] = hinge.reshape(-1, 3)
    for c in (0, 1):
        at, first = side[:, c] // 3, 3 + 2 * (side[:, c] % 3)
        for q in (0, 1):
            slot[at, first + q] = hinge[near[:, 2 * (1 - c) + q]]
    slot[len(t):, 0] = alone
    slot[:len(t)][~soft] = -1
    return Patches(ids, t, hinge.reshape(-1, 3), sign.reshape(-1, 3), side, way, near,
                   np.concatenate([ids[whole], apex], axis=1), bends, whole, alone, slot)


def _triangle_key(corners: np.ndarray, n: int) -> np.ndarray:
    s = np.sort(corners, axis=1)
    return (s[:, 0] * n + s[:, 1]) * n + s[:, 2]


def _has_height(corners: np.ndarray) -> np.ndarray:
    """Whether triangles (t, 3, 3) have a height that tells an angle."""
    e = corners[:, [1, 2, 0]] - corners
    return np.linalg.norm(np.cross(e[:, 0], e[:, 1]), axis=1) > LOW * (e**2).sum(-1).max(axis=1)


def _row_dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Without conjugates: points may be complex, of differences."""
    return (a * b).sum(axis=-1)


def _edge_height(start: np.ndarray, end: np.ndarray, apex: np.ndarray) -> tuple[np.ndarray, ...]:
    """Length L of edges (.., 3), foot p and height h of an apex over them."""
    e, r = end - start, apex - start
    L = np.sqrt(_row_dot(e, e))
    p = _row_dot(e, r) / L
    return L, p, np.sqrt(_row_dot(r, r) - p * p)


def _angle_rows(start: np.ndarray, end: np.ndarray, apex: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """a of triangles that bend, else 0, by (nn, 2^1/2 nt, tt), (.., 3)."""
    L, p, h = _edge_height(start, end, apex)
    return np.stack([0.5 * h, (p - 0.5 * L) / ROOT2, 0.5 * p * (p - L) / h], axis=-1) * bends[..., None]


def _turned_rows(row: np.ndarray, c: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Rows in axes that are turned by (cosine, sine), in those that are not."""
    nn, nt, tt = row[..., 0], row[..., 1] * ROOT2, row[..., 2]
    return np.stack([c * c * nn + c * s * nt + s * s * tt, (2.0 * s * c * (tt - nn) + (c * c - s * s) * nt) / ROOT2,
                     s * s * nn - s * c * nt + c * c * tt], axis=-1)


def split_hinge_angles(p: np.ndarray, bends: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(f + c_0, c_1 .. c_4) of hinges, (h, 5), from their points (h, 8, 3), who bends (h, 6), and which of the four other
    edges have a hinge (h, 4). alpha of the first triangle is that combination of the angles."""
    x0, x1, x2, x3 = (p[:, k] for k in range(4))
    a0, a1 = _angle_rows(x0, x1, x2, bends[:, 0]), _angle_rows(x1, x0, x3, bends[:, 1])
    L, _, h0 = _edge_height(x0, x1, x2)
    h1 = _edge_height(x1, x0, x3)[2]
    rows = [a0 + a1]
    for q, (start, end, inner, high, sine) in enumerate(((x1, x2, x0, h0, 1.0), (x2, x0, x1, h0, -1.0),
                                                         (x0, x3, x1, h1, 1.0), (x3, x1, x0, h1, -1.0))):
        beyond = np.where(there[:, q, None], p[:, 4 + q], inner)
        R = _angle_rows(start, end, inner, bends[:, q // 2]) + _angle_rows(end, start, beyond, bends[:, 2 + q])
        e = end - start
        length = np.sqrt(_row_dot(e, e))
        along = (x1 - x0) if q < 2 else (x0 - x1)
        rows.append(_turned_rows(R, _row_dot(e, along) / (length * L), sine * high / length) * there[:, q, None])
    G = np.stack(rows, axis=1)
    f = np.where(bends[:, 1], np.where(bends[:, 0], h0 / (h0 + h1), 0.0), 1.0)
    A = np.swapaxes(G, 1, 2) @ G
    trace = A[:, 0, 0] + A[:, 1, 1] + A[:, 2, 2]
    least = np.where(trace.real > 0.0, SHARP * trace, 1.0)                 # between two clamps there is nothing to tell
    filtered = A @ A + least[:, None, None]**2 * np.eye(3)
    c = np.einsum("hij,hj->hi", G @ A, np.linalg.solve(filtered, (a0 - f[:, None] * rows[0])[..., None])[..., 0])
    return np.concatenate([c[:, :1] + f[:, None], c[:, 1:]], axis=1)


def edge_bearing_rows(corners: np.ndarray, free: np.ndarray) -> np.ndarray:
    """l_k / A^1/2 n_k n_k^T of triangles (t, 3, 3) without what borders leave free (t, 3), all of those without a height:
    (t, edge, 3), by (tt, 2^1/2 nt, nn) of edge 0."""
    x = [np.where(np.sum(free, axis=1, keepdims=True) == 3, ANY[k], corners[:, k]) for k in range(3)]
    e = [x[2] - x[1], x[0] - x[2], x[1] - x[0]]
    L = [np.sqrt(_row_dot(each, each)) for each in e]
    h = _edge_height(x[1], x[2], x[0])[2]
    one, found = np.ones_like(L[0]), []
    for k, sine in enumerate((0.0 * one, h / L[1], -h / L[2])):
        c = one if k == 0 else _row_dot(e[k], e[0]) / (L[k] * L[0])
        found.append(np.stack([sine * sine, -ROOT2 * sine * c, c * c], axis=-1))
    kept = [None if not free[:, k].any() else found[k] * free[:, k, None] for k in range(3)]
    basis: list[np.ndarray] = []
    for u in (k for k in kept if k is not None):
        for q in basis:
            u = u - q * _row_dot(u, q)[:, None]
        size = _row_dot(u, u)
        some = size.real > 1e-12
        basis.append(u * (some / np.sqrt(np.where(some, size, 1.0)))[:, None])
    for k in range(3):
        for q in basis:
            found[k] = found[k] - q * _row_dot(found[k], q)[:, None]
        found[k] = found[k] * (L[k] / np.sqrt(0.5 * L[0] * h) * ~free[:, k])[:, None]
    return np.stack(found, axis=1)


@dataclass
class Coupling:
    """Curvatures of the triangles of one sheet: C_t = sum_s value_ts z_s, z = (bend D)^1/2 f(theta - theta_0).

    slot (t, SLOTS) hinges, -1 without; value (t, SLOTS, 3); patches to make gradients of, by rest positions.
    """

    slot: np.ndarray
    value: np.ndarray
    patches: Patches


def hinge_coupling(points: np.ndarray, found: Patches) -> tuple[Coupling, np.ndarray]:
    """Coupling, and 1 / D of each hinge. points (n, 3) at rest [m]."""
    F = _sheet_curvatures(points, found)[0]
    D = _majorant(F, found)[0]
    return Coupling(found.slot, F / np.sqrt(D)[found.slot][..., None], found), 1.0 / D


def _side_shares(s: Patches, c: int) -> tuple[np.ndarray, ...]:
    """Of side c of whole hinges: triangle, edge, and of the five angles (own, near): their slots there, and signs."""
    t, k = s.side[:, c] // 3, s.side[:, c] % 3
    mine, others = s.near[:, 2 * c:2 * c + 2] % 3, np.stack([3 + 2 * k, 4 + 2 * k], axis=1)
    slots = np.concatenate([k[:, None], *((mine, others) if c == 0 else (others, mine))], axis=1)
    turn = s.way[:, [0, 0, 1, 1]] * s.sign.ravel()[s.near] * s.way[:, c, None]
    return t, k, slots, np.concatenate([s.way[:, c, None], turn], axis=1)


def _sheet_curvatures(points: np.ndarray, s: Patches) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, and what it is made of: angles alpha by those of the slots, (t, edge, SLOTS), and `edge_bearing_rows`."""
    parted = split_hinge_angles(points[s.points], s.bends, s.hinge.ravel()[s.near] >= 0)
    g = edge_bearing_rows(points[s.triangles], s.hinge < 0)
    alpha = np.zeros((len(s.triangles), 3, SLOTS))
    for c in (0, 1):
        t, k, slots, sign = _side_shares(s, c)
        own = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
        np.add.at(alpha, (t[:, None], k[:, None], slots), sign * (parted if c == 0 else own - parted))
    F = np.zeros((len(s.slot), SLOTS, 3))
    F[:len(alpha)] = np.einsum("tks,tkr->tsr", alpha, g)
    F[s.slot < 0] = 0.0
    F[len(alpha):, 0, 0] = _lone_hinge_rows(points[s.ids[s.alone]])
    return F, alpha, g


def _lone_hinge_rows(p: np.ndarray) -> np.ndarray:
    """l / A^1/2 of hinges by themselves, (m, 4, 3)."""
    L, _, h2 = _edge_height(p[:, 0], p[:, 1], p[:, 2])
    return np.sqrt(L / (0.5 * (h2 + _edge_height(p[:, 1], p[:, 0], p[:, 3])[2])))


def _majorant(F: np.ndarray, s: Patches) -> tuple[np.ndarray, ...]:
    """D; lam, M = dlam / dB (t, 3, 3), and |F|, with a smooth corner at 0."""
    square = (F**2).sum(axis=2)
    size = np.sqrt(square + SMOOTH * square.sum(axis=1, keepdims=True) + 1e-300)
    B = np.swapaxes(F / size[..., None], 1, 2) @ F
    scale = np.maximum(np.trace(B, axis1=1, axis2=2), 1e-300)[:, None, None]
    power = np.linalg.matrix_power(B / scale, POWER - 1)
    last = np.maximum(np.einsum("tij,tji->t", power, B / scale), 1e-300)
    lam = last**(1.0 / POWER)
    lam, M = lam * scale[:, 0, 0], power * (lam / last)[:, None, None]
    D = np.bincount(np.maximum(s.slot, 0).ravel(), (lam[:, None] * size * (s.slot >= 0)).ravel(), len(s.ids))
    return np.where(D > 1e-100, D, 1.0), lam, M, size    # between two clamps there is no energy, whatever D is


def rest_point_gradient(points: np.ndarray, s: Patches, by_value: np.ndarray, by_inverse: np.ndarray) -> np.ndarray:
    """Gradient by the points at rest, (n, 3), from those by what `hinge_coupling` makes of them."""
    F, alpha, g = _sheet_curvatures(points, s)
    D, lam, M, size = _majorant(F, s)
    slot, used = np.maximum(s.slot, 0), s.slot >= 0
    root = np.sqrt(D)[slot][..., None]
    by_D = -by_inverse / D**2 - 0.5 / D * np.bincount(slot.ravel(), ((by_value * F / root).sum(axis=2) * used).ravel(), len(D))
    own = by_D[slot] * used
    by_lam, MF = (own * size).sum(axis=1, keepdims=True), F @ M
    by_square = (own * lam[:, None] - by_lam * (F * MF).sum(axis=2) / size**2) / (2.0 * size)
    by_square += SMOOTH * by_square.sum(axis=1, keepdims=True)
    by_F = by_value / root + 2.0 * ((by_lam / size)[..., None] * MF + by_square[..., None] * F)
    by_F[~used] = 0.0
    n, by = len(s.triangles), np.zeros((len(points), 3))
    by_alpha, by_g = np.einsum("tkr,tsr->tks", g, by_F[:n]), np.einsum("tks,tsr->tkr", alpha, by_F[:n])
    by_parted = np.zeros((len(s.whole), 5))
    for c in (0, 1):
        t, k, slots, sign = _side_shares(s, c)
        by_parted += (1 - 2 * c) * sign * by_alpha[t[:, None], k[:, None], slots]
    there = s.hinge.ravel()[s.near] >= 0
    _add_gradient(by, points, s.points, lambda p: split_hinge_angles(p, s.bends, there), by_parted)
    _add_gradient(by, points, s.triangles, lambda p: edge_bearing_rows(p, s.hinge < 0), by_g)
    _add_gradient(by, points, s.ids[s.alone], _lone_hinge_rows, by_F[n:, 0, 0])
    return by


def _add_gradient(by: np.ndarray, points: np.ndarray, ids: np.ndarray, function, weights: np.ndarray) -> None:
    """Adds the gradient of sum weights function(points[ids]), by complex steps (Squire, Trapp 1998): exact to rounding."""
    for k in range(ids.shape[1] if len(ids) else 0):
        for axis in range(3):
            p = points[ids].astype(complex)
            p[:, k, axis] += 1j * TINY
            found = (function(p).imag * weights).reshape(len(ids), -1).sum(axis=1) / TINY
            np.add.at(by[:, axis], ids[:, k], found)
