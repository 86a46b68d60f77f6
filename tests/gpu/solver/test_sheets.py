"""Frames of sheets in one launch of a cluster, or of a grid of blocks: the motion of launch by launch within rounding, and
twice the same bits. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.gpu.solver.sheets import BLOCKS, end, moves_alike
from tests.make.physics.motion.fused.kernel_fusion import CLOTH, blown, moved, sheet
from wsim.model.launches import KernelLaunches
from wsim.scene import Motion, Scene, shapes
from wsim.scene.curve import Curve
from wsim.scene.fabric import Fabric

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
STIFF = Fabric(**{**CLOTH.__dict__, "damping": 0.0, "weft": 500.0})
ROUNDING = 2e-6        # [m], after four frames of a fold through which rounding grows


def two() -> Scene:
    """A folded sheet whose pin moves, and one that falls: of other materials, without damping."""
    scene = Scene(solver="explicit")
    points, counts, indices = shapes.sheet(0.6, 0.4, 20, 14, horizontal=True)
    points = np.where(points[:, :1] > 0.0, points * [-1.0, 1.0, 1.0] + [0.0, 0.02, 0.0], points)
    folded = scene.cloth("/folded", points, counts, indices, material=STIFF)
    scene.pin("/hand", folded, range(15), motion=Motion([0.0, 1.0], [np.eye(4), moved(0.2, 0.3, 0.0)]))
    points, counts, indices = shapes.sheet(0.3, 0.3, 9, 9)
    scene.cloth("/falls", points + [2.0, 0.0, 0.0], counts, indices, material=CLOTH)
    return scene


def limp() -> Scene:
    """Triangles without hinges."""
    return sheet(Fabric(stretch=300.0, shear=100.0, bend=0.0, thickness=2e-3))


def loaded() -> Scene:
    """Forces on the points of two sheets, which grow and turn back; one of them bears both."""
    scene = two()
    turns = Curve([0.0, 0.05, 0.2], [[0.0, 0.0, 0.0], [0.0, 0.01, 0.005], [0.0, -0.02, 0.0]])
    scene.force("/push", "/folded", range(40, 200), turns)
    scene.force("/stays", "/folded", range(150, 260), [0.002, 0.004, 0.0])
    scene.force("/lifts", "/falls", range(100), Curve([0.0, 0.1], [[0.0, 0.0, 0.0], [0.0, 0.01, 0.0]]))
    return scene


SCENES = {"damped": sheet, "two": two, "limp": limp, "loaded": loaded}


@pytest.mark.parametrize("blocks", BLOCKS)
@pytest.mark.parametrize("name", SCENES)
def test_one_launch_moves_as_launch_by_launch(name, blocks, monkeypatch):
    moves_alike(SCENES[name], BLOCKS[blocks], ROUNDING, monkeypatch)


def test_live_values_are_those_of_the_next_frame():
    scene, other = sheet(), sheet(Fabric(**{**CLOTH.__dict__, "stretch": 200.0}))
    sim, want = (wsim.Simulation(s, device="cuda:0") for s in (scene, other))
    sim.set("/cloth", "stretch", 200.0)
    for each in (sim, want):
        each.step()
    assert np.abs(sim.state.x.numpy() - want.state.x.numpy()).max() < ROUNDING


def test_loads_of_the_next_frame_are_those_that_are_set():
    sim, want = (wsim.Simulation(loaded(), device="cuda:0", precision=precision) for precision in ("float32", "float64"))
    for each in (sim, want):
        each.step()
        each.set("/push", "force", Curve([0.0, 0.2], [[0.0, 0.02, 0.0], [0.0, 0.02, -0.02]]))
        each.set("/falls", "gravity", [0.0, 1.0, 0.0])
        each.step()
    assert sim.plan.method("explicit").taken == {"loads"} and want.plan.ports.force_gather.cluster is None
    assert np.abs(sim.state.x.numpy() - want.state.x.numpy()).max() < ROUNDING


def test_pins_that_the_gpu_takes_go_where_the_host_takes_them():
    """One turns, and is set to turn otherwise; one stays."""
    turn, other = np.eye(4), np.eye(4)
    turn[:3, :3], other[:3, :3] = ([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
                                   [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    scene, found = two(), []
    scene.substeps = 200
    scene.pin("/stays", "/folded", range(280, 300))
    scene.pins[0].motion = Motion([0.0, 0.5], [np.eye(4), turn])
    sim = wsim.Simulation(scene, device="cuda:0")
    pins = sim.plan.ports.pins
    for k in range(4):
        if k == 2:
            sim.set("/hand", "motion", Motion([0.0, 0.5], [np.eye(4), other]))
        start = sim.time
        sim.step()
        found.append(pins.target["hard"].numpy())
        want = np.concatenate([p.table(start + sim.plan.clock.moments(True)) for p in pins.groups["hard"]], axis=1)
        assert np.abs(found[-1] - want).max() < 1e-7 and pins.own["hard"] == [p.motion.moves for p in pins.groups["hard"]]
    assert all(np.abs(a - b).max() > 1e-3 for a, b in zip(found[:3], found[1:4], strict=True))


def test_air_within_one_launch_is_that_between_launches_in_the_limit(monkeypatch):
    """One takes it at the velocity of the moment, the other at that half a step later: they differ by order 1 of the step."""
    apart = []
    for substeps in (100, 400):
        found = []
        for fuses in (None, False):
            monkeypatch.setattr(KernelLaunches, "fuses", fuses)
            scene = blown()
            scene.substeps = substeps
            x, _, pull = end(scene)
            assert (pull.cluster is None) == (fuses is False)
            found.append(x)
        apart.append(np.abs(found[0] - found[1]).max())
    assert 3.0 * apart[1] < apart[0] < 0.01 * np.ptp(found[0], axis=0).max()
