"""CPU threads that share the phases of a launch of many substeps: the bits of launch by launch, whatever their number; who does
not come is not waited for; what is part of the one kernel is not compiled by itself."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import wsim
from tests.make.physics.motion.fused.thread_team import scene
from wsim.kernels.motion.fast_paths.threads import FORMED
from wsim.physics.motion.fast_paths import threads
from wsim.physics.motion.fused import kernel_fusion

ROOT = Path(__file__).resolve().parents[4]




def simulation(name: str, monkeypatch, count: int) -> wsim.Simulation:
    """count: threads; 0: launch by launch."""
    with monkeypatch.context() as m:
        m.setattr(kernel_fusion, "SHARE", 1)
        m.setattr(kernel_fusion, "count_cores", lambda: count)
        if count == 0:
            m.setattr(kernel_fusion.Fuser, "kernel", lambda self, steps: None)
        sim = wsim.Simulation(scene(name), device="cpu")
        sim.step()
        sim.step()                                       # from here on a graph
    return sim


@pytest.mark.skipif(threads.count_cores() < 2, reason="a helper has no core to come to")
@pytest.mark.parametrize("name, count", [
    ("everything", 2), ("blown", 3), ("cube", 2), pytest.param("everything", 3, marks=pytest.mark.slow)])
def test_any_number_of_threads_gives_the_bits_of_launch_by_launch(name, count, monkeypatch):
    want, sim = (simulation(name, monkeypatch, n) for n in (0, count))
    teams = list(sim.model.fuser.teams.values())
    assert {team.count for team in teams} == {count} and sim.model.fuser.launched >= 2 and want.model.fuser.launched == 0
    formed = 0
    for _ in range(8):
        want.step(), sim.step()
        formed += any(team.words[FORMED] > 0 and team.words[FORMED] == team.words[0] >> 6 for team in teams)
        assert np.array_equal(want.positions(), sim.positions()) and np.array_equal(want.velocities(), sim.velocities())
    assert formed > 0 and np.abs(sim.velocities()).max() > 1e-3


def test_helpers_that_never_come_are_not_waited_for(monkeypatch):
    monkeypatch.setattr(threads, "worker_queue", lambda number: threads.SimpleQueue())
    want, sim = (simulation("blown", monkeypatch, n) for n in (0, 3))
    for each in (want, sim):
        each.run(2)
    assert np.array_equal(want.positions(), sim.positions())
    (team,) = sim.model.fuser.teams.values()
    assert team.words[FORMED] == 0


def test_the_kernel_has_the_same_name_in_every_process():
    """Else no process would find in the cache what another has compiled."""
    code = ("import warp as wp, wsim\nfrom tests.make.physics.motion.fused.thread_team import scene\n"
            "sim = wsim.Simulation(scene('blown'), device='cpu')\nprint(sorted(wp.get_module(sim.model.module).kernels))")
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT,
                           env=os.environ | {"PYTHONHASHSEED": seed}) for seed in ("1", "2")]
    names = [run.stdout.splitlines()[-1] for run in runs]
    assert names[0] == names[1] and "fused_" in names[0]
