"""Loops of joints and mimics in reduced coordinates: closed forms, maximal coordinates, order of convergence, gaps."""

import numpy as np
import pytest

import wsim
from tests.make.physics.joints.chains import linkage
from tests.physics.joints.trees.chains import chain_scene, trees_of
from wsim import Box, Plane, Scene
from wsim.physics.rigid.joints.joint import Drive, Mimic


def run_scene(scene, frames=60):
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(frames)
    return simulation


def energy(simulation) -> float:
    return trees_of(simulation)[0].indicators(None, None)["rigid_energy"]


def joint_gap(simulation) -> float:
    """Largest distance [m] between the two frames of a joint, by the poses of its bodies."""
    poses, found = simulation.poses(), 0.0
    for joint in simulation.scene.things("Joint"):
        a, b = (poses[path] if path else np.eye(4) for path in (joint.body0, joint.body1))
        shift = (b[:3, :3] @ joint.at1 + b[:3, 3]) - (a[:3, :3] @ joint.at0 + a[:3, 3])
        found = max(found, float(np.linalg.norm(shift)))
    return found


def test_a_four_bar_linkage_converges_with_order_four_to_what_maximal_coordinates_do():
    place = [run_scene(linkage(substeps=n)).poses()["/b1"][:3, 3] for n in (4, 8, 32)]
    off = [np.linalg.norm(p - place[-1]) for p in place[:2]]
    assert abs(np.log2(off[0] / off[1]) - 4.0) < 0.6 and off[1] < 1e-5
    coarse, fine = (run_scene(linkage("maximal", n)).poses()["/b1"][:3, 3] for n in (8, 16))
    assert np.linalg.norm(fine + (fine - coarse) / 3.0 - place[-1]) < 1e-5


def test_loops_do_not_drift():
    """Ten seconds: gaps are those of rounding, by the poses of bodies, and energy is that of rk4."""
    simulation = run_scene(linkage(), 1)
    first = energy(simulation)
    simulation.run(599)
    assert joint_gap(simulation) < 1e-12
    assert abs(energy(simulation) - first) < 1e-4 * 9.81 * sum(m.mass for m in trees_of(simulation)[0].masses)
    assert simulation.report()["error"]["joint_error"] < 1e-12


def test_a_closed_chain_hangs_and_swings_as_in_maximal_coordinates():
    """A ring of eight rods with balls, which hangs on one of them: the last ball closes it."""
    def ring(coordinates, substeps):
        scene = Scene(fps=60, substeps=substeps, coordinates=coordinates)
        angles = np.linspace(0.0, 2.0 * np.pi, 9)
        places = np.stack([np.sin(angles), np.cos(angles), 0.3 * np.sin(2.0 * angles)], 1)
        rods = []
        for k in range(8):
            way = places[k + 1] - places[k]
            x = way / np.linalg.norm(way)
            y = np.cross([0.0, 0.0, 1.0], x)
            y /= np.linalg.norm(y)
            M = np.eye(4)
            M[:3, :3], M[:3, 3] = np.stack([x, y, np.cross(x, y)], 1), 0.5 * (places[k] + places[k + 1])
            rods.append(scene.body(f"/b{k}", Box((0.5 * np.linalg.norm(way), 0.03, 0.03)), motion=wsim.Motion.still(M)))
            rods[-1].colliders[0].meets = False
        scene.joint("spherical", "/top", None, rods[0], at=places[0])
        for k in range(8):
            scene.joint("spherical", f"/j{k}", rods[k], rods[(k + 1) % 8], at=places[k + 1])
        return scene
    runs = [run_scene(ring("reduced", n), 24) for n in (8, 16)]
    places = [run.poses()["/b4"][:3, 3] for run in runs]
    assert max(joint_gap(run) for run in runs) < 1e-11
    coarse, fine = (run_scene(ring("maximal", n), 24).poses()["/b4"][:3, 3] for n in (16, 32))
    assert np.linalg.norm(places[0] - places[1]) < 1e-4
    assert np.linalg.norm(fine + (fine - coarse) / 3.0 - places[1]) < 1e-3 * np.linalg.norm(places[1])


@pytest.mark.parametrize("kinds", [("revolute", "revolute", "spherical", "revolute"),
                                   ("revolute", "spherical", "spherical", "fixed")])
def test_other_joints_close_a_loop(kinds):
    """A ball in a planar linkage changes nothing; a fixed rod leaves a coupler between balls, which swings."""
    simulation = run_scene(linkage(kinds=kinds, substeps=8), 30)
    assert joint_gap(simulation) < 1e-12
    if "fixed" not in kinds:
        plain = run_scene(linkage(substeps=8), 30).poses()["/b1"][:3, 3]
        assert np.linalg.norm(simulation.poses()["/b1"][:3, 3] - plain) < 1e-6


def test_a_stiff_drive_turns_a_linkage_to_its_target():
    """An implicit step, of order 2; the drive's own angle is what it asks for, less what the weight takes."""
    def driven(substeps):
        scene = linkage(substeps=substeps)
        scene.things("Joint")[0].drives = {"rotX": Drive(stiffness=3e4, damping=1e3, target=-0.4)}
        return run_scene(scene, 60)
    runs = [driven(n) for n in (4, 8, 16)]
    assert max(joint_gap(run) for run in runs) < 1e-12
    trees = trees_of(runs[-1])[1]
    assert trees.trees.integrator.numpy()[0] == 0 and abs(trees.q.numpy()[0] + 0.4) < 1e-2
    places = [run.poses()["/b1"][:3, 3] for run in runs]
    assert np.linalg.norm(places[1] - places[2]) < 1e-5


def test_a_limit_stops_a_linkage():
    scene = linkage(substeps=8)
    scene.things("Joint")[0].limits["rotX"] = (-0.5, 0.5)
    simulation = run_scene(scene, 240)
    trees = trees_of(simulation)[1]
    assert joint_gap(simulation) < 1e-11
    assert -0.5 - 1e-3 < trees.q.numpy()[0] < 0.5 + 1e-3 and np.abs(trees.qd.numpy()).max() < 1e-6


def test_a_linkage_lies_on_the_floor_and_is_borne_by_it():
    """Contacts push through the loop: what the floor and the two hinges of the world bear is the weight."""
    scene = linkage(substeps=8)
    for body in scene.things("Body"):
        body.colliders[0].meets = True
    scene.collider("/floor", Plane(), at=(0.0, -0.1, 0.0))
    simulation = run_scene(scene, 240)
    method, trees = trees_of(simulation)
    assert joint_gap(simulation) < 1e-10
    assert np.abs(method.velocities()).max() < 1e-3
    assert simulation.poses()["/b1"][1, 3] > -0.1


@pytest.mark.parametrize("ratio", [-2.0, 0.5])
def test_a_mimic_turns_at_its_ratio_with_the_inertia_of_both(ratio):
    """Two arms on the world: (I_1 + r^2 I_2) a = M_1 + r M_2, from rest."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced")
    last = None
    for k in range(2):
        body = scene.body(f"/b{k}", Box((0.25, 0.02, 0.03)), at=(0.25 + 0.5 * k, 0, 0))
        body.colliders[0].meets = False
        scene.joint("revolute", f"/j{k}", last, body, at=(0.5 * k, 0, 0), axis=(0, 0, 1))
        last = body
    scene.things("Joint")[1].mimics = {"rotX": Mimic("/j0", (0.0, ratio, 0.1))}
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    trees = trees_of(simulation)[1]
    a = trees.accelerations()
    assert a[1] == pytest.approx(ratio * a[0], rel=1e-12)
    first = energy(simulation)
    simulation.run(60)
    q = trees.q.numpy()
    assert q[1] == pytest.approx(ratio * q[0] + 0.1 * q[0]**2, abs=1e-12) and abs(q[0]) > 0.1
    assert energy(simulation) == pytest.approx(first, abs=1e-4)


def test_a_mimic_that_starts_elsewhere_jumps_and_says_so():
    scene = chain_scene(["revolute", "revolute"], gravity=(0, 0, 0))
    scene.things("Joint")[1].mimics = {"rotX": Mimic("/j0", (0.5, 1.0))}
    simulation = run_scene(scene, 1)
    q = trees_of(simulation)[1].q.numpy()
    assert q[1] == pytest.approx(q[0] + 0.5, abs=1e-12) and trees_of(simulation)[1].qd.numpy() == pytest.approx(0.0, abs=1e-12)
    assert any("starts 0.5 m or rad off" in w for w in simulation.warnings)


def test_mimics_go_through_usd(tmp_path):
    scene = chain_scene(["revolute", "revolute", "prismatic"])
    scene.things("Joint")[1].mimics = {"rotX": Mimic("/j0", (0.0, -2.0, 0.25))}
    wsim.save(scene, tmp_path / "s.usda")
    joints = wsim.load(tmp_path / "s.usda").things("Joint")
    assert [joint.mimics for joint in joints] == [{}, {"rotX": Mimic("/j0", (0.0, -2.0, 0.25))}, {}]


def test_mimics_of_nothing_are_refused():
    scene = chain_scene(["revolute", "spherical"])
    for leader, what in (("/j9", "/j9, which is no joint"), ("/j0", "itself"), ("/j1", "3 free coordinates")):
        scene.things("Joint")[0].mimics = {"rotX": Mimic(leader)}
        with pytest.raises(wsim.SceneError, match=what):
            wsim.Simulation(scene, device="cpu")
