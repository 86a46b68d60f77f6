"""Forces of rods: gradients of strains against differences; damping, loads and reactions against closed forms (Kelvin and
Voigt's solid, Euler's beam, a catenary, momentum)."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.physics.rods.rig import AREA, DENSITY, FIRST, SECOND, YOUNG, clamped, scene, simulated
from wsim.kernels.rods import element
from wsim.physics.rods import shape
from wsim.scene import Scene, SceneError
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

FORCE = 1e-3
BEND = element.rod_strain_functions()
strains = BEND.strains


@wp.kernel(module="test_rod_strains", enable_backward=False)
def evaluate(X: wp.array(dtype=wp.vec3d), T: wp.array(dtype=wp.vec3d), M: wp.array(dtype=wp.vec3d),
             turn: wp.array(dtype=wp.float64), s: wp.array(dtype=wp.vec3d), g: wp.array(dtype=wp.mat33d),
             o: wp.array(dtype=wp.vec3d)):
    e0 = X[1] - X[0]
    e1 = X[2] - X[1]
    t0 = wp.normalize(e0)
    t1 = wp.normalize(e1)
    m0 = element.rotated_director(t0, element.orthogonal_director(t0, element.transport_director(T[0], t0, M[0])), turn[0])
    m1 = element.rotated_director(t1, element.orthogonal_director(t1, element.transport_director(T[1], t1, M[1])), turn[1])
    f = strains(t0, t1, wp.length(e0), wp.length(e1), m0, m1, wp.float64(0.0))
    s[0] = f.s
    g[0] = f.a
    g[1] = f.b
    o[0] = f.u
    o[1] = f.w


class Place:
    """Three points with directors that go along when points move, as in a substep."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self.X = np.cumsum(np.array([1.0, 0.0, 0.0]) + 0.7 * rng.normal(size=(3, 3)), axis=0)
        self.T = shape.unit_vectors(np.diff(self.X, axis=0))
        m = np.cross(self.T, rng.normal(size=(2, 3)))
        self.M = shape.unit_vectors(m)

    def at(self, X: np.ndarray, turn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s, g, o = wp.zeros(1, dtype=wp.vec3d, device="cpu"), wp.zeros(2, dtype=wp.mat33d, device="cpu"), wp.zeros(
            2, dtype=wp.vec3d, device="cpu")
        given = [wp.array(v, dtype=wp.vec3d, device="cpu") for v in (X, self.T, self.M)]
        wp.launch(evaluate, 1, [*given, wp.array(turn, dtype=wp.float64, device="cpu")], [s, g, o], device="cpu")
        return s.numpy()[0], g.numpy(), o.numpy()


@pytest.mark.parametrize("seed", range(4))
def test_gradients_of_curvature_and_twist_are_those_of_differences(seed):
    place, h = Place(seed), 1e-6
    _, g, o = place.at(place.X, (0.0, 0.0))
    wanted = np.stack([-g[0], g[0] - g[1], g[1]], axis=1)                       # of each strain, by point
    for i, c in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, c] = h
        found = (place.at(place.X + d, (0.0, 0.0))[0] - place.at(place.X - d, (0.0, 0.0))[0]) / (2.0 * h)
        assert found == pytest.approx(wanted[:, i, c], abs=1e-8)
    for j in range(2):
        d = np.eye(2)[j] * h
        assert (place.at(place.X, d)[0] - place.at(place.X, -d)[0]) / (2.0 * h) == pytest.approx(o[j], abs=1e-8)


def test_the_host_has_the_strains_of_the_device():
    place = Place(7)
    host = shape.bending_twist_strains(place.X[None], place.M[None])[0, 1]
    assert host == pytest.approx(place.at(place.X, (0.0, 0.0))[0], abs=1e-14)


def test_rigid_motions_do_not_strain():
    rng = np.random.default_rng(3)
    x, q = np.cumsum(rng.normal(size=(1, 9, 3)), axis=1), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    q *= np.linalg.det(q)
    m = shape.director_frames(x)
    assert shape.bending_twist_strains(x @ q.T + 5.0, m @ q.T) == pytest.approx(shape.bending_twist_strains(x, m), abs=1e-12)
    assert np.abs(shape.bending_twist_strains(x, m)[..., 2]).max() < 1e-12      # frames without twist have none


def tip(n: int, **more):
    """A clamped metre of rod with a force at its end, at rest: (its tip's place, simulation)."""
    made, _ = clamped(n, fps=2.0, damping=0.4, **more)
    made.force("/push", "/rod", [n], (0.0, FORCE, 0.0))
    sim, method = simulated(made)
    sim.run(60)
    return method.points(0)[0][-1], sim


def test_a_beam_bends_under_a_load_as_eulers_does_and_its_clamp_bears_it():
    """P L^3 / 3 E I, of order 2 in the length of edges; the clamp bears -P, and the couple -P L of its two points."""
    errors = []
    for n in (9, 17):
        place, sim = tip(n)
        errors.append(place[1] / (FORCE / (3.0 * YOUNG * SECOND)) - 1.0)
        R = sim.reactions("/clamp")
        held = np.array([[-1.0 / (n - 1), 0.0, 0.0], [0.0, 0.0, 0.0]])
        assert R.sum(axis=0) == pytest.approx([0.0, -FORCE, 0.0], abs=1e-5 * FORCE)
        assert np.cross(held, R).sum(axis=0) == pytest.approx([0.0, 0.0, -FORCE], abs=1e-4 * FORCE)
    assert errors[1] < 0.003 and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_strands_that_touch_themselves_bear_loads_and_are_damped_too():
    assert tip(9, self_collision=True)[0] == pytest.approx(tip(9)[0], abs=1e-7)


@pytest.mark.parametrize("tau", [0.0, 2e-3])
def test_the_first_mode_of_a_beam_dies_with_the_ratio_of_its_relaxation_time(tau):
    """zeta = tau omega / 2, as of any elastic force tau K v; from two peaks four half periods apart, which higher
    modes change by up to 5e-5. Without it nothing is lost beyond that."""
    made, rods = clamped(17, fps=400.0, damping=tau)
    s = np.clip(rods.points[:, 0].astype(float), 0.0, None)
    mode = np.cosh(FIRST * s) - np.cos(FIRST * s) - 0.7340955138 * (np.sinh(FIRST * s) - np.sin(FIRST * s))
    rods.velocities = 5e-4 * mode[:, None] * np.array([0.0, 1.0, 0.0]) * (s > 0.0)[:, None]
    sim, method = simulated(made)
    y = []
    for _ in range(1100):
        sim.step()
        y.append(method.points(0)[0][-1, 1])
    y = np.abs(y)
    peaks = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    omega = FIRST**2 * np.sqrt(YOUNG * SECOND / (DENSITY * AREA))
    lost = np.log(y[peaks[0]] / y[peaks[4]]) / (4.0 * np.pi)
    assert lost == pytest.approx(0.5 * tau * omega, rel=0.02, abs=5e-5)


def test_damping_takes_no_momentum_and_does_not_slow_a_rod_that_turns_as_a_whole():
    """A straight rod that turns and flies, with a relaxation time of a turn: momentum to rounding, spin to order 2."""
    x = np.stack([np.linspace(-0.5, 0.5, 11), np.zeros(11), np.zeros(11)], axis=1)
    omega = 2.0
    found = []
    for tau in (0.0, 3.0):
        made, _ = scene(x, fps=240.0, damping=tau, velocities=np.cross([0.0, 0.0, omega], x) + [0.3, 0.2, 0.1])
        sim, method = simulated(made)
        sim.run(60)
        m, (place, v) = method.table.values["m"][:, 0], method.points(0)
        assert m @ v / m.sum() == pytest.approx([0.3, 0.2, 0.1], abs=1e-9)
        found.append((m[:, None] * np.cross(place - m @ place / m.sum(), v)).sum(axis=0)[2])
    assert found[1] == pytest.approx(found[0], rel=1e-4)
    assert found[0] == pytest.approx((method.table.values["m"][:, 0] * x[:, 0]**2).sum() * omega, rel=1e-3)


def test_the_ends_of_a_catenary_bear_its_weight_and_its_pull():
    """2 a sinh(D / 2 a) = L: a pull of a times the weight of a metre, and half of the weight at either end."""
    n, span, length, g = 41, 0.8, 1.0, 9.81
    low, high = 0.1, 10.0
    for _ in range(60):
        a = 0.5 * (low + high)
        low, high = (a, high) if 2.0 * a * np.sinh(span / (2.0 * a)) > length else (low, a)
    half = np.linspace(0.0, 0.5 * length, n // 2 + 1)
    drop = np.sqrt(0.25 * (length**2 - span**2))
    arm = np.stack([half / 0.5 / length * 0.5 * span, -half / (0.5 * length) * drop, 0.0 * half], axis=1)
    x = np.concatenate([arm, np.stack([span - arm[-2::-1, 0], arm[-2::-1, 1], 0.0 * arm[1:, 0]], axis=1)])
    made, rods = scene(x, gravity=(0.0, -g, 0.0), fps=24.0, bend=1e-7, twist=1e-7, damping=0.02)
    rods.pin("/left", [0])
    rods.pin("/right", [n - 1])
    made.air_drag = 4.0
    sim, method = simulated(made)
    sim.run(150)
    weight = method.table.values["m"].sum() * g
    left, right = (sim.reactions(path)[0] for path in ("/left", "/right"))
    assert left + right == pytest.approx([0.0, weight, 0.0], abs=1e-3 * weight)
    assert right[0] == pytest.approx(DENSITY * AREA * g * a, rel=5e-3)


def test_a_reaction_is_what_changes_the_momentum_of_a_rod_that_swings():
    """R = d(m v) / dt - m g: against the difference of momenta of the frames before and behind, of order 2."""
    x = np.stack([np.linspace(0.0, 1.0, 9), np.zeros(9), np.zeros(9)], axis=1)
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), fps=480.0, young=1e7, damping=1e-3)
    rods.pin("/top", [0])
    sim, method = simulated(made)
    sim.run(150)
    m, p, found = method.table.values["m"][:, 0], [], []
    for _ in range(3):
        p.append(m @ method.points(0)[1])
        found.append(sim.reactions("/top")[0])
        sim.step()
    rate = (p[2] - p[0]) * 480.0 / 2.0
    assert found[1] == pytest.approx(rate + m.sum() * np.array([0.0, 9.81, 0.0]), abs=2e-3 * m.sum() * 9.81)
    assert np.linalg.norm(found[1]) > 0.5 * m.sum() * 9.81


def test_a_load_over_time_is_followed_and_one_on_a_pin_goes_into_its_reaction():
    """A free rod gets the impulse of its load (2 N s of a ramp); `set` changes it; a held point hands it on."""
    x = np.stack([np.linspace(0.0, 1.0, 5), np.zeros(5), np.zeros(5)], axis=1)
    made, _ = scene(x, fps=60.0)
    made.force("/ramp", "/rod", range(5), Curve(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [0.0, 4.0, 0.0]])))
    sim, method = simulated(made)
    sim.run(60)
    m = method.table.values["m"][:, 0]
    assert m @ method.points(0)[1] == pytest.approx([0.0, 2.0, 0.0], abs=0.1)            # forces at the ends of substeps
    before = m @ method.points(0)[1]
    sim.set("/ramp", "force", (1.0, 0.0, 0.0))
    sim.run(60)
    assert m @ method.points(0)[1] - before == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    made, rods = scene(x)
    rods.pin("/hold", [0])
    made.force("/push", "/rod", [0], (1.0, 2.0, 3.0))
    sim, _ = simulated(made)
    sim.run(2)
    assert sim.reactions() == pytest.approx(np.array([[-1.0, -2.0, -3.0]]), abs=1e-9)


def test_damping_and_loads_are_written_and_read_and_reactions_are_written(tmp_path):
    made, _ = clamped(9, damping=0.03, gravity=(0.0, -9.81, 0.0))
    made.frames = 2
    made.force("/push", "/rod", [9], (0.0, FORCE, 0.0))
    path, result = str(tmp_path / "rod.usda"), str(tmp_path / "out.usda")
    wsim.save(made, path)
    read = wsim.load(path)
    assert read.things("Rods")[0].damping == pytest.approx(0.03)
    assert read.loads[0].body == "/rod" and read.loads[0].points.tolist() == [9]
    sim = wsim.Simulation(read, device="cpu")
    with sim.record(result, reactions=True):
        sim.run(2)
    from pxr import Usd
    stage = Usd.Stage.Open(result)
    written = stage.GetAttributeAtPath("/clamp.wsim:reaction").Get(2)
    assert np.array(written) == pytest.approx(sim.reactions("/clamp"), rel=1e-5, abs=1e-6)


def test_a_traction_on_rods_is_refused_with_what_is_allowed():
    made, _ = clamped(9)
    made.traction("/wind", "/rod", [[0, 1, 2]], (0.0, 1.0, 0.0))
    with pytest.raises(SceneError, match="/rod are rods, which have no triangles .* give a force on points"):
        simulated(made)


def live_rope(self_collision: bool = False) -> Scene:
    scene = Scene(fps=30.0, frames=6, substeps=4)
    x = np.linspace(0.0, 0.4, 7)
    rope = scene.rods("/rope", np.stack([x, 1.0 + 0.0 * x, 0.0 * x], 1), [7], diameters=0.01, self_collision=self_collision)
    rope.pin("/hand", [0, 1])
    return scene


@pytest.mark.parametrize("self_collision", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_pin_that_is_moved_live_goes_as_one_that_has_the_keys(self_collision):
    """Frame by frame along x and turning, in one world of two: as by the keys of all frames, to rounding; the reaction too."""
    times = np.arange(7) / 30.0
    half = 0.5 * np.sin(2.0 * times)
    turns = np.stack([0.0 * times, 0.0 * times, np.sin(half), np.cos(half)], axis=1)
    places = np.stack([0.3 * times, 0.0 * times, 0.1 * times], axis=1)
    keyed = live_rope(self_collision)
    keyed.things("Rods")[0].pins[0].motion = Motion.through(times, places, turns, kind="linear")
    whole, still = Simulation(keyed, device="cpu"), Simulation(live_rope(self_collision), device="cpu")
    sim = Simulation(live_rope(self_collision), device="cpu", worlds=2)
    for k in range(5):
        sim.set("/hand", "motion", Motion.through(times[k:k + 2], places[k:k + 2], turns[k:k + 2], kind="linear"), world=1)
        for each in (sim, whole, still):
            each.step()
    assert np.abs(whole.positions("/rope")[:2] - still.positions("/rope")[:2]).max() > 0.03
    assert np.abs(sim.positions("/rope", world=1) - whole.positions("/rope")).max() < 1e-6
    assert np.abs(sim.positions("/rope", world=0) - still.positions("/rope")).max() < 1e-6


def test_a_pin_of_rods_that_cannot_go_so_is_refused():
    sim = Simulation(live_rope(), device="cpu")
    with pytest.raises(SceneError, match="/hand: motion has shape"):
        sim.set("/hand", "motion", [1.0, 2.0])
    with pytest.raises(SceneError, match="/hnd: is no object of this scene; there are .*/hand"):
        sim.set("/hnd", "motion", Motion.still())
