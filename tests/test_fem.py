"""Linear tetrahedra: forces against the energy, patch test, rotations, blocks of the stiffness, damping."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels import descent, fem
from wsim.kernels.material import TABLE, lame
from wsim.kernels.real import types
from wsim.kernels.tangent import elements_of
from wsim.tetra import tets
from wsim.tetra.lattice import box

MATERIALS = sorted(TABLE)
E, NU, TAU = 1e5, 0.3, 0.01
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


class Body:
    """A box of tets on the CPU, evaluated by the kernels."""

    def __init__(self, material: str, real=wp.float64, size=(0.3, 0.2, 0.2), cells=(3, 2, 2)):
        self.material, self.real, self.t = material, real, types(real)
        self.points, self.tets = box(size, cells)
        mu, lam = lame(E, NU)
        self.batch, t, count = fem.elements(real)(), self.t, len(self.tets)
        corners = self.points[self.tets]
        self.batch.point = wp.array(self.tets, dtype=wp.vec4i, device="cpu")
        self.batch.edge = self.array(corners[:, 1:] - corners[:, :1], t.mat33)
        self.batch.gradient = self.array(tets.gradients(self.points, self.tets)[:, 1:], t.mat33)
        self.batch.volume = self.array(tets.volumes(self.points, self.tets), real)
        self.batch.mu, self.batch.lam, self.batch.tau = (self.array(np.full(count, v), real) for v in (mu, lam, TAU))
        self.x = self.array(self.points, t.vec3)
        self.q = wp.zeros(count, dtype=t.quat, device="cpu")

    @property
    def module(self) -> str:
        return f"test_fem_{self.material}_{self.t.name}"

    def array(self, values, dtype):
        return wp.array(np.asarray(values, np.float32 if self.real is wp.float32 else np.float64), dtype=dtype, device="cpu")

    def gathered(self, parts) -> np.ndarray:
        total = np.zeros((len(self.points), 3))
        np.add.at(total, self.tets.ravel(), parts.numpy().astype(np.float64))
        return total

    def force(self, u, v=None) -> np.ndarray:
        """Forces at displacements u [m] and velocities v [m/s]."""
        parts, t = wp.zeros(4 * len(self.tets), dtype=self.t.vec3, device="cpu"), self.t
        kernel = fem.forces(self.material, True, real=self.real, module=self.module)
        velocities = self.array(np.zeros_like(self.points) if v is None else v, t.vec3)
        wp.launch(kernel, len(self.tets), [self.batch, self.x, self.array(u, t.vec3), velocities, self.q],
                  [parts, wp.zeros_like(self.q)], device="cpu")
        return self.gathered(parts)

    def change(self, u, p, rate=0.0, a=None) -> float:
        """Of energy (and, with the anchor a, damping) from u to u + p."""
        t, trial = self.t, descent.Trial()
        trial.first = wp.array([0, len(self.tets)], dtype=int, device="cpu")
        trial.lanes, trial.begin, trial.end = 1, 0, 1
        trial.step = wp.array([-1.0], dtype=wp.float64, device="cpu")
        trial.change = wp.zeros((1, 9), dtype=wp.float64, device="cpu")
        kernel = fem.energy_change(self.material, True, real=self.real, module=self.module)
        where = [self.array(z, t.vec3) for z in (u, u if a is None else a, p)]
        wp.launch(kernel, 1, [trial, self.batch, self.x, *where, self.q, rate], [], device="cpu")
        return float(trial.change.numpy()[0, 0])

    def stiffness(self, u, rate=0.0) -> tuple[np.ndarray, np.ndarray]:
        """K (3n, 3n) with the damping's part, and forces at rest, of the kernel that Newton's method takes."""
        t, out, n = self.t, elements_of(self.real)(), len(self.points)
        out.block = wp.zeros(6 * len(self.tets), dtype=t.mat33, device="cpu")
        out.force = wp.zeros(4 * len(self.tets), dtype=t.vec3, device="cpu")
        kernel, where = fem.linearise(self.material, True, real=self.real, module=self.module), self.array(u, t.vec3)
        wp.launch(kernel, len(self.tets), [self.batch, self.x, where, where, self.q, rate], [wp.zeros_like(self.q), out],
                  device="cpu")
        K, blocks = np.zeros((n, n, 3, 3)), out.block.numpy().astype(np.float64).reshape(-1, 6, 3, 3)
        for pair, (k, m) in enumerate(PAIRS):
            i, j, A = self.tets[:, k], self.tets[:, m], blocks[:, pair]
            for at, value in (((i, j), A), ((j, i), A.transpose(0, 2, 1)), ((i, i), -A), ((j, j), -A.transpose(0, 2, 1))):
                np.add.at(K, at, value)
        return K.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n), self.gathered(out.force)


def turn(seed: int = 3) -> np.ndarray:
    """Some proper rotation."""
    Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def bent(body: Body, seed: int = 1, size: float = 0.02) -> np.ndarray:
    """Random displacements of a fifth of a cell on top of a turn."""
    u = size * np.random.default_rng(seed).normal(size=body.points.shape)
    return u if body.material == "linear" else body.points @ (turn() - np.eye(3)).T + u


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_are_minus_the_gradient_of_the_energy(material):
    """Central differences of h = 1e-6 m in float64: h^2 of the third derivative, and rounding 1e-16 E / h."""
    body, rng, h = Body(material), np.random.default_rng(2), 1e-6
    u, v = bent(body), rng.normal(size=body.points.shape)
    slope = (body.change(u, h * v) - body.change(u, -h * v)) / (2.0 * h)
    force = body.force(u)
    assert np.sum(force * v) == pytest.approx(-slope, rel=1e-7)
    np.testing.assert_allclose(body.stiffness(u)[1], force, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("real, bound", [(wp.float64, 1e-12), (wp.float32, 1e-5)])
def test_the_inside_of_a_body_under_uniform_strain_is_at_rest(material, real, bound):
    """Patch test: an affine displacement, here 10 % with shear, is a solution for every mesh. Beside the surface's forces."""
    body = Body(material, real, cells=(4, 3, 3))
    u = body.points @ np.array([[0.1, 0.05, 0.0], [0.02, -0.03, 0.04], [0.0, 0.01, 0.05]]).T
    lattice = np.abs(body.points) / body.points.max(axis=0)
    inside = (lattice < 1.0 - 1e-9).all(axis=1)
    force = body.force(u)
    assert inside.sum() == 12 and np.abs(force[inside]).max() < bound * np.abs(force).max()


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_within_a_body_sum_to_nothing_and_turn_nothing(material):
    body = Body(material)
    u = bent(body)
    force, at = body.force(u, np.random.default_rng(5).normal(size=u.shape)), body.points + u
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * size
    if material != "linear":
        assert np.abs(np.cross(at, force).sum(axis=0)).max() < 1e-14 * size * np.abs(at).max()


@pytest.mark.parametrize("material", ["corotational", "neo_hookean", "st_venant_kirchhoff"])
def test_a_turned_body_is_at_rest(material):
    """float32: displacements of 0.3 m are rounded by 2e-8, strains of cells of 0.1 m by 2e-7, stress over E."""
    body = Body(material, wp.float32)
    force = body.force(body.points @ (turn() - np.eye(3)).T)
    assert np.abs(force).max() < 1e-6 * E * 0.1**2


def test_a_turned_linear_body_swells():
    """Linear strain of a turn by 90 degrees is -1 in two directions: what it is shown beside the others for."""
    body = Body("linear")
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(body.force(body.points @ (quarter - np.eye(3)).T)).max() > 0.1 * E * 0.1**2


@pytest.mark.parametrize("material", MATERIALS)
def test_blocks_are_differences_of_forces_where_the_stiffness_is_positive(material):
    """Stretched by 20 % in all directions, K has no negative part."""
    body, h = Body(material), 1e-6
    u = 0.2 * body.points + bent(body, size=0.002) * (material == "linear")
    v = np.random.default_rng(4).normal(size=u.shape)
    K = body.stiffness(u)[0]
    df = (body.force(u + h * v) - body.force(u - h * v)) / (2.0 * h)
    np.testing.assert_allclose((K @ v.ravel()).reshape(v.shape), -df, rtol=1e-6, atol=1e-6 * np.abs(df).max())


@pytest.mark.parametrize("material", MATERIALS)
def test_the_stiffness_is_symmetric_and_never_negative(material):
    """Scrambled points: half of the tets are inside out. Eigenvalues are good to 1e-15 of the largest times their number."""
    body = Body(material, cells=(2, 2, 2))
    u = 0.2 * np.random.default_rng(6).normal(size=body.points.shape)
    K = body.stiffness(u, rate=50.0)[0]
    values = np.linalg.eigvalsh(0.5 * (K + K.T))
    assert np.abs(K - K.T).max() < 1e-14 * np.abs(K).max() and values[0] > -1e-13 * values[-1]


@pytest.mark.parametrize("material", MATERIALS)
def test_damping_takes_power_from_strain_alone_as_its_blocks_and_its_potential_say(material):
    """No power of a turning body; -f.v is twice the potential; the blocks hold the damping over g."""
    body = Body(material)
    u, rng = bent(body), np.random.default_rng(8)
    at, v = body.points + u, rng.normal(size=body.points.shape)
    drag = body.force(u, v) - body.force(u)
    spin = np.cross(rng.normal(size=3), at) + rng.normal(size=3)
    assert np.abs(body.force(u, spin) - body.force(u)).max() < 1e-12 * np.abs(drag).max()
    assert np.sum(drag * v) < 0.0
    rate, small = 1.0 / 0.02, 1e-3 * v
    potential = body.change(u, small, rate) - body.change(u, small)
    assert np.sum(drag * v) == pytest.approx(-2.0 * potential / (rate * 1e-6), rel=1e-9)
    K = body.stiffness(u, rate)[0] - body.stiffness(u)[0]
    np.testing.assert_allclose((K @ v.ravel()).reshape(v.shape), -rate * drag, atol=1e-9 * rate * np.abs(drag).max())


@pytest.mark.parametrize("material", MATERIALS)
def test_a_collapsed_body_has_finite_forces_and_blocks(material):
    body = Body(material, wp.float64)
    for u in (-body.points, -2.0 * body.points, -body.points * (1.0, 0.0, 0.0)):
        K, force = body.stiffness(u, rate=50.0)
        assert np.isfinite(force).all() and np.isfinite(K).all()
