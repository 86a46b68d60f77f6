"""Gradients of whole runs in float64: against complex steps of a NumPy leapfrog, to 1e-10, and against differences of order 8
of runs without gradients, which themselves are right to about 1e-11."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.gradient.gradients import Run, bar, everything_of_a_sheet, leapfrog, net, sheet
from tests.make.simulation.ties import laid
from wsim.gradient import checkpoints
from wsim.gradient.recording import Recording
from wsim.scene import Pin, Scene, SceneError, Springs
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("integrator", ["leapfrog", "symplectic_euler", "rk4", "midpoint", "explicit_euler"])
def test_a_chain_of_springs_by_every_explicit_integrator(integrator):
    run = Run(net(integrator=integrator))
    run.state("positions")
    run.material("stiffness", 40.0)
    run.material("damping", 1e-3)
    if integrator in ("leapfrog", "rk4"):
        run.state("velocities")
        run.world()


def test_every_gradient_of_a_chain_is_that_of_a_complex_step():
    """Squire, Trapp 1998: no difference is taken, so nothing cancels. 300 substeps, another code, another language."""
    lengths = np.linspace(0.09, 0.11, 11).astype(np.float32)
    scene = net(integrator="leapfrog", substeps=100, damping=0.0, lengths=lengths, air_drag=0.0)
    run, chain = Run(scene), scene.springs[0]
    n, rng = len(chain.points), np.random.default_rng(7)
    start = {"x": chain.points.astype(float), "v": np.zeros((n, 3)), "k": np.full(11, 40.0), "rest": lengths.astype(float),
             "masses": chain.masses.astype(np.float64), "gravity": np.array(scene.gravity)}
    gradient = run.gradient
    found = {"x": gradient.positions(), "v": gradient.velocities(), "k": gradient.material("stiffness", elements=True),
             "rest": gradient.lengths(), "masses": gradient.masses(), "gravity": gradient.gravity()}
    i, j = chain.edges.T
    fixed = {"free": (np.arange(n) > 0)[:, None], "i": i, "j": j, "h": 1 / 6000, "steps": 300}
    ends = leapfrog(**start, **fixed)
    assert np.abs(ends[0] - run.recording.positions(3)).max() < 1e-12
    for name, values in start.items():
        way = rng.normal(size=values.shape)
        if name in ("x", "v", "masses"):
            way[0] = 0.0                                # the pinned point has its own place, and no mass
        ends = leapfrog(**start | fixed | {name: values + 1e-30j * way})
        expected = ((ends[0] * run.x).sum() + (ends[1] * run.v).sum()).imag / 1e-30
        assert (found[name] * way).sum() == pytest.approx(expected, rel=1e-10), name


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("solver, integrator", [("explicit", "leapfrog"), ("implicit", "bdf2"), ("implicit", "sdirk3")])
def test_where_a_pin_puts_its_points(solver, integrator, moving):
    """Along one motion of the pin: a shift that stands still, and one that grows from frame to frame."""
    more = {"integrator": integrator} | ({"substeps": 2} if solver == "implicit" else {})
    times, way = np.arange(5) / 60, np.array([0.02, -0.01, 0.03])
    path = Motion(times, np.stack([np.eye(4)] * 5))
    path.values[:, :3, 3] = np.linspace(0.0, 1.0, 5)[:, None] ** 2 * (0.01, 0.02, 0.0) * moving
    if not moving:
        path = Motion.still()
    scene = net(solver=solver, pins=[Pin("/pin", "/chain", np.array([0]), motion=path)], **more)
    run = Run(scene)

    def pushed(s: float):
        values = path.values.copy()
        values[:, :3, 3] += s * way * (np.linspace(0.0, 1.0, 5)[:, None] if moving else 1.0)
        return "/pin", "motion", Motion(path.times, values)
    by = run.gradient.targets("/pin")
    if not moving:
        return run.check(by[0] @ way, pushed, 5e-4)
    at = run.sim.plan.clock.moments(True) * 60.0         # in frames; of sdirk3 two stages and the end of each substep
    assert by.shape == (3, len(at), 1, 3) and len(at) == scene.substeps * (1 + 2 * (integrator == "sdirk3"))
    grows = (np.arange(3)[:, None] + at) / 4.0
    run.check((by[:, :, 0] * grows[:, :, None]).sum(axis=(0, 1)) @ way, pushed, 2e-3)


@pytest.mark.parametrize("model", ["membrane", "springs"])
def test_a_sheet_that_stretches_shears_and_bends(model):
    everything_of_a_sheet(Run(sheet(model, damping=2e-4)))


def test_bending_slackened_to_nothing_still_has_a_derivative():
    """One-sided: what a little bending would do, which its hinges' roots, all 0, do not hide."""
    scene, losses = sheet("membrane", damping=2e-4), []
    w = np.random.default_rng(5).normal(size=(25, 3))
    for bend in (0.0, 1e-8):
        sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
        sim.set("/cloth", "bend", bend)
        recording = Recording(sim, 3)
        losses.append((recording.positions(3) * w).sum())
        if not bend:
            found = recording.backward({3: w}).material("bend")
    assert found == pytest.approx((losses[1] - losses[0]) / 1e-8, rel=1e-3) and found != 0.0


@pytest.mark.parametrize("integrator, model", [("backward_euler", "membrane"), ("bdf2", "springs"),
                                               ("implicit_midpoint", "membrane"), ("sdirk3", "springs")])
def test_a_sheet_by_implicit_steps(integrator, model):
    """Of 1/120 s, solved to a residual: exact for the scheme that ran, though Newton's Jacobian drops and clamps."""
    run = Run(sheet(model, solver="implicit", integrator=integrator, substeps=2, damping=2e-4))
    assert run.recording.residuals["forward"] < 1e-12 and run.recording.residuals["adjoint"] < 1e-11
    for name in ("stretch", "bend", "damping"):
        run.material(name, getattr(run.scene.cloths[0].material, name))
    run.state("positions")
    run.check(run.gradient.density(), lambda s: ("/cloth", "density", 150.0 + s), 0.8)
    if integrator == "bdf2":
        run.world()


@pytest.mark.parametrize("model, damping", [("corotational", 1e-3), ("corotational", 0.0), ("neo_hookean", 1e-3),
                                            ("neo_hookean", 0.0), ("st_venant_kirchhoff", 0.0), ("linear", 0.0)])
def test_a_soft_bar(model, damping):
    run = Run(bar(model, damping=damping))
    run.material("young", 2e4)
    run.material("poisson", 0.35)
    if damping:
        run.material("damping", 1e-3)
    run.state("positions")
    run.state("velocities")


@pytest.mark.parametrize("model, more", [("corotational", {"substeps": 160}), ("st_venant_kirchhoff", {"substeps": 160}),
                                         ("neo_hookean", {"solver": "implicit", "integrator": "bdf2", "substeps": 2})])
def test_a_bar_of_quadratic_tets_under_pressure(model, more):
    """Points of the author's carry the middles between them."""
    scene = bar(model, damping=1e-4, **more)
    scene.softs[0].quadratic, scene.softs[0].pressure = True, 400.0
    run = Run(scene, frames=1)
    for name, value, step in (("young", 2e4, 1.0), ("poisson", 0.35, 1.0), ("damping", 1e-4, 6.0), ("pressure", 400.0, 1.0)):
        run.material(name, value, step)
    run.state("positions", 1e-5)
    run.state("velocities")


def test_a_bar_with_a_cloth_laid_on_it():
    """They share points: those of the cloth have the derivatives of the bar's."""
    scene, mine, others = laid(solver="explicit", integrator="leapfrog", substeps=150)
    run = Run(scene, frames=2)
    run.material("stretch", 200.0)
    assert np.array_equal(run.gradient.positions("/blanket")[mine], run.gradient.positions("/bar")[others])
    run.path, n = "/bar", len(scene.softs[0].points)
    run.x, run.v = np.random.default_rng(5).normal(size=(2, n, 3)) * [[[1.0]], [[0.01]]]
    run.gradient = run.recording.backward({2: {"/bar": run.x}}, {2: {"/bar": run.v}})
    run.material("young", scene.softs[0].material.young)


@pytest.mark.parametrize("integrator, model", [("bdf2", "neo_hookean"), ("implicit_midpoint", "corotational"),
                                               ("sdirk3", "neo_hookean")])
def test_a_soft_bar_by_implicit_steps(integrator, model):
    run = Run(bar(model, solver="implicit", integrator=integrator, substeps=2, damping=1e-3 * (model == "neo_hookean")))
    run.material("young", 2e4)
    run.material("poisson", 0.35)
    run.state("positions")
    run.state("velocities")


@pytest.mark.parametrize("frames, substeps", [(6, 40), (40, 2)])
def test_checkpoints_give_the_same_gradient_for_less_memory(frames, substeps, monkeypatch):
    """The last point falls free of the chain: parts of a frame, or several frames, are kept at a time. No launches are counted,
    as on a GPU: on so few points they are most of what a CPU keeps."""
    monkeypatch.setattr(checkpoints, "LAUNCH", 0.0)
    scene = net(integrator="leapfrog", substeps=substeps, stiffness=4.0)
    kept, again = (Run(scene, frames, keep=keep) for keep in ("all", "checkpoints"))
    assert again.recording.checkpoints and not kept.recording.checkpoints
    assert (len(again.recording.cuts) > 2) == (substeps == 40) and (again.recording.group > 1) == (substeps == 2)
    assert again.recording.bytes < 0.5 * kept.recording.bytes
    for name in ("positions", "velocities", "masses"):
        assert getattr(again.gradient, name)() == pytest.approx(getattr(kept.gradient, name)(), rel=1e-12, abs=1e-12)
    assert again.gradient.material("stiffness") == pytest.approx(kept.gradient.material("stiffness"), rel=1e-12)


def test_a_recording_runs_as_a_simulation_does_and_again_after_a_change():
    scene = sheet("membrane")
    sim, plain = (Simulation(scene, device="cpu", precision="float64", gradients=g) for g in (True, False))
    recording = Recording(sim, 2)
    for stretch in (40.0, 30.0):
        for s in (sim, plain):
            s.set("/cloth", "stretch", stretch)
        recording.run()
        plain.run(2)
        assert recording.positions(2) == pytest.approx(plain.positions(), abs=1e-14)
        plain = Simulation(scene, device="cpu", precision="float64")


def test_names_that_have_no_derivative_are_named():
    gradient = Run(sheet("springs"), frames=1).gradient
    for call, text in [(lambda: gradient.material("weft"), "/cloth: has no 'weft' with a derivative; there are bend, stretch"),
                       (lambda: gradient.material("damping"), "/cloth: has no 'damping'"),
                       (lambda: gradient.targets("/nail"), "/nail: is no pin; there are /pin"),
                       (gradient.lengths, "/cloth: is no spring net")]:
        with pytest.raises(SceneError, match=text):
            call()
    scene = sheet("membrane")
    scene.cloths[0].material = replace(scene.cloths[0].material, weft=0.0, shear=0.0)
    run = Run(scene, frames=1)
    for name, text in [("weft", "weft is 0 and follows stretch"), ("shear", "shear is below 1e-06 of stretch")]:
        with pytest.raises(SceneError, match=text):
            run.gradient.material(name)
    run.material("stretch", 40.0)
    scene.cloths[0].masses = np.full(25, 1e-3)
    with pytest.raises(SceneError, match="its masses follow no single density"):
        Run(scene, frames=1).gradient.density()


def test_a_recording_does_not_run_when_the_simulation_has_become_another():
    sim = Simulation(net(integrator="leapfrog"), device="cpu", gradients=True)
    recording = Recording(sim, 2)
    recording.run()
    start = recording.positions(0)
    assert np.abs(sim.positions() - recording.positions(2)).max() < 1e-7 < np.abs(start - recording.positions(2)).max()
    sim.set("/chain", "stiffness", 4e6)                        # takes more substeps
    with pytest.raises(SceneError, match="make another Recording"):
        recording.run()


def test_a_recording_of_a_pin_that_stands_does_not_run_when_it_moves():
    """Beside a soft pin, whose targets have a row for each substep whether they move or not."""
    scene = net(integrator="leapfrog")
    scene.pins.append(Pin("/soft", "/chain", np.array([11]), stiffness=50.0))
    sim = Simulation(scene, device="cpu", gradients=True)
    recording = Recording(sim, 2)
    recording.run()
    sim.set("/pin", "motion", Motion(np.array([0.0, 0.05]), np.stack([np.eye(4), Motion.at_place((0.1, 0.0, 0.0)).values[0]])))
    with pytest.raises(SceneError, match="pins that move where they stood still; make another Recording"):
        recording.run()


def test_a_gradient_that_grows_is_said_with_its_rate():
    """Two springs in a line, pressed: they buckle, and what is off the line grows as e^(r t), r^2 = -k (1 - L / l) 2 / m."""
    points = np.array([[0.0, 0, 0], [0.5, 1e-9, 0], [1.0, 0, 0]])
    chain = Springs("/chain", points, np.array([[0, 1], [1, 2]]), masses=0.1, stiffness=np.array([40.0]),
                    lengths=np.full(2, 0.75, np.float32))
    scene = Scene(objects={"Springs": [chain]}, pins=[Pin("/pin", "/chain", np.array([0, 2]))], fps=60, frames=40,
                  gravity=(0, 0, 0),
                  solver="explicit", integrator="leapfrog", substeps=20)
    sim = Simulation(scene, device="cpu", gradients=True)
    seed = np.zeros((3, 3))
    seed[1, 1] = 1.0
    Recording(sim, 30).backward({30: seed})
    rate = (40.0 * 0.5 * 2.0 / 0.1) ** 0.5                    # 20 / s
    said = next(text for text in sim.warnings if "changes grow" in text)
    assert float(said.split(" by ")[1].split()[0]) == pytest.approx(rate, rel=0.1)
    sim = Simulation(scene, device="cpu", gradients=True)
    Recording(sim, 3).backward({3: seed})
    assert not [text for text in sim.warnings if "changes grow" in text]


def test_a_gradient_that_is_no_number_is_named_by_its_frame():
    recording = Recording(Simulation(net(integrator="leapfrog"), device="cpu", gradients=True), 3)
    with pytest.raises(SceneError, match="backward: the gradient by the positions is no number at frame [01]"):
        recording.backward({3: np.full((12, 3), 3e38), 2: np.full((12, 3), 3e38)})


def test_single_precision_loses_four_digits_at_most():
    scene, found = bar("corotational"), []
    for precision in ("float32", "float64"):
        recording = Recording(Simulation(scene, device="cpu", precision=precision, gradients=True), 2)
        x = recording.positions(0)
        found.append(recording.backward({2: x}))
    for name in ("young", "poisson"):
        a, b = (g.material(name, elements=True) for g in found)
        assert np.linalg.norm(a - b) < 1e-4 * np.linalg.norm(b)
    assert np.linalg.norm(found[0].positions() - found[1].positions()) < 1e-4 * np.linalg.norm(found[1].positions())


@pytest.mark.parametrize("seeds, text", [({9: np.zeros((12, 3))}, "found frame 9; allowed are 0 to 2"),
                                         ({1: np.zeros((11, 3))}, r"shape \(12, 3\); found \(11, 3\)"),
                                         ({1: np.full((12, 3), np.nan)}, "must be finite")])
def test_wrong_seeds_are_named(seeds, text):
    recording = Recording(Simulation(net(), device="cpu", gradients=True), 2)
    with pytest.raises(SceneError, match=text):
        recording.backward(seeds)


def test_a_recording_wants_gradients():
    with pytest.raises(SceneError, match="Simulation\\(scene, gradients=True\\)"):
        Recording(Simulation(net(), device="cpu"), 2)
