"""A frame that ends without numbers: which substep, stage, array and point were first."""

import numpy as np
import pytest

import wsim
from tests.make.gradient.gradients import net
from wsim import Motion, SceneError, Simulation
from wsim.fitting import Settings, Track
from wsim.gradient.recording import Recording

H = 1.0 / 60.0 / 40.0


def lost(solver: str, frame: int = 0, when: float = 11.4, **more) -> wsim.Scene:
    """Point 0 hangs on what is nowhere from so many substeps after the begin of a frame on."""
    integrator = "leapfrog" if solver == "explicit" else "backward_euler"
    scene = net(**{"solver": solver, "integrator": integrator} | more)
    values = np.tile(np.eye(4), (3, 1, 1))
    values[2, 0, 3] = np.nan
    scene.pins[0].motion = Motion(np.array([0.0, when, 12.0]) * H + frame / 60.0, values)
    return scene


def simulated(scene: wsim.Scene, **more) -> Simulation:
    """Which `check` would have refused."""
    motion, scene.pins[0].motion = scene.pins[0].motion, Motion.still()
    sim = Simulation(scene, device="cpu", precision="float64", **more)
    sim.plan.method("pins").set_value("/pin", "motion", motion)
    return sim


@pytest.mark.parametrize("solver, stage", [("explicit", "leapfrog"), ("xpbd", "pins")])
def test_a_simulation_says_what_first_went_bad(solver, stage):
    """Repeated with up to 16 times the substeps: 183 of those are more than 11.4 of the first ones."""
    sim = simulated(lost(solver, 1))
    with pytest.raises(SceneError, match="stopped being a number in frame 2, with 640 substeps too") as said:
        sim.run(3)
    assert f"first in substep 183 of 640, stage {stage}: array " in str(said.value)
    assert "of point 0 of /chain" in str(said.value)


@pytest.mark.slow
def test_steps_of_sdirk3_are_counted_and_not_the_systems_of_both_stages():
    """Of step 183 of 640 the first stage looks at 182.79 and the second at 182.21 and at the end, 183: points hang on what is
    nowhere from 16 x 11.43 = 182.88 on."""
    sim = simulated(lost("implicit", 1, 11.43, integrator="sdirk3"))
    with pytest.raises(SceneError, match="stopped being a number in frame 2, with 640 substeps too") as said:
        sim.run(3)
    assert "first in substep 183 of 640 (stage 2 of sdirk3), stage pins" in str(said.value)
    assert sim.plan.clock.steps == 640 and sim.plan.clock.substeps == 1280
    assert [w.rpartition(" with ")[2] for w in sim.warnings] == [f"{n} substeps, which stay" for n in (80, 160, 320, 640)]


def test_a_recording_counts_steps_of_sdirk3_too():
    recording = Recording(simulated(lost("implicit", 1, integrator="sdirk3"), gradients=True), 2)
    with pytest.raises(SceneError, match="first in substep 12 of 40 .stage 1 of sdirk3., stage pins: .* point 0 of /chain"):
        recording.run()


@pytest.mark.parametrize("frames, keep", [(2, "all"), (2, "checkpoints")])
def test_a_recording_says_it_too(frames, keep):
    recording = Recording(simulated(lost("explicit", 1), gradients=True), frames, keep)
    with pytest.raises(SceneError, match="no number in frame 2 .first in substep 12 of 40, stage leapfrog: .* point 0 of"):
        recording.run()


@pytest.mark.parametrize("names", ["stiffness", "stiffness[]"])
def test_a_fit_says_it_too(names, monkeypatch):
    scene = net(integrator="leapfrog")
    track, step = Track("/chain", [1], np.zeros((1, 12, 3)), sigma=1e-3), Simulation.set

    def breaks(self, path, name, *rest):
        self.plan.method("pins").set_value("/pin", "motion", lost("explicit").pins[0].motion)        # which `set` would refuse
        step(self, path, name, *rest)
    monkeypatch.setattr(Simulation, "set", breaks)
    from wsim.fitting.copies import SceneCopies
    begin = SceneCopies.begin
    monkeypatch.setattr(SceneCopies, "begin", lambda self,
                        values: (begin(self, values), breaks(self.sim, "/", "air_drag", 0.4)))
    with pytest.raises(SceneError, match="first in substep [0-9]+ of [0-9]+, stage leapfrog: array .* of point 0 of /chain"):
        wsim.fit(scene, [track], names, settings=Settings(device="cpu"))
