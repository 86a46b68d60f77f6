"""Launches that several cores share: the same bits for any number of threads, wherever they are launched from."""

import os
import subprocess
import sys
from collections.abc import Iterator
from threading import Thread

import numpy as np
import pytest
import warp as wp

from wsim import Box, Plane, Scene, Simulation
from wsim.kernels.math.marks import kernel_over_cores
from wsim.model import kernel_cache, warp_private
from wsim.model.compiler import core_sharing as code
from wsim.model.compiler import core_team
from wsim.physics.position_based.objects import ConstraintFluid, Grains
from wsim.scene import SceneError

THREADS = 100_000


def sum_of_thread(x: wp.array(dtype=float), rounds: int, y_out: wp.array(dtype=float), count_out: wp.array(dtype=int)):
    i = wp.tid()
    y = float(x[i])
    for _ in range(rounds):
        y += wp.sin(y)
    y_out[i] = y
    wp.atomic_add(count_out, 0, 1)
    wp.atomic_max(count_out, 1, i)
    wp.atomic_min(count_out, 2, -i)


@pytest.fixture
def team(monkeypatch) -> Iterator[core_team.CoreTeam]:
    """Every launch of 16 threads and more is shared, however long it waits for helpers."""
    if warp_private.PLAIN:
        pytest.skip("Warp's own source of kernels is not shared")
    monkeypatch.setattr(core_team, "MOST", 3)
    team, before = core_team.TEAM, core_team.TEAM.desk.copy()
    team.desk[code.SHARED], team.desk[code.LEAST], team.desk[code.LATE], team.desk[code.ALONE] = 0, 1, 1 << 62, 0
    yield team
    team.desk[:code.LINE] = before[:code.LINE]
    team.use(int(before[code.CORES]))


@pytest.fixture(scope="module")
def kernel() -> wp.Kernel:
    made = kernel_over_cores(sum_of_thread, "sum_of_thread", wp.get_module("test_cores"))
    kernel_cache.load_kernel_module("test_cores", wp.get_device("cpu"), 1)
    return made


def launch(kernel, rounds: int = 20) -> np.ndarray:
    """Sums, then the numbers that are added and compared by all threads."""
    x = wp.array(np.linspace(0.0, 1.0, THREADS, dtype=np.float32), device="cpu")
    y, count = wp.zeros(THREADS, dtype=float, device="cpu"), wp.zeros(3, dtype=int, device="cpu")
    wp.launch(kernel, THREADS, [x, rounds], [y, count], device="cpu")
    return np.concatenate([y.numpy(), count.numpy()])


def jobs(team) -> int:
    """Launches so far that were shared."""
    return int(team.desk[code.OPEN]) >> 32


def test_any_number_of_threads_gives_the_same_bits_and_counts(team, kernel):
    team.use(1)
    begun, alone = jobs(team), launch(kernel)
    assert jobs(team) == begun                                           # nobody to share with
    assert tuple(alone[-3:]) == (THREADS, THREADS - 1, 1 - THREADS)
    for count in (2, 3):
        team.use(count)
        helped = team.desk[code.HELPED]
        for _ in range(1000):
            np.testing.assert_array_equal(launch(kernel), alone)
            if team.desk[code.HELPED] > helped:
                break
        assert team.desk[code.HELPED] > helped
    assert jobs(team) > begun


def test_a_graph_is_shared_as_it_is_replayed(team, kernel):
    x, y, count = (wp.ones(size, dtype=dtype, device="cpu") for size, dtype in ((THREADS, float), (THREADS, float), (3, int)))
    team.use(1)
    with kernel_cache.capture_graph(wp.get_device("cpu")) as capture:
        wp.launch(kernel, THREADS, [x, 20], [y, count], device="cpu")
    team.use(3)
    begun = jobs(team)
    wp.capture_launch(capture.graph)
    assert jobs(team) == begun + 1
    assert (y.numpy() == y.numpy()[0]).all()


def test_launches_of_several_threads_do_not_mix(team, kernel):
    team.use(3)
    alone, found = launch(kernel), list[np.ndarray]()
    threads = [Thread(target=lambda: found.extend(launch(kernel) for _ in range(20))) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 60
    for each in found:
        np.testing.assert_array_equal(each, alone)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_process_launches_alone(team, kernel):
    team.use(2)
    alone = launch(kernel)
    child = os.fork()
    if child == 0:
        begun = jobs(team)
        team.use(2)
        os._exit(0 if np.array_equal(launch(kernel), alone) and jobs(team) == begun else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_the_environment_says_how_many(monkeypatch):
    monkeypatch.setenv(core_team.VARIABLE, "3")
    assert core_team.count_cores() == 3
    for wrong in ("0", "-1", "two", "1.5"):
        monkeypatch.setenv(core_team.VARIABLE, wrong)
        with pytest.raises(SceneError, match=f"{core_team.VARIABLE}.*whole number from 1.*fix:"):
            Simulation(Scene())                            # and so before a file is begun
    monkeypatch.delenv(core_team.VARIABLE)
    assert 1 <= core_team.count_cores() <= (os.cpu_count() or 1)


PROCESS = """
import numpy, wsim
from wsim.model.compiler import core_team
scene = wsim.Scene(fps=60, frames=2, substeps=2, iterations=2)
scene.particles("/water", wsim.Box((0.05, 0.05, 0.05)), at=(0, 0.05, 0), radius=0.005, material="fluid")
simulation = wsim.Simulation(scene, device="cpu")
simulation.run()
assert len(core_team.TEAM.helpers) == 2, core_team.TEAM.helpers
print(simulation.positions().tobytes().hex()[:64])
"""


@pytest.mark.slow
def test_a_process_with_helpers_ends():
    how = {**os.environ, core_team.VARIABLE: "3"}
    found = subprocess.run([sys.executable, "-c", PROCESS], capture_output=True, text=True, timeout=300, env=how)
    assert found.returncode == 0, found.stderr
    assert not found.stderr
    assert len(found.stdout.strip()) == 64


def fluid_scene() -> Scene:
    """A block of fluid that falls into a corner."""
    scene = Scene(fps=60, frames=4, substeps=2, iterations=2)
    scene.collider("/floor", Plane())
    scene.particles("/water", Box((0.06, 0.06, 0.06)), at=(0, 0.07, 0), radius=0.005,
                    material=ConstraintFluid(viscosity=0.05, surface_tension=0.05))
    return scene


def grain_scene() -> Scene:
    """Grains that fall."""
    scene = Scene(fps=60, frames=6, substeps=4, iterations=2)
    scene.collider("/floor", Plane(), static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/beads", Box((0.05, 0.06, 0.05)), at=(0, 0.065, 0), radius=0.005, material=Grains())
    return scene


@pytest.mark.parametrize("make", [fluid_scene, grain_scene])
def test_particles_move_by_the_same_bits(team, make):
    found, shared = [], []
    for count in (1, 2, 3):
        team.use(count)
        begun, simulation = jobs(team), Simulation(make(), device="cpu")
        team.use(count)                                                  # where this was the first module with shared kernels
        simulation.run()
        found.append((simulation.positions().tobytes(), simulation.velocities().tobytes(), str(simulation.indicators())))
        shared.append(jobs(team) - begun)
    assert found[0] == found[1] == found[2]
    assert shared[1] > 100 and shared[2] == shared[1]
