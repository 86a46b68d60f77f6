"""Forces, Jacobians and the linear solver of implicit steps, against differences and dense solves."""

import numpy as np
import pytest

from tests.make.physics.solver.newton import DOUBLE, garment, make
from tests.make.physics.solver.newton_adjoint import Probe
from wsim.physics.solver import linear
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("size", [1.0, 0.01])
@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_the_force_is_minus_the_gradient_of_phi(size, damping):
    scene = garment(size, damping)
    if damping:
        scene.pin("/pin", "/cloth", [0])
    probe = Probe(scene)
    random = np.random.default_rng(1)
    d, p = 0.02 * size * random.normal(size=(2, probe.n, 3))
    p[probe.m.rows.w.numpy() == 0.0] = 0.0                                   # what is pinned does not move
    force, eps = probe.force(d), 1e-4
    slope = (probe.change(eps * p) - probe.change(-eps * p)) / (2.0 * eps)
    assert slope == pytest.approx(-force @ p.ravel(), rel=1e-6)


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_at_rest_the_jacobian_is_exact(size):
    """No stress, no geometric part: Gauss-Newton is all there is."""
    probe = Probe(garment(size))
    K, exact = probe.matrix(np.zeros((probe.n, 3))), probe.differences(np.zeros((probe.n, 3)), 1e-6 * size)
    np.testing.assert_allclose(K, exact, atol=2e-5 * np.abs(exact).max())
    np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("size", [1.0, 0.01])
@pytest.mark.parametrize("stretch", [1.3, 0.8])
def test_a_spring_keeps_the_positive_part_exactly(size, stretch):
    scene = make()
    scene.net("/net", [[0, 0, 0], [0.6 * size, 0.8 * size, 0.0]], [[0, 1]], [200.0], [0.1], lengths=[size / stretch])
    probe = Probe(scene)
    K, exact = probe.matrix(np.zeros((2, 3))), probe.differences(np.zeros((2, 3)), 1e-6 * size)
    own = probe.m.A.own.numpy()[0]
    w, V = np.linalg.eigh(exact - own * np.eye(6))
    np.testing.assert_allclose(K - own * np.eye(6), (V * np.maximum(w, 0.0)) @ V.T, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_a_stretched_membrane_is_exact_across_its_plane_and_in_its_spin(size):
    scene = make()
    scene.cloth("/cloth", np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.9, 0]]) * size, [3], [0, 1, 2],
                material=Fabric(stretch=500.0, shear=100.0, poisson=0.2))
    probe = Probe(scene)
    X = probe.sim.state.x.numpy()
    F = np.array([[1.3, 0.1, 0.0], [0.05, 1.2, 0.0], [0.0, 0.0, 1.0]])
    d = X @ F.T - X
    own = np.repeat(probe.m.A.own.numpy(), 3)
    K, exact = probe.matrix(d) - np.diag(own), probe.differences(d, 1e-6 * size) - np.diag(own)
    z, atol = np.arange(3) * 3 + 2, 1e-6 * np.abs(exact).max()
    assert np.abs(exact[np.ix_(z, z)]).max() > 1e3 * atol                     # tension does stiffen it
    np.testing.assert_allclose(K[np.ix_(z, z)], exact[np.ix_(z, z)], atol=atol)
    U, s, Vt = np.linalg.svd(F[:2, :2])                                       # dF = R J U strains nothing
    R = U @ Vt
    turn = np.zeros((3, 3))
    turn[:, :2] = X[:, :2] @ (R @ np.array([[0.0, -1.0], [1.0, 0.0]]) @ (Vt.T * s) @ Vt).T
    t = turn.ravel()
    assert t @ K @ t == pytest.approx(t @ exact @ t, rel=1e-5) and t @ K @ t > 0.0
    assert np.linalg.eigvalsh(K).min() > -1e-9 * np.abs(K).max()


def test_the_inverse_of_a_block_stays_below_one_over_own_where_a_hinge_is_nearly_flat():
    """1e3 N m at a hinge whose one height is micrometres: blocks of 1e14 N/m in one direction, `own` in the others."""
    scene = make()
    scene.cloth("/cloth", [[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.6, -1, 0]], [3, 3], [0, 1, 2, 1, 0, 3],
                material=Fabric(bend=1e3))
    probe = Probe(scene, precision="float32")
    m, random = probe.m, np.random.default_rng(5)
    x, e, w = probe.sim.state.x.numpy().copy(), probe.sim.state.e.numpy().copy(), random.normal(size=3)
    for height in (1e-3, 1e-4, 1e-5, 3e-6):
        for _ in range(20):
            w = random.normal(size=3)
            d = e + (np.abs(x[:, 1:2] - 1.0) < 1e-6) * ((0.0, -1.0, 0.0) + height * w / np.linalg.norm(w))
            probe.force(d)
            size = np.abs(np.linalg.eigvalsh(m.A.P.numpy().astype(float))).max(axis=1)
            assert (size <= 1.001 / m.A.own.numpy()).all()


def test_conjugate_gradients_solve_the_dense_system():
    scene = garment(damping=0.01)
    scene.pin("/pin", "/cloth", [0, 3])
    probe = Probe(scene)
    m = probe.m
    K, f = probe.matrix(0.01 * np.random.default_rng(2).normal(size=(probe.n, 3))), probe.m.f.numpy().ravel()
    m.system.solve(m.f, 1e-13, 1000)
    free = np.repeat(m.rows.w.numpy() > 0.0, 3)
    wanted = np.zeros(3 * probe.n)
    wanted[free] = np.linalg.solve(K[np.ix_(free, free)], f[free])
    y = m.v.y.numpy().ravel()
    np.testing.assert_allclose(y, wanted, atol=1e-10 * np.abs(wanted).max())
    assert m.system.drop.numpy().sum() == pytest.approx(f @ wanted, rel=1e-9)


@pytest.mark.parametrize("worlds", [1, 2])
def test_several_blocks_a_body_do_the_same_as_one(monkeypatch, worlds):
    scene, ends = garment(damping=0.01), []
    scene.pin("/pin", "/cloth", [0, 3])
    for several in (False, True):
        if several:
            monkeypatch.setitem(linear.FUSE, "cpu", 0)
            monkeypatch.setattr(linear, "BLOCK", 3)                          # points of a chunk
        sim = Simulation(scene, worlds=worlds, **DOUBLE)
        assert sim.plan.ports.newton_assembly.system.large == several
        sim.run(4)
        ends.append(sim.positions("/cloth", worlds - 1))
        counted = sim.indicators()["pcg_iterations"]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-12)
    assert counted > 0
