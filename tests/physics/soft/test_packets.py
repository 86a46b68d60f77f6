"""Tets of a CPU eight at a time: the forces and rotations of one at a time, whatever the tets look like."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.soft.tet_box import TetBox
from wsim.kernels.math.real import types
from wsim.kernels.soft import fem, packets

BOXES: dict = {}


def both(material: str, real, d, v, q=None):
    """Forces and rotations, one by one and by packets, of a box of 61 tets displaced by d (points, 3)."""
    t, module = types(real), f"test_packets_{material}_{types(real).name}"
    if module not in BOXES:
        BOXES[module] = TetBox(material, real), [of.forces(material, True, real=real, module=module) for of in (fem, packets)]
    box, kernels = BOXES[module]
    size, found = len(box.tets) - 11, []
    for number, kernel in enumerate(kernels):
        turn = wp.zeros(size, dtype=t.quat, device="cpu") if q is None else wp.array(q[:size], dtype=t.quat, device="cpu")
        f = wp.zeros(4 * size, dtype=t.vec3, device="cpu")
        given = [box.batch, *[size] * number, *(box.array(a, t.vec3) for a in (box.points, d, v)), turn]
        wp.launch(kernel, -(-size // packets.EIGHT) if number else size, given, [f, turn], device="cpu")
        found.append((f.numpy().astype(float), turn.numpy().astype(float)))
    return found


def moves() -> dict[str, np.ndarray]:
    """Displacements of the points: small, strained, turned far, inverted in places, flat, all in one point."""
    points, noise = TetBox("linear", wp.float32).points, np.random.default_rng(1)
    n, c, s = len(points), np.cos(2.5), np.sin(2.5)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return {"small": 1e-4 * noise.normal(size=(n, 3)), "strained": 0.01 * noise.normal(size=(n, 3)),
            "turned": points @ turn.T - points + 1e-3 * noise.normal(size=(n, 3)),
            "inverted": 0.1 * noise.normal(size=(n, 3)), "flat": -points * (1.0, 0.0, 0.0), "point": -points}


@pytest.mark.parametrize("material, real", [("corotational", wp.float32), ("corotational", wp.float64),
                                            ("neo_hookean", wp.float64)])
def test_packets_have_the_forces_of_tets_one_by_one(material, real):
    unit = np.finfo(np.float32 if real is wp.float32 else np.float64).eps
    for name, d in moves().items():
        v = np.random.default_rng(2).normal(size=d.shape)
        (f, q), (g, r) = both(material, real, d, v)
        assert np.isfinite(f).all()
        sure = np.ones(len(q), bool)
        if name == "inverted" and material == "corotational":
            sure = np.abs(np.einsum("ij,ij->i", q, r)) > 1.0 - 100.0 * unit
        each = np.repeat(sure, 4)
        assert sure.mean() > 0.9                             # of a tet near a mirror of itself rounding decides
        np.testing.assert_allclose(g[each], f[each], atol=300.0 * unit * max(np.abs(f).max(), 1.0), err_msg=name)
        np.testing.assert_allclose(r[sure], q[sure], atol=300.0 * unit, err_msg=name)


def test_a_lane_does_not_see_the_others():
    """Tets that do not converge, or are no numbers, leave the bits of those beside them."""
    d, v = moves()["small"], np.zeros_like(moves()["small"])
    _, (f, _) = both("corotational", wp.float32, d, v)
    for bad in (np.nan, 1e9):
        one = d.copy()
        one[0] = bad
        _, (g, _) = both("corotational", wp.float32, one, v)
        away = ~np.repeat((BOXES["test_packets_corotational_f32"][0].tets[:len(f) // 4] == 0).any(1), 4)
        assert away.any() and np.array_equal(f[away], g[away])


def test_what_turned_before_is_where_a_rotation_begins():
    d, v = moves()["turned"], np.zeros_like(moves()["turned"])
    _, (_, q) = both("corotational", wp.float64, d, v)
    (f, _), (g, r) = both("corotational", wp.float64, d, v, q)
    np.testing.assert_allclose(g, f, atol=1e-12 * np.abs(f).max())
    np.testing.assert_allclose(r, q, atol=1e-12)
