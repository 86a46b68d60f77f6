"""Skinning on a GPU: the points of the host's formulas, and within 1.5 times a copy of the bytes that it must move."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.animation.dressed import clothed, seen
from tests.make.physics.animation.skinning import nearest_faces, track
from tests.physics.animation.make import bones, lump, scene_of, skin
from tools.bench.contact.skinning import character, speed
from wsim.geometry.triangulate import triangulate_polygons
from wsim.kernels.contact.project import SUNK
from wsim.kernels.math import mesh_refit
from wsim.model.structs import fill_struct
from wsim.physics.animation.objects import DUAL, LINEAR
from wsim.physics.animation.skinning import points_over_triangles
from wsim.scene import shapes

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("scaled", [False, True])
@pytest.mark.parametrize("method", [LINEAR, DUAL])
def test_points_are_those_of_the_host(method, scaled, precision):
    rng = np.random.default_rng(3)
    points, counts, indices = shapes.sphere(0.3, 12)
    skinned = skin(rng, bones(rng, scaled), points, method=method, blends=[lump(rng)])
    sim = wsim.Simulation(scene_of(skinned, counts, indices), device="cuda:0", precision=precision)
    sim.run(2)
    ours, times = track(sim)
    want = skinned.over(times)
    assert np.abs(ours - want).max() < (2e-6 if precision == "float32" else 4e-7) * np.abs(want).max()


def test_runs_repeat_to_the_bit():
    rng = np.random.default_rng(3)
    points, counts, indices = shapes.sphere(0.3, 12)
    skinned = skin(rng, bones(rng), points)
    found = []
    for _ in range(2):
        sim = wsim.Simulation(scene_of(skinned, counts, indices), device="cuda:0")
        sim.run(2)
        found.append((sim.positions("/sheet"), track(sim)[0]))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


def test_a_million_vertices_are_where_the_host_has_them():
    rows = [row for row in speed(wp.get_device("cuda:0"), 1_000_000, 200) if row["order"] == "in order"]
    assert {row["method"] for row in rows} == {LINEAR, DUAL}
    assert all(row["error"] < 2e-5 for row in rows), rows


def test_what_follows_driven_joints_goes_with_their_bodies():
    scene = clothed(DUAL, soft=True)
    sim, follow = wsim.Simulation(scene, device="cuda:0"), scene.pins[0].follows
    for _ in range(4):
        sim.step()
        x = seen(sim, follow.skin)
        np.testing.assert_allclose(sim.positions("/sheet")[:2], points_over_triangles(x[follow.corners], follow.places),
                                   atol=3e-6)
    again = wsim.Simulation(clothed(DUAL, soft=True), device="cuda:0")
    again.run(4)
    assert np.array_equal(again.positions("/sheet"), sim.positions("/sheet"))


def test_a_character_under_a_cloth_stays_under_it():
    row = character(wp.get_device("cuda:0"), 60)
    assert row["penetration"] < 5e-3 and row["contacts"] > 100


@pytest.mark.parametrize("sides", [4, 12, 65])        # of 8 to 4095 triangles
@pytest.mark.parametrize("how", ["block", "blocks", "boxes"])
@pytest.mark.parametrize("held", [False, True])
def test_trees_that_a_loop_fits_are_warps(sides, how, held):
    """Faces and rays about a sphere that was squashed and shaken, and sides by winding numbers, where a point asks for them.
    held: by boxes of the substep before, which name another one of faces that are equally near."""
    rng = np.random.default_rng(5)
    points, counts, indices = shapes.sphere(0.3, sides)
    corners = triangulate_polygons(points, counts, indices, True)[0].astype(np.int32)
    q, way = (wp.array(rng.normal(size=(300, 3)) * 0.4, dtype=wp.vec3f, device="cuda:0") for _ in range(2))
    moved = (points * [1.0, 3.0, 0.4] + 0.05 * np.sin(9.0 * points[:, [1, 2, 0]])).astype(np.float32)
    found = []
    for own in (False, True):
        places = wp.array(points.astype(np.float32), dtype=wp.vec3f, device="cuda:0")
        mesh = wp.Mesh(places, wp.array(corners.ravel(), dtype=int, device="cuda:0"), support_winding_number=True)
        if not own:
            places.assign(moved)
        if own:
            deep, mark, wound = (wp.array([value], dtype=int, device="cuda:0") for value in (0, SUNK * (how != "boxes"), 0))
            before = points.astype(np.float32)
            shapes_of = wp.array(np.stack([0.0 * before, before, moved][1 - held:]), dtype=wp.vec3f, device="cuda:0")
            still, low, high = (wp.zeros_like(places) for _ in range(3))
            count = len(corners)
            tree = fill_struct(mesh_refit.FittedTree, mesh=mesh.id, track=shapes_of, low=low, high=high, deep=deep, mark=mark,
                               wound=wound, first=0, span=1 + held)
            for substep in range(1 + held):
                now, shape = wp.array([substep], dtype=int, device="cuda:0"), [places, still]
                if how == "blocks":
                    wp.launch(mesh_refit.pose_point_kernel(), len(points), [tree, now], shape, device="cuda:0")
                    wp.launch(mesh_refit.triangle_bound_kernel(), count, [tree, count, now], device="cuda:0")
                    wp.launch(mesh_refit.tree_fit_kernel(), count, [tree, count, now], device="cuda:0")
                else:
                    wp.launch(mesh_refit.fit_block(), mesh_refit.BLOCK, [tree, now], shape, device="cuda:0",
                              block_dim=mesh_refit.BLOCK)
            assert np.array_equal(places.numpy(), moved) and np.array_equal(still.numpy(), moved - before)
            assert wound.numpy()[0] == 0
        else:
            mesh.refit()
        out = wp.zeros(300, dtype=wp.vec4f, device="cuda:0")
        wp.launch(nearest_faces, 300, [mesh.id, q, way], [out], device="cuda:0")
        found.append(out.numpy()[:, [3] + [0] * (not held) + [2] * (how != "boxes")])     # sides by normals need the mean edge
    assert len(corners) <= mesh_refit.SMALL and np.array_equal(*found)
