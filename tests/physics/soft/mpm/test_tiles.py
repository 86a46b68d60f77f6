"""Explicit steps on a CPU: any number of threads gives the bits of launch by launch, with what comes and goes; helpers that do
not come are not waited for, and rest when others want the cores."""

import numpy as np
import pytest

import wsim
from wsim.kernels.motion.fast_paths.threads import FORMED
from wsim.physics.motion.fast_paths import threads
from wsim.physics.mpm import tile_grid
from wsim.physics.mpm.objects import Granular, Jelly, Pour


def make_scene(pours: bool) -> wsim.Scene:
    """Sand and jelly that fall on a floor; pours: also a stream, and a sink under a part of them."""
    scene = wsim.Scene(fps=60, frames=12)
    scene.collider("/floor", wsim.Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.mpm("/sand", wsim.Box((0.3, 0.2, 0.2)), at=(0.0, 0.2, 0.0), cell=0.05, material=Granular(young=2e4))
    scene.mpm("/jelly", wsim.Sphere(0.15), at=(0.1, 0.7, 0.0), cell=0.05, material=Jelly(young=2e4), velocity=(0.0, -2.0, 0.0))
    if pours:
        scene.mpm("/stream", wsim.Box((0.1, 0.05, 0.1)), at=(-0.3, 0.9, 0.0), cell=0.05, material=Granular(young=2e4),
                  velocity=(0.0, -2.0, 0.0), pour=Pour(rate=20.0))
        scene.sink("/drain", wsim.Box((0.1, 0.05, 0.3)), at=(0.25, 0.05, 0.0))
    return scene


def run_frames(count: int, pours: bool, monkeypatch, precision: str = "float32") -> tuple[np.ndarray, int]:
    """State behind ten frames, and in how many of them helpers came. count: threads; 0: launch by launch."""
    with monkeypatch.context() as m:
        m.setattr(tile_grid, "count_cores", lambda: count)
        m.setattr(tile_grid, "SHARE", 1)
        m.setattr(tile_grid, "TEAM", count > 0)
        m.setattr(tile_grid.StepTeam, "helpers_rest", lambda self, substeps: False)
        simulation = wsim.Simulation(make_scene(pours), device="cpu", precision=precision)
        method = next(each for each in simulation.plan.methods if each.name == "mpm")
        formed = 0
        for _ in range(10):
            simulation.step()
            words = method.grid.team.words
            formed += int(0 < words[FORMED] == words[0] >> 6)
        state = [method.part.arrays[name].numpy().astype(np.float64).reshape(method.part.count, -1) for name in "ovbsTCqaijk"]
    return np.concatenate(state, axis=1), formed


@pytest.mark.skipif(threads.count_cores() < 2, reason="a helper has no core to come to")
@pytest.mark.parametrize("pours", [False, True])
def test_any_number_of_threads_gives_the_bits_of_launch_by_launch(pours, monkeypatch):
    want, _ = run_frames(0, pours, monkeypatch)
    assert np.isfinite(want).all()
    for count in (1, 2, 3):
        found, formed = run_frames(count, pours, monkeypatch)
        assert np.array_equal(found, want)
        assert (formed > 0) == (count > 1)


def test_helpers_that_never_come_are_not_waited_for(monkeypatch):
    monkeypatch.setattr(threads, "worker_queue", lambda number: threads.SimpleQueue())
    want, _ = run_frames(1, False, monkeypatch)
    found, formed = run_frames(3, False, monkeypatch)
    assert np.array_equal(found, want) and formed == 0


def test_helpers_rest_longer_and_longer_where_frames_take_longer_with_them(monkeypatch):
    """Frames without helpers take 1 s a step, those with them 2 s: after one with them there is 1 without, then 2, 4, ..."""
    clock = [0.0]
    monkeypatch.setattr(tile_grid, "perf_counter", lambda: clock[0])
    team = tile_grid.StepTeam.__new__(tile_grid.StepTeam)
    team.words, team.rest, team.pause, team.count, team.key = np.zeros(16, np.int64), 0, 1, 2, ()
    came: list[bool] = []

    def send(key, launch):
        came[-1] = not team.helpers_rest(64)
    team.send = send
    for frame in range(1, 34):
        came.append(False)
        team.begin_frame((64,), None)
        team.words[0] = frame << 6
        team.words[FORMED] = frame if came[-1] else 0
        clock[0] += 20.0 if came[-1] else 10.0
        team.end_frame(10)
    assert np.diff(np.flatnonzero(came)).tolist() == [2, 3, 5, 9]
