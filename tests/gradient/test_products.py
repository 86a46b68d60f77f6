"""Products with derivatives of a rollout: against exact adjoints, dense matrices, a NumPy leapfrog with complex arguments."""

import numpy as np
import pytest

from tests.make.gradient.gradients import bar, leapfrog, net, sheet
from tests.make.simulation.ties import laid
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import FEW, SIZES, Rollout
from wsim.gradient.rollout.richardson import richardson_derivative, richardson_offsets, richardson_order
from wsim.scene import Pin, SceneError
from wsim.scene.curve import Motion
from wsim.scene.integrator import TABLE
from wsim.simulation.simulation import Simulation

CHAIN = ["/chain:positions", "/chain:velocities", "/chain:stiffness", "/chain:damping", "gravity", "air_drag", "/pin:targets"]
SCENES = {
    "chain": (lambda: net(integrator="leapfrog"), CHAIN),
    "xpbd": (lambda: net(solver="xpbd", substeps=10, iterations=3), CHAIN[:3] + CHAIN[4:6] + ["/chain:lengths"]),
    "membrane": (lambda: sheet("membrane", damping=2e-4),
                 ["/cloth:stretch", "/cloth:bend", "/cloth:density", "/cloth:rest_shape"]),
    "implicit": (lambda: sheet("springs", solver="implicit", substeps=2, integrator="bdf2"),
                 ["/cloth:bend", "/cloth:positions"]),
    "solid": (lambda: bar("neo_hookean", damping=1e-3), ["/bar:young", "/bar:poisson", "/bar:velocities", "/bar:rest_shape"]),
}


def rollout(scene, names, frames=None, precision="float64") -> Rollout:
    """Of two frames."""
    return Rollout(Recording(Simulation(scene, device="cpu", precision=precision, gradients=True), 2), names, frames)


@pytest.mark.parametrize("key", SCENES)
def test_seeds_times_jvp_is_vjp_times_direction(key):
    """s.(J d) = (J^T s).d, with J^T by the exact adjoint: within 1e-9 of |s| |J d|, and within the error that jvp names."""
    make, names = SCENES[key]
    f, rng = rollout(make(), names), np.random.default_rng(3)
    f.run()
    s = rng.normal(size=f.shape)
    by = f.vjp(s)
    for name, value in f.values().items():
        d = rng.normal(size=value.shape) * f.inputs[name].difference_scale()
        found = f.jvp({name: d})
        sizes = [np.linalg.norm(s[k]) * np.linalg.norm(found.value[k]) for k in (0, 1)]
        missed = abs((s * found.value).sum() - (by[name] * d).sum())
        assert missed < 1e-9 * sum(sizes) and missed < found.error @ sizes + 1e-11 * sum(sizes), name
        assert found.error.max() < 1e-7


def dense(f: Rollout, name: str) -> np.ndarray:
    """J by one input, a backward pass for each row."""
    f.recording.run()
    return np.stack([f.vjp(row.reshape(f.shape))[name].ravel() for row in np.eye(np.prod(f.shape))])


def test_gauss_newton_is_that_of_the_dense_jacobian():
    f, rng = rollout(net(integrator="leapfrog", substeps=20), ["/chain:velocities"], frames=[2]), np.random.default_rng(4)
    J, d = dense(f, "/chain:velocities"), rng.normal(size=(12, 3))
    y = f.jvp({"/chain:velocities": d})
    missed = np.linalg.norm((y.value.ravel() - J @ d.ravel()).reshape(2, -1), axis=1)
    assert (missed < 5.0 * y.error * np.linalg.norm(y.value.reshape(2, -1), axis=1)).all()
    weights = rng.uniform(0.5, 2.0, size=f.shape)
    expected = J.T @ (weights.ravel() * (J @ d.ravel()))
    found = f.gauss_newton({"/chain:velocities": d}, weights)
    assert found.value["/chain:velocities"].ravel() == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert found.error["/chain:velocities"] < 1e-9


def test_hessian_of_a_chain_is_that_of_another_code():
    """By the stiffness of each spring and gravity: rows of differences of order 4 of complex steps of a NumPy leapfrog."""
    scene = net(integrator="leapfrog", substeps=60, damping=0.0, air_drag=0.0, lengths=np.full(11, 0.1, np.float32))
    f, chain = rollout(scene, ["/chain:stiffness", "gravity"], frames=[1]), scene.springs[0]
    n, (i, j), p0 = 12, chain.edges.T, np.r_[np.full(11, 40.0), scene.gravity]
    fixed = {"x": chain.points.astype(float), "v": np.zeros((n, 3)), "rest": chain.lengths.astype(float), "i": i, "j": j,
             "masses": chain.masses.astype(float), "free": (np.arange(n) > 0)[:, None], "h": 1 / 3600, "steps": 60}

    def loss(p):
        return 0.5 * (leapfrog(**fixed, k=p[:11], gravity=p[11:])[0] ** 2).sum()

    H = np.zeros((14, 14))
    for a, step in enumerate(np.r_[np.full(11, 0.2), np.full(3, 0.05)]):
        for b in range(14):
            turn = 1e-30j * (np.arange(14) == b)
            slopes = [loss(p0 + s * step * (np.arange(14) == a) + turn).imag / 1e-30 for s in (2, 1, -1, -2)]
            H[a, b] = np.array([-1, 8, -8, 1]) @ slopes / (12.0 * step)
    for a, size in [(0, 1.0), (5, 1.0), (12, 1.0)]:
        d = size * (np.arange(14) == a)
        found = f.hvp({"/chain:stiffness": d[:11], "gravity": d[11:]}, lambda y: np.stack([y[0], 0 * y[1]]))
        row = np.r_[found.value["/chain:stiffness"], found.value["gravity"]]
        assert np.linalg.norm(row - H[a]) < 1e-6 * np.linalg.norm(H[a])
    assert f.values()["/chain:stiffness"] == 40.0


@pytest.mark.parametrize("key", ["membrane", "implicit", "solid"])
def test_hessians_are_symmetric_and_errors_are_named(key):
    make, names = SCENES[key]
    f, rng = rollout(make(), names), np.random.default_rng(5)
    wanted = f.run() + 0.01
    d, e = ({n: rng.normal(size=v.shape) * f.inputs[n].difference_scale() for n, v in f.values().items()} for _ in range(2))
    ways = [(f.hvp(a, lambda y: np.sin(y - wanted)), b) for a, b in ((d, e), (e, d))]
    one, other = (sum((p.value[n] * way[n]).sum() for n in names) for p, way in ways)
    assert one == pytest.approx(other, rel=1e-7)
    assert max(ways[0][0].error.values()) < 1e-4


@pytest.mark.parametrize("side", [0, 1, -1])
@pytest.mark.parametrize("sizes", [FEW, SIZES])
def test_what_is_extrapolated_has_an_error_that_is_no_less_than_the_true_one(sizes, side):
    """Of functions with known derivatives, for both numbers of step sizes, from both sides or from one."""
    for function, slope in ((np.exp, 1.0), (np.sin, 1.0), (lambda s: 1.0 / (1.3 + s), -1.0 / 1.69), (np.cbrt, np.inf)):
        value, error = richardson_derivative(function(0.3 * richardson_offsets(sizes, side))[:, None], 0.3, side)
        if np.isfinite(slope):
            rounding = 1e-12 if side else 1e-13               # of the smallest step, h / 1024 of one side
            assert abs(value[0] / slope - 1.0) < error + rounding and error < (1e-2 if sizes == FEW else 1e-7)
        else:
            assert error > 0.1


@pytest.mark.parametrize("side", [0, 1, -1])
def test_differences_are_exact_for_polynomials_of_their_order(side):
    at = richardson_offsets(FEW, side)
    assert len(at) == 2 * FEW and (side == 0 or (side * at >= 0.0).all())
    for degree in range(1, richardson_order(FEW, side) - 1):  # two neighbours in the tableau are
        value, error = richardson_derivative(at[:, None]**degree + 0.3, 1.0, side)
        assert abs(value[0] - (degree == 1)) < 1e-13


@pytest.mark.parametrize("stiffness", [np.inf, 60.0])
def test_targets_of_a_pin_that_moves(stiffness):
    """Where it puts its points, or pulls them to, in each substep."""
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 1, 3] = 0.0, 0.01, 0.03
    pin = Pin("/pin", "/chain", np.array([0, 1]), motion=Motion(np.arange(3) / 60, poses), stiffness=stiffness)
    f, rng = rollout(net(integrator="leapfrog", pins=[pin]), ["/pin:targets"]), np.random.default_rng(8)
    y, table = f.run(), f.values()["/pin:targets"]
    assert table.shape == (2, 40, 2, 3) and np.abs(f.run({"/pin:targets": table}) - y).max() < 1e-13
    s, d = rng.normal(size=y.shape), 1e-3 * rng.normal(size=table.shape)
    found = f.jvp({"/pin:targets": d})
    assert (f.vjp(s)["/pin:targets"] * d).sum() == pytest.approx((s * found.value).sum(), rel=1e-8)


def test_bodies_stand_behind_each_other():
    """A cloth laid on a bar, which share points."""
    scene, mine, others = laid(solver="explicit", integrator="leapfrog", substeps=150)
    f = rollout(scene, ["/bar:young", "/blanket:stretch"], [1])
    y = f.run()
    for path in ("/bar", "/blanket"):
        assert y[0, 0, f.part(path)] == pytest.approx(f.recording.positions(1, path), abs=1e-14)
        assert np.array_equal(y[1, 0, f.part(path)], f.recording.velocities(1, path))
    assert np.array_equal(y[0, 0, f.part("/blanket")][mine], y[0, 0, f.part("/bar")][others])


def test_copies_have_what_was_set_and_begin_where_the_recording_does():
    sim = Simulation(net(integrator="leapfrog"), device="cpu", precision="float64", gradients=True)
    sim.run(2)
    sim.set("/chain", "stiffness", 35.0)
    sim.set("/", "gravity", (0.0, -3.0, 1.0))
    f = Rollout(Recording(sim, 2), ["/chain:stiffness", "/chain:velocities"])
    y = f.run({"/chain:velocities": np.full((12, 3), 0.1)})
    copy = f.copies()
    assert np.abs(copy.run() - y).max() < 1e-12
    assert f.values()["/chain:stiffness"] == 35.0


def test_copies_of_what_gave_way_take_its_steps():
    f = rollout(net(solver="xpbd", integrator="sdirk3", substeps=4, iterations=3), ["gravity"])
    f.sim.plan.clock.integrator = TABLE["backward_euler"]        # backward Euler now, of eight substeps
    f = Rollout(Recording(f.sim, 2), ["gravity"])
    y = f.run()
    assert np.abs(f.copies().run() - y).max() < 1e-13


@pytest.mark.parametrize("names, text", [
    (["/chain:stretch"], "has no 'stretch' to be differentiated by; there are positions, velocities, rest_shape, damping, "),
    (["/rope:stiffness"], "there is no body /rope; there are /chain, /pin:targets"),
    (["wind"], "no cloth has drag or lift"), (["weight"], "no value of the whole scene; there are gravity, wind, air_drag"),
    (["gravity", "gravity"], "named twice"), ([], "none is named")])
def test_names_that_are_none_are_named(names, text):
    with pytest.raises(SceneError, match=text):
        rollout(net(), names)


def test_wrong_values_are_named():
    f = rollout(net(integrator="leapfrog"), ["/chain:stiffness", "gravity"])
    for call, text in [(lambda: f.run({"gravity": np.zeros(2)}), r"gravity: found shape \(2,\); allowed are \(3,\)"),
                       (lambda: f.run({"/chain:stiffness": np.full(11, np.nan)}), "no finite number"),
                       (lambda: f.run({"/chain:stiffness": 4e6}), "these values want [0-9]+. Give the scene more substeps"),
                       (lambda: f.run({"wind": 1.0}), "found wind; there are /chain:stiffness, gravity"),
                       (lambda: f.jvp({"gravity": np.zeros(3)}), "direction: is zero"),
                       (lambda: f.vjp(np.zeros(3)), r"allowed is \(2, 2, 12, 3\)"),
                       (lambda: Rollout(f.recording, ["gravity"], [3]), "allowed are 0 to 2")]:
        with pytest.raises(SceneError, match=text):
            call()
    f.run({"/chain:stiffness": 40.0})
    with pytest.raises(SceneError, match="second derivatives need"):
        rollout(net(), ["gravity"], precision="float32").hvp({"gravity": (0.0, 1.0, 0.0)}, lambda y: y)


def test_values_of_elements_are_in_the_authors_order():
    """Springs one by one, and tets, which stand in another order in memory."""
    for scene, name, count in ((net(integrator="leapfrog"), "/chain:stiffness", 11), (bar("corotational"), "/bar:young", 40)):
        f = rollout(scene, [name])
        base = float(f.values()[name]) * (1.0 + 0.1 * np.arange(count) / count)
        y = f.run({name: base})
        assert f.values()[name] == pytest.approx(base)
        one = (np.arange(count) == 4) * f.inputs[name].difference_scale()
        assert (f.vjp(y)[name] * one).sum() == pytest.approx((y * f.jvp({name: one}).value).sum(), rel=1e-7)
