"""The report lists what runs on the host around the graph of a frame, and what it evaluates there."""

import numpy as np
import pytest

from wsim.scene import Motion, Scene, Sphere, shapes
from wsim.simulation.measure.host import SETTLED
from wsim.simulation.report import report_text
from wsim.simulation.simulation import Simulation


class Circling(Motion):
    """A motion that is no curve."""

    def at(self, t: float) -> np.ndarray:
        M = np.eye(4)
        M[:3, 3] = 0.1 * np.sin(t), 0.1 * (1.0 - np.cos(t)), 0.0
        return M

    def sampled(self, t) -> np.ndarray:
        return np.stack([self.at(one) for one in np.atleast_1d(t)])


def lifted(motion: Motion) -> Simulation:
    scene = Scene(solver="xpbd", integrator="backward_euler", substeps=3, iterations=1)
    scene.cloth("/cloth", *shapes.sheet(0.4, 0.3, 4, 4))
    scene.pin("/pin", "/cloth", [0, 1], motion=motion)
    scene.collider("/ball", Sphere(0.1), at=(0.0, -5.0, 0.0))
    sim = Simulation(scene, device="cpu")
    sim.run(SETTLED + 3)
    return sim


def keys() -> np.ndarray:
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, :3, 3] = 0.1
    return M


@pytest.mark.parametrize("motion, evaluates", [
    (Motion([0.0, 1.0], keys()), []), (Motion([0.0, 1.0], keys(), "eased", easing="bounce-out"), []),
    (Circling([0.0, 1.0], keys()), ["targets of /pin"])])
def test_curves_are_evaluated_by_kernels_and_what_is_none_is_told(motion, evaluates):
    sim = lifted(motion)
    told = sim.report(profile=False)
    rows = {row["what"]: row for row in told["host"]}
    assert rows["pins"]["evaluates"] == evaluates and rows["pins"]["ms"] > 0.0
    assert not any(row["evaluates"] for what, row in rows.items() if what != "pins")
    assert ("  evaluates targets of /pin" in report_text(told)) == bool(evaluates)


def test_times_are_of_frames_behind_the_first_and_less_than_whole_frames():
    sim = lifted(Motion([0.0, 1.0], keys()))
    assert sim.host.frames == 3
    told = sim.report(profile=False)
    total = sum(row["ms"] for row in told["host"])
    assert 0.0 < total <= sum(sim.milliseconds[SETTLED:]) / 3 + 1e3 * sim.host.seconds["first frames, measured"] / 3
    assert told["host"] == sorted(told["host"], key=lambda row: -row["ms"])
    assert f"host      {total:.2g} ms a frame" in report_text(told)
    sim.reset()
    assert sim.report(profile=False)["host"] == []
