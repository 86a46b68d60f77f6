"""Gradients by keys, tangents, easing handles and turns of what pins and colliders follow, against differences in float64."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.gradient.paths import KINDS, SOLVERS, pinned, struck
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation


def slope(scene: Scene, name: str, step: float = 1e-6) -> tuple[float, float]:
    """Along a direction: of the gradient, and of differences of order 4."""
    recording = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 4)
    f = Rollout(recording, [name], [2, 4])
    s = np.random.default_rng(3).normal(size=f.run().shape)
    found = f.vjp(s)[name]
    base = f.values()[name]
    way = np.random.default_rng(4).normal(size=base.shape)
    losses = {}
    for k in (-2, -1, 1, 2):
        losses[k] = float((f.run({name: base + k * step * way}) * s).sum())
    return float((found * way).sum()), (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["catmull_rom", "handles", "squad"])
def test_stages_of_runge_kutta_see_each_part_of_a_path(kind):
    what, how = KINDS[kind]
    scene = pinned("explicit", how, False)
    scene.integrator, scene.substeps = "rk4", 60
    found, expected = slope(scene, f"/pin:{what}")
    assert abs(expected) > 1e-3 and found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("solver", "kind", "soft"), first_and_slow([("xpbd", "handles", False), *(
    (solver, kind, soft) for solver in SOLVERS for kind in KINDS for soft in (False, True)
    if (solver, kind, soft) != ("xpbd", "handles", False))]))
def test_by_what_the_path_of_a_pin_is_made_of(solver, kind, soft):
    what, how = KINDS[kind]
    found, expected = slope(pinned(solver, how, soft), f"/pin:{what}")
    assert abs(expected) > 1e-3 and found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("solver", "kind"), first_and_slow([("xpbd", "catmull_rom"), *(
    (solver, kind) for solver in SOLVERS for kind in KINDS if (solver, kind) != ("xpbd", "catmull_rom"))]))
def test_by_what_the_path_of_a_collider_is_made_of(solver, kind):
    what, how = KINDS[kind]
    step = 1e-7 if (solver, kind) == ("explicit", "linear") else 1e-6            # a contact more within 1e-6
    found, expected = slope(struck(solver, how, what == "turns"), f"/ball:{what}", step)
    assert abs(expected) > 1e-3 and found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("iterations", first_and_slow([1, 6]))
def test_contacts_that_few_newton_steps_do_not_find_are_sought_once_more(iterations):
    """A ball that jumps to 4 m/s: active sets went in circles from where six Newton steps had come, and the gradient was of a
    solve that had left forces thrice those of inertia."""
    scene = struck("implicit", {"kind": "linear"})
    scene.iterations = iterations
    found, expected = slope(scene, "/ball:keys")
    assert found == pytest.approx(expected, rel=1e-6) and found == pytest.approx(-143.81428, rel=1e-6)


def simulated(iterations: int, velocities: np.ndarray | None = None) -> tuple[Scene, Simulation]:
    """A ball that turns as it strikes, by so many Newton steps a substep; 4 frames of a simulation."""
    scene = struck("implicit", {"kind": "catmull_rom"}, True)
    scene.iterations, scene.cloths[0].velocities = iterations, velocities
    sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
    if velocities is not None:
        sim.run(4)
    return scene, sim


def told(iterations: int) -> tuple[Recording, np.ndarray, np.ndarray]:
    """A recording that has gone back from a loss, its weights, and the gradient with respect to velocities."""
    recording = Recording(simulated(iterations)[1], 4)
    recording.run()
    w = np.random.default_rng(3).normal(size=recording.positions(4).shape)
    return recording, w, recording.backward({4: w}).velocities()


@pytest.mark.slow
def test_the_warning_tells_how_far_gradients_of_a_simulation_are():
    """Its gradient by differences, one velocity after the other: 20 % from that of the recording, where places are 1 % apart.
    Two directions tell it to a factor 2 of chance."""
    recording, w, by = told(6)
    v, h, found = np.zeros(by.shape), 1e-3, np.zeros(by.shape)
    for k in np.argwhere(by != 0.0):
        ends = []
        for sign in (1.0, -1.0):
            v[tuple(k)] = sign * h
            ends.append(float((simulated(6, v)[1].positions() * w).sum()))
        v[tuple(k)], found[tuple(k)] = 0.0, (ends[0] - ends[1]) / (2.0 * h)
    true, apart = np.linalg.norm(found - by) / np.linalg.norm(by), recording.apart
    assert 0.5 < apart.gradient / true < 2.0 and true > 10.0 * apart.places / apart.way
    assert any(f"differ by about {100.0 * apart.gradient:.2g} %" in text for text in recording.sim.warnings)


@pytest.mark.slow
def test_gradients_of_a_simulation_that_solves_its_contacts_are_those_of_the_recording():
    recording = told(20)[0]
    assert recording.apart.gradient < 5e-3 and not any("among contacts" in text for text in recording.sim.warnings)


@pytest.mark.parametrize(("name", "how", "said"), [
    ("tangents", {"kind": "catmull_rom"}, "of kind catmull_rom, which has no tangents; kinds hermite and bezier"),
    ("handles", {"kind": "eased", "easing": "bounce-out"}, "has no handles; kind eased has them")])
def test_what_a_path_has_not_is_refused_with_what_would_have_it(name, how, said):
    recording = Recording(Simulation(pinned("xpbd", how, False), device="cpu", precision="float64", gradients=True), 1)
    with pytest.raises(SceneError, match=said):
        inputs_by_name(recording, [f"/pin:{name}"])


def test_turns_that_are_set_are_read_and_go_behind_those_that_were():
    recording = Recording(Simulation(pinned("xpbd", {"kind": "catmull_rom"}, False), device="cpu", precision="float64",
                                     gradients=True), 4)
    f, way = Rollout(recording, ["/pin:turns"], [4]), 0.4 * np.random.default_rng(1).normal(size=(4, 3))
    s = np.random.default_rng(3).normal(size=f.run().shape)
    before = f.run()
    assert np.abs(f.run({"/pin:turns": way}) - before).max() > 1e-3
    np.testing.assert_allclose(f.values()["/pin:turns"], way, atol=1e-12)
    found, along = f.vjp(s)["/pin:turns"], np.random.default_rng(4).normal(size=way.shape)
    losses = {k: float((f.run({"/pin:turns": way + k * 1e-6 * along}) * s).sum()) for k in (-2, -1, 1, 2)}
    expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / 12e-6
    assert float((found * along).sum()) == pytest.approx(expected, rel=1e-6)
