"""Forces on points and tractions on triangles: closed forms, what pins bear, derivatives, and what is refused."""

import numpy as np
import pytest

from tests.make.physics.motion.loads import GROWS, RATE, STAYS, T, pushed
from wsim import Bulk, Fabric, Scene, Simulation
from wsim.gradient.recording import Recording
from wsim.model.model import make_body
from wsim.scene import Plane, SceneError, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.scene.nodal.loads import nodal_load_shares, surface_triangles_among


def of_order(solver: str, integrator: str) -> float:
    """Relative error of x = RATE t^3 / 6 after T, of that scheme: forces at the start of a substep with half of the first
    (leapfrog), at its end (backward Euler); methods of order 3 and more have none."""
    h = T / 32
    return {"leapfrog": -h**2 / T**2, "backward_euler": 3 * h / T + 2 * h**2 / T**2}.get(integrator, 0.0)


SOLVERS = pytest.mark.parametrize("solver, integrator", [("explicit", "leapfrog"),
                                                         ("xpbd", "backward_euler"), ("implicit", "sdirk3")])


def loss(recording, y) -> float:
    x = recording.positions(4, "/chain"), recording.positions(2, "/pair")
    borne = recording.reactions(3, "/pin")
    return sum(float((a * b).sum()) for a, b in zip((*x, borne), y, strict=True))


@SOLVERS
def test_a_force_over_time_moves_by_its_integral_and_has_exact_derivatives(solver, integrator):
    sim = Simulation(pushed(solver, integrator), gradients=True, precision="float64", device="cpu")
    recording = Recording(sim, 4)
    exact = RATE * T**3 / 6 * (1.0 + of_order(solver, integrator))
    assert recording.positions(4, "/pair")[0, 0] == pytest.approx(exact, rel=1e-10)
    y = [np.array([[0, 0, 0], [0.3, -1.0, 0.5], [1.0, 0.4, -0.2]]), np.array([[1.0, 2.0, 3.0], [0.5, 0.0, 1.0]]),
         np.array([[0.02, -0.01, 0.03]])]
    gradient = recording.backward({4: {"/chain": y[0]}, 2: {"/pair": y[1]}}, reactions={3: {"/pin": y[2]}})

    def slope(path, name, value, by, eps) -> float:
        ends = []
        for sign in (1.0, -1.0):
            sim.set(path, name, value + sign * eps * by)
            recording.run()
            ends.append(loss(recording, y))
        sim.set(path, name, value)
        return (ends[0] - ends[1]) / (2.0 * eps)

    rng = np.random.default_rng(1)
    near = {"rel": 2e-7 if solver != "implicit" else 1e-5, "abs": 1e-8}
    for path, value in (("/grows", np.array([np.zeros(3), 4.0 * RATE * T * GROWS])), ("/stays", np.array([STAYS])),
                        ("/other", np.array([[0.3, 0.0, 0.0]]))):
        by = rng.standard_normal(value.shape)
        assert (gradient.load(path) * by).sum() == pytest.approx(slope(path, "force", value, by, 1e-4), **near)
    g, by = np.array([0.0, -9.81, 0.0]), rng.standard_normal(3)
    assert gradient.mass("/chain") == pytest.approx(slope("/chain", "mass", 0.4, 1.0, 1e-5), **near)
    assert gradient.gravity() @ by == pytest.approx(slope("/", "gravity", g, by, 1e-4), **near)


def test_a_bar_under_traction_grows_by_t_l_over_e_and_its_wall_bears_every_load():
    """Linear elasticity, Poisson's ratio 0: x = X (1 + t / E) everywhere, whatever the mesh. Backward Euler in long steps comes
    to rest. What acts on points that are pinned goes to the wall at once."""
    scene = Scene(gravity=(0, 0, 0), fps=0.5, frames=8, substeps=2, solver="implicit", integrator="backward_euler")
    bar = scene.soft("/bar", *shapes.block((0.4, 0.2, 0.2), (2, 1, 1)), quadratic=True,
                     material=Bulk(young=1e5, poisson=0.0, density=100.0, model="linear"))
    left, right = (np.flatnonzero(abs(bar.points[:, 0] - s * 0.2) < 1e-6) for s in (-1, 1))
    scene.pin("/wall", bar, left)
    scene.traction("/pull", bar, surface_triangles_among(bar, right), (2e3, 0.0, 0.0))
    scene.traction("/wind", bar, surface_triangles_among(bar, left), (0.0, 50.0, 0.0))
    sim = Simulation(scene, precision="float64", device="cpu")
    sim.run(8)
    np.testing.assert_allclose(sim.positions("/bar"), bar.points + (0.02 * (bar.points + 0.2)) * [1, 0, 0], atol=2e-8)
    np.testing.assert_allclose(sim.reactions("/wall").sum(axis=0), [-2e3 * 0.04, -50.0 * 0.04, 0], atol=1e-3)
    assert "energy_change" not in sim.report(profile=False)["error"]          # loads do work


@pytest.mark.parametrize("body", ["cloth", "soft", "quadratic"])
def test_nodal_forces_have_the_sum_and_the_moment_of_the_traction(body):
    """At rest: sum = t A, moment = integral of x dA times t, of each triangle its centre times its area."""
    scene = Scene()
    if body == "cloth":
        points, counts, indices = shapes.sheet(0.7, 0.4, 3, 2, cut="quads")
        thing = scene.cloth("/b", points, counts, indices, material=Fabric())
    else:
        thing = scene.soft("/b", *shapes.block((0.4, 0.2, 0.2), (2, 1, 1)), quadratic=body == "quadratic")
    triangles = surface_triangles_among(thing)[::2]
    places, parts = nodal_load_shares(scene.traction("/t", thing, triangles, (1.0, 2.0, 3.0)),
                                      made := make_body(thing, 0, 0, 0))
    X = thing.points.astype(np.float64)
    corner = X[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    assert parts.sum() == pytest.approx(area.sum(), rel=1e-6)
    np.testing.assert_allclose(parts @ (made.places[places] + made.origin), area @ corner.mean(axis=1), atol=1e-7)


def wrong(change: str) -> Scene:
    scene = pushed()
    bar = scene.soft("/bar", *shapes.block((0.4, 0.2, 0.2), (2, 1, 1)))
    load = scene.traction("/pull", bar, surface_triangles_among(bar)[:2], (1.0, 0.0, 0.0))
    if change == "body":
        load.body = "/none"
    elif change == "range":
        scene.loads[0].points = np.array([0, 7])
    elif change == "inside":
        load.triangles = bar.tets[:1, :3][:, [0, 0, 1]]
    elif change == "twice":
        load.triangles = load.triangles[[0, 0]]
    elif change == "net":
        scene.loads.append(scene.loads[-1].__class__("/t", "/pair", load.curve, triangles=[[0, 1, 0]]))
    elif change == "shape":
        load.curve = Curve([0.0], [[1.0, 2.0]])
    elif change == "infinite":
        load.curve = Curve([0.0], [[np.inf, 0.0, 0.0]])
    elif change == "weights":
        scene.loads[0].weights = np.ones(3, np.float32)
    elif change == "both":
        load.points = np.array([1])
    elif change == "nothing":
        scene.loads[0].points = np.zeros(0, np.int32)
    else:
        load.path = "/bar"
    return scene


@pytest.mark.parametrize("change, words", [
    ("body", "it loads '/none'"), ("range", "it loads point 7 of /pair"), ("inside", "of one triangle of its surface"),
    ("twice", "names a triangle twice"), ("net", "a spring net, which has no triangles"), ("shape", "three numbers a key"),
    ("infinite", "not finite"), ("weights", "3 weights"), ("both", "both points and triangles"), ("nothing", "acts on nothing"),
    ("path", "2 objects have this path")])
def test_bad_loads_are_refused(change, words):
    assert words in "\n".join(str(p) for p in check_scene(wrong(change)) if p.fatal)


def test_live_loads_are_judged_and_refused_whole():
    sim = Simulation(pushed(), precision="float64", device="cpu", gradients=True)
    for name, value, words in (("force", [1.0, 2.0], "shape"), ("force", [np.nan, 0, 0], "finite"),
                               ("force", "much", "allowed"), ("traction", [1, 0, 0], "live"),
                               ("force", np.zeros((3, 3)), "values")):
        with pytest.raises(SceneError, match=words):
            sim.set("/grows", name, value)
    assert sim.changes == []
    sim.set("/grows", "force", [8.0, 0.0, 0.0])                     # 2 m/s^2 for each mass
    sim.run(2)
    np.testing.assert_allclose(sim.velocities("/pair")[:, 0], 0.4, rtol=1e-12)


@pytest.mark.parametrize("solver, integrator", [("explicit", "leapfrog"), ("xpbd", "backward_euler"),
                                                ("implicit", "backward_euler")])
def test_what_bears_a_load_rests_on_a_collider_that_it_presses_by_weight_and_load(solver, integrator):
    """Two bodies, of which the second bears half of its weight upwards, and the first twice its weight downwards."""
    scene = Scene(gravity=(0.0, -10.0, 0.0), fps=10, substeps=10, iterations=4, solver=solver, integrator=integrator)
    for name, x in (("/down", 0.0), ("/up", 3.0)):
        scene.net(name, [[x, 0, 0], [x + 1.0, 0, 0]], [[0, 1]], [10.0], [2.0, 2.0])
    scene.force("/presses", "/down", [0, 1], [0.0, -40.0, 0.0], weights=[1.0, 1.0])
    scene.force("/lifts", "/up", [0, 1], [0.0, 10.0, 0.0], weights=[1.0, 1.0])
    scene.collider("/floor", Plane(), static_friction=0.0, dynamic_friction=0.0)
    sim = Simulation(scene, device="cpu", precision="float64")
    for _ in range(3):
        sim.step()
    assert np.abs(np.concatenate([sim.positions("/down"), sim.positions("/up")])[:, 1]).max() < 1e-9
    push = sim.plan.ports.contacts.impulses(sim.plan.clock.effective_step)["/floor"]
    assert push == pytest.approx(np.array([0.0, -(2 * 60.0 + 2 * 10.0), 0.0]) * sim.plan.clock.h, rel=1e-6, abs=1e-9)
