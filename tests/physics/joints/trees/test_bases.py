"""Trees that hang from what keyframes move, in reduced coordinates."""

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import trees_of
from wsim import Box, Motion, Scene
from wsim.physics.rigid.joints.trees.bases import some_base_moves
from wsim.usd.result.restart import load_restart


def moved_by_keys(keys: int = 25):
    """A pivot that swings and turns for 1 s, straight between its keys: (times, frames)."""
    times, M = np.linspace(0.0, 1.0, keys), np.tile(np.eye(4), (keys, 1, 1))
    angle = 0.8 * times**2
    M[:, 0, 3] = 0.3 * np.sin(2.0 * np.pi * times) * times
    M[:, 0, 0], M[:, 0, 1] = np.cos(angle), -np.sin(angle)
    M[:, 1, 0], M[:, 1, 1] = np.sin(angle), np.cos(angle)
    return times, M


def pendulum_scene(coordinates: str, substeps: int, **settings) -> Scene:
    """Two rods below a pivot that moves; the second turns about a skew axis."""
    scene = Scene(coordinates=coordinates, fps=24, substeps=substeps, **settings)
    first = scene.body("/a", Box((0.02, 0.25, 0.02)), at=(0.0, -0.25, 0.0))
    second = scene.body("/b", Box((0.02, 0.25, 0.02)), at=(0.0, -0.75, 0.0))
    for body in (first, second):
        body.colliders[0].meets = False
    scene.joint("revolute", "/j", None, first, at=(0.0, 0.0, 0.0), axis=(0, 0, 1), motion=Motion(*moved_by_keys()))
    scene.joint("revolute", "/k", first, second, at=(0.0, -0.5, 0.0), axis=(0.6, 0, 0.8))
    return scene


def ends(scene: Scene, frames: int = 20) -> np.ndarray:
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(frames)
    poses = simulation.poses()
    return np.concatenate([poses[body.path][:3, 3] for body in scene.things("Body")])


def driven_pendulum(times: np.ndarray, x: np.ndarray, length: float, steps: int) -> float:
    """Angle [rad] at the end of a rod that hangs from a pivot at x [m] of so many times [s], straight between them, by rk4:

    I a'' = -m l (g sin a),   and at each time I (a' jumps) = -m l cos a (v' - v)          l: half of the rod, I = m (4 l^2) / 3
    """
    half = 0.5 * length
    k = half / (length**2 / 3.0)
    angle = rate = before = 0.0                                            # the rod starts at rest
    for n in range(len(times) - 1):
        v, h = (x[n + 1] - x[n]) / (times[n + 1] - times[n]), (times[n + 1] - times[n]) / steps
        rate -= k * np.cos(angle) * (v - before)
        before = v
        for _ in range(steps):
            f = [(rate, -9.81 * k * np.sin(angle))]
            for part in (0.5, 0.5, 1.0):
                f.append((rate + part * h * f[-1][1], -9.81 * k * np.sin(angle + part * h * f[-1][0])))
            angle += h / 6.0 * (f[0][0] + 2.0 * f[1][0] + 2.0 * f[2][0] + f[3][0])
            rate += h / 6.0 * (f[0][1] + 2.0 * f[1][1] + 2.0 * f[2][1] + f[3][1])
    return angle


def test_a_pendulum_whose_pivot_is_keyed_swings_as_its_equation_says():
    times = np.linspace(0.0, 1.0, 25)
    x = 0.3 * np.sin(2.0 * np.pi * times) * times
    M = np.tile(np.eye(4), (25, 1, 1))
    M[:, 0, 3] = x
    found = []
    for substeps in (4, 8):
        scene = Scene(coordinates="reduced", fps=24, substeps=substeps)
        rod = scene.body("/rod", Box((1e-4, 0.25, 1e-4)), at=(0.0, -0.25, 0.0))
        rod.colliders[0].meets = False
        scene.joint("revolute", "/pivot", None, rod, at=(0.0, 0.0, 0.0), axis=(0, 0, 1), motion=Motion(times, M))
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.run(23)
        found.append(trees_of(simulation)[1].q.numpy()[0])
    exact = driven_pendulum(times[:24], x[:24], 0.5, 64)
    off = np.abs(np.array(found) - exact)
    assert off[0] < 1e-5 and off[1] < 1e-6 and abs(exact) > 0.1


def test_a_tree_below_a_pivot_that_moves_converges_with_order_four_to_what_maximal_coordinates_do():
    coarse, fine = (ends(pendulum_scene("maximal", n)) for n in (32, 64))
    exact = fine + (fine - coarse) / 3.0
    off = [np.linalg.norm(ends(pendulum_scene("reduced", n)) - exact) for n in (4, 8)]
    assert off[0] < 2e-7 and abs(np.log2(off[0] / off[1]) - 4.0) < 0.3


def test_auto_takes_reduced_coordinates_where_what_a_tree_hangs_from_moves():
    scene = pendulum_scene("auto", 8)
    simulation = wsim.Simulation(scene, device="cpu")
    assert "reduced coordinates" in simulation.plan.describe() and some_base_moves(scene.things("Joint"))


def test_a_box_rides_on_a_link_that_keyframes_move():
    """Its platform goes from rest to 0.5 m/s within the grip of friction, and the box goes with it."""
    times = np.linspace(0.0, 1.0, 61)
    M = np.tile(np.eye(4), (61, 1, 1))
    M[:, 0, 3] = 0.25 * times**2
    scene = Scene(coordinates="reduced", fps=60, substeps=4)
    plate = scene.body("/plate", Box((0.5, 0.05, 0.5)), at=(0.0, 0.0, 0.0))
    scene.joint("fixed", "/mount", None, plate, at=(0.0, 0.0, 0.0), motion=Motion(times, M))
    scene.body("/box", Box((0.1, 0.1, 0.1)), at=(0.0, 0.15, 0.0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(59)
    poses = simulation.poses()
    assert poses["/plate"][0, 3] == pytest.approx(0.25 * (59 / 60)**2, abs=1e-6)
    assert poses["/box"][:3, 3] - poses["/plate"][:3, 3] == pytest.approx((0.0, 0.15, 0.0), abs=2e-3)
    assert trees_of(simulation)[0].velocities()[1, 0] == pytest.approx(0.5 * 59 / 60, abs=5e-3)


def test_a_loop_between_a_base_that_moves_and_one_that_stands_is_refused():
    scene = pendulum_scene("reduced", 4)
    scene.joint("spherical", "/end", None, scene.things("Body")[1], at=(0.0, -1.0, 0.0))
    with pytest.raises(wsim.SceneError, match="/j: what it hangs from moves, and a loop closes to what may move otherwise"):
        wsim.Simulation(scene, device="cpu")


def test_a_run_that_goes_on_from_a_file_takes_no_jump_twice(tmp_path):
    """The velocity of the base is state: half of a run, and its other half from the file, end at the same place."""
    whole = ends(pendulum_scene("reduced", 4), 12)
    simulation = wsim.Simulation(pendulum_scene("reduced", 4), device="cpu", precision="float64")
    with simulation.record(tmp_path / "half.usdc"):
        simulation.run(6)
    rest = wsim.Simulation(pendulum_scene("reduced", 4), device="cpu", precision="float64")
    state = load_restart(tmp_path / "half.usdc", rest.scene)
    rest.restart(state.frame, state.fields)
    rest.run(6)
    poses = rest.poses()
    assert np.array_equal(np.concatenate([poses[path][:3, 3] for path in ("/a", "/b")]), whole)
