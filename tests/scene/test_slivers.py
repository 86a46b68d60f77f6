"""The triangles that hold explicit steps down, against eigenvalues of one triangle's stiffness and mass."""

import numpy as np
import pytest

from wsim.scene import Scene, shapes
from wsim.scene.check.slivers import describe_slivers, triangle_frequencies
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

FABRIC = Fabric(stretch=800.0, thickness=1e-3, density=300.0, poisson=0.3)


def highest(p: np.ndarray) -> float:
    """Highest frequency [rad/s] of a triangle (3, 2) whose stress is E / (1 - nu^2) times the gradient of its displacement."""
    area = 0.5 * abs(np.linalg.det(p[1:] - p[:1]))
    inverse = np.linalg.inv(np.c_[np.ones(3), p])               # barycentric coordinates are rows of 1, x, y times it
    g = inverse[1:].T
    K = area * FABRIC.stretch / (1.0 - FABRIC.poisson**2) * g @ g.T
    return float(np.sqrt(np.linalg.eigvalsh(K).max() / (FABRIC.density * FABRIC.thickness * area / 3.0)))


@pytest.mark.parametrize("p", [[(0, 0), (1, 0), (0, 1)], [(0, 0), (0.3, 0), (0.15, 1e-4)], [(0, 0), (2, 0.1), (1.0, 3.0)]])
def test_a_triangle_is_as_fast_as_its_stiffness_over_its_mass(p):
    p = np.array(p, np.float64)
    cloth = Scene().cloth("/cloth", np.c_[p, np.zeros(3)], [3], [0, 1, 2], material=FABRIC)
    omega, face = triangle_frequencies(cloth)
    assert omega == pytest.approx([highest(p)], rel=1e-9) and face.tolist() == [0]


def test_a_sliver_is_named_by_its_face_and_a_grid_has_none():
    scene = Scene()
    points, counts, indices = shapes.sheet(1.0, 1.0, 6, 6)
    scene.cloth("/good", points, counts, indices, material=FABRIC)
    assert describe_slivers(scene) == []
    flat = np.array([[3.0, 0.0, 0.0], [3.2, 0.0, 0.0], [3.1, 1e-4, 0.0]])
    scene.cloth("/bad", np.r_[points, flat], [*counts, 3], [*indices, len(points), len(points) + 1, len(points) + 2],
                material=FABRIC)
    (text,) = describe_slivers(scene)
    assert text.startswith("/bad: 1 of 73 triangles") and f"faces {len(counts)}" in text


def thin(self_collision: bool) -> Scene:
    """A sheet of 9 x 9 points, two of which are 10 um apart."""
    points, counts, indices = shapes.sheet(0.4, 0.4, 8, 8, horizontal=True)
    points[40] = points[41] - (1e-5, 0.0, 0.0)
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0)
    scene.cloth("/cloth", points, counts, indices, material=FABRIC, self_collision=self_collision)
    return scene


def test_a_run_that_slivers_make_dear_says_which_faces():
    """A grid needs some tens of substeps, the sliver thousands."""
    (text,) = [w for w in Simulation(thin(False), device="cpu").warnings if "substeps" in w]
    assert text.startswith("warning: /cloth: a frame takes ") and "scene names 10: 2 of 128 triangles are over 10 times" in text
    assert "the worst are faces 57, 73 (move their corners apart" in text
    even = thin(False)
    even.cloths[0].points[40] = (0.0, 0.0, 0.0)
    assert not [w for w in Simulation(even, device="cpu").warnings if "substeps" in w]


def test_auto_knows_what_a_substep_of_self_contact_costs():
    """6889 substeps of leapfrog, which took two minutes to record, where XPBD takes a few hundred."""
    choice = Simulation(thin(True), device="cpu").plan.choice
    assert choice.solver == "xpbd" and choice.substeps < 500


def test_a_frame_whose_launches_have_no_room_is_not_recorded_and_has_the_same_bits(monkeypatch):
    """55008 substeps of self-contact would take 25 GB, and the process with them."""
    found = []
    for free in (np.inf, 1e3):
        monkeypatch.setattr("wsim.simulation.measure.memory.free_bytes", lambda device, free=free: free)
        monkeypatch.setattr("wsim.simulation.plan.SMALL", 1.0)
        scene = thin(True)
        scene.solver, scene.substeps = "xpbd", 4
        sim = Simulation(scene, device="cpu")
        sim.run(2)
        found.append((sim.positions(), bool(sim.graphs), [w for w in sim.warnings if "launched one by one" in w]))
    assert found[0][1:] == (True, []) and not found[1][1] and "GiB, more than half of what is free" in found[1][2][0]
    assert np.array_equal(found[0][0], found[1][0])
