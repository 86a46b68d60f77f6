"""The Schwarz preconditioner against dense sums over its domains, and what it is for."""

import numpy as np
import pytest

from tests.make.physics.solver.newton_adjoint import Probe
from tests.make.physics.solver.schwarz.schwarz import sheet
from wsim.physics.solver.schwarz import solver, tree
from wsim.physics.solver.schwarz.bisection import bisect_coordinates
from wsim.simulation.simulation import Simulation


@pytest.fixture(autouse=True)
def always(monkeypatch):
    """Small and soft sheets too."""
    monkeypatch.setitem(solver.PAYS, "cpu", (0, 0.0))


class Sheet(Probe):
    """A crumpled sheet, its matrix and its domains."""

    def __init__(self, cells: int = 9, **more):
        super().__init__(sheet(cells), **more)
        self.free = self.m.rows.w.numpy() > 0.0
        self.d = 0.01 * np.random.default_rng(0).normal(size=(self.n, 3)) * self.free[:, None]
        self.schwarz = self.m.system.schwarz
        self.setup()

    def setup(self):
        self.K = self.matrix(self.d)
        self.schwarz.setup(self.m.rows, self.m.A, self.sim.state.x, self.sim.state.d)
        self.X = self.sim.state.x.numpy().astype(float) + self.sim.state.d.numpy()

    def apply(self, r):
        """M^-1 r: what a solve without iterations begins with."""
        self.m.f.assign(np.asarray(r).reshape(-1, 3))
        s = self.m.system
        self.schwarz.solve(self.m.rows, self.m.A, self.m.f, 1e-3, 0, self.m.v, s.drop, s.count)
        return self.m.v.z.numpy().ravel().copy()

    def affine(self, points, S):
        """The 12 affine motions of some points about their mean, filtered, (3 n, 12)."""
        E = np.zeros((self.n, 3, 4, 3))
        if not len(points):
            return E.reshape(3 * self.n, 12)
        arm = self.X[points] - self.X[points].mean(axis=0)
        E[points] = np.einsum("ip,irc->irpc", np.c_[np.ones(len(points)), arm], S[points])
        return E.reshape(3 * self.n, 12)

    def dense(self, S):
        """The sum over all domains, from their definition."""
        leaf, groups = self.schwarz.tree.leaf, self.schwarz.tree.groups
        spaces = [np.eye(3 * self.n).reshape(self.n, 3, self.n, 3)[:, :, leaf // 4 == d].reshape(3 * self.n, -1)
                  for d in range(2 * groups)]
        F = np.zeros((self.n, 3, self.n, 3))
        F[np.arange(self.n), :, np.arange(self.n)] = S
        F = F.reshape(3 * self.n, -1)
        spaces = [F @ E for E in spaces]
        for g in range(groups):
            spaces.append(np.hstack([self.affine(np.flatnonzero(leaf == 8 * g + k), S) for k in range(8)]))
        span = 1
        while span < groups:
            for g in range(0, groups, 8 * span):
                nodes = [(leaf // 8 >= a) & (leaf // 8 < a + span) for a in range(g, g + 8 * span, span)]
                spaces.append(np.hstack([self.affine(np.flatnonzero(inside), S) for inside in nodes if inside.any()]))
            span *= 8
        return sum(E @ np.linalg.pinv(E.T @ self.K @ E, rcond=1e-11, hermitian=True) @ E.T for E in spaces)


def test_bisection_leaves_parts_of_equal_size_that_hang_together():
    points = np.random.default_rng(1).random((1000, 3)) * (4.0, 1.0, 0.01)
    part = bisect_coordinates(points, 6)
    counts = np.bincount(part, minlength=64)
    assert counts.min() == 15 and counts.max() == 16
    spread = [np.ptp(points[part == k, :2], axis=0).max() for k in range(64)]
    assert max(spread) < 0.5                                         # the square of 1/16 has sides of 0.25
    assert np.array_equal(bisect_coordinates(np.zeros((5, 3)), 3), bisect_coordinates(np.zeros((5, 3)), 3))


@pytest.mark.parametrize("points, levels, run", [(8, 1, 16), (1, 2, 3)])
def test_the_preconditioner_is_the_sum_over_the_domains_of_all_levels(points, levels, run, monkeypatch):
    """Leaves of one point have more motions than they need: those that are none are left out. Short runs are summed apart."""
    monkeypatch.setattr(tree, "POINTS", points)
    monkeypatch.setattr(tree, "RUN", run)
    probe = Sheet()
    r = np.random.default_rng(2).normal(size=3 * probe.n)
    S = probe.free[:, None, None] * np.eye(3)
    wanted = probe.dense(S) @ r
    np.testing.assert_allclose(probe.apply(r), wanted, atol=1e-7 * np.abs(wanted).max())
    assert probe.schwarz.tree.levels == levels and len(probe.schwarz.tree.joined) > 0


def test_filtered_directions_are_in_no_domain():
    """Filters like those of contacts: some points keep a plane, one nothing."""
    probe, random = Sheet(), np.random.default_rng(3)
    S = probe.free[:, None, None] * np.eye(3)
    for i in np.flatnonzero(probe.free)[::3]:
        n = random.normal(size=3)
        S[i] -= np.outer(n, n) / (n @ n)
    S[50] = 0.0
    P = probe.m.A.P.numpy()
    probe.m.A.P.assign(S @ P @ S)
    probe.schwarz.setup(probe.m.rows, probe.m.A, probe.sim.state.x, probe.sim.state.d)
    r = np.einsum("irc,ic->ir", S, random.normal(size=(probe.n, 3))).ravel()
    wanted = probe.dense(S) @ r
    np.testing.assert_allclose(probe.apply(r), wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("precision, rounding", [("float64", 1e-12), ("float32", 1e-3)])
def test_the_preconditioner_is_symmetric_and_positive(precision, rounding):
    probe = Sheet(precision=precision)
    keep = np.repeat(probe.free, 3)
    M = np.stack([probe.apply(e) for e in np.eye(3 * probe.n)[keep]], axis=1)[keep]
    assert np.abs(M - M.T).max() < rounding * np.abs(M).max()
    assert np.linalg.eigvalsh(0.5 * (M + M.T)).min() > 0.0


def test_a_solve_is_the_dense_solve():
    probe = Sheet(14)
    keep = np.repeat(probe.free, 3)
    f = probe.force(probe.d)
    probe.m.system.solve(probe.m.f, 1e-12, 500, (probe.sim.state.x, probe.sim.state.d))
    wanted = np.zeros(3 * probe.n)
    wanted[keep] = np.linalg.solve(probe.K[np.ix_(keep, keep)], f[keep])
    np.testing.assert_allclose(probe.m.v.y.numpy().ravel(), wanted, atol=1e-8 * np.abs(wanted).max())
    assert probe.m.system.drop.numpy()[0] == pytest.approx(f @ wanted, rel=1e-8)


@pytest.mark.parametrize("stretch", [1e3, 1e4])
def test_a_smooth_load_takes_a_fifth_of_the_iterations_of_block_jacobi(stretch, monkeypatch):
    """Gravity on a sheet of 40 x 40 cells, to 1e-2."""
    counts = []
    for least in (0, 10**9):
        monkeypatch.setitem(solver.PAYS, "cpu", (least, 0.0))
        probe = Probe(sheet(40, stretch), precision="float32")
        probe.force(np.zeros((probe.n, 3)))
        free = probe.m.rows.w.numpy()[:, None] > 0.0
        probe.m.f.assign(free * (0.0, -1e-3, 0.0))
        probe.m.system.count.zero_()
        probe.m.system.solve(probe.m.f, 1e-2, 3000, (probe.sim.state.x, probe.sim.state.d))
        counts.append(int(probe.m.system.count.numpy()[0]))
    assert 0 < counts[0] <= counts[1] / 5, counts


def test_bits_are_the_same_twice_and_worlds_do_not_see_each_other():
    ends = []
    for worlds in (1, 1, 2):
        sim = Simulation(sheet(12), device="cpu", worlds=worlds)
        sim.run(3)
        ends.append(sim.positions("/cloth", world=worlds - 1))
    assert np.array_equal(ends[0], ends[1]) and np.array_equal(ends[0], ends[2])


def test_systems_too_small_for_their_leaves_are_solved_too():
    """A triangle and a sheet: leaves without points have no part."""
    scene = sheet(12)
    scene.cloth("/scrap", np.array([[3.0, 0, 0], [3.1, 0, 0], [3.0, 0.1, 0]]), [3], [0, 1, 2], model="membrane")
    sim = Simulation(scene, device="cpu", precision="float64")
    start = sim.positions("/scrap")
    sim.run(3)
    n, h = 6, 1.0 / 48.0
    np.testing.assert_allclose(sim.positions("/scrap") - start, np.tile([0, -9.81 * h * h * n * (n + 1) / 2, 0], (3, 1)),
                               atol=1e-10)


def test_a_tree_has_each_point_once_and_each_pair_of_leaves_once():
    points = np.random.default_rng(5).random((700, 3))
    first = np.arange(0, 2101, 3)
    column = (np.repeat(np.arange(700), 3) + np.tile([1, 2, 5], 700)) % 700
    found = tree.build_domain_tree(points, np.array([0, 300, 700]), first, column)
    assert np.array_equal(np.sort(found.order), np.arange(700)) and np.diff(found.first).max() <= 8
    assert len(np.unique(found.pair, axis=0)) == len(found.pair) and (found.pair[:, 0] <= found.pair[:, 1]).all()
    assert found.rank.max() < 32
