"""The coarse space of soft bodies against NumPy: prolongation, Galerkin product, cycle, and what it is for."""

import numpy as np
import pytest

from tests.make.physics.solver.coarse_space import bar
from tests.make.physics.solver.newton_adjoint import Probe
from wsim.physics.solver import coarse_space
from wsim.scene import shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


@pytest.fixture(autouse=True)
def always(monkeypatch):
    """Small bodies have a coarse space too, of several levels."""
    monkeypatch.setitem(coarse_space.PAYS, "cpu", ((0, 0.0),))
    monkeypatch.setattr(coarse_space, "CELLS", 1.5)


class Bar(Probe):
    """A bar turned and bent, its system and its coarse space laid open."""

    def __init__(self, **more):
        super().__init__(bar(), **more)
        x = self.sim.state.x.numpy().astype(float)
        c, s = np.cos(2.0), np.sin(2.0)
        d = x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T - x + 0.02 * np.random.default_rng(3).normal(size=x.shape)
        self.A, self.x = self.matrix(d), x + d
        self.system, self.coarse = self.m.system, self.m.system.coarse
        self.free = self.m.rows.w.numpy() > 0.0
        self.filter = self.free[:, None, None] * np.eye(3)

    def hold(self):
        """Takes one, two and three directions from some points."""
        P, n, t = self.m.A.P.numpy().copy(), np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6])
        for k, S in enumerate([np.eye(3) - np.outer(n, n), np.outer(t, t), np.zeros((3, 3))]):
            for i in np.flatnonzero(self.free)[k:30:7]:
                self.filter[i], P[i] = S, S @ P[i] @ S
        self.m.A.P.assign(P)

    def setup(self):
        self.coarse.setup(self.m.rows, self.m.A, self.sim.state.x, self.sim.state.d)

    def table(self, name):
        return getattr(self.coarse.g, name).numpy().astype(float).reshape(-1, 6, 6)

    def prolongation(self, level):
        """Dense: from the nodes of a level to the level below, of the first to the points."""
        v = self.coarse.levels[level]
        fine = (v.of >= 0).nonzero()[0]
        begin = 0 if level == 0 else int(self.coarse.node[level - 1])
        R = np.zeros((len(v.of), 3 if level == 0 else 6, v.size, 6))
        inverse = self.table("inverse")[self.coarse.node[level]:]
        for i in fine:
            K = v.of[i]
            if level:
                R[i, :, K] = self.table("Q")[begin + i]
            else:
                a = self.x[i] - self.x[v.place[K]]
                turn = np.stack([np.cross(e, a) for e in np.eye(3)], axis=1)
                R[i, :, K] = self.filter[i] @ np.hstack([np.eye(3), turn]) @ inverse[K].T
        return R.reshape(-1, 6 * v.size)

    def matrix_of(self, level):
        """Dense matrix of a level, its blocks with themselves as they should be: 1, 0 in directions that a node lacks."""
        v, K, b = self.coarse.levels[level], int(self.coarse.node[level]), int(self.coarse.block[level])
        A = np.zeros((v.size, 6, v.size, 6))
        for k in range(v.size):
            A[k, :, k] = np.diag(np.any(self.table("inverse")[K + k] != 0.0, axis=1))
            for e in range(v.first[k], v.first[k + 1]):
                A[k, :, v.column[e]] = self.table("A")[b + e]
        return A.reshape(6 * v.size, 6 * v.size)

    def apply(self, r):
        """z = M r."""
        v, P = self.m.v, self.m.A.P.numpy()
        v.r.assign(r.reshape(-1, 3))
        v.z.assign(np.einsum("nij,nj->ni", P, r.reshape(-1, 3)))
        self.system.chunks.going.fill_(1)
        self.system.chunks.done.zero_()
        self.system.correct(0)
        return v.z.numpy().ravel().copy()


@pytest.fixture(scope="module")
def held():
    patch = pytest.MonkeyPatch()
    with patch.context() as p:
        p.setitem(coarse_space.PAYS, "cpu", ((0, 0.0),))
        p.setattr(coarse_space, "CELLS", 1.5)
        probe = Bar()
    probe.hold()
    probe.setup()
    return probe


def test_the_coarse_matrices_are_galerkin_products_in_the_range_of_the_filter(held):
    A = held.A
    assert len(held.coarse.levels) >= 3
    for level in range(len(held.coarse.levels)):
        P = held.prolongation(level)
        A = P.T @ A @ P
        np.testing.assert_allclose(held.matrix_of(level), A, atol=1e-9)


def test_rigid_motions_of_the_whole_body_go_through_all_levels(held):
    top = len(held.coarse.levels) - 1
    assert held.coarse.levels[top].size == 1
    place = held.coarse.levels[top].place[0]
    for v, w in zip(np.eye(6)[:, :3], np.eye(6)[:, 3:], strict=True):
        t = np.linalg.solve(held.table("inverse")[-1].T, np.r_[v, w])
        for level in range(top, -1, -1):
            t = held.prolongation(level) @ t
        rigid = v + np.cross(w, held.x - held.x[place])
        whole = held.coarse.levels[0].of
        full = np.linalg.matrix_rank(held.table("inverse")[:held.coarse.levels[0].size]) == 6
        wanted = np.einsum("nij,nj->ni", held.filter, rigid)
        np.testing.assert_allclose(t.reshape(-1, 3)[full[whole]], wanted[full[whole]], atol=1e-9)
        assert full[whole].mean() > 0.5


def test_the_preconditioner_is_symmetric_and_positive(held):
    n = 3 * held.n
    M = np.stack([held.apply(np.einsum("nij,nj->ni", held.filter, e.reshape(-1, 3)).ravel()) for e in np.eye(n)], axis=1)
    np.testing.assert_allclose(M, M.T, atol=1e-12 * np.abs(M).max())
    kept = round(np.einsum("nii->", held.filter))
    values = np.linalg.eigvalsh(M)
    assert values[n - kept - 1] < 1e-12 * values[-1] < 1e-6 * values[n - kept]          # none outside the range, all inside


def test_it_solves_the_dense_system_in_few_iterations():
    probe = Bar()
    f, free = probe.m.f.numpy().ravel(), np.repeat(probe.free, 3)
    probe.system.count.zero_()
    probe.system.solve(probe.m.f, 1e-12, 1000, (probe.sim.state.x, probe.sim.state.d))
    wanted = np.zeros(len(f))
    wanted[free] = np.linalg.solve(probe.A[np.ix_(free, free)], f[free])
    np.testing.assert_allclose(probe.m.v.y.numpy().ravel(), wanted, atol=1e-9 * np.abs(wanted).max())
    assert probe.system.drop.numpy().sum() == pytest.approx(f @ wanted, rel=1e-9)


def test_iterations_do_not_grow_with_the_number_of_points(monkeypatch):
    """A stiff bar; block Jacobi takes 2 times as many on twice as fine a mesh."""
    monkeypatch.setattr(coarse_space, "CELLS", 4.0)
    counts = {}
    for coarse in (True, False):
        monkeypatch.setitem(coarse_space.PAYS, "cpu", ((0, 0.0 if coarse else np.inf),))
        for cells in (8, 16):
            scene = bar((cells * 2, cells, cells), young=3e6, size=(1.0, 0.5, 0.5))
            sim = Simulation(scene, device="cpu", precision="float32")
            sim.step()
            counts[coarse, cells] = sim.indicators()["pcg_iterations"] / 2
    assert counts[False, 16] > 1.6 * counts[False, 8] and counts[False, 16] > 2.0 * counts[True, 16]
    assert counts[True, 16] < 1.4 * counts[True, 8]


def test_worlds_do_not_mix_and_end_where_they_do_without(monkeypatch):
    ends = []
    for coarse in (0.0, np.inf):
        monkeypatch.setitem(coarse_space.PAYS, "cpu", ((0, coarse),))
        sim = Simulation(bar(), worlds=2, device="cpu", precision="float64")
        sim.run(3)
        ends.append([sim.positions("/bar", world) for world in (0, 1)])
        assert np.array_equal(*ends[-1])
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-5)


def test_the_plan_says_what_was_chosen_and_why(monkeypatch):
    def chosen():
        sim = Simulation(bar(), device="cpu", precision="float64")
        return next(r["what"] for r in sim.plan.table() if r["name"] == "newton"), sim.plan.ports.newton_assembly.system.coarse
    words, coarse = chosen()
    assert "multigrid, since a wave passes" in words and coarse
    monkeypatch.setitem(coarse_space.PAYS, "cpu", ((0, 1e3),))
    words, coarse = chosen()
    assert "block Jacobi, since a wave passes" in words and coarse is None
    monkeypatch.setitem(coarse_space.PAYS, "cpu", ((1000, 0.0),))
    words, coarse = chosen()
    assert "block Jacobi, under 1000 points" in words and coarse is None


def test_bodies_without_a_coarse_space_share_the_scene():
    """A sheet beside the bar: neither knows of the other."""
    alone, beside = bar(), bar()
    beside.cloth("/sheet", *shapes.sheet(1.0, 1.0, 5, 5, at=(3.0, 0.0, 0.0)), material=Fabric(stretch=500.0, bend=1e-3))
    found = [Simulation(scene, device="cpu", precision="float64") for scene in (alone, beside)]
    for sim in found:
        sim.run(2)
    assert len(found[1].plan.ports.newton_assembly.system.coarse.levels) > 1
    assert np.array_equal(found[0].positions("/bar"), found[1].positions("/bar"))
    fall = -0.5 * 9.81 * (1 / 60)**2 * 3.0                     # backward Euler: h^2 g (1 + 2), nothing holds the sheet
    drop = found[1].positions("/sheet") - beside.cloths[0].points
    assert drop[:, 1] == pytest.approx(2.0 * fall, rel=1e-6)
