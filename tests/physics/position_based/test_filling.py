"""Shapes that grains and fluids fill, and what grains do where nobody says how they roll."""

import numpy as np
import pytest

import wsim
from wsim import Box, Capsule, Motion, Plane, Scene, Simulation, Sphere, Surface, shapes
from wsim.physics.position_based import objects
from wsim.physics.position_based.filling import fill_with_particles
from wsim.physics.position_based.objects import Grains, Pour

R = 0.005


@pytest.mark.parametrize("shape", [Box((0.03, 0.04, 0.02)), Sphere(0.04), Capsule(0.02, 0.03)])
def test_balls_lie_within_a_shape_and_none_stands_straight_on_another(shape):
    x = fill_with_particles("/p", shape, R)
    apart = np.linalg.norm(x[:, None] - x[None], axis=-1) + np.eye(len(x))
    assert apart.min() >= 2 * R * (1 - 1e-9) and len(x) > 40
    assert (wsim.scene.solids.shape_row(shape).distance(shape, x) <= -R * (1 - 1e-6)).all()
    for axis in range(3):
        way = np.abs(x[:, None] - x[None])
        over = (way[..., axis] < 2.5 * R) & (np.delete(way, axis, axis=-1) < R).all(axis=-1)
        assert np.count_nonzero(over) == len(x)                         # each over itself alone


def test_there_are_as_many_grains_as_on_a_cubic_lattice():
    """Of a large ball, where its surface counts little: 1 / (2.2 r)^3 in a volume, less a layer at the surface."""
    x = fill_with_particles("/p", Sphere(0.2), R)
    assert len(x) == pytest.approx(4 / 3 * np.pi * (0.2 - 1.2 * R)**3 / (2.2 * R)**3, rel=0.01)


def test_a_fluid_fills_a_box_by_its_density():
    x = fill_with_particles("/p", Box((0.03, 0.02, 0.04)), R, "fluid")
    assert len(x) == 6 * 4 * 8 and (np.abs(x).max(axis=0) <= [0.025 + 1e-9, 0.015 + 1e-9, 0.035 + 1e-9]).all()


def test_a_mesh_is_filled_as_the_box_that_it_is():
    points, counts, indices = shapes.box((0.05, 0.05, 0.05))
    x = fill_with_particles("/p", Surface(points, counts, indices), R)
    assert np.abs(x).max() < 0.05 + R and len(x) == pytest.approx(0.1**3 / (2.2 * R)**3, rel=0.15)


def collapse(**more):
    """(height, radius) of what is left of a block of grains, four times as high as its half width, over those at the start."""
    scene = Scene(fps=60, substeps=8, iterations=4)
    scene.collider("/floor", Plane())
    scene.particles("/grains", Box((0.035, 0.07, 0.035)), at=(0, 0.072, 0), radius=0.004, **more)
    simulation = Simulation(scene, device="cpu")
    simulation.run(75)
    x = simulation.positions("/grains")
    return x[:, 1].max() / 0.14, np.quantile(np.hypot(x[:, 0], x[:, 2]), 0.98) / 0.035


def test_a_block_of_grains_falls_in_a_heap_as_sand_does():
    """Lube, Huppert, Sparks, Freundt 2005: a column of sand of aspect a = h / r keeps 0.88 r a^(1/6), and reaches
    (1 + 1.6 a^(1/2)) r. A heap of a few hundred grains has no thin foot: it reaches less."""
    height, reach = collapse()
    assert height == pytest.approx(0.88 * 4 ** (1 / 6) / 4, rel=0.35) and 2.0 < reach < 1 + 1.6 * 2


def test_grains_that_do_not_turn_stand_steeper():
    height, reach = collapse(material=Grains(rolling_friction=np.inf))
    assert height > 0.5 and reach < 2.0


def grains_of_run(**more):
    scene = Scene(fps=60, frames=4, substeps=4, iterations=2)
    scene.collider("/floor", Plane())
    scene.particles("/p", Box((0.02, 0.02, 0.02)), at=(0, 0.1, 0), radius=R, **more)
    scene.particles("/q", Box((0.02, 0.02, 0.02)), at=(0.1, 0.1, 0), radius=R, velocity=(0, -1, 0), pour=Pour())
    return scene, Simulation(scene, device="cpu")


def test_grains_roll_by_default_and_where_they_are_many_do_not(monkeypatch):
    scene, few = grains_of_run()
    assert few.plan.method("grains").rolling and not few.warnings
    assert scene.things("Particles")[0].material.rolling_friction is None                       # the author's stays
    monkeypatch.setattr(objects, "TURNING", 40)
    _, many = grains_of_run()
    assert many.plan.method("grains").rolling is None
    assert sum("do not turn" in str(line) for line in many.warnings) == 2                           # of each prim
    _, mixed = grains_of_run(material=Grains(rolling_friction=0.1))
    assert mixed.plan.method("grains").rolling and sum("do not turn" in str(line) for line in mixed.warnings) == 1


def test_a_saved_scene_keeps_what_its_author_said(tmp_path):
    scene, simulation = grains_of_run(material=Grains(rolling_friction=np.inf))
    with simulation.record(tmp_path / "out.usdc"):
        simulation.run(2)
    wsim.save(scene, tmp_path / "scene.usda")
    for name in ("scene.usda", "out_scene.usda"):
        again = wsim.load(tmp_path / name).things("Particles")
        assert [thing.material.rolling_friction for thing in again] == [np.inf, None]


def test_triangles_alone_make_a_surface():
    points, counts, indices = shapes.sphere(0.1, 8)
    triangles = wsim.geometry.triangulate.triangulate_polygons(points, counts, indices)[0]
    one, other = Surface(points, triangles), Surface(points, np.full(len(triangles), 3), triangles.ravel())
    assert one == other
    assert Scene().cloth("/c", points, triangles) == Scene().cloth("/c", points, [3] * len(triangles), triangles)
    assert np.array_equal(Scene().clusters("/c", points, mass=1.0, counts=triangles).indices, one.indices)
    with pytest.raises(ValueError, match="it has no indices; allowed: counts and indices, or triangles"):
        Surface(points, counts)
    with pytest.raises(ValueError, match=r"/c: counts has rows of 3, and there are indices"):
        Scene().cloth("/c", points, triangles, indices)


@pytest.mark.parametrize("add", [
    lambda s, way: s.particles("/p", Sphere(0.03), motion=way, radius=R),
    lambda s, way: s.clusters("/p", np.eye(4, 3), mass=1.0, motion=way),
    lambda s, way: s.cloth("/p", *shapes.sheet(0.1, 0.1, 2, 2), motion=way)])
def test_what_begins_on_an_animated_transform_and_is_pinned_nowhere_is_told(add):
    def told(way):
        scene = Scene(frames=10)
        scene.collider("/floor", Plane())
        body = add(scene, way)
        found = [p for p in wsim.scene.check.scene.check_scene(scene) if "its transform is animated" in str(p)]
        return scene, body, found
    way = Motion.through([0.0, 1.0], [(0, 0.2, 0), (1, 0.2, 0)])
    scene, body, found = told(way)
    assert len(found) == 1 and not found[0].fatal and str(found[0]).count("\n") == 0
    scene.pin("/hand", body, [0], motion=way)
    assert not any("its transform is animated" in str(p) for p in wsim.scene.check.scene.check_scene(scene))
    assert not told(Motion.through([0.0, 1.0], [(0, 0.2, 0), (0, 0.2, 0)]))[2]                     # keys that do not move
