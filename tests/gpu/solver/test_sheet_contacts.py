"""Frames of sheets that meet colliders, or are held by soft pins and tethers, in one launch: the motion, the reports and the
next frame's form of launch by launch within rounding, and twice the same bits. Skipped where there is no CUDA device."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.gpu.solver.sheet_contacts import run
from tests.make.physics.contact.candidate_lists import blob, surface
from tests.make.physics.contact.candidate_lists import sheet as open_sheet
from tests.make.physics.motion.fused.kernel_fusion import CLOTH, jelly, many, mesh, moved, sheet
from wsim.model.launches import KernelLaunches
from wsim.physics.motion.fused import domain_decomposition
from wsim.scene import Box, Capsule, Motion, Plane, Scene, Sphere, shapes
from wsim.scene.curve import Curve
from wsim.scene.fabric import Fabric
from wsim.simulation import cost

wp.init()
pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")
UNDAMPED = Fabric(**{**CLOTH.__dict__, "damping": 0.0})
ROUNDING = 5e-6        # [m]


def falling(material=CLOTH, height=0.0, n=16, **more) -> Scene:
    scene = Scene(solver="explicit")
    points, counts, indices = shapes.sheet(0.4, 0.4, n, n, horizontal=True)
    scene.cloth("/cloth", points + [0.0, height, 0.0], counts, indices, material=material, **more)
    return scene


def rising() -> Scene:
    """A ball that rises into a sheet, a plane below, a capsule that it slides on; frames without contacts stand before."""
    scene = falling(height=0.02)
    scene.collider("/ball", Sphere(0.1), motion=Motion([0.0, 1.0], [moved(0.0, -0.1, 0.0), moved(0.1, 0.6, 0.0)]),
                   static_friction=0.5, dynamic_friction=0.4)
    scene.collider("/capsule", Capsule(0.05, 0.05), at=(0.2, -0.06, 0.1), static_friction=0.0, dynamic_friction=0.0)
    scene.collider("/floor", Plane(), at=(0.0, -0.1, 0.0))
    return scene


def lifted() -> Scene:
    """A load that lifts half of a sheet off a plane; frames without contacts stand before."""
    scene = falling(height=0.04)
    scene.force("/lift", "/cloth", range(140, 280), Curve([0.0, 0.1, 0.2], [[0.0, 0.0, 0.0], [0.0, 0.2, 0.0], [0.1, 2.0, 0.0]]))
    scene.collider("/floor", Plane(), static_friction=0.5, dynamic_friction=0.4)
    return scene


def thrown() -> Scene:
    """A floor that throws back."""
    scene = falling(UNDAMPED, height=0.05)
    scene.collider("/floor", Plane(), restitution=0.8)
    return scene


def within() -> Scene:
    """A sheet that begins inside of the floor, and is pushed by a potential."""
    scene = falling(height=-0.002)
    scene.collider("/floor", Plane(), static_friction=0.3, dynamic_friction=0.2)
    scene.contact_width = 1e-3
    return scene


def faced(form, height) -> Scene:
    """A mesh that turns and rises into a sheet."""
    scene = falling(height=height)
    turned = np.eye(4)
    turned[:3, :3] = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]
    scene.collider("/mesh", surface(*form(np.random.default_rng(0))), static_friction=0.4, dynamic_friction=0.3,
                   motion=Motion([0.0, 1.0], [moved(0.0, -0.3, 0.0), turned @ moved(0.05, 0.3, 0.0)]))
    return scene


def tied(ball: bool) -> Scene:
    """A sheet on tethers to two pins, one of which moves, and a soft pin that drags a corner."""
    scene = sheet(tethers=True)
    scene.pin("/soft", "/cloth", [48], stiffness=50.0, damping=0.1,
              motion=Motion([0.0, 1.0], [np.eye(4), moved(0.3, -0.5, 0.4)]))
    if ball:
        scene.collider("/ball", Sphere(0.1), motion=Motion([0.0, 1.0], [moved(0.0, -0.12, 0.0), moved(0.0, 0.2, 0.0)]))
    return scene


def blown() -> Scene:
    scene = sheet(drag=1.0, lift=0.5)
    scene.wind = (0.0, -2.0, 1.0)
    scene.collider("/ball", Sphere(0.1), at=(0.0, -0.11, 0.0))
    return scene


def smooth_blob(rng):
    """A closed mesh whose edges bend too little to stand out of a sheet."""
    return blob(rng, rough=0.03)


SCENES = {"rising": rising, "thrown": thrown, "within": within, "blob": lambda: faced(smooth_blob, 0.05),
          "jelly": jelly, "lifted": lifted, "many": many, "open": lambda: faced(open_sheet, -0.28), "tied": lambda: tied(True)}
BLOCKS = {"cluster": 8, "grid": 32}
# Frames of four. In frame 3 the blob's sheet springs off folds at 4.8 m/s: places that begin one rounding apart (1.5e-8 m) are
# 3e-7 to 7e-7 m apart behind frame 2, in which 33 points touch, and 4e-6 to 6e-6 behind frame 4 (launch by launch on a CPU)
FRAMES = {"blob": 2}


@pytest.mark.parametrize("blocks", BLOCKS)
@pytest.mark.parametrize("name", SCENES)
def test_one_launch_meets_colliders_as_launch_by_launch(name, blocks, monkeypatch):
    monkeypatch.setattr(domain_decomposition, "blocks_of", lambda *given: [BLOCKS[blocks]])
    frames = FRAMES.get(name, 4)
    sim, x, v, impulses, mark = run(SCENES[name](), frames)
    taken = {"contact"} | {"tied": {"soft pins", "xpbd"}, "lifted": {"loads"}}.get(name, set())
    assert sim.plan.method("explicit").taken == taken and sim.plan.ports.force_gather.cluster.size == BLOCKS[blocks]
    _, again, rate, more, _ = run(SCENES[name](), frames)
    assert np.array_equal(x, again) and np.array_equal(v, rate)
    assert all(np.array_equal(impulses[path], more[path]) for path in impulses)
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    other, apart, v_apart, given, marked = run(SCENES[name](), frames)
    assert other.plan.ports.force_gather.cluster is None and sim.forms == other.forms
    assert np.abs(x - apart).max() < ROUNDING and np.abs(v).max() > 0.1
    assert np.abs(v - v_apart).max() < 2e-3 * np.abs(v_apart).max()
    assert (mark != marked).mean() < 0.02 and (name in ("thrown", "within") or (marked & 1).any())
    for path, J in given.items():
        assert np.linalg.norm(impulses[path] - J) <= 0.02 * max(np.linalg.norm(J) for J in given.values())


def test_what_holds_in_one_launch_holds_as_launch_by_launch(monkeypatch):
    found = []
    for fuses in (None, None, False):
        monkeypatch.setattr(KernelLaunches, "fuses", fuses)
        sim = wsim.Simulation(tied(False), device="cuda:0")
        for _ in range(4):
            sim.step()
        assert sim.plan.method("explicit").taken == ({"soft pins", "xpbd"} if fuses is None else set())
        found.append(sim.state.x.numpy())
    assert np.array_equal(*found[:2]) and np.abs(found[0] - found[2]).max() < ROUNDING


def test_air_and_contacts_in_one_launch(monkeypatch):
    """Air is taken at the velocity of the moment: apart by order 1 of the step, as without contacts."""
    apart = []
    for substeps in (100, 400):
        found = []
        for fuses in (None, False):
            monkeypatch.setattr(KernelLaunches, "fuses", fuses)
            sim, x, *_ = run(replace(blown(), substeps=substeps))
            assert (sim.plan.ports.force_gather.cluster is None) == (fuses is False)
            found.append(x)
        apart.append(np.abs(found[0] - found[1]).max())
    assert 2.0 * apart[1] < apart[0] < 0.01


def boxed() -> Scene:
    scene = falling(height=0.05)
    scene.collider("/box", Box((0.2, 0.2, 0.2)), at=(0.0, -0.1, 0.0))
    return scene


@pytest.mark.parametrize("form", [boxed, mesh])
def test_what_edges_meet_is_launched_substep_by_substep_and_priced_so(form):
    """A launch that takes many substeps would leave the contacts of edges out."""
    sim, x, *_ = run(form(), 2)
    assert not sim.plan.method("explicit").taken and sim.plan.ports.contacts.edges and np.isfinite(x).all()
    assert not cost.blocks_take_whole_frames(sim.model, {"membrane"})


def test_what_a_mesh_that_deforms_meets_is_launched_substep_by_substep():
    scene = falling(height=0.05)
    p, f = blob(np.random.default_rng(0))
    scene.collider("/mesh", surface(p - [0.0, 0.3, 0.0], f, Curve([0.0, 1.0], np.stack([p, 1.1 * p]) - [0.0, 0.3, 0.0])))
    sim, x, *_ = run(scene, 2)
    assert not sim.plan.method("explicit").taken and np.isfinite(x).all()
