"""Rigid bodies on triangle meshes that stand, against closed forms and against the plane they lie in."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import G, Seen, ball, box, tilted
from tests.make.physics.rigid.narrow.triangles import cube, floor
from tests.physics.rigid.pairs import WHERE
from wsim.physics.rigid.solids import contact_shape_of
from wsim.scene import Collider, Scene, Surface, shapes
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def grid(n: int, wide: float = 10.0) -> Surface:
    """A square in y = 0 about the origin of 2 n^2 triangles, its diagonals laid at random."""
    points, faces = floor(n)
    points = points[:, [1, 2, 0]] * (0.5 * wide)               # the normal up, along y
    return Surface(points, np.full(len(faces), 3), faces.ravel())


def on(surface: Surface, *bodies, gravity=(0.0, -G, 0.0), rub: float = 0.5, still=None, **more) -> Simulation:
    """Over a mesh; far away fall what else there is, for kernels that all tests share."""
    scene = Scene(gravity=gravity, fps=60.0, substeps=8)
    scene.collider("/ground", surface, motion=still or Motion.still(), static_friction=rub, dynamic_friction=rub)
    for body in (*bodies, ball("/far/ball", (90.0, 0.5, 0.0), rest=0.5), box("/far/box", (90.0, 0.5, 5.0)),
                 lump("/far/lump", (90.0, 0.5, 10.0))):
        scene.add(body)
    return Simulation(scene, **WHERE | {"precision": "float64"} | more)


def lump(path: str, at):
    """A cube of 40 cm as a mesh."""
    found = box(path, at)
    found.colliders = [Collider(f"{path}/shape", Surface(*shapes.box((0.2, 0.2, 0.2))))]
    return found


@pytest.mark.parametrize("n", [1, 32])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_box_slides_over_triangles_as_far_as_friction_lets_it_and_does_not_catch(n, precision):
    """2 and 2048 triangles: v^2 / (2 mu g); along edges, across them and over their corners; it leaves its line by nothing."""
    sim = on(grid(n), box("/box", (-2.0, 0.5, 0.1), velocity=(3.0, 0.0, 0.0)), precision=precision)
    highest = 0.0
    for _ in range(80):
        sim.step()
        highest = max(highest, float(Seen(sim).at("/box")[1]))
    seen = Seen(sim)
    assert abs((seen.at("/box")[0] + 2.0) / (9.0 / (2.0 * 0.5 * G)) - 1.0) < 1e-2
    assert highest < 0.5 + 1e-4 and abs(seen.at("/box")[2] - 0.1) < 1e-3 and np.abs(seen.speed("/box")).max() < 1e-4


@pytest.mark.parametrize("n", [1, 32])
def test_a_ball_rolls_over_triangles_at_five_sevenths_of_the_slope(n):
    sim = on(grid(n, 20.0), ball("/ball", (-5.0, 0.5, 0.3)), gravity=tilted(10.0))
    sim.run(120)
    expected = 5.0 / 7.0 * G * np.sin(np.radians(10.0)) * 2.0
    assert abs(Seen(sim).speed("/ball")[0] / expected - 1.0) < 1e-2
    assert abs(Seen(sim).at("/ball")[1] - 0.5) < 1e-3 and abs(Seen(sim).at("/ball")[2] - 0.3) < 1e-2


def test_boxes_stand_on_triangles_at_rest_and_a_column_of_them_sinks_no_more_than_on_a_plane():
    sim = on(grid(16), *[box(f"/box{k}", (0.3, 0.5 + k, 0.2)) for k in range(5)])
    sim.run(300)
    assert 4.5 - Seen(sim).at("/box4")[1] < 3e-3 and np.abs(Seen(sim).v[:5]).max() < 1e-3
    assert abs(Seen(sim).at("/box4")[0] - 0.3) < 1e-3


def test_a_sheet_holds_what_lies_under_it_too():
    """Weight upward: a box is pressed against a floor from below, over 512 triangles."""
    sim = on(grid(16), box("/box", (0.3, -0.6, 0.2)), gravity=(0.0, G, 0.0))
    sim.run(120)
    assert abs(Seen(sim).at("/box")[1] + 0.5) < 1e-3 and np.abs(Seen(sim).speed("/box")).max() < 1e-4


def bowl(rings: int = 12, sides: int = 48) -> Surface:
    """Half a sphere of 2 m, open above."""
    theta = np.linspace(0.5 * np.pi, 0.0, rings + 1)[1:-1]
    phi = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rim = [np.stack([2.0 * np.sin(a) * np.cos(phi), np.full(sides, -2.0 * np.cos(a)), 2.0 * np.sin(a) * np.sin(phi)], -1)
           for a in theta]
    points = np.concatenate([*rim, [[0.0, -2.0, 0.0]]])
    faces = []
    for r in range(len(theta) - 1):
        for k in range(sides):
            a, b = r * sides + k, r * sides + (k + 1) % sides
            faces += [(a, b, a + sides), (b, b + sides, a + sides)]
    last = (len(theta) - 1) * sides
    faces += [(last + k, last + (k + 1) % sides, len(points) - 1) for k in range(sides)]
    return Surface(points, np.full(len(faces), 3), np.ravel(faces))


def test_what_falls_into_a_bowl_comes_to_rest_at_its_bottom():
    """A box and a hull on many normals at a time; the ball, which nothing brakes, rolls on. No energy is gained."""
    sim = on(bowl(), box("/box", (0.5, -0.5, 0.2), (0.3, 0.2, 0.2)), ball("/ball", (0.0, 0.3, -0.6), 0.25),
             lump("/hull", (-0.6, -0.3, 0.0)))
    energy = sim.indicators()["rigid_energy"]
    for _ in range(300):
        sim.step()
        now = sim.indicators()["rigid_energy"]
        assert now < energy + 1.0                                  # [J] of some thousand
        energy = min(energy, now)
    seen = Seen(sim)
    assert np.abs(seen.v[[0, 2]]).max() < 1e-3 and all(np.linalg.norm(seen.at(p)) < 2.0 for p in ("/box", "/ball", "/hull"))


def test_a_mesh_that_moves_carries_a_box_along():
    times, frames = np.array([0.0, 10.0]), np.tile(np.eye(4), (2, 1, 1))
    frames[1, 0, 3] = 10.0
    sim = on(grid(8), box("/box", (0.0, 0.5, 0.0)), still=Motion(times, frames))
    sim.run(120)
    assert np.abs(Seen(sim).speed("/box") - (1.0, 0.0, 0.0)).max() < 1e-4


def test_more_pairs_with_a_mesh_than_there_is_room_for_repeat_the_frame():
    """Thirty-four boxes on one mesh take eight rows each, where there is room for 256 in all."""
    sim = on(grid(8), *[box(f"/box{k}", (-4.0 + 0.24 * k, 0.1, 0.0), (0.1, 0.1, 0.1)) for k in range(34)], precision="float32")
    sim.run(30)
    assert any("pairs of rigid shapes" in w and "repeated" in w for w in sim.repeats)
    assert np.abs(Seen(sim).v[:34]).max() < 1e-3 and abs(Seen(sim).at("/box33")[1] - 0.1) < 1e-3


def test_runs_over_a_mesh_are_the_same_to_the_bit():
    def ends() -> bytes:
        sim = on(bowl(6, 16), box("/box", (0.5, -0.5, 0.2), (0.3, 0.2, 0.2)), ball("/ball", (0.0, 0.3, -0.6), 0.25),
                 precision="float32")
        sim.run(60)
        return b"".join(sim.plan.method("rigid").part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))
    assert ends() == ends()


def closed() -> Surface:
    points, faces = cube()
    return Surface(0.5 * points + (3.0, 0.0, 0.0), np.full(12, 3), faces.ravel())


@pytest.mark.parametrize("approximation, kind", [
    ("none", "mesh"), ("meshSimplification", "mesh"), ("sdf", "mesh"), ("convexHull", "hull"),
    ("convexDecomposition", "mesh"),
    ("boundingCube", "box"), ("boundingSphere", "sphere")])
def test_a_mesh_that_stands_is_met_as_its_approximation_says(approximation, kind):
    """A bowl, hollow and open; a cube is convex, and its own hull whatever is said but for the bounds."""
    met = contact_shape_of(Collider("/c", bowl(), approximation=approximation), False)
    assert met.kind == kind
    cubic = contact_shape_of(Collider("/c", closed(), approximation=approximation), False)
    assert cubic.kind == (kind if kind in ("box", "sphere") else "hull")


@pytest.mark.parametrize("approximation, height", [("boundingCube", 1.0), ("boundingSphere", 0.5 + np.sqrt(0.75))])
def test_a_ball_rests_on_the_bounds_of_a_mesh(approximation, height):
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0, substeps=8)
    scene.add(ball("/ball", (3.0, height + 0.01, 0.0)))
    scene.collider("/bounds", closed(), approximation=approximation)
    sim = Simulation(scene, **WHERE, precision="float64")
    sim.run(60)
    assert abs(Seen(sim).at("/ball")[1] - height) < 1e-3
