"""Linear tetrahedra: forces against the energy, patch test, rotations, blocks of the stiffness, damping."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.soft.tet_box import E, TetBox, bent, turn
from wsim.kernels.soft.material import TABLE

MATERIALS = sorted(TABLE)


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_are_minus_the_gradient_of_the_energy(material):
    """Central differences of h = 1e-6 m in float64: h^2 of the third derivative, and rounding 1e-16 E / h."""
    body, rng, h = TetBox(material), np.random.default_rng(2), 1e-6
    u, v = bent(body), rng.normal(size=body.points.shape)
    slope = (body.change(u, h * v) - body.change(u, -h * v)) / (2.0 * h)
    force = body.force(u)
    assert np.sum(force * v) == pytest.approx(-slope, rel=1e-7)
    np.testing.assert_allclose(body.stiffness(u)[1], force, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("real, bound", [(wp.float64, 1e-12), (wp.float32, 1e-5)])
def test_the_inside_of_a_body_under_uniform_strain_is_at_rest(material, real, bound):
    """Patch test: an affine displacement, here 10 % with shear, is a solution for every mesh. Beside the surface's forces."""
    body = TetBox(material, real, cells=(4, 3, 3))
    u = body.points @ np.array([[0.1, 0.05, 0.0], [0.02, -0.03, 0.04], [0.0, 0.01, 0.05]]).T
    force = body.force(u)
    assert body.inside.sum() == 12 and np.abs(force[body.inside]).max() < bound * np.abs(force).max()


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_within_a_body_sum_to_nothing_and_turn_nothing(material):
    body = TetBox(material)
    u = bent(body)
    force, at = body.force(u, np.random.default_rng(5).normal(size=u.shape)), body.points + u
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * size
    if material != "linear":
        assert np.abs(np.cross(at, force).sum(axis=0)).max() < 1e-14 * size * np.abs(at).max()


@pytest.mark.parametrize("material", ["corotational", "neo_hookean", "st_venant_kirchhoff"])
def test_a_turned_body_is_at_rest(material):
    """float32: displacements of 0.3 m are rounded by 2e-8, strains of cells of 0.1 m by 2e-7, stress over E."""
    body = TetBox(material, wp.float32)
    force = body.force(body.points @ (turn() - np.eye(3)).T)
    assert np.abs(force).max() < 1e-6 * E * 0.1**2


def test_a_turned_linear_body_swells():
    """Linear strain of a turn by 90 degrees is -1 in two directions: what it is shown beside the others for."""
    body = TetBox("linear")
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(body.force(body.points @ (quarter - np.eye(3)).T)).max() > 0.1 * E * 0.1**2


@pytest.mark.parametrize("material", MATERIALS)
def test_blocks_are_differences_of_forces_where_the_stiffness_is_positive(material):
    """Stretched by 20 % in all directions, K has no negative part."""
    body, h = TetBox(material), 1e-6
    u = 0.2 * body.points + bent(body, size=0.002) * (material == "linear")
    v = np.random.default_rng(4).normal(size=u.shape)
    K = body.stiffness(u)[0]
    df = (body.force(u + h * v) - body.force(u - h * v)) / (2.0 * h)
    np.testing.assert_allclose((K @ v.ravel()).reshape(v.shape), -df, rtol=1e-6, atol=1e-6 * np.abs(df).max())


@pytest.mark.parametrize("material", MATERIALS)
def test_the_stiffness_is_symmetric_and_never_negative(material):
    """Scrambled points: half of the tets are inside out. Eigenvalues are good to 1e-15 of the largest times their number."""
    body = TetBox(material, cells=(2, 2, 2))
    u = 0.2 * np.random.default_rng(6).normal(size=body.points.shape)
    K = body.stiffness(u, rate=50.0)[0]
    values = np.linalg.eigvalsh(0.5 * (K + K.T))
    assert np.abs(K - K.T).max() < 1e-14 * np.abs(K).max() and values[0] > -1e-13 * values[-1]


@pytest.mark.parametrize("material", MATERIALS)
def test_damping_takes_power_from_strain_alone_as_its_blocks_and_its_potential_say(material):
    """No power of a turning body; -f.v is twice the potential; the blocks hold the damping over g."""
    body = TetBox(material)
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
    body = TetBox(material)
    for u in (-body.points, -2.0 * body.points, -body.points * (1.0, 0.0, 0.0)):
        K, force = body.stiffness(u, rate=50.0)
        assert np.isfinite(force).all() and np.isfinite(K).all()
