"""Concave bodies touch as the meshes that they are: links, rings, gears and bowls, against closed forms."""

import numpy as np
import pytest

from tests.physics.rigid.concave.meshes import bowl, gear, ring
from wsim import Capsule, Collider, Motion, Plane, Scene, Simulation, Sphere
from wsim.physics.rigid.joints.joint import Drive

FACING_X = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])          # z of a ring to x, and to y
FACING_Y = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
R, TUBE = 1.0, 0.25
SAG = 0.5 * 9.81 / 480**2          # [m] a third of g h^2 is what a soft contact sinks by under a body's own weight


def place(turn: np.ndarray, at) -> Motion:
    M = turn.copy()
    M[:3, 3] = at
    return Motion.still(M)


def hanging_chain(links: int, size: float, weight: float = 1.0) -> Scene:
    """Rings in each other below one that stands; the last has the mass of so many."""
    scene, shape = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, -9.81), up="Z"), ring(R * size, TUBE * size)
    pitch = 2.0 * (R - TUBE) - 2e-3
    for k in range(links + 1):
        motion = place(FACING_X if k % 2 else FACING_Y, (0, 0, -k * pitch * size))
        if k == 0:
            scene.collider("/hook", shape, motion=motion)
        else:
            scene.body(f"/link{k}", shape, motion=motion, density=1000.0 * (weight if k == links else 1.0))
    return scene


def heights(simulation: Simulation, links: int) -> np.ndarray:
    return np.array([simulation.poses(f"/link{k}")[f"/link{k}"][2, 3] for k in range(1, links + 1)])


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_three_links_hang_by_twice_their_inner_radius_each(size):
    """Corners of both rings lie where they touch: the distance is 2 (R - r), less what soft contacts sink by."""
    simulation = Simulation(hanging_chain(3, size), device="cpu")
    simulation.run(90)
    gap = np.diff(np.concatenate([[0.0], heights(simulation, 3) / size])) + 2.0 * (R - TUBE)
    assert np.abs(gap).max() < 1e-3 + 3 * SAG / size


@pytest.mark.slow
def test_a_chain_of_twelve_links_carries_ten_of_them():
    simulation = Simulation(hanging_chain(12, 1.0, 10.0), device="cpu")
    simulation.run(20)
    before = heights(simulation, 12)
    simulation.run(100)
    after = heights(simulation, 12)
    gap = np.diff(np.concatenate([[0.0], after])) + 2.0 * (R - TUBE)
    assert np.abs(gap).max() < 2e-3 and after[-1] <= before[-1] + 1e-3


def test_links_are_the_same_to_the_bit_from_run_to_run():
    def hang() -> bytes:
        simulation = Simulation(hanging_chain(2, 1.0), device="cpu")
        simulation.run(12)
        return b"".join(simulation.poses(f"/link{k}")[f"/link{k}"].tobytes() for k in (1, 2))
    assert hang() == hang()


def test_a_ring_on_a_peg_rests_on_the_lowest_place_of_its_tube():
    """A capsule across a hole: the centre hangs below the axis of the peg by R - r - radius."""
    scene = Scene(fps=60, substeps=8, gravity=(0, 0, -9.81), up="Z")
    scene.collider("/peg", Capsule(0.2, 1.0), motion=place(FACING_X, (0, 0, 0)))
    scene.body("/ring", ring(R, TUBE), motion=place(FACING_X, (0, 0, -0.54)))
    simulation = Simulation(scene, device="cpu")
    simulation.run(60)
    at = simulation.poses("/ring")["/ring"][:3, 3]
    assert abs(at[2] + (R - TUBE - 0.2)) < 1e-3 and abs(at[1]) < 1e-3


def test_a_mug_swings_on_a_hook_by_its_handle():
    """A cup with a ring for a handle, 10 cm wide, on a ring that stays: it hangs on, and swings."""
    scene = Scene(fps=60, substeps=16, iterations=4, gravity=(0, 0, -9.81), up="Z")
    handle, tube = 0.03, 0.006
    scene.collider("/hook", ring(handle, tube, 24, 12), motion=place(FACING_X, (0, 0, 0)))
    cup = Collider("/mug/cup", bowl(0.05, 0.006), motion=Motion.still(np.array([[0, 0, 1, 0.085], [0, 1, 0, 0], [-1, 0, 0, 0],
                                                                                [0, 0, 0, 1.0]])))
    mug = scene.body("/mug", colliders=[Collider("/mug/handle", ring(handle, tube, 24, 12), motion=place(FACING_Y, (0, 0, 0))),
                                        cup], density=2300.0, at=(0, 0, -2.0 * (handle - tube) + 1e-4), spin_drag=1.0)
    simulation = Simulation(scene, device="cpu")
    far, low = [], []
    for _ in range(90):
        simulation.step()
        pose = simulation.poses("/mug")[mug.path]
        far.append(np.linalg.norm(pose[:3, 3]))
        low.append((pose @ [0.085, 0.0, 0.0, 1.0])[2])
    assert max(far) < 2.0 * handle and min(low) < -0.1


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_a_ring_lies_on_a_floor(size):
    scene = Scene(fps=60, substeps=8, gravity=(0, 0, -9.81), up="Z")
    scene.collider("/floor", Plane("Z"))
    scene.body("/ring", ring(R * size, TUBE * size), at=(0, 0, 0.2505 * size))
    simulation = Simulation(scene, device="cpu")
    simulation.run(40)
    pose = simulation.poses("/ring")["/ring"]
    assert abs(pose[2, 3] / size - TUBE) < 1e-3 + SAG / size and pose[2, 2] > 1.0 - 1e-6


def test_a_bowl_that_slides_keeps_its_balls():
    scene = Scene(fps=60, substeps=8, gravity=(0, 0, -9.81), up="Z")
    scene.collider("/floor", Plane("Z"))
    scene.body("/bowl", bowl(1.0, 0.1), at=(0, 0, 1.0), density=2000.0, velocity=(1.0, 0, 0))
    for k in range(3):
        scene.body(f"/ball{k}", Sphere(0.15), at=(0.4 * np.cos(2.1 * k), 0.4 * np.sin(2.1 * k), 0.6))
    simulation = Simulation(scene, device="cpu")
    simulation.run(90)
    cup = simulation.poses("/bowl")["/bowl"]
    far = [np.linalg.norm(simulation.poses(f"/ball{k}")[f"/ball{k}"][:3, 3] - cup[:3, 3]) for k in range(3)]
    assert max(far) < 0.9 - 0.15 + 2e-3 and cup[0, 3] > 0.05


@pytest.mark.parametrize("coordinates", ["maximal", "reduced"])
def test_two_gears_turn_at_the_ratio_of_their_teeth(coordinates):
    """12 teeth drive 20. What is left over many turns is the play between teeth, 0.06 modules of 0.1 m on a radius of 1 m."""
    scene = Scene(fps=60, substeps=8, gravity=(0, 0, 0), up="Z", coordinates=coordinates)
    one = scene.body("/one", gear(12, 0.1, 0.2), dynamic_friction=0.0, static_friction=0.0)
    turn = np.pi * (1.0 + 1.0 / 20)
    M = np.eye(4)
    M[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    two = scene.body("/two", gear(20, 0.1, 0.2), motion=place(M, (1.6, 0, 0)), spin_drag=1.0, dynamic_friction=0.0,
                     static_friction=0.0)
    drive = Drive(damping=1e4, speed=2.0 * np.pi, acceleration=True)
    scene.joint("revolute", "/axle1", None, one, axis=(0, 0, 1), drives={"rotX": drive})
    scene.joint("revolute", "/axle2", None, two, at=(1.6, 0, 0), axis=(0, 0, 1))
    simulation = Simulation(scene, device="cpu")
    turned, last = np.zeros(2), np.array([0.0, turn])
    for _ in range(90):
        simulation.step()
        now = np.array([np.arctan2(p[1, 0], p[0, 0]) for p in (simulation.poses(x)[x] for x in ("/one", "/two"))])
        turned += np.mod(now - last + np.pi, 2 * np.pi) - np.pi
        last = now
    assert abs(turned[0] - 3.0 * np.pi) < 0.1
    assert abs(turned[1] + turned[0] * 12 / 20) < 2.0 * 0.06 * 0.1
