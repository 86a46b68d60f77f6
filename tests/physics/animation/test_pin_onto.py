"""`scene.pin(..., onto=collider)`: points go as the collider goes, by keys or by a skeleton; what has no sense is refused."""

import numpy as np
import pytest

import wsim
from tests.make.physics.animation.lying import lying_cube
from tests.physics.animation.make import bones, skin
from wsim.physics.animation.skinning import nearest_triangles, triangle_distances
from wsim.scene import Plane, Scene, SceneError, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

KEYS = Motion.through([0.0, 0.1, 0.3], [(0, 0, 0), (0.1, 0.2, 0), (0, 0.3, 0.2)],
                      [(0, 0, 0, 1), (0, np.sin(0.3), 0, np.cos(0.3)), (np.sin(0.2), 0, 0, np.cos(0.2))], kind="linear")


def cube_scene() -> tuple[Scene, wsim.Collider]:
    skeleton, skinned, counts, indices = lying_cube()
    scene = Scene(fps=24.0, frames=3, substeps=4)
    scene.add(skeleton)
    return scene, scene.collider("/man/body", Surface(skinned.at(0.0), counts, indices, poses=skinned), motion=skeleton.motion)


def rag(scene: Scene):
    return scene.cloth("/rag", *shapes.sheet(0.1, 0.1, 4, 4, horizontal=True, at=(0.05, 0.16, 0.02)))


def test_points_on_skin_of_one_joint_go_as_the_joint_goes():
    """x(t) = M(t) M(0)^-1 x(0), over faces that are quads."""
    scene, man = cube_scene()
    cloth = rag(scene)
    pin = scene.pin("/held", cloth, range(5), onto=man)
    simulation = Simulation(scene, device="cpu", precision="float64")
    joint, start = scene.things("Skeleton")[0].joint_motion("hip"), cloth.points[:5]
    assert pin.target == "/man/body" and np.isfinite(pin.follows.places).all()
    for _ in range(3):
        simulation.step()
        M = joint.at(simulation.frame / scene.fps) @ np.linalg.inv(joint.at(0.0))
        assert np.abs(simulation.positions("/rag")[:5] - start @ M[:3, :3].T - M[:3, 3]).max() < 1e-7


@pytest.mark.parametrize("shape", [Sphere(0.1), Surface(*shapes.sphere(0.1, 12))], ids=["sphere", "mesh"])
def test_points_on_a_collider_that_moves_by_keys_go_with_its_frame(shape):
    scene = Scene(fps=24.0, frames=3, substeps=4)
    ball, cloth = scene.collider("/ball", shape, motion=KEYS), rag(scene)
    scene.pin("/held", "/rag", [0, 4], onto="/ball")
    simulation = Simulation(scene, device="cpu", precision="float64")
    for _ in range(3):
        simulation.step()
        M = ball.motion.at(simulation.frame / scene.fps) @ np.linalg.inv(ball.motion.at(0.0))
        assert np.abs(simulation.positions("/rag")[[0, 4]] - cloth.points[[0, 4]] @ M[:3, :3].T - M[:3, 3]).max() < 1e-7


def test_a_saved_pin_holds_the_same_faces(tmp_path):
    scene, man = cube_scene()
    pin = scene.pin("/held", rag(scene), range(5), onto=man)
    wsim.save(scene, tmp_path / "s.usda")
    again = wsim.load(tmp_path / "s.usda")
    assert np.array_equal(again.pins[0].follows.faces, pin.follows.faces)
    assert np.abs(again.pins[0].follows.places - pin.follows.places).max() < 1e-7
    one, two = (Simulation(each, device="cpu") for each in (scene, again))
    one.run(2), two.run(2)
    assert np.abs(one.positions("/rag") - two.positions("/rag"))[:5].max() < 1e-6        # the rest crumples


def animated_sheet(scene: Scene):
    points, counts, indices = shapes.sheet(0.2, 0.2, 2, 2)
    return scene.collider("/sheet", Surface(points, counts, indices, poses=Curve([0.0, 1.0], np.stack([points, points + 0.1]))))


@pytest.mark.parametrize("wrong, text", [
    (lambda s, man: s.pin("/p", "/rag", [0], onto="/nobody"), "onto is '/nobody', which is no collider of the scene; there"),
    (lambda s, man: s.pin("/p", "/rug", [0], onto=man), "body is '/rug', which is no body with points of the scene"),
    (lambda s, man: s.pin("/p", "/rag", [0], onto=s.body("/ball", Sphere(0.1))), "onto is '/ball', which is no collider"),
    (lambda s, man: s.pin("/p", "/rag", [25], onto=man), "holds points 25 to 25 of /rag; allowed is 0 to 24"),
    (lambda s, man: s.pin("/p", "/rag", [0], onto=man, motion=KEYS), "has motion, beside onto=/man/body"),
    (lambda s, man: s.pin("/p", "/rag", [0], onto=man, places=[(0, 0, 0)]), "has places, beside onto=/man/body"),
    (lambda s, man: s.pin("/p", "/rag", [0], onto=animated_sheet(s)), "whose points are animated; allowed are meshes that a"),
    (lambda s, man: s.pin("/p", s.rods("/r", np.eye(3), [3]), [0], onto=man), "fix: rods.pin_roots(path, collider)")])
def test_what_has_no_sense_is_refused_in_one_line_and_adds_no_pin(wrong, text):
    scene, man = cube_scene()
    rag(scene)
    with pytest.raises(SceneError) as error:
        wrong(scene, man)
    assert text in str(error.value) and len(str(error.value)) <= 300 and not scene.all_pins()


def test_a_plane_that_stands_still_holds_points_where_they_are():
    scene = Scene(frames=2)
    cloth = rag(scene)
    scene.pin("/held", cloth, range(5), onto=scene.collider("/floor", Plane()))
    simulation = Simulation(scene, device="cpu")
    simulation.run(2)
    assert np.abs(simulation.positions("/rag")[:5] - cloth.points[:5]).max() < 1e-6


def test_the_nearest_triangle_is_that_of_all_distances():
    rng = np.random.default_rng(2)
    points, counts, indices = shapes.sphere(0.3, 24)
    corners = skin(rng, bones(rng), points).at(0.0)[indices.reshape(-1, 3)] + (50.0, 0.0, 0.0)
    corners[7] = corners[7, 0]                                                     # no area: never chosen
    x = rng.normal(size=(40, 3)) + (50.0, 0.0, 0.0)
    sound = np.flatnonzero(np.arange(len(corners)) != 7)
    expected = [sound[np.argmin(triangle_distances(corners[sound], np.tile(place, (len(sound), 1))))] for place in x]
    assert np.array_equal(nearest_triangles(corners, x), expected)
