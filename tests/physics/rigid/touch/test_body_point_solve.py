"""A body and the points that touch it, solved at once, against single contacts in turn, in float64."""

import numpy as np
import pytest
import warp as wp

from tests.physics.rigid.touch.point_problems import problem, squeezed_box
from wsim.kernels.math.real import types
from wsim.kernels.rigid.touch import body_point_solve as stars
from wsim.model.structs import fill_struct

CASES = [(4, 0.0, 1.0), (4, 0.5, 100.0), (12, 0.3, 0.01), (12, 1.0, 1.0), (12, 0.3, 10.0)]


def solved(problems, real=wp.float64):
    """V (n, 6) of these problems, in one launch, and what is left."""
    t, (Rows, Hubs) = types(real), stars.star_structs(real)
    dtype = np.float64 if real is wp.float64 else np.float32

    def array(values, kind):
        return wp.array(np.ascontiguousarray(values, np.int32 if kind is int else dtype), dtype=kind, device="cpu")

    def joined(name):
        return np.concatenate([getattr(p, name) for p in problems])
    count, n = [len(p.n) for p in problems], len(problems)
    rows = fill_struct(Rows, first=array(np.concatenate([[0], np.cumsum(count)]), int), slot=array(np.arange(sum(count)), int),
                       f=array(np.concatenate([p.m / p.h for p in problems]), real), least=array(np.zeros(sum(count)), real),
                       **{name: array(joined(name), t.vec3) for name in ("n", "r", "slip")},
                       **{name: array(joined(name), real) for name in ("base", "mu")})
    q = np.array([p.q for p in problems])
    hubs = fill_struct(Hubs, w=array([1.0 / p.M[0, 0] for p in problems], real),
                       inverse=array([1.0 / np.diag(p.M)[3:] for p in problems], t.vec3),
                       turn=array(np.tile(np.eye(3), (n, 1, 1)), t.mat33),
                       q=wp.array(np.concatenate([q[:, :3], q[:, 3:]]), dtype=wp.vec3d, device="cpu"))
    V, left = wp.zeros(2 * n, dtype=wp.vec3d, device="cpu"), wp.zeros(n, dtype=real, device="cpu")
    h = problems[0].h
    wp.launch(stars.star_solve_kernel(real, "test_star"), n, [rows, hubs, h, h, 1], [V, left], device="cpu", block_dim=1)
    return np.concatenate([V.numpy()[:n], V.numpy()[n:]], axis=1), left.numpy()


def made():
    rng = np.random.default_rng(5)
    return [problem(rng, *case) for case in CASES]


def test_it_is_where_sweeps_of_single_contacts_end():
    found, left = solved(made())
    assert left.max() < 1e-10
    for V, one in zip(found, made(), strict=True):
        assert np.abs(V - one.swept()).max() < 1e-9 * (1.0 + np.abs(V).max())


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.0])
def test_thousands_of_contacts_at_all_ratios_of_mass(mu):
    rng = np.random.default_rng(7)
    many = [problem(rng, 3000, mu, ratio) for ratio in (0.01, 1.0, 100.0)]
    found, left = solved(many)
    assert left.max() < 1e-10
    for V, one in zip(found, many, strict=True):
        P = one.pushes(V)[0]
        moment = np.concatenate([P, np.cross(one.r, P)], 1) * (one.m / one.h)[:, None]
        assert np.abs(one.M @ V - one.q + moment.sum(0)).max() < 1e-9 * np.abs(moment).sum()
        assert one.newton()[1] <= 20


@pytest.mark.parametrize("ratio", [100.0, 1e4])
def test_a_light_body_goes_with_heavy_points_whatever_its_mass(ratio):
    """The root has a limit as the body's mass goes to 0: pushes and slips of its points over h. Newton's method alone ends off
    it for one of 30, and what is left throws the body at 3 to 300 m/s."""
    found, left = solved([squeezed_box(np.random.default_rng(k), ratio) for k in range(30)])
    limit, _ = solved([squeezed_box(np.random.default_rng(k), 1e7) for k in range(30)])
    assert left.max() < 1e-10 and np.abs(found[:, :3]).max() < 8e-5 / 2e-3
    assert np.abs(found - limit).max() < 2.0 / ratio * np.abs(limit).max()


def test_what_it_finds_is_coulombs_law():
    """Gaps are closed where contacts push, and open where they do not; friction is in the cone, and against the slip."""
    rng = np.random.default_rng(3)
    one = problem(rng, 300, 0.4, 1.0)
    V = solved([one])[0][0]
    P, U = one.pushes(V)[0], one.arms() @ V
    lam = (P * one.n).sum(1)
    gap = -one.base - one.h * (one.n * U).sum(1) + lam
    T = P - lam[:, None] * one.n
    slide = one.slip - one.h * U + T
    slide -= (slide * one.n).sum(1)[:, None] * one.n
    slides = np.linalg.norm(slide, axis=1) > 1e-9
    assert np.abs(np.minimum(gap, lam)).max() < 1e-12
    assert np.linalg.norm(T, axis=1).max() > 0.0 and (np.linalg.norm(T, axis=1) <= 0.4 * lam * (1 + 1e-9)).all()
    hit = slides & (lam > 0.0)
    assert hit.any() and (~slides & (lam > 0.0)).any()
    assert np.abs((T[hit] * slide[hit]).sum(1) + 0.4 * lam[hit] * np.linalg.norm(slide[hit], axis=1)).max() < 1e-9
