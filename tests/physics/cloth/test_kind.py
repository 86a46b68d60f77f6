"""A kind of constraint of one file and one row (tests/make/rows/area.py) goes through all that those of wsim go through: every
solver, energy and bounds, live values, worlds, reactions, gradients."""

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import Run
from tests.make.rows.area import KIND, ROW, VALUE, Film
from wsim.geometry import topology
from wsim.kernels.cloth import general
from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.cloth.terms import batch_of
from wsim.physics.cloth import constraints, kind
from wsim.physics.motion import frequency
from wsim.scene import Cloth, Pin, Scene, shapes
from wsim.scene.values import table
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}
STRETCH, AREA, FRAME = 20.0, 3e4, 1.0 / 60.0
SWEPT = {"solver": "xpbd", "integrator": "backward_euler", "substeps": 4, "iterations": 100}
SOLVED = {"solver": "implicit", "integrator": "backward_euler", "substeps": 4, "iterations": 30}
LEAPT = {"solver": "explicit", "integrator": "leapfrog", "substeps": 100}


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setitem(kind.TABLE, "area", ROW)
    monkeypatch.setattr(table, "VALUES", [*table.VALUES, VALUE])


def film(damping: float = 0.0, area: float = AREA, **more) -> Scene:
    """A sheet of 4 x 4 points held at two corners, sheared and stretched."""
    rest, counts, indices = shapes.sheet(0.15, 0.15, 3, 3)
    points = rest * (1.03, 1.05, 1.0) + np.outer(0.2 * rest[:, 1], (1.0, 0.0, 0.0))
    points[:, 2] = 0.3 * points[:, 0]**2 + 0.1 * points[:, 0] * points[:, 1]
    fabric = Film(stretch=STRETCH, shear=0.0, bend=0.0, density=150.0, thickness=1e-3, damping=damping, area=area)
    cloth = Cloth("/cloth", points, counts, indices, rest_points=rest, model="springs", material=fabric)
    pins = [Pin("/pin", "/cloth", np.array([12, 15]))]
    return Scene(**{"objects": {"Cloth": [cloth]}, "pins": pins, "fps": 60, "frames": 3} | more)


class Reference:
    """The same sheet in NumPy: springs of STRETCH A / l^2 along authored edges, areas, gravity."""

    def __init__(self, scene: Scene):
        self.sim = Simulation(scene, **DOUBLE)
        (b,) = self.sim.model.bodies
        self.index, self.x, self.masses = b.index, b.places + b.origin, b.masses
        self.free = ~np.isin(np.arange(b.count), b.index[[12, 15]])
        springs = [r for r in self.sim.model.constraints if r.kind == "distance"]
        self.ends, self.l0, self.k = (np.concatenate([a(r) for r in springs])
                                      for a in (lambda r: r.ids, lambda r: r.rest, lambda r: 1.0 / r.alpha))
        self.triangles = b.triangles
        self.A0 = topology.triangle_areas(b.rest, b.triangles)

    def force(self, x: np.ndarray) -> np.ndarray:
        f = np.zeros_like(x)
        r = x[self.ends[:, 1]] - x[self.ends[:, 0]]
        L = np.linalg.norm(r, axis=1)
        pull = (self.k * (1.0 - self.l0 / L))[:, None] * r
        np.add.at(f, self.ends[:, 0], pull)
        np.add.at(f, self.ends[:, 1], -pull)
        p = x[self.triangles]
        N = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        size = np.linalg.norm(N, axis=1)
        s = AREA * (0.5 * size - self.A0) / size
        for k in range(3):                               # dA/dx_k = n x (edge across) / 2
            across = p[:, (k + 2) % 3] - p[:, (k + 1) % 3]
            np.add.at(f, self.triangles[:, k], -(0.5 * s)[:, None] * np.cross(N, across))
        return f

    def energy(self, x: np.ndarray) -> float:
        L = np.linalg.norm(x[self.ends[:, 1]] - x[self.ends[:, 0]], axis=1)
        strained = topology.triangle_areas(x, self.triangles) - self.A0
        return float((0.5 * self.k * (L - self.l0)**2).sum() + 0.5 * AREA * (strained**2).sum())

    def acceleration(self, x: np.ndarray) -> np.ndarray:
        a = self.force(x) / self.masses[:, None] + np.asarray(self.sim.scene.gravity)
        return np.where(self.free[:, None], a, 0.0)

    def exact(self, time: float) -> np.ndarray:
        """To 1e-10."""
        def rate(t, y):
            x, v = y.reshape(2, -1, 3)
            return np.concatenate([v.ravel(), self.acceleration(x).ravel()])
        start = np.concatenate([self.x.ravel(), 0.0 * self.x.ravel()])
        solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
        return solve_ivp(rate, (0.0, time), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1].reshape(2, -1, 3)[0]

    def backward_euler(self, h: float, steps: int) -> np.ndarray:
        """Each step solved to rounding."""
        x, v = self.x, np.zeros_like(self.x)
        for _ in range(steps):
            def left(y, x=x, v=v):
                y = y.reshape(-1, 3)
                return (y - x - np.where(self.free[:, None], h * v + h * h * self.acceleration(y), 0.0)).ravel()
            root = pytest.importorskip("scipy.optimize").root
            y = root(left, (x + h * v).ravel(), method="hybr", tol=1e-13).x.reshape(-1, 3)
            assert np.abs(left(y)).max() < 1e-13
            x, v = y, (y - x) / h
        return x


def test_explicit_steps_go_where_the_equation_of_motion_leads():
    """Of second order: a quarter of the error in half the step."""
    reference, errors = Reference(film(**LEAPT)), []
    exact = reference.exact(3 * FRAME)[reference.index]
    for n in (50, 100):
        sim = Simulation(film(**LEAPT | {"substeps": n}), **DOUBLE)
        sim.run(3)
        errors.append(np.abs(sim.positions("/cloth") - exact).max())
    assert errors[1] < 1e-4 and abs(np.log2(errors[0] / errors[1]) - 2.0) < 0.1


def test_solved_substeps_are_those_of_backward_euler():
    """To where the potential, whose rounding is 1e-16 of it, shows no gain: its square root."""
    reference, sim = Reference(film(**SOLVED)), Simulation(film(**SOLVED), **DOUBLE)
    expected = reference.backward_euler(FRAME / 4, 4)[reference.index]
    sim.step()
    assert np.abs(sim.positions("/cloth") - expected).max() < 3e-9
    assert np.abs(expected - reference.x[reference.index]).max() > 1e-3


def test_sweeps_tend_to_backward_euler_with_the_step():
    """Converged: what XPBD leaves in the momentum rows, whose gradients turn from sweep to sweep, is of order h, and less than
    what backward Euler errs by."""
    reference, apart, own = Reference(film(**SWEPT)), [], []
    exact = reference.exact(FRAME)[reference.index]
    for n in (8, 32):
        expected = reference.backward_euler(FRAME / n, n)[reference.index]
        sim = Simulation(film(**SWEPT | {"substeps": n}), **DOUBLE)
        sim.step()
        apart.append(np.abs(sim.positions("/cloth") - expected).max())
        own.append(np.abs(expected - exact).max())
    assert apart[0] > 3.5 * apart[1] and apart[1] < 0.5 * own[1]


@pytest.mark.parametrize("how", [LEAPT, SOLVED, SWEPT])
def test_reports_have_its_energy(how):
    reference, sim = Reference(film(**how)), Simulation(film(**how), **DOUBLE)
    sim.run(2)
    x = np.empty_like(reference.x)
    x[reference.index] = sim.positions("/cloth")
    assert sim.indicators()["elastic_energy"] == pytest.approx(reference.energy(x), rel=1e-9)


def test_the_solver_is_chosen_by_the_bound_of_its_frequency():
    """The highest of all: that of the NumPy forces by differences, at rest."""
    reference = Reference(film())
    b, n = reference.sim.model.bodies[0], len(reference.x)
    root_w, K, eps = np.sqrt(np.where(reference.free, 1.0 / b.masses, 0.0)), np.zeros((3 * n, 3 * n)), 1e-6
    for c in range(3 * n):
        step = np.zeros(3 * n)
        step[c] = eps
        step = step.reshape(-1, 3)
        K[:, c] = ((reference.force(b.rest - step) - reference.force(b.rest + step)) / (2.0 * eps)).ravel()
    highest = np.linalg.eigvalsh(0.5 * (K + K.T) * np.outer(*2 * (np.repeat(root_w, 3),))).max()**0.5
    bound, low = frequency.frequency_bound(reference.sim.model)[0], frequency.frequency_estimate(reference.sim.model, 200)
    assert low == pytest.approx(highest, rel=1e-3) and highest <= bound < 1.5 * highest


@pytest.mark.parametrize("moved", [0.0, 0.3])
def test_what_newton_keeps_of_the_jacobian_is_never_negative_and_exact_at_rest(moved):
    """Forces are minus the gradient of the energy; blocks of pairs are those of its Hessian where C = 0."""
    p = 0.1 * np.array([[0, 0, 0], [1.0, 0.2, 0.1], [0.3, 1.1, -0.2]])
    A0, alpha, eps = float(topology.triangle_areas(p, np.array([[0, 1, 2]]))[0]), 1e-4, 1e-6
    p = p * (1.0 + moved)

    def energy(q: np.ndarray) -> float:
        C, _ = kind.evaluate_kind(KIND.equation, q.reshape(1, 3, 3), np.array([A0]))
        return float(0.5 * C[0]**2 / alpha)
    data, out = batch_of(KIND.equation, wp.float64)(), elements_of(wp.float64)()
    data.point = wp.array([[0, 1, 2]], dtype=wp.vec3i, device="cpu")
    data.rest, data.alpha, data.tau = (wp.array([v], dtype=wp.float64, device="cpu") for v in (A0, alpha, 0.0))
    out.force, out.block = wp.zeros(3, dtype=wp.vec3d, device="cpu"), wp.zeros(3, dtype=wp.mat33d, device="cpu")
    x, none = wp.array(p, dtype=wp.vec3d, device="cpu"), wp.zeros(3, dtype=wp.vec3d, device="cpu")
    wp.launch(general.general_element_kernel(KIND.equation, wp.float64, "test_area_element"), 1,
              [data, x, none, none, 1.0, wp.vec2i(0, 0)], [out], device="cpu")
    steps = eps * np.eye(9)
    gradient = np.array([(energy(p.ravel() + s) - energy(p.ravel() - s)) / (2.0 * eps) for s in steps])
    assert np.abs(out.force.numpy().ravel() + gradient).max() < 1e-7 * max(1.0, np.abs(gradient).max())
    A01, A02, A12 = out.block.numpy()
    A = np.block([[-(A01 + A02), A01, A02], [A01.T, -(A01.T + A12), A12], [A02.T, A12.T, -(A02.T + A12.T)]])
    values = np.linalg.eigvalsh(A)
    assert values.min() > -1e-12 * values.max() and values.max() > 0.0
    if not moved:
        def slope(q: np.ndarray) -> np.ndarray:
            C, G = kind.evaluate_kind(KIND.equation, q.reshape(1, 3, 3), np.array([A0]))
            return (C[0] / alpha) * G[0, 0].ravel()
        H = np.array([(slope(p.ravel() + s) - slope(p.ravel() - s)) / (2.0 * eps) for s in steps])
        assert np.abs(A - H).max() < 1e-8 * np.abs(H).max()


@pytest.mark.parametrize("how", [LEAPT, SOLVED | {"iterations": 3}, SWEPT | {"iterations": 6}])
def test_a_live_stiffness_is_that_of_a_scene_of_its_own_in_each_world(how):
    sim = Simulation(film(1e-4, **how), worlds=2, **DOUBLE)
    sim.set("/cloth", "area", 0.5 * AREA, 1)
    sim.run(2)
    for world, stiffness in enumerate((AREA, 0.5 * AREA)):
        other = Simulation(film(1e-4, stiffness, **how), **DOUBLE)
        other.run(2)
        assert np.abs(sim.positions("/cloth", world) - other.positions("/cloth")).max() < 1e-12
    assert np.abs(sim.positions("/cloth", 0) - sim.positions("/cloth", 1)).max() > 1e-4


def test_pins_bear_what_it_pulls_with():
    """At rest: the weight."""
    sim = Simulation(film(2e-3, air_drag=8.0, **SOLVED | {"iterations": 6, "substeps": 1}), **DOUBLE)
    sim.run(200)
    weight = 0.15**2 * 0.15 * 9.81
    assert np.abs(sim.reactions("/pin").sum(axis=0) @ np.asarray(sim.scene.gravity) / 9.81 + weight) < 1e-3 * weight


@pytest.mark.parametrize("how", [LEAPT, LEAPT | {"integrator": "rk4", "substeps": 60}, SOLVED | {"iterations": 4},
                                 SWEPT | {"iterations": 6}, SWEPT | {"iterations": 1}])
def test_gradients_go_through_every_solver(how):
    """By the start, its stiffness, damping, and where points are at rest."""
    run = Run(film(1e-4, **how), 2)
    run.state("positions", 2e-5)
    run.material("area", AREA)
    run.check(run.gradient.material("damping"), lambda s: ("/cloth", "damping", 1e-4 + s), 1e-5)
    rest = film().cloths[0].rest_points
    way = np.random.default_rng(8).normal(size=rest.shape)
    run.check((run.gradient.rest_shape() * way).sum(), lambda s: ("/cloth", "rest_shape", rest + s * way), 1e-5, 1e-7)


@pytest.mark.parametrize("how", [LEAPT, SOLVED, SWEPT])
def test_constraints_are_made_once_a_build(how, monkeypatch):
    """One list, of which whoever steps, chooses, reports and draws bounds reads."""
    made, rows_of = [], constraints.constraints_of_body
    monkeypatch.setattr(constraints, "constraints_of_body", lambda body,
                        pinned: made.append(body.path) or rows_of(body, pinned))
    sim = Simulation(film(1e-4, **how), worlds=2, gradients=how is not SWEPT, **DOUBLE)
    sim.step()
    sim.indicators()
    assert made == ["/cloth"]
    assert len({id(r) for r in sim.model.constraints}) == len(sim.model.constraints) == 4


def test_a_solve_its_adjoint_and_the_energy_read_one_table():
    sim = Simulation(film(1e-4, **SOLVED), gradients=True, **DOUBLE)
    implicit = sim.plan.method("implicit")
    (elements,) = implicit.adjoint.pull.elements
    own = implicit.assembly.tables["area"]
    assert own is elements.table is sim.model.tables["area"]
    assert all(getattr(own.data, name).ptr == getattr(elements.data, name).ptr for name in ("point", "rest", "tau"))
    sim.set("/cloth", "area", 2.0 * AREA)
    assert np.all(own.data.alpha.numpy() == 0.5 / AREA) and np.all(elements.data.stiffness.numpy() == 2.0 * AREA)
