"""Kernels of search, proof and sweeps are compiled once for all scenes whose surfaces touch."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.contact.selfcontact.modules import swept
from tests.make.physics.rods.touch import thrown
from tests.physics.contact.selfcontact.rig import SOLVERS, layers
from wsim.physics.contact.selfcontact import modules as shared
from wsim.physics.contact.selfcontact.rows import sweeps
from wsim.simulation.simulation import Simulation

CORE = len(shared.CORE) + len(shared.CORE_WORDS) + 1                    # search.meet
SWEEPS = len(shared.SWEEPS) + len(shared.SWEEPS_WORDS) + 1               # press
NEWTON = len(shared.NEWTON) + len(shared.NEWTON_WORDS) + 5               # of forces: product, 3 of conjugate gradients, choose


def simulated(solver: str, **more) -> Simulation:
    return Simulation(layers(2, 4, 5e-3, **SOLVERS[solver]), device="cpu", **more)


def kernels(module: str) -> set[str]:
    """Names of the functions that are the kernels of a module."""
    return {key.partition("__locals__")[0] for key in wp.get_module(module).kernels}


def modules(sim: Simulation) -> dict[str, int]:
    """Number of kernels in each module that a plan's are in, by name."""
    return {name: len(wp.get_module(name).kernels) for name in (sim.model.module, *sim.model.modules)}


def test_another_scene_finds_what_the_first_has_loaded():
    """None of it is in the module of either plan, and what is loaded stays as it is."""
    first = simulated("newton")
    first.load()
    module = wp.get_module("wsim_selfcontact_f32")
    loaded, digest = dict(module.execs), module.get_module_hash(1)
    assert loaded
    for solver in ("leapfrog", "xpbd"):
        other = simulated(solver)
        other.step()
        assert other.model.module != first.model.module
        assert module.get_module_hash(1) == digest and module.execs == loaded
        for sim in (first, other):
            shared = {name for name in sim.model.modules if name.startswith("wsim_selfcontact")}
            assert not kernels(sim.model.module) & {key for name in shared for key in kernels(name)}


@pytest.mark.parametrize("solver, precision, wanted", [
    ("newton", "float32", {"wsim_selfcontact_f32": CORE, "wsim_selfcontact_sweeps_f32": SWEEPS,
                           "wsim_selfcontact_newton_elements_f32": NEWTON, "wsim_selfcontact_sweep_f32_1_0": 1}),
    ("xpbd", "float32", {"wsim_selfcontact_f32": CORE, "wsim_selfcontact_sweeps_turns_f32": SWEEPS,
                         "wsim_selfcontact_sweep_f32_turns_1_0": 1}),
    ("newton midpoint", "float64", {"wsim_selfcontact_f64": CORE, "wsim_selfcontact_sweeps_f64": SWEEPS,
                                    "wsim_selfcontact_newton_elements_f64": NEWTON, "wsim_selfcontact_sweep_f64_1_0": 1})])
def test_modules_hold_the_same_kernels_in_every_plan(solver, precision, wanted):
    sim = simulated(solver, precision=precision)
    assert {name: n for name, n in modules(sim).items() if name.startswith("wsim_selfcontact")} == wanted


def test_ropes_share_the_core_and_have_none_of_the_sweeps():
    found = modules(Simulation(thrown()[0], device="cpu"))
    assert found["wsim_selfcontact_f64"] == CORE and not any("sweeps" in name for name in found)


def test_kernels_of_the_core_have_no_adjoint():
    sim = simulated("newton")
    for name in sim.model.modules:
        assert not any(k.options["enable_backward"] for k in wp.get_module(name).kernels.values())


def test_sweeps_in_one_launch_have_the_bits_of_many(monkeypatch):
    """Pairs that all push at once, and contacts among them."""
    assert np.array_equal(swept("leapfrog", True, "cpu", monkeypatch), swept("leapfrog", False, "cpu", monkeypatch))


def test_blocks_of_sweeps_run_at_once():
    """A grid whose blocks wait for each other has no more than there are multiprocessors, in whole clusters."""
    for multiprocessors in (14, 36, 66, 132, 144):
        for cluster in (0, 8, 16):
            blocks = sweeps.concurrent_blocks(multiprocessors, cluster)
            assert 0 < blocks <= max(multiprocessors, cluster) and blocks % max(cluster, 1) == 0
    assert sweeps.concurrent_blocks(132, 16) == 64


def test_warps_of_pairs_in_a_row_are_of_different_blocks():
    from wsim.kernels.contact.selfcontact.sweep import spread_lanes
    number = np.array([spread_lanes(lane, 4 * 256, 256) for lane in range(4 * 256)])
    assert np.array_equal(np.sort(number), np.arange(1024))
    blocks = np.argsort(number).reshape(-1, 32) // 256
    assert (blocks == blocks[:, :1]).all() and np.array_equal(blocks[:8, 0], [0, 1, 2, 3, 0, 1, 2, 3])
