"""Edges of guides that carry points of followers, and places in their frames: NumPy only, float64.

A strand has the guides whose roots are nearest to its own, GUIDES at most, by weights 1 / distance (one that grows from the
root of a guide has that alone). On each a point has the two edges beside its own arc length s from the root, by weights linear
in s between the middles of edges; before the first and behind the last middle one edge. kernels/rods/follow.py.
"""

import numpy as np

from wsim.physics.rods.follow.objects import Followers
from wsim.physics.rods.tables import StrandTable

GUIDES = 3                 # a triangle of roots around a root; more would blur what guides do
CHUNK = 1024               # strands whose distances to all guides are looked at together


def nearest_guides(roots: np.ndarray, guides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (strands, k) of the guides nearest to roots, and their weights, which sum to 1."""
    k = min(GUIDES, len(guides))
    number, away = [], []
    for first in range(0, len(roots), CHUNK):
        d = np.linalg.norm(roots[first:first + CHUNK, None] - guides, axis=2)
        number.append(np.argsort(d, axis=1, kind="stable")[:, :k])
        away.append(np.take_along_axis(d, number[-1], axis=1))
    d = np.concatenate(away)
    at = d[:, :1] == 0.0
    weight = np.where(at, np.arange(k) == 0, 1.0 / np.where(d > 0.0, d, 1.0))
    return np.concatenate(number), weight / weight.sum(axis=1, keepdims=True)


def arc_lengths(points: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Arc length of each point from the root of its strand, (n,) [m]."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return s - np.repeat(s[np.cumsum(counts) - counts], counts)


def bind_followers(followers: Followers, table: StrandTable, own: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (n, 2 k), rows of the flat tables; weights; places from the middles of edges in their frames (tangent, director,
    their cross product) [m], (n, 2 k, 3). own: strands of the guides."""
    y = followers.motion.points(followers.points, 0.0)
    counts = followers.counts
    x, d = table.x[:, own] + table.origin[own], table.d[:-1, own]
    e = np.diff(x, axis=0)
    length = np.linalg.norm(e, axis=2)
    middle = np.cumsum(length, axis=0) - 0.5 * length
    edges = table.counts[own] - 1
    guide, share = nearest_guides(y[np.cumsum(counts) - counts], x[0])
    strand = np.repeat(np.arange(len(counts)), counts)
    guide, share, s = guide[strand], share[strand], arc_lengths(y, counts)
    a, part = np.zeros(guide.shape, int), np.zeros(guide.shape)
    for g in np.unique(guide).tolist():
        at = np.nonzero(guide == g)
        m, here = middle[:edges[g], g], s[at[0]]
        a[at] = i = np.clip(np.searchsorted(m, here) - 1, 0, max(edges[g] - 2, 0))
        if edges[g] > 1:
            part[at] = np.clip((here - m[i]) / (m[i + 1] - m[i]), 0.0, 1.0)
    b = np.minimum(a + 1, edges[guide] - 1)
    number, on = np.concatenate([a, b], axis=1), np.concatenate([guide, guide], axis=1)
    weight = np.concatenate([share * (1.0 - part), share * part], axis=1)
    t = e[number, on] / length[number, on][..., None]
    m1 = d[number, on]
    frame = np.stack([t, m1, np.cross(t, m1)], axis=-2)
    place = y[:, None] - 0.5 * (x[number, on] + x[number + 1, on])
    return number * table.strands + own.start + on, weight, np.einsum("pjrc,pjc->pjr", frame, place)
