"""Keys of points where edges of polyhedra cross: they last while the edges do, and tell all pairs of edges apart."""

import numpy as np
import pytest

from tests.make.physics.rigid.narrow.manifold import about, both, eps
from tests.physics.rigid.narrow.reference import SIGNS
from tests.physics.rigid.pairs import WHERE, matrix, touch
from wsim.geometry import rotation
from wsim.geometry.convex_hull import convex_hull
from wsim.kernels.rigid.narrow.pair import pairs_of_kinds
from wsim.physics.rigid.surfaces import hull_tables

HALF = 0.5
TOP = HALF * np.sqrt(2.0)
PAIRS = pairs_of_kinds(("box", "hull"))
SHAPES = {"hull": ("hull", 0.0, 0), "box": ("box", (HALF,) * 3)}
of_kinds = pytest.mark.parametrize("kinds", [("hull", "hull"), ("box", "hull"), ("hull", "box"), ("box", "box")])


def crossed(kinds, lean_a, lean_b, slide, quarters=(0, 0), real=None):
    """Manifolds of two cubes, the upper edge of one along x and the lower of the other along y, 1 cm in each other, after so
    many quarter turns about the edges, turned by rotation vectors (n, 3) [rad] about where they cross, slid by (n, 3) [m]."""
    pose = []
    for lean, axis, k, z, s in ((lean_a, (1.0, 0, 0), quarters[0], 0.005 - TOP, 0.0), (lean_b, (0, 1.0, 0), quarters[1],
                                                                                     TOP - 0.005, slide)):
        q = turned(lean)
        x = np.einsum("nij,j->ni", matrix(q), np.array([0.0, 0.0, z])) + s
        pose.append(np.hstack([x, rotation.quat_product(q, np.tile(about(axis, np.pi / 4 + k * np.pi / 2), (len(q), 1)))]))
    H = hull_tables([convex_hull(HALF * SIGNS)], real, WHERE["device"])
    a, b = ([SHAPES[kind]] * len(lean_a) for kind in kinds)
    return touch(a, pose[0], b, pose[1], 0.1, real, H, PAIRS)


def turned(v):
    """Quaternions (n, 4) of rotation vectors."""
    angle = np.linalg.norm(v, axis=1, keepdims=True)
    return np.hstack([v / np.maximum(angle, 1e-30) * np.sin(angle / 2), np.cos(angle / 2)])


@both
@of_kinds
def test_crossed_edges_keep_their_key_while_they_rock_and_slide(kinds, real):
    rng = np.random.default_rng(3)
    lean_a, lean_b = 0.08 * rng.uniform(-1, 1, (2, 60, 3))
    slide = np.hstack([rng.uniform(-0.3, 0.3, (60, 2)), np.zeros((60, 1))])
    m = crossed(kinds, lean_a, lean_b, slide, real=real)
    assert (m["count"] == 1).sum() >= 55
    assert len({int(k) for k, n in zip(m["key"][:, 0], m["count"], strict=True) if n == 1}) == 1


@both
@of_kinds
def test_every_pair_of_edges_has_a_key_of_its_own(kinds, real):
    found = [crossed(kinds, *np.zeros((3, 1, 3)), (i, j), real)[0] for i in range(4) for j in range(4)]
    assert all(m["count"] == 1 for m in found)
    np.testing.assert_allclose([m["gap"][0] for m in found], -0.01, atol=64 * eps(real))
    assert len({int(m["key"][0]) for m in found}) == 16 and not any(m["key"][0] == 0 for m in found)
