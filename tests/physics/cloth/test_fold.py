"""Hinges that fold sharply, and through pi: energy, forces, damping, line search and XPBD's targets against NumPy."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.cloth.element_adjoint import STEP, WEIGHTS, Case
from tools.stress.energy import _angles
from wsim.geometry import topology
from wsim.kernels.cloth import curvature, curvature_adjoint, curvature_line_search
from wsim.kernels.cloth.constraint import DIHEDRAL
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.solver.line_search import LineSearchTrial
from wsim.physics.cloth import bending
from wsim.scene import Scene
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

COUNT, RATE = 40, 30.0
SHEET = np.array([[0, 0, 0], [0, 1, 0], [1, 0.3, 0], [1.2, 1.1, 0], [2, 0, 0]])        # three triangles, two hinges
TRIANGLES = np.array([[0, 2, 1], [1, 2, 3], [3, 2, 4]], np.int32)


def f(angle: np.ndarray) -> np.ndarray:
    return np.sin(angle) + np.sin(angle)**3 / 6.0


def turned(points: np.ndarray, start: int, end: int, angle: float) -> np.ndarray:
    """About the line through two points of SHEET (Rodrigues)."""
    axis = (SHEET[end] - SHEET[start]) / np.linalg.norm(SHEET[end] - SHEET[start])
    r = points - SHEET[start]
    return SHEET[start] + np.cos(angle) * r + np.sin(angle) * np.cross(axis, r) + (1 - np.cos(angle)) * np.outer(r @ axis, axis)


def folded(one: float, other: float) -> np.ndarray:
    x = SHEET.copy()
    x[[0]], x[[4]] = turned(x[[0]], 1, 2, one), turned(x[[4]], 3, 2, other)
    return x


def closed_form(x: np.ndarray, bend: float) -> float:
    """f K f / 2 + sum K_hh (D^2 - f^2) / 2, K from `wsim.physics.cloth.bending`."""
    ids = topology.hinges_of_triangles(TRIANGLES)
    coupling, inverse = bending.hinge_coupling(SHEET, bending.sheet_patches(SHEET, TRIANGLES, ids, np.zeros(5, bool)))
    V = np.zeros((len(coupling.slot), 3, len(ids)))
    for t, s in zip(*np.nonzero(coupling.slot >= 0), strict=True):
        V[t, :, coupling.slot[t, s]] += coupling.value[t, s] / np.sqrt(inverse[coupling.slot[t, s]])
    K, D = bend * np.einsum("tra,trb->ab", V, V), _angles(x, ids)
    return 0.5 * f(D) @ K @ f(D) + 0.5 * np.diag(K) @ (D**2 - f(D)**2)


def test_the_energy_of_two_hinges_has_its_closed_form_and_goes_on_through_pi():
    """Just before and after pi they differ by the slope only: 2e-6 rad times a moment of some bend."""
    scene = Scene(solver="explicit", integrator="leapfrog", substeps=1000, gravity=(0.0, 0.0, 0.0))
    scene.cloth("/c", SHEET, [3, 3, 3], TRIANGLES.ravel(), material=Fabric(bend=2.0, stretch=1e-9, shear=0.0))
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    for one in (0.4, 2.0, np.pi - 1e-6, np.pi + 1e-6):
        sim.set("/c", "positions", folded(one, 1.1))
        x = sim.positions()                                    # in float32, as they are set
        found.append(sim.indicators()["elastic_energy"])
        assert found[-1] == pytest.approx(closed_form(x, 2.0), rel=1e-7)
    assert abs(found[3] - found[2]) < 1e-5 * found[2]


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_f_its_slope_and_what_it_leaves(real):
    """To two units of 1, of any angle; near 0 relative to the angle. Slopes to three, f'' is up to
    3/2; the rest, s^4 (3 + s^2) / 4, to six."""
    def fold(angle: wp.array(dtype=real), out: wp.array2d(dtype=real)):
        value, slope, rest = curvature.folded_angle(angle[wp.tid()])
        out[wp.tid(), 0] = value
        out[wp.tid(), 1] = slope
        out[wp.tid(), 2] = rest
    name = f"test_fold_{real.__name__}"
    unit, kind = (1.2e-7, np.float32) if real is wp.float32 else (2.3e-16, float)
    D = np.r_[np.linspace(-np.pi, np.pi, 2001), np.logspace(-12, 0, 200)].astype(kind)
    out = wp.zeros((len(D), 3), dtype=real, device="cpu")
    wp.launch(wp.kernel(fold, name=name, module=name, enable_backward=False), len(D),
              [wp.array(D, dtype=real, device="cpu"), out], device="cpu")
    D, (value, slope, rest) = D.astype(float), out.numpy().astype(float).T
    right = np.cos(D) * (1.0 + 0.5 * np.sin(D)**2)
    assert (np.abs(value - f(D)) <= 2.0 * unit * np.minimum(np.abs(D), 1.2)).all()
    np.testing.assert_allclose(slope, right, rtol=0.0, atol=3.0 * unit)
    np.testing.assert_allclose(rest, 1.0 - right**2, rtol=0.0, atol=6.0 * unit)
    assert (rest >= 0.0).all() and (np.abs(value) <= np.abs(D) * (1.0 + unit)).all()


def energy(case: Case, x: np.ndarray) -> float:
    """E of the hinges and triangles of a case, in NumPy."""
    D = _angles(x, np.arange(4 * COUNT).reshape(COUNT, 4)) - case.values["rest"]
    D -= 2.0 * np.pi * np.round(D / (2.0 * np.pi))
    root, value = np.sqrt(case.values["stiffness"]), case.values["value"].reshape(20, 9, 3)
    C = np.einsum("ts,tsr->tr", (root * f(D))[case.slot], value)
    own = np.bincount(case.slot.ravel(), (value**2).sum(axis=2).ravel(), COUNT)
    assert np.abs(D).max() > 2.0 and np.abs(D).max() < 3.1
    return 0.5 * float((C**2).sum() + (case.values["stiffness"] * own) @ (D**2 - f(D)**2))


def test_forces_are_minus_the_slope_of_the_energy():
    case = Case("dihedral", False)
    x = case.values["x"] + case.values["d"]
    slope = sum(w * (energy(case, x + k * STEP * case.p) - energy(case, x - k * STEP * case.p))
                for k, w in enumerate(WEIGHTS, 1)) / STEP
    assert case.loss(case.values) == pytest.approx(-slope, rel=1e-9)


def test_damping_takes_energy_in_proportion_to_the_stiffness():
    """-tau (|C_t(f' b)|^2 + k q (1 - f'^2) b^2), with b the rate of each angle."""
    damped, tau = Case("dihedral", True), 0.3
    still = damped.values | {"tau": np.full(COUNT, tau), "v": np.zeros_like(damped.p)}
    ids = np.arange(4 * COUNT).reshape(COUNT, 4)
    x = still["x"] + still["d"]
    D = _angles(x, ids) - still["rest"]
    slope, root = np.cos(D) * (1.0 + 0.5 * np.sin(D)**2), np.sqrt(still["stiffness"])
    value = still["value"].reshape(20, 9, 3)
    own = np.bincount(damped.slot.ravel(), (value**2).sum(axis=2).ravel(), COUNT)
    for seed in range(5):
        damped.p = v = np.random.default_rng(seed).normal(size=x.shape)
        b = sum(w * (_angles(x + k * STEP * v, ids) - _angles(x - k * STEP * v, ids)) for k, w in enumerate(WEIGHTS, 1)) / STEP
        C = np.einsum("ts,tsr->tr", (root * slope * b)[damped.slot], value)
        right = -tau * ((C**2).sum() + (still["stiffness"] * own * (1.0 - slope**2)) @ b**2)
        assert damped.loss(still | {"v": v}) - damped.loss(still) == pytest.approx(right, rel=1e-8) and right < 0.0


def table(case: Case, values: dict):
    data = batch_of(DIHEDRAL, wp.float64)()
    data.point = wp.array(np.arange(4 * COUNT, dtype=np.int32).reshape(COUNT, 4), dtype=wp.vec4i, device="cpu")
    for name in ("rest", "alpha", "tau"):
        setattr(data, name, wp.array(values[name], dtype=wp.float64, device="cpu"))
    return data


def vectors(values: dict, *names: str) -> list[wp.array]:
    return [wp.array(values[name], dtype=wp.vec3d, device="cpu") for name in names]


def test_the_line_search_sees_the_change_of_the_energy():
    """At steps 1, 1/2 .. 1/256, of a sheet without damping."""
    case, step = Case("dihedral", False), 0.1
    values = case.values | {"alpha": 1.0 / case.values["stiffness"], "tau": np.zeros(COUNT), "p": step * case.p}
    x, d, a, p = vectors(values, "x", "d", "d", "p")
    cur, trial, looks = case.curvatures(values), LineSearchTrial(), curvature_line_search.hinge_searches(wp.float64)()
    looks.own, looks.found = cur.own, wp.zeros((COUNT, curvature_line_search.COLUMNS), dtype=wp.float64, device="cpu")
    trial.lanes, trial.begin, trial.end = 1, 0, 9
    trial.step = wp.full(1, -1.0, dtype=wp.float64, device="cpu")
    trial.change = wp.zeros((1, 9), dtype=wp.float64, device="cpu")
    for kernel, size, inputs in ((curvature_line_search.hinge_search_kernel, COUNT,
                                  [table(case, values), x, d, a, p, RATE, looks]),
                                 (curvature_line_search.curvature_change_kernel, 20, [cur, looks])):
        trial.first = wp.array([0, size], dtype=int, device="cpu")
        case.launch(kernel(wp.float64, case.module), trial, *inputs, count=1)
    at = values["x"] + values["d"]
    for k, found in enumerate(trial.change.numpy()[0]):
        assert found == pytest.approx(energy(case, at + 0.5**k * values["p"]) - energy(case, at), rel=1e-9)


class Targets:
    """Angles at rest that XPBD projects to, of a case with an anchor, and a loss p.target."""

    def __init__(self, damped: bool):
        self.case, rng = Case("dihedral", damped), np.random.default_rng(7)
        given = self.case.values
        self.values = {name: given[name] for name in ("x", "d", "rest", "value")} | {
            "a": given["d"] + given["v"] / RATE, "alpha": 1.0 / given["stiffness"], "tau": given["tau"]}
        self.p, how, adjoint = rng.normal(size=COUNT), (wp.float64, f"test_targets_{damped}"), curvature_adjoint
        self.forward = (curvature.hinge_angle_kernel(*how, damped), curvature.curvature_sum_kernel(*how),
                        curvature.target_angle_kernel(*how))
        self.back = (adjoint.target_seed_kernel(*how, damped), curvature.curvature_sum_kernel(*how, both=True),
                     adjoint.target_adjoint_kernel(*how, damped), adjoint.curvature_adjoint_kernel(*how))

    def at(self, values: dict) -> list:
        return [table(self.case, values), *vectors(values, "x", "d", "a")]

    def loss(self, values: dict) -> float:
        data, x, d, a = self.at(values)
        cur, target = self.case.curvatures(values), wp.zeros(COUNT, dtype=wp.float64, device="cpu")
        angles, sums, targets = self.forward
        self.case.launch(angles, data, data.rest, x, d, a, RATE, cur)
        self.case.launch(sums, cur, count=20)
        self.case.launch(targets, data, data.rest, cur, target)
        return float(target.numpy() @ self.p)

    def gradients(self) -> dict:
        data, x, d, a = self.at(self.values)
        by, s = (table(self.case, {k: np.zeros_like(v) for k, v in self.values.items()}),
                 curvature_adjoint.swept_hinges(wp.float64)())
        cur, by_cur = (self.case.curvatures(self.values | {"value": v}) for v in (self.values["value"], np.zeros((180, 3))))
        s.rest, s.by_rest, s.by_target = data.rest, by.rest, wp.array(self.p, dtype=wp.float64, device="cpu")
        s.corners, s.rates = (wp.zeros(4 * COUNT, dtype=wp.vec3d, device="cpu") for _ in range(2))
        seeds, sums, back, values = self.back
        self.case.launch(seeds, data, x, d, a, RATE, cur, s)
        self.case.launch(sums, cur, count=20)
        self.case.launch(back, data, x, d, a, RATE, cur, s, by)
        self.case.launch(values, cur, by_cur, count=20)
        places, rates = s.corners.numpy(), s.rates.numpy()
        return {"x": places, "d": places + rates, "a": -rates, "rest": by.rest.numpy(), "alpha": by.alpha.numpy(),
                "tau": by.tau.numpy(), "value": by_cur.value.numpy()}


@pytest.mark.parametrize("damped", [False, True])
def test_gradients_by_targets_are_those_of_differences(damped):
    targets, rng = Targets(damped), np.random.default_rng(8)
    found = targets.gradients()
    for name in ("x", "d", "rest", "alpha", "value", *(("a", "tau") if damped else ())):
        way, values = rng.normal(size=targets.values[name].shape), targets.values
        step = STEP * (0.3 if name == "alpha" else 1.0)
        slope = sum(w * (targets.loss(values | {name: values[name] + k * step * way})
                         - targets.loss(values | {name: values[name] - k * step * way}))
                    for k, w in enumerate(WEIGHTS, 1)) / step
        assert (found[name] * way).sum() == pytest.approx(slope, rel=1e-9)
    assert damped or not found["a"].any()
