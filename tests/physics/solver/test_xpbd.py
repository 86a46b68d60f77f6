"""Projection kernels against closed forms: who moves how far, stiffness, damping, hardness, accuracy, determinism."""

import numpy as np
import pytest
import warp as wp

from tests.make.rows.equations import EQUATIONS
from wsim.kernels.cloth.constraint import DISTANCE, LIMIT
from wsim.kernels.cloth.energy import strain_statistics_kernel
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.xpbd import xpbd_projection_kernel
from wsim.model.structs import fill_struct

wp.config.quiet = True
REALS = [wp.float32, wp.float64]
ROUNDING = {wp.float32: 1.2e-7, wp.float64: 2.3e-16}


class Problem:
    """Constraints of one kind on a few points, on the CPU; w inverse masses, rate 1 / h."""

    def __init__(self, name, points, ids, rest, alpha, w, real=wp.float64, tau=0.0, **options):
        t = types(real)
        self.real, self.t, self.m = real, t, len(ids)
        self.Batch, self.kernel = xpbd_projection_kernel(EQUATIONS[name], real=real, **options)
        block = EQUATIONS[name].rows == 3
        self.lam = self.array(np.zeros((self.m, 3) if block else self.m), t.vec3 if block else real)
        b = self.batch = self.Batch()
        b.point = self.array(ids, wp.types.vector(EQUATIONS[name].points, int))
        b.rest = self.array(rest, t.mat22 if block else real)
        b.alpha = self.array(alpha, t.vec4 if block else real)
        b.tau, b.left = (self.array([value] * self.m, real) for value in (tau, 0.0))
        self.x = self.array(points, t.vec3)
        self.w = b.w = self.array(w, real)
        self.d = self.array(np.zeros((len(points), 3)), t.vec3)
        self.a = self.array(np.zeros((len(points), 3)), t.vec3)

    def array(self, values, dtype):
        return wp.array(np.asarray(values), dtype=dtype, device="cpu")

    def at(self, d):
        """Without None, which Warp's own tape does not take."""
        none = dict.fromkeys("evsu", self.array(np.zeros((0, 3)), self.t.vec3)) | {"struck": self.array([], self.real)}
        return fill_struct(point_states(self.real), **none | {"x": self.x, "d": d, "a": self.a})

    def project(self, times=1, rate=1.0, d=None, count=None):
        """Projects in place, `count` constraints at once (1: each its own colour); returns d."""
        if d is not None:
            self.d = self.array(d, self.t.vec3)
        step = count or 1
        for _ in range(times):
            for first in range(0, self.m, step):
                wp.launch(self.kernel, step, [self.batch, self.at(self.d), first, rate, 1.0, self.lam],
                          [self.d, self.lam], device="cpu")
        return self.d.numpy().astype(np.float64)


PAIR = [[0.0, 0, 0], [1.2, 0, 0]]


@pytest.mark.parametrize("real", REALS)
def test_two_equal_masses_meet_half_way(real):
    d = Problem("distance", PAIR, [[0, 1]], [1.0], [0.0], [2.0, 2.0], real).project()
    assert np.abs(d - [[0.1, 0, 0], [-0.1, 0, 0]]).max() < 2 * ROUNDING[real]


@pytest.mark.parametrize("real", REALS)
def test_the_free_end_of_a_pinned_pair_moves_all_the_way(real):
    d = Problem("distance", PAIR, [[0, 1]], [1.0], [0.0], [0.0, 2.0], real).project()
    assert np.all(d[0] == 0) and np.abs(d[1] - [-0.2, 0, 0]).max() < 2 * ROUNDING[real]


def test_masses_share_the_correction_inversely():
    d = Problem("distance", PAIR, [[0, 1]], [1.0], [0.0], [1.0, 3.0]).project()
    assert np.abs(d[:, 0] - [0.05, -0.15]).max() < 1e-15


@pytest.mark.parametrize("iterations, rate", [(40, 10.0), (60, 100.0), (5, 1000.0)])
def test_converged_force_is_displacement_over_compliance(iterations, rate):
    """A mass on a spring, moved by d~ in a step: d = d~ / (1 + w h^2 / alpha), whatever the step and iterations."""
    alpha, w = 1e-3, 4.0
    p = Problem("distance", [[0.0, 0, 0], [1.0, 0, 0]], [[0, 1]], [1.0], [alpha], [0.0, w], multipliers=True)
    d = p.project(iterations, rate, [[0.0, 0, 0], [0.3, 0, 0]])
    assert d[1, 0] == pytest.approx(0.3 / (1 + w / (alpha * rate**2)), rel=1e-12)
    assert p.lam.numpy()[0] / (1 / rate) ** 2 == pytest.approx(-d[1, 0] / alpha, rel=1e-12)


def test_damping_follows_the_damped_spring():
    """One linear step: m dd = -k h^2 (d + tau (d - a) / h) for a spring along a line, d from d~."""
    alpha, w, rate, tau, moved, anchor = 2e-3, 3.0, 50.0, 0.04, 0.2, 0.15
    for multipliers, times in ((False, 1), (True, 7)):
        p = Problem("distance", [[0.0, 0, 0], [1.0, 0, 0]], [[0, 1]], [1.0], [alpha], [0.0, w], tau=tau, damped=True,
                    multipliers=multipliers)
        p.a = p.array([[0.0, 0, 0], [anchor, 0, 0]], p.t.vec3)
        d = p.project(times, rate, [[0.0, 0, 0], [moved, 0, 0]])[1, 0]
        assert d - moved == pytest.approx(-w / (alpha * rate**2) * (d + tau * rate * (d - anchor)), rel=1e-12)


def rest_triangle():
    return np.array([[0.0, 0, 0], [1.0, 0, 0], [0.2, 0.8, 0]])


def compliance(stretch, nu, shear, area):
    return [1 / (stretch * area), -nu / (stretch * area), 1 / (shear * area), 1 / (stretch * area)]


def membrane(p=None, alpha=(0.0, 0.0, 0.0, 0.0), w=(1.0, 1.0, 1.0), real=wp.float64, **options):
    X = rest_triangle()
    B = np.linalg.inv((X[1:] - X[0])[:, :2].T)
    return Problem("membrane", X if p is None else p, [[0, 1, 2]], [B], [alpha], w, real, **options)


def strains(problem):
    p = problem.x.numpy() + problem.d.numpy()
    F = (p[1:] - p[0]).T @ problem.batch.rest.numpy()[0]
    _, sigma, Vt = np.linalg.svd(F, full_matrices=False)
    U = Vt.T @ np.diag(sigma) @ Vt
    return np.array([U[0, 0] - 1, U[1, 1] - 1, 2 * U[0, 1]])


def test_membrane_force_is_the_gradient_of_the_plane_stress_energy():
    """Converged lam = -alpha~^-1 C, alpha~^-1 = h^2 A [[k, nu k, 0], [nu k, k, 0], [0, 0, G]], k = E / (1 - nu^2)."""
    stretch, nu, shear, rate = 300.0, 0.3, 120.0, 10.0
    p = membrane(alpha=compliance(stretch, nu, shear, 0.4), multipliers=True)
    p.project(200, rate, [[0.0, 0, 0], [0.2, 0.1, 0], [-0.1, 0.15, 0.3]])
    k = stretch / (1 - nu**2)
    K = 0.4 * np.array([[k, nu * k, 0], [nu * k, k, 0], [0, 0, shear]])
    assert np.abs(strains(p)).max() > 1e-3
    assert np.abs(p.lam.numpy()[0] * rate**2 + K @ strains(p)).max() < 1e-10 * np.abs(K @ strains(p)).max()


@pytest.mark.parametrize("start", [
    [[0, 0, 0], [1, 0, 0], [0.2, -0.8, 0.0]],            # mirrored: a triangle turned over is at rest
    [[0, 0, 0], [1, 0, 0], [0.2, 1e-3, 0]],              # nearly a line
    [[0, 0, 0], [0.01, 0, 0], [0.0, 0.01, 0.005]],       # nearly a point
    [[0, 0, 0], [0.4, -0.3, 0], [0.5, 0.9, 1.0]],
])
@pytest.mark.parametrize("real", REALS)
def test_hard_membrane_comes_back_to_its_shape(start, real):
    p = membrane(start, real=real)
    p.project(60)
    assert np.abs(strains(p)).max() < 20 * ROUNDING[real]


@pytest.mark.parametrize("alpha", [(0.0, 0.0, 0.0, 0.0), (1e-3, -3e-4, 1e-3, 1e-3)])
@pytest.mark.parametrize("start", [[[0, 0, 0]] * 3, [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
                                   [[0, 0, 0], [0, 0, 0], [1, 0, 0]]])
def test_collapsed_membrane_stays_finite(start, alpha):
    assert np.isfinite(membrane(start, alpha).project(20)).all()


def test_pinned_corners_of_a_membrane_do_not_move():
    start = rest_triangle() * 1.3
    d = membrane(start, w=(0.0, 1.0, 0.0)).project(3)
    assert np.all(d[[0, 2]] == 0) and np.abs(d[1]).max() > 0
    assert np.all(membrane(start, w=(0.0, 0.0, 0.0)).project() == 0)


def case(name, real=wp.float64, far=0.0, w=None, **options):
    """A moved and stretched constraint of each kind."""
    points = {2: [[0, 0, 0], [0.9, 0.5, -0.3]], 3: rest_triangle(),
              4: [[0, 0, 0], [1.0, 0, 0], [0.5, 1.0, 0], [0.5, -1.0, 0]]}[EQUATIONS[name].points]
    rest = {"membrane": [np.linalg.inv(rest_triangle()[1:, :2].T)], "dihedral": [0.1]}.get(name, [1.0])
    alpha = [[1e-3, -3e-4, 2e-3, 1e-3]] if name == "membrane" else [1e-3]
    ids = [list(range(EQUATIONS[name].points))]
    w = np.arange(1, len(points) + 1) if w is None else w
    problem = Problem(name, np.asarray(points, np.float64) + far, ids, rest, alpha, w, real, **options)
    d = 0.02 * np.sin(np.arange(3 * len(points))).reshape(-1, 3)
    return problem, d


FREE = [name for name in sorted(EQUATIONS) if not EQUATIONS[name].anchored]


@pytest.mark.parametrize("name", FREE)
def test_projection_keeps_linear_and_angular_momentum(name):
    problem, d = case(name, multipliers=True)
    moved = problem.project(1, 10.0, d) - d
    m = 1 / problem.w.numpy()[:, None]
    arm = problem.x.numpy() + d
    assert np.abs(moved).max() > 1e-3
    assert np.abs((m * moved).sum(0)).max() < 1e-15
    assert np.abs((m * np.cross(arm, moved)).sum(0)).max() < 1e-15


@pytest.mark.parametrize("name", sorted(EQUATIONS))
def test_all_pinned_stays_put(name):
    problem, d = case(name, w=[0.0] * EQUATIONS[name].points)
    assert np.all(problem.project(1, 10.0, d) == d)


@pytest.mark.parametrize("name", sorted(EQUATIONS))
def test_small_displacements_far_out_lose_nothing(name):
    """In float32 at 1000 m, where positions are 6e-5 m apart, d errs by two roundings of a shape of 1 m."""
    far = 1000.0
    single, d = case(name, wp.float32, far)
    double, _ = case(name, wp.float64, 0.0)
    double.x = double.array(single.x.numpy().astype(np.float64) - far, double.t.vec3)
    d = d * 1e-3
    true = double.project(1, 10.0, d)
    assert np.abs(true - d).max() > 1e-6
    assert np.abs(single.project(1, 10.0, d) - true).max() < 2 * ROUNDING[wp.float32]


@pytest.mark.parametrize("name", sorted(EQUATIONS))
def test_separate_output_equals_in_place(name):
    problem, d = case(name, multipliers=True, damped=True)
    kept = problem.array(d, problem.t.vec3)
    out, lam_out = wp.clone(kept), wp.clone(problem.lam)
    wp.launch(problem.kernel, 1, [problem.batch, problem.at(kept), 0, 10.0, 1.0, problem.lam],
              [out, lam_out], device="cpu")
    assert np.array_equal(kept.numpy(), d) and np.all(problem.lam.numpy() == 0)
    assert np.array_equal(out.numpy(), problem.project(1, 10.0, d))
    assert np.array_equal(lam_out.numpy(), problem.lam.numpy())


@pytest.mark.parametrize("name", [n for n in sorted(EQUATIONS) if not EQUATIONS[n].unilateral])
def test_uniform_compliance_equals_the_array(name):
    problem, d = case(name, damped=True, multipliers=True, tau=0.01)
    other, _ = case(name, damped=True, multipliers=True, tau=0.01, uniform=True)
    assert np.array_equal(problem.project(3, 10.0, d), other.project(3, 10.0, d))


@pytest.mark.parametrize("name", ["limit", "tether"])
def test_unilateral_constraints_act_only_when_exceeded(name):
    p = Problem(name, PAIR, [[0, 1]], [1.3], [0.0], [0.0, 1.0])
    assert np.all(p.project() == 0)
    assert p.project(1, 1.0, [[0.0, 0, 0], [0.4, 0, 0]])[1, 0] == pytest.approx(0.1, abs=1e-15)


def test_tether_moves_the_point_and_not_its_anchor():
    p = Problem("tether", [[0.0, 0, 0], [1.2, 0, 0], [0, 3.0, 0]], [[0, 1], [0, 2]], [1.0, 1.0], [0.0], [5, 1, 0])
    d = p.project(count=2)
    assert np.abs(d - [[0, 0, 0], [-0.2, 0, 0], [0, 0, 0]]).max() < 1e-15


def test_hinge_unfolds_to_its_rest_angle():
    p = Problem("dihedral", [[0, 0, 0], [1.0, 0, 0], [0.5, 1.0, 0], [0.5, -0.6, 0.8]], [[0, 1, 2, 3]], [0.4], [0.0],
                [1.0, 1.0, 1.0, 1.0])
    x = p.x.numpy() + p.project(30)
    n, m = np.cross(x[1] - x[0], x[2] - x[0]), np.cross(x[3] - x[0], x[1] - x[0])
    assert np.arccos(n @ m / np.linalg.norm(n) / np.linalg.norm(m)) == pytest.approx(0.4, abs=1e-12)


def measured(problem, name, threads=3, **options):
    """(largest strain, sum of squared strains, energy) by the kernel, reduced on the host."""
    out = wp.zeros(threads, dtype=wp.vec3d, device="cpu")
    wp.launch(strain_statistics_kernel(EQUATIONS[name], real=problem.real, **options), threads,
              [problem.batch, problem.x, problem.m, 1, problem.d], [out], device="cpu")
    s = out.numpy()
    return s[:, 0].max(), s[:, 1].sum(), s[:, 2].sum()


def test_strain_and_energy_of_a_chain():
    """Springs of rest length 0.5 m stretched by 10 %, 20 %, 30 % and 40 % against the definitions."""
    ends, strain, alpha = np.cumsum([0, 0.55, 0.6, 0.65, 0.7]), np.array([0.1, 0.2, 0.3, 0.4]), [1e-2, 1e-3, 1e-2, 1e-3]
    p = Problem("distance", np.stack([ends, 0 * ends, 0 * ends], 1), [[i, i + 1] for i in range(4)], [0.5] * 4, alpha,
                [1.0] * 5)
    for threads in (1, 3, 7):
        most, squares, energy = measured(p, "distance", threads)
        assert (most, squares) == (pytest.approx(0.4, rel=1e-14), pytest.approx(np.sum(strain**2), rel=1e-14))
        assert energy == pytest.approx(0.5 * np.sum((0.5 * strain)**2 / alpha), rel=1e-14)


def test_hard_and_slack_constraints_store_nothing():
    hard = Problem("distance", PAIR, [[0, 1]], [1.0], [0.0], [1.0, 1.0])
    assert measured(hard, "distance") == (pytest.approx(0.2), pytest.approx(0.04), 0.0)
    assert measured(Problem("limit", PAIR, [[0, 1]], [1.3], [0.0], [1.0, 1.0]), "limit") == (0.0, 0.0, 0.0)


def test_energy_of_a_membrane_is_area_times_the_fabrics_density():
    stretch, nu, shear, area = 300.0, 0.3, 120.0, 0.4
    p = membrane(rest_triangle() @ [[1.1, 0.2, 0], [0, 0.9, 0], [0, 0, 1]], compliance(stretch, nu, shear, area))
    eu, ev, g = strains(p)
    psi = 0.5 * stretch / (1 - nu**2) * (eu**2 + ev**2 + 2 * nu * eu * ev) + 0.5 * shear * g**2
    most, squares, energy = measured(p, "membrane")
    assert energy == pytest.approx(area * psi, rel=1e-14)
    assert (most, squares) == (pytest.approx(max(abs(eu), abs(ev), abs(g))), pytest.approx(eu**2 + ev**2 + g**2))


@pytest.mark.parametrize("name", FREE)
def test_recorded_projection_has_the_right_gradient(name):
    """Reverse mode through one projection, separate arrays, against central differences (error: eps^2, 1e-8)."""
    problem, d = case(name, multipliers=True, backward=True)
    seed = np.cos(np.arange(d.size)).reshape(d.shape)

    def run(start):
        d_in = wp.array(start, dtype=problem.t.vec3, device="cpu", requires_grad=True)
        out = wp.array(start, dtype=problem.t.vec3, device="cpu", requires_grad=True)
        lam_out = wp.zeros_like(problem.lam)
        wp.launch(problem.kernel, 1, [problem.batch, problem.at(d_in), 0, 10.0, 1.0, problem.lam],
                  [out, lam_out], device="cpu")
        return d_in, out

    with wp.Tape() as tape:
        d_in, out = run(d)
    tape.backward(grads={out: wp.array(seed, dtype=problem.t.vec3, device="cpu")})
    numeric, eps = np.zeros_like(d), 1e-5
    for index in np.ndindex(d.shape):
        step = np.zeros_like(d)
        step[index] = eps
        numeric[index] = np.sum(seed * (run(d + step)[1].numpy() - run(d - step)[1].numpy())) / (2 * eps)
    assert np.abs(d_in.grad.numpy() - numeric).max() < 1e-7 * np.abs(numeric).max()


def test_structs_of_one_shape_are_shared():
    assert batch_of(DISTANCE, wp.float32) is batch_of(LIMIT, wp.float32)
    assert xpbd_projection_kernel(DISTANCE, real=wp.float32) is xpbd_projection_kernel(DISTANCE, real=wp.float32)
