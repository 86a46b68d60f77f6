"""Frames of tets in one launch of a cluster, or of a grid of blocks: the motion of launch by launch within rounding, twice the
same bits; what a free body keeps, and the order of leapfrog. Skipped where there is no CUDA device."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.gpu.solver.sheet_contacts import run
from tests.make.gpu.solver.sheets import BLOCKS, end, moves_alike
from tests.make.physics.motion.fused.kernel_fusion import cube, jelly, moved, sheet
from wsim import Bulk
from wsim.model.launches import KernelLaunches
from wsim.physics.motion.fused import domain_decomposition
from wsim.scene import Motion, Plane, Scene, shapes

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
ROUNDING = 1e-6        # [m], of bodies of 0.3 m after four frames


def bar(material="corotational", damping=0.0) -> Scene:
    """A bar that a moving pin bends and turns."""
    scene = Scene(solver="explicit")
    points, tets = shapes.block((0.3, 0.1, 0.1), (9, 3, 3))
    body = scene.soft("/bar", points, tets, material=Bulk(3e4, 0.4, 1e3, material, damping=damping))
    turned = moved(0.0, 0.1, 0.05)
    turned[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    scene.pin("/hand", body, np.flatnonzero(points[:, 0] < -0.149), motion=Motion([0.0, 0.3], [np.eye(4), turned]))
    return scene


def several() -> Scene:
    """Two bodies of three materials, one of them damped, and a sheet beside them."""
    scene = sheet()
    points, tets = shapes.block((0.3, 0.1, 0.1), (6, 2, 2))
    which = (points[tets, 0].mean(axis=1) > 0.0).astype(int)
    scene.soft("/two", points + [2.0, 0.0, 0.0], tets, material=Bulk(3e4, 0.3, 1e3), which=which,
               others=[Bulk(6e4, 0.4, 2e3, "neo_hookean", damping=5e-4)])
    body = scene.soft("/falls", points + [3.0, 0.0, 0.0], tets, material=Bulk(2e4, 0.2, 500.0, "st_venant_kirchhoff"))
    scene.pin("/end", body, [0, 1, 2])
    return scene


def free(material: str, substeps: int) -> Scene:
    """A bar that is stretched and sheared where it begins, spins, and nothing acts on."""
    scene = Scene(solver="explicit", gravity=(0.0, 0.0, 0.0), substeps=substeps)
    points, tets = shapes.block((0.3, 0.1, 0.1), (9, 3, 3))
    scene.soft("/bar", points @ [[1.2, 0.1, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 1.0]], tets, rest_points=points,
               velocities=np.cross([5.0, 3.0, 20.0], points), material=Bulk(3e4, 0.4, 1e3, material))
    return scene


SCENES = {"corotational": bar, "neo_hookean": lambda: bar("neo_hookean"), "damped": lambda: bar("neo_hookean", 5e-4),
          "corotational damped": lambda: bar("corotational", 5e-4), "linear": lambda: bar("linear"), "several": several}


@pytest.mark.parametrize("blocks", BLOCKS)
@pytest.mark.parametrize("name", SCENES)
def test_one_launch_moves_as_launch_by_launch(name, blocks, monkeypatch):
    moves_alike(SCENES[name], BLOCKS[blocks], ROUNDING, monkeypatch)


def thrown() -> Scene:
    """A floor throws a bar back."""
    scene = Scene(solver="explicit")
    points, tets = shapes.block((0.3, 0.1, 0.1), (6, 2, 2))
    scene.soft("/bar", points + [0.0, 0.08, 0.0], tets, material=Bulk(3e4, 0.3, 1e3, "neo_hookean"))
    scene.collider("/floor", Plane(), restitution=0.8)
    return scene


@pytest.mark.parametrize("blocks", BLOCKS)
@pytest.mark.parametrize("made", [cube, jelly, thrown])
def test_colliders_are_met_as_launch_by_launch(made, blocks, monkeypatch):
    monkeypatch.setattr(domain_decomposition, "blocks_of", lambda *given: [BLOCKS[blocks]])
    sim, x, v, impulses, mark = run(made(), 6)
    assert sim.plan.method("explicit").taken == {"contact"} and sim.plan.ports.force_gather.cluster.size == BLOCKS[blocks]
    _, again, rate, *_ = run(made(), 6)
    assert np.array_equal(x, again) and np.array_equal(v, rate)
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    other, apart, _, given, marked = run(made(), 6)
    assert other.plan.ports.force_gather.cluster is None and sim.forms == other.forms and (sim.forms["met"] or made is thrown)
    assert np.abs(x - apart).max() < 5 * ROUNDING and np.abs(v).max() > 0.01
    for path, J in given.items():
        assert np.linalg.norm(impulses[path] - J) <= 0.02 * max(np.linalg.norm(J) for J in given.values())


def test_a_large_body_takes_a_grid(monkeypatch):
    scene = Scene(solver="explicit")
    points, tets = shapes.block((0.4, 0.4, 0.4), (16, 16, 16))
    body = scene.soft("/cube", points, tets, material=Bulk(3e4, 0.4, 1e3, "neo_hookean"))
    scene.pin("/top", body, np.flatnonzero(points[:, 1] > 0.199))
    x, _, pull = end(scene, 2)
    assert pull.cluster.grid
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    apart, _, _ = end(scene, 2)
    assert np.abs(x - apart).max() < ROUNDING


@pytest.mark.parametrize("material", ["corotational", "neo_hookean"])
def test_a_free_body_keeps_momentum_and_errs_by_the_square_of_the_step(material):
    exact = wsim.Simulation(free(material, 1600), device="cuda:0", precision="float64")
    exact.step()
    errors = []
    for substeps in (100, 200):
        sim = wsim.Simulation(free(material, substeps), device="cuda:0")
        w = sim.plan.ports.constants.w.numpy()[:, None]
        before = (sim.state.v.numpy().astype(np.float64) / w, np.cross(sim.state.x.numpy(), sim.state.v.numpy()) / w)
        sim.step()
        assert sim.plan.ports.force_gather.cluster is not None
        x, v = (a.numpy().astype(np.float64) for a in (sim.state.x, sim.state.v))
        size = np.abs(v / w).sum()
        assert np.abs((v / w - before[0]).sum(axis=0)).max() < 1e-6 * size
        assert np.abs((np.cross(x, v) / w - before[1]).sum(axis=0)).max() < 1e-6 * size
        errors.append(np.sqrt(np.mean((x - exact.state.x.numpy()) ** 2)))
    assert 3.7 < errors[0] / errors[1] < 4.3, errors


def test_live_values_are_those_of_the_next_frame():
    scene, other = bar(), bar()
    other.softs[0].material = Bulk(2e4, 0.4, 1e3)
    scene.substeps = other.substeps = 100
    sim, want = (wsim.Simulation(s, device="cuda:0") for s in (scene, other))
    sim.set("/bar", "young", 2e4)
    for each in (sim, want):
        each.step()
    assert np.abs(sim.state.x.numpy() - want.state.x.numpy()).max() < ROUNDING


def test_frames_without_contacts_are_those_of_the_body_alone():
    """Its live values as well, which the frames with contacts have too."""
    sims = []
    for far in (False, True):
        scene = bar(damping=5e-4)
        if far:
            scene.collider("/floor", Plane(), at=(0.0, -9.0, 0.0))
        sims.append(wsim.Simulation(scene, device="cuda:0"))
        sims[-1].step()
        sims[-1].set("/bar", "young", 2e4)
        sims[-1].step()
    alone, far = sims
    assert far.forms == {"free": 2, "met": 0, "repeated": 0}
    assert np.array_equal(alone.state.x.numpy(), far.state.x.numpy())


def test_poses_of_a_collider_at_many_substeps_are_those_of_a_cpu():
    poses = []
    for device in ("cpu", "cuda:0"):
        scene = jelly()
        scene.substeps = 120
        sim = wsim.Simulation(scene, device=device)
        sim.step()
        contacts = sim.plan.ports.contacts
        assert contacts.poses.many.tolist() == [0]
        poses.append(contacts.table.of.pose.numpy())
    assert poses[0].shape == (121, 1, 7) and np.abs(poses[0] - poses[1]).max() < 1e-6
