"""Every material of the table: energy, stress and stiffness against each other and against NumPy; rotations against the SVD."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import polar_rotation
from wsim.kernels.soft.material import TABLE, corotational_response, lame_parameters, twist_stiffness
from wsim.kernels.soft.principal import stress_response

wp.config.quiet = True
NAMES = sorted(TABLE)
TURNING = [name for name in NAMES if TABLE[name].turns]
MU, LAM = lame_parameters(1.0, 0.4)               # [Pa]: stresses below are in units of E
ONE = np.eye(3)
EPS = {wp.float32: 2.0**-23, wp.float64: 2.0**-52}


def rotator(real):
    t = types(real)

    def turn_all(H: wp.array(dtype=t.mat33), warm: wp.array(dtype=t.quat), q: wp.array(dtype=t.quat)):
        i = wp.tid()
        q[i] = polar_rotation(H[i], warm[i])

    kernel = wp.kernel(turn_all, name=f"turn_{t.name}", module=f"test_turn_{t.name}", enable_backward=False)

    def run(H, warm):
        """F as the precision has it, and the quaternions found, in float64."""
        H = wp.array(H, dtype=t.mat33, device="cpu")
        q = wp.zeros(len(H), dtype=t.quat, device="cpu")
        wp.launch(kernel, len(H), [H, wp.array(warm, dtype=t.quat, device="cpu")], [q], device="cpu")
        return H.numpy().astype(np.float64) + ONE, q.numpy().astype(np.float64)

    return run


ROTATORS = {real: rotator(real) for real in EPS}


def evaluator(name, real):
    """Kernel writing q, Psi, P, dP and the positive part of dP for arrays of H and dF."""
    row, t = TABLE[name], types(real)
    energy, stress, derivative, spectrum = row.energy, row.stress, row.derivative, row.spectrum

    def evaluate(H: wp.array(dtype=t.mat33), dF: wp.array(dtype=t.mat33), mu: real, lam: real, q: wp.array(dtype=t.quat),
                 psi: wp.array(dtype=real), P: wp.array(dtype=t.mat33), dP: wp.array(dtype=t.mat33),
                 positive: wp.array(dtype=t.mat33)):
        i = wp.tid()
        psi[i] = energy(H[i], q[i], mu, lam)
        P[i] = stress(H[i], q[i], mu, lam)
        dP[i] = derivative(H[i], q[i], dF[i], mu, lam)
        V, A, B = spectrum(H[i], q[i], mu, lam)
        positive[i] = stress_response(q[i], V, A, B, dF[i])

    kernel = wp.kernel(evaluate, name=f"material_{name}_{t.name}", module=f"test_material_{t.name}", enable_backward=False)

    def run(H, dF=None, mu=MU, lam=LAM):
        """Psi (n,), P, dP, positive dP (n, 3, 3) in float64."""
        H = np.asarray(H, np.float64).reshape(-1, 3, 3)
        n = len(H)
        dF = np.zeros((n, 3, 3)) if dF is None else np.broadcast_to(dF, (n, 3, 3))
        q = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        if row.turns:
            _, q = ROTATORS[real](H, q)
        q = wp.array(q, dtype=t.quat, device="cpu")
        out = [wp.zeros(n, dtype=kind, device="cpu") for kind in (real, t.mat33, t.mat33, t.mat33)]
        given = [wp.array(a, dtype=t.mat33, device="cpu") for a in (H, dF)]
        wp.launch(kernel, n, [*given, mu, lam, q], out, device="cpu")
        return [a.numpy().astype(np.float64) for a in out]

    return run


EVALUATORS = {(name, real): evaluator(name, real) for name in NAMES for real in EPS}


def turn(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def samples(count=60, seed=1):
    """F: strained by up to a half, anything (half of it inverted), and one near its collapse."""
    rng = np.random.default_rng(seed)
    near = [turn(rng) @ (ONE + 0.25 * rng.normal(size=(3, 3))) for _ in range(count // 2)]
    wild = [rng.normal(size=(3, 3)) for _ in range(count // 2)]
    return np.array(near + wild + [0.1 * turn(rng), np.diag([1.0, 1.0, -0.5])])


def hessian(name, F, positive=False):
    """(n, 9, 9): column k is dP of the k-th entry of dF."""
    H = np.repeat(F - ONE, 9, axis=0)
    basis = np.tile(np.eye(9).reshape(9, 3, 3), (len(F), 1, 1))
    found = EVALUATORS[name, wp.float64](H, basis)[3 if positive else 2]
    return found.reshape(len(F), 9, 9).transpose(0, 2, 1)


def smooth(F):
    """Those F whose rotation is not about to jump: s2 + s3 well above 0."""
    s = np.linalg.svd(F, compute_uv=False)
    return F[s[:, 1] + np.sign(np.linalg.det(F)) * s[:, 2] > 0.1]


def polar(F):
    """The rotation nearest to F, from NumPy's SVD."""
    U, s, Vt = np.linalg.svd(F)
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt


def defined(name, F, mu=MU, lam=LAM):
    """Psi [J/m^3] written down from the definition of each material."""
    if name == "neo_hookean":
        m, v = 4 / 3 * mu, lam + 5 / 6 * mu
        I = (F * F).sum((1, 2))  # noqa: E741 - the symbol of the paper
        alpha = 1 + mu / v
        return (m / 2 * (I - 3) + v / 2 * (np.linalg.det(F) - alpha) ** 2 - m / 2 * np.log(I + 1)
                - v / 2 * (1 - alpha) ** 2 + m / 2 * np.log(4.0))
    Ft = F.transpose(0, 2, 1)
    E = {"linear": (F + Ft) / 2 - ONE, "corotational": polar(F).transpose(0, 2, 1) @ F - ONE,
         "st_venant_kirchhoff": (Ft @ F - ONE) / 2}[name]
    return mu * (E * E).sum((1, 2)) + lam / 2 * np.trace(E, axis1=1, axis2=2) ** 2


@pytest.mark.parametrize("name", NAMES)
def test_energy_is_the_defined_one(name):
    F = samples()
    expected = defined(name, F)
    assert np.abs(EVALUATORS[name, wp.float64](F - ONE)[0] - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("name", NAMES)
def test_stress_is_the_gradient_of_the_energy(name):
    F = smooth(samples())
    run, eps = EVALUATORS[name, wp.float64], 1e-5          # eps^2 Psi''' / 6 and rounding / eps: about 1e-9, 1e-10
    P = run(F - ONE)[1].reshape(-1, 9)
    step = eps * np.eye(9).reshape(1, 9, 3, 3)
    numeric = (run((F - ONE)[:, None] + step)[0] - run((F - ONE)[:, None] - step)[0]) / (2 * eps)
    # corotational energy is a root of a quartic, off by rounding over (s1 + s2) (s2 + s3) (s3 + s1)
    assert np.abs(P - numeric.reshape(-1, 9)).max() < (1e-7 if name == "corotational" else 1e-8) * np.abs(P).max()


@pytest.mark.parametrize("name", NAMES)
def test_derivative_is_that_of_the_stress(name):
    F = smooth(samples())
    run, eps = EVALUATORS[name, wp.float64], 1e-6          # curvature of R grows with (s2 + s3)^-3: 1e3 eps^2
    K = hessian(name, F)
    step = eps * np.eye(9).reshape(1, 9, 3, 3)
    numeric = (run((F - ONE)[:, None] + step)[1] - run((F - ONE)[:, None] - step)[1]) / (2 * eps)
    numeric = numeric.reshape(-1, 9, 9).transpose(0, 2, 1)
    assert (np.abs(K - numeric).max((1, 2)) < 1e-7 * np.abs(K).max((1, 2))).all()


@pytest.mark.parametrize("positive", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_stiffness_is_symmetric(name, positive):
    K = hessian(name, samples(), positive)
    assert np.abs(K - K.transpose(0, 2, 1)).max() < 1e-12 * np.abs(K).max()


@pytest.mark.parametrize("name", NAMES)
def test_positive_part_is_the_stiffness_with_its_negative_eigenvalues_cleared(name):
    """Eigenvalues of the 9 x 9 stiffness by LAPACK, clamped; where it is positive, the two are the same."""
    F = smooth(samples(200))
    K = hessian(name, F)
    D, V = np.linalg.eigh((K + K.transpose(0, 2, 1)) / 2)
    expected = (V * np.maximum(D, 0.0)[:, None, :]) @ V.transpose(0, 2, 1)
    size = np.abs(D).max(1)
    assert (np.abs(hessian(name, F, positive=True) - expected).max((1, 2)) < 1e-12 * size).all()
    assert name == "linear" or (D.min(1) < -0.01 * size).sum() > 20       # it had something to clear


@pytest.mark.parametrize("name", NAMES)
def test_positive_part_has_no_negative_eigenvalue_in_any_state(name):
    rng = np.random.default_rng(3)
    F = np.concatenate([rng.normal(size=(200, 3, 3)), degenerate()])
    D = np.linalg.eigvalsh(hessian(name, F, positive=True))
    assert (D.min(1) >= -1e-14 * D.max(1)).all()


def test_twist_form_of_corotational_equals_the_common_one():
    t = types(wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def short(H: wp.array(dtype=t.mat33), dF: wp.array(dtype=t.mat33), mu: wp.float64, lam: wp.float64,
              dP: wp.array(dtype=t.mat33)):
        i = wp.tid()
        q = polar_rotation(H[i], t.quat())
        dP[i] = corotational_response(q, twist_stiffness(H[i], q, mu, lam, wp.float64(0.0)), dF[i], mu, lam)

    F = samples()
    dF = np.random.default_rng(4).normal(size=F.shape)
    found = wp.zeros(len(F), dtype=t.mat33, device="cpu")
    wp.launch(short, len(F), [wp.array(F - ONE, dtype=t.mat33, device="cpu"), wp.array(dF, dtype=t.mat33, device="cpu"),
                              MU, LAM], [found], device="cpu")
    expected = EVALUATORS["corotational", wp.float64](F - ONE, dF)[3]
    assert np.abs(found.numpy() - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("name", TURNING)
def test_energy_does_not_change_and_stress_turns_with_the_body(name):
    F, Q = samples(), turn(np.random.default_rng(5))
    psi, P, _, _ = EVALUATORS[name, wp.float64](F - ONE)
    turned_psi, turned_P, _, _ = EVALUATORS[name, wp.float64](Q @ F - ONE)
    assert np.abs(turned_psi - psi).max() < 1e-13 * np.abs(psi).max()
    assert np.abs(turned_P - Q @ P).max() < 1e-13 * np.abs(P).max()


@pytest.mark.parametrize("real", EPS)
@pytest.mark.parametrize("name", TURNING)
def test_a_turned_body_is_free_of_stress(name, real):
    """Half turns too. H is rounded to the precision first, which strains the body by as much."""
    rng = np.random.default_rng(6)
    R = np.array([ONE, np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), *(turn(rng) for _ in range(50))])
    psi, P, _, _ = EVALUATORS[name, real](R - ONE)
    assert np.abs(P).max() < 8 * EPS[real] * (2 * MU + 3 * LAM)
    assert np.abs(psi).max() < 8 * EPS[real] * (2 * MU + 3 * LAM)


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.49])
@pytest.mark.parametrize("name", NAMES)
def test_small_strain_has_the_modulus_and_the_ratio_that_were_asked_for(name, nu):
    """A bar pulled by 1e-7 with its sides free: the strain across follows from P = 0 there, by Newton."""
    E = 2.5e6
    mu, lam = lame_parameters(E, nu)
    H, e = np.diag([1e-7, 0.0, 0.0]), 1e-7                  # departs from the limit by about 3 e, and P by 1e-16 E / e
    run = EVALUATORS[name, wp.float64]
    for _ in range(3):
        _, P, dP, _ = run(H, np.diag([0.0, 1.0, 1.0]), mu, lam)
        H -= np.diag([0.0, 1.0, 1.0]) * P[0, 1, 1] / dP[0, 1, 1]
    _, P, _, _ = run(H, None, mu, lam)
    assert abs(P[0, 0, 0] / (E * e) - 1) < 1e-6
    assert abs(-H[1, 1] / e - nu) < 1e-6


@pytest.mark.parametrize("turned_by", [0.0, 1e-6])
@pytest.mark.parametrize("name", NAMES)
def test_a_strain_of_a_millionth_keeps_three_digits_in_float32(name, turned_by):
    strain = 1e-6 * np.array([[1.0, 0.3, -0.2], [0.3, -0.6, 0.4], [-0.2, 0.4, 0.5]])
    H = strain + turned_by * np.array([[0.0, -1, 0.5], [1, 0, -0.3], [-0.5, 0.3, 0]])
    single, double = EVALUATORS[name, wp.float32](H), EVALUATORS[name, wp.float64](H)
    if name != "corotational":                                       # its energy wants float64, which all sums of energy have
        assert abs(single[0][0] / double[0][0] - 1) < 1e-3
    assert np.abs(single[1] - double[1]).max() < 1e-3 * np.abs(double[1]).max()


@pytest.mark.parametrize("name", NAMES)
def test_float32_agrees_with_float64(name):
    F = np.float32(smooth(samples()) - ONE).astype(np.float64)     # conditions of up to 100: 1 / (s2 + s3), powers of F
    dF = np.float32(np.random.default_rng(7).normal(size=F.shape)).astype(np.float64)
    for single, double in zip(EVALUATORS[name, wp.float32](F, dF), EVALUATORS[name, wp.float64](F, dF), strict=True):
        assert np.abs(single - double).max() < 100 * EPS[wp.float32] * np.abs(double).max()


def degenerate():
    """Collapsed, flat, mirrored, half turns; exact, and a little beside it."""
    rng = np.random.default_rng(8)
    a, b = rng.normal(size=(2, 3))
    F = [0 * ONE, np.outer(a, b), np.outer(a, b) + np.outer(b, a), np.diag([1.0, 1, 0]), np.diag([1.0, 0, 0]),
         np.diag([0, 0, -1.0]), -ONE, np.diag([1.0, 1, -1]), np.diag([1.0, -1, -1]), np.diag([-1.0, -1, 1]),
         np.diag([2.0, 1, -1]), np.ones((3, 3)), turn(rng) @ np.diag([3.0, 1e-3, -1e-3]), 1e-9 * rng.normal(size=(3, 3)),
         np.diag([1e-20, 1e-20, 1e-20]), 1e-12 * np.ones((3, 3))]
    return np.array(F + [f + 1e-8 * rng.normal(size=(3, 3)) for f in F])


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e6, 1e30])
@pytest.mark.parametrize("real", EPS)
@pytest.mark.parametrize("name", NAMES)
def test_every_state_gives_finite_numbers(name, real, scale):
    F = scale * np.concatenate([degenerate(), samples(), [np.diag([-1.0, -1.0, -1.0]), 3 * np.ones((3, 3))]])
    dF = np.random.default_rng(9).normal(size=F.shape)
    for mu, lam in (lame_parameters(1.0, 0.3), lame_parameters(1e9, 0.499)):
        assert all(np.isfinite(a).all() for a in EVALUATORS[name, real](F - ONE, dF, mu, lam))


def test_neo_hookean_beyond_its_seam_has_the_stress_of_its_energy():
    F = 120.0 * turn(np.random.default_rng(10)) @ np.diag([1.0, 1.1, 0.9])               # J = 1.7e6
    run, eps = EVALUATORS["neo_hookean", wp.float64], 1e-3
    P = run(F - ONE)[1].reshape(9)
    step = eps * np.eye(9).reshape(9, 3, 3)
    numeric = (run(F - ONE + step)[0] - run(F - ONE - step)[0]) / (2 * eps)              # 1e-16 Psi / eps / P: 1e-11
    assert np.abs(P - numeric).max() < 1e-9 * np.abs(P).max()


def test_neo_hookean_pressed_to_a_point_opens():
    _, P, _, _ = EVALUATORS["neo_hookean", wp.float64](0.01 * ONE - ONE)
    assert np.trace(P[0]) < 0


@pytest.mark.parametrize(("E", "nu"), [(0.0, 0.3), (float("nan"), 0.3), (float("inf"), 0.3), (1.0, 0.5), (1.0, -1.0),
                                       (1.0, float("nan"))])
def test_moduli_of_no_solid_are_refused(E, nu):
    with pytest.raises(ValueError, match="nu is" if E == 1.0 else "E is"):
        lame_parameters(E, nu)


def matrix(q):
    x, y, z, w = q.T
    return np.stack([w*w + x*x - y*y - z*z, 2*(x*y - w*z), 2*(x*z + w*y), 2*(x*y + w*z), w*w - x*x + y*y - z*z,
                     2*(y*z - w*x), 2*(x*z - w*y), 2*(y*z + w*x), w*w - x*x - y*y + z*z], -1).reshape(-1, 3, 3)


@pytest.mark.parametrize("warm", ["none", "far", "near"])
@pytest.mark.parametrize("real", EPS)
def test_rotation_is_that_of_the_singular_value_decomposition(real, warm):
    """1000 random F, half of them inverted. Condition of the problem: s1 / (s2 + s3). LAPACK errs by 30 units of float64."""
    rng = np.random.default_rng(11)
    F = rng.normal(size=(1000, 3, 3))
    start = np.zeros((1000, 4)) if warm == "none" else rng.normal(size=(1000, 4))
    if warm == "near":
        start = ROTATORS[real](F - ONE, np.zeros((1000, 4)))[1] + 1e-3 * start
    F, q = ROTATORS[real](F - ONE, start)
    s = np.linalg.svd(F, compute_uv=False)
    gap = (s[:, 1] + np.sign(np.linalg.det(F)) * s[:, 2]) / s[:, 0]
    error = np.abs(matrix(q) - polar(F)).max((1, 2))
    assert (error * gap < 8 * EPS[real] + 64 * EPS[wp.float64]).all()


@pytest.mark.parametrize("real", EPS)
def test_rotation_of_a_degenerate_state_is_proper_and_turns_as_much_as_any(real):
    """tr(R^T F) = s1 + s2 + s3, or - s3 where det F < 0: what no proper rotation exceeds; R itself may not be unique."""
    F = np.concatenate([degenerate(), 1e6 * degenerate()])
    F, q = ROTATORS[real](F - ONE, np.random.default_rng(12).normal(size=(len(F), 4)))
    assert np.abs(np.linalg.norm(q, axis=1) - 1).max() < 4 * EPS[real]
    s = np.linalg.svd(F, compute_uv=False)
    reached = np.einsum("nij,nij->n", matrix(q), F)
    sign = np.where(np.linalg.det(F / np.maximum(s[:, :1, None], 1e-300)) < 0, -1, 1)
    assert (np.abs(reached - (s[:, 0] + s[:, 1] + sign * s[:, 2])) <= 64 * EPS[real] * s[:, 0]).all()


def test_rotation_of_nothing_is_the_last_one():
    warm = np.array([[0.5, 0.5, -0.5, 0.5], [0.0, 0.0, 0.0, 0.0]])
    _, q = ROTATORS[wp.float64](np.tile(-ONE, (2, 1, 1)), warm)
    assert np.abs(q - [[0.5, 0.5, -0.5, 0.5], [0, 0, 0, 1]]).max() < 1e-15


def test_rotation_agrees_with_scipy_where_nothing_is_inverted():
    linalg = pytest.importorskip("scipy.linalg")
    F = np.array([f if np.linalg.det(f) > 0 else -f for f in samples()])
    _, q = ROTATORS[wp.float64](F - ONE, np.zeros((len(F), 4)))
    expected = np.array([linalg.polar(f)[0] for f in F])
    assert np.abs(matrix(q) - expected).max() < 1e-12


@pytest.mark.parametrize("real", EPS)
def test_eigenvectors_restore_the_matrix_whatever_its_gaps(real):
    """Random, twice and three times the same eigenvalue and almost, rank 1, nothing; from 1e-10 to 1e20."""
    t = types(real)

    @wp.kernel(module="unique", enable_backward=False)
    def decompose(A: wp.array(dtype=t.mat33), d: wp.array(dtype=t.vec3), V: wp.array(dtype=t.mat33)):
        values, vectors = eigen_three(A[wp.tid()])
        d[wp.tid()] = values
        V[wp.tid()] = vectors

    rng = np.random.default_rng(13)
    spectra = [rng.normal(size=3) for _ in range(200)] + [[1, 1, 2], [2, 1, 1], [1, 1, 1], [1, 1, -1], [0, 0, 1], [0, 0, 0]]
    spectra += [np.array(s) + size * rng.normal(size=3) for s in spectra[-6:] for size in (1e-15, 1e-9, 1e-7, 1e-4)]
    A = np.array([(Q * s) @ Q.T for s in spectra for Q in (ONE, turn(rng), turn(rng))])
    A = np.concatenate([scale * A for scale in (1e-10, 1.0, 1e20)])
    given = wp.array((A + A.transpose(0, 2, 1)) / 2, dtype=t.mat33, device="cpu")
    d, V = wp.zeros(len(A), dtype=t.vec3, device="cpu"), wp.zeros(len(A), dtype=t.mat33, device="cpu")
    wp.launch(decompose, len(A), [given], [d, V], device="cpu")
    A, d, V = (a.numpy().astype(np.float64) for a in (given, d, V))
    assert np.abs(V.transpose(0, 2, 1) @ V - ONE).max() < 8 * EPS[real]
    assert (np.abs((V * d[:, None, :]) @ V.transpose(0, 2, 1) - A).max((1, 2)) <= 16 * EPS[real] * np.abs(A).max((1, 2))).all()
