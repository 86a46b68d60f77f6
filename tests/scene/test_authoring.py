"""Objects of all methods, added to a scene by name: what they are, that files keep them, and what is refused."""

import numpy as np
import pytest

import wsim
from wsim import Box, Plane, Scene, SceneError, Sphere


def everything() -> Scene:
    scene = Scene(frames=2, up="Z")
    scene.collider("/floor", Plane())
    post = scene.body("/post", Box((0.1, 0.1, 0.5)), at=(0, 0, 0.5), mass=2.0, dynamic_friction=0.3)
    scene.body("/door", Box((0.4, 0.02, 0.4)), at=(0.5, 0, 0.5), density=500.0, restitution=0.25)
    scene.joint("revolute", "/hinge", post, "/door", at=(0.1, 0, 0.5), axis=(0, 0, 1), low=-1.0, high=1.5)
    scene.joint("fixed", "/anchor", None, post)
    scene.rods("/rope", [(0.1 * k, 2, 1) for k in range(5)], counts=[5], diameters=0.01)
    scene.smoke_source("/fire", scene.smoke("/air", (-1, 3, 0), (1, 5, 2), 0.25), Sphere(0.3), at=(0, 4, 0.3), smoke=5.0)
    scene.liquid_source("/water", scene.liquid("/tank", (-1, 6, 0), (1, 8, 1), 0.25), Box((1, 1, 0.25)), at=(0, 7, 0.25))
    return scene


def test_objects_of_methods_are_where_they_are_put():
    scene = everything()
    post, door = scene.things("Body")
    assert (post.mass, door.density) == (2.0, 500.0)
    assert (post.colliders[0].dynamic_friction, door.colliders[0].restitution) == (0.3, 0.25)
    hinge, anchor = scene.things("Joint")
    assert hinge.limits["rotX"] == (-1.0, 1.5) and (anchor.body0, anchor.body1) == ("", "/post")
    assert np.allclose(hinge.at1 + (0.5, 0, 0.5), (0.1, 0, 0.5)) and np.allclose(hinge.at0 + (0, 0, 0.5), (0.1, 0, 0.5))
    assert scene.things("Source")[0].fluid == "/air" and scene.things("LiquidSource")[0].liquid == "/tank"
    assert np.allclose(scene.things("Source")[0].place, (0, 4, 0.3))


def test_a_file_keeps_them(tmp_path):
    scene = everything()
    wsim.save(scene, tmp_path / "all.usda")
    found = wsim.load(tmp_path / "all.usda")
    assert {name: [thing.path for thing in things] for name, things in found.objects.items()} == \
           {name: [thing.path for thing in things] for name, things in scene.objects.items()}
    assert [found.things(name)[k] == thing for name, things in scene.objects.items() for k, thing in enumerate(things)
            if name in ("Source", "Fluid", "Liquid", "LiquidSource", "Rods")] == [True] * 5


@pytest.mark.parametrize("wrong, said", [
    (lambda s: s.joint("ball", "/j", "/post"), "kind is 'ball'; allowed is one of fixed, revolute, prismatic, spherical"),
    (lambda s: s.joint("fixed", "/j", "/gate"), "which is no rigid body or collider of the scene; there are: /post, /door"),
    (lambda s: s.collider("/b", Sphere(0.1), motion=(0, 1, 0)), "motion is .0, 1, 0.; allowed is a Motion"),
    (lambda s: s.body("/b", Sphere(0.1), at=(0, 1, 0), motion=wsim.Motion.still()), "beside a motion, which says where it is")])
def test_what_is_none_is_refused(wrong, said):
    with pytest.raises(SceneError, match=said):
        wrong(everything())


def test_a_scene_says_what_it_holds():
    """In a line, not by its arrays."""
    said = repr(everything())
    assert said.startswith("<Scene: 1 collider, 2 bodies, 2 joints, 1 rod prim, 1 fluid, 1 source, 1 liquid, 1 liquid source; ")
    assert repr(Scene()).startswith("<Scene: nothing; 96 frames of 1/24 s")
