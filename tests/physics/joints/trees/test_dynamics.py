"""Trees in reduced coordinates beside other forms of the same equations, and beside conservation laws."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.physics.joints.chains import heavy_chain
from tests.physics.joints.trees.chains import body_frames, chain_scene, constrained_accelerations, trees_of
from wsim.cli.run import prepare_recorded_run
from wsim.geometry import rotation
from wsim.physics.rigid.joints.joint import Drive


@pytest.mark.parametrize("kinds, free", [
    (["revolute"] * 3, False), (["spherical"] * 3, True), (["prismatic", "revolute"], False),
    (["fixed", "spherical", "prismatic", "revolute"], True)])
def test_accelerations_are_those_of_lagrange_multipliers(kinds, free):
    """Bodies' velocities a step of 1e-5 s before and behind, against M a + G^T lam = f. Central differences err by 1e-10
    s^2 of the third derivative, some 1e3 rad/s^3 here."""
    h = 1e-5
    scene = chain_scene(kinds, free, fps=1.0 / h, substeps=1)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    method, trees = trees_of(simulation)
    generator = np.random.default_rng(0)
    trees.qd.assign(generator.normal(size=len(trees.qd)))
    q = trees.q.numpy()
    for link, ball in enumerate(trees.links.ball):
        first = trees.links.first_coordinate[link] + trees.links.slides[link]
        if ball:
            turned = q[first:first + 4] + generator.normal(size=4)
            q[first:first + 4] = turned / np.linalg.norm(turned)
        elif trees.links.joint[link] >= 0:
            q[first:trees.links.first_coordinate[link + 1]] += 0.7
    trees.q.assign(q)
    trees.stale = False
    found = []
    for _ in range(3):
        simulation.step()
        found.append(body_frames(simulation))
    (_, _, v0, o0), (x, R, v, omega), (_, _, v2, o2) = found
    measured = np.concatenate([v2 - v0, o2 - o0], axis=1) / (2.0 * h)
    joints = []
    for link, j in enumerate(trees.links.joint):
        if j < 0:
            continue
        kind, parent, body = kinds[int(trees.joints[j].path[2:])], trees.links.parent[link], trees.links.body[link]
        a = trees.links.body[parent] if parent >= 0 else -1
        joints.append((a, body, kind, trees.joints[j]))
    at, frames = joint_frames(found[1], method, joints)
    rows = []
    for (a, b, kind, _), place, A in zip(joints, at, frames, strict=True):
        turns = {"revolute": A.T[1:], "spherical": A.T[:0], "prismatic": A.T, "fixed": A.T}[kind]
        shifts = A.T[1:] if kind == "prismatic" else A.T
        rows.append((a, b, place, turns, shifts))
    mass, inertia = np.array([m.mass for m in method.masses]), np.array([m.moments for m in method.masses])
    exact = constrained_accelerations(x, R, v, omega, mass, inertia, scene.gravity, rows)
    assert np.abs(measured - exact).max() < 1e-5 * max(1.0, np.abs(exact).max())


def joint_frames(frames, method, joints):
    """Origins of frames b, and frames a as matrices, of joints now, by the poses of bodies."""
    x, R, _, _ = frames
    at, axes = [], []
    for a, b, _, joint in joints:
        mass = method.masses[b]
        P = R[b] @ rotation.quaternion_to_matrix(mass.axes).T                 # body's own frame to the world
        at.append(x[b] + P @ (joint.at1 - mass.center))
        Q = np.eye(3) if a < 0 else R[a] @ rotation.quaternion_to_matrix(method.masses[a].axes).T
        axes.append(Q @ rotation.quaternion_to_matrix(joint.turn0))
    return at, axes


def tip(substeps, coordinates, kinds=("spherical", "revolute"), frames=30):
    scene = chain_scene(kinds, substeps=substeps, coordinates=coordinates)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(frames)
    return simulation.poses()[f"/b{len(kinds) - 1}"][:3, 3]


def test_a_double_pendulum_converges_with_order_four():
    exact = tip(96, "reduced")
    off = [np.linalg.norm(tip(n, "reduced") - exact) for n in (3, 6, 12)]
    assert np.all(np.abs(np.log2(np.array(off[:-1]) / off[1:]) - 4.0) < 0.3), off


def test_both_coordinates_converge_to_the_same_motion():
    """The maximal ones are of order 2: extrapolated from 16 and 32 substeps, they err by 1e-8 or so."""
    coarse, fine = tip(16, "maximal"), tip(32, "maximal")
    assert np.linalg.norm(fine + (fine - coarse) / 3.0 - tip(48, "reduced")) < 1e-7


def energy(simulation):
    method, _ = trees_of(simulation)
    return method.indicators(None, None)["rigid_energy"]


@pytest.mark.slow
def test_a_free_chain_keeps_its_energy_for_ten_seconds():
    scene = chain_scene(["spherical"] * 19, True, fps=240, substeps=1, gravity=(0, 0, 0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    simulation.step()
    first = energy(simulation)
    simulation.run(2400)
    assert abs(energy(simulation) / first - 1.0) < 1e-4


def test_momenta_of_a_free_chain_stay():
    """RK4 keeps them to its own order; here steps are 1/960 s."""
    simulation = wsim.Simulation(chain_scene(["spherical"] * 5, True, substeps=16, gravity=(0, 0, 0)), device="cpu",
                                 precision="float64")
    simulation.load()
    simulation.step()
    method, _ = trees_of(simulation)

    def momenta():
        places = method.origin + method.get("x") + method.get("e")
        p = method.read("p")
        return np.concatenate([p.sum(0), (method.read("L") + np.cross(places, p)).sum(0)])
    before = momenta()
    simulation.run(30)
    assert np.abs(momenta() - before).max() < 1e-7 * np.abs(before).max()


def test_a_chain_carries_a_thousand_times_its_weight():
    """A double check of energy where sweeps joint by joint fail."""
    simulation = wsim.Simulation(heavy_chain(4), device="cpu", precision="float64")
    simulation.step()
    first = energy(simulation)
    simulation.run(120)
    swing = 0.5 * 1000.0 * 0.5**2
    assert not np.allclose(trees_of(simulation)[1].q.numpy(), 0.0, atol=0.01)
    assert abs(energy(simulation) - first) < 0.01 * swing


def test_a_restart_gives_the_same_bits(tmp_path):
    wsim.save(chain_scene(["spherical", "revolute", "prismatic"], True), tmp_path / "s.usda")
    half, rest = (str(tmp_path / f"{name}.usdc") for name in ("half", "rest"))

    def run(output: str, frames: int, restart: str | None = None):
        scene = replace(wsim.load(tmp_path / "s.usda"), frames=frames)
        job = prepare_recorded_run(scene, output, lambda s: wsim.Simulation(s, device="cpu"), restart=restart)
        job.frames()
        return job.simulation
    whole = run(str(tmp_path / "whole.usdc"), 12)
    run(half, 6)
    two = run(rest, 12, half)
    assert whole.scene.coordinates == two.scene.coordinates == "reduced"
    assert not any("bit for bit" in w for w in two.warnings)
    assert np.array_equal(trees_of(whole)[1].q.numpy(), trees_of(two)[1].q.numpy())
    assert np.array_equal(trees_of(whole)[1].qd.numpy(), trees_of(two)[1].qd.numpy())


def test_worlds_do_what_one_does():
    one = wsim.Simulation(chain_scene(["spherical", "revolute"], True), device="cpu")
    many = wsim.Simulation(chain_scene(["spherical", "revolute"], True), device="cpu", worlds=3)
    one.run(10)
    many.run(10)
    method, _ = trees_of(many)
    n = len(trees_of(one)[0].bodies)
    for world in range(3):
        assert np.array_equal(method.get("x")[world * n:(world + 1) * n], trees_of(one)[0].get("x"))


def test_what_has_no_reduced_coordinates_is_refused():
    scene = chain_scene(["revolute", "revolute"])
    scene.things("Joint")[1].drives = {"distance": Drive(1.0)}
    with pytest.raises(wsim.SceneError, match="coordinates is reduced, .*it has a drive along a distance"):
        wsim.Simulation(scene, device="cpu")
