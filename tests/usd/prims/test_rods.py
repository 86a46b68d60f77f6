"""Curves that make no sense: each mistake is an error with its path, its place and the name that its author wrote."""

import numpy as np
import pytest

from tests.make.usda import Reader, errors
from wsim.kernels.rods.coupled_newton.coupled import MOST
from wsim.physics.contact.selfcontact.start import segment_distances
from wsim.physics.rods.objects import Rods
from wsim.scene import Box, Motion, Scene, SceneError, Sphere
from wsim.scene.check.scene import check_scene
from wsim.scene.methods import describe_scene_contents
from wsim.simulation.simulation import Simulation

APIS = '"PhysicsDeformableBodyAPI", "PhysicsCurvesDeformableSimAPI", "WsimRodsAPI"'
STRAIGHT = [[0.1 * k, 0.0, 0.0] for k in range(4)]


def curve(values: str) -> str:
    places = ", ".join(map(str, map(tuple, STRAIGHT)))
    return (f'def BasisCurves "rope" (prepend apiSchemas = [{APIS}]) {{\nuniform token type = "linear"\n'
            f"int[] curveVertexCounts = [4]\npoint3f[] points = [{places}]\n{values}\n}}\n")


@pytest.mark.parametrize("values, said", [
    ("normal3f[] normals = [(0, 0, 1), (nan, 0, 0), (0, 0, 1), (0, 0, 1)]", "directors (of curves: normals)[1] is [nan,"),
    ("normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 0), (0, 0, 1)]",
     "directors (of curves: normals)[2] is [0.0, 0.0, 0.0], the edge behind point 2"),
    ("normal3f[] normals = [(0, 0, 1), (1, 0, 0), (1, 0, 0), (0, 0, 1)]",
     "directors (of curves: normals)[1] is [1.0, 0.0, 0.0], the edge behind point 1 goes along [0.1"),
    ("normal3f[] physics:restNormals = [(0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)]",
     "rest_directors (of curves: physics:restNormals)[0] is [0.0, 0.0, 0.0]"),
    ("point3f[] physics:restShapePoints = [(0, 0, 0), (1, 0, 0), (inf, 0, 0), (3, 0, 0)]",
     "rest_points (of curves: physics:restShapePoints)[2] is [inf,"),
    ("float[] physics:thicknesses = [0]", "physics:thicknesses holds 0"),
    ("float[] physics:thicknesses = [0.01, 0.01, -0.2, 0.01]", "physics:thicknesses holds -0.2")])
def test_what_a_curve_says_wrongly_is_named_as_its_author_wrote_it(tmp_path, values, said):
    assert f"/rope: {said}" in errors(Reader(tmp_path), curve(values))


def test_the_normal_of_a_last_point_which_no_edge_has_may_be_anything(tmp_path):
    read = Reader(tmp_path)(curve("normal3f[] normals = [(0, 0, 1), (0, 1, 1), (1, 0, 1), (0, 0, 0)]"))
    assert len(read.things("Rods")) == 1


def test_directors_are_seen_beside_the_edges_of_each_strand():
    """Two strands that are not one: the edge between them is none, and none behind the last point."""
    x = np.array(STRAIGHT + [[0.5, 0.125, 0.0], [0.5, 0.25, 0.0], [0.5, 0.375, 0.0]])
    d = np.tile([0.0, 0.0, 1.0], (7, 1))
    d[[3, 6]] = 0.0
    scene = Scene()
    rods = scene.add(Rods("/two", x, [4, 3], directors=d))
    assert not [p for p in check_scene(scene) if p.fatal]
    rods.directors[5] = 0.0, 3.0, 0.0
    assert [p.text for p in check_scene(scene) if p.fatal] == [
        "directors (of curves: normals)[5] is [0.0, 3.0, 0.0], the edge behind point 5 goes along [0.0, 0.125, 0.0] "
        "(1 such edges); allowed: directions across their edges, not 0; fix: author it again, or leave it out: no twist then"]


def test_counts_that_change_in_time_are_refused(tmp_path):
    counts = "int[] curveVertexCounts = [4]"
    text = curve("").replace(counts, counts + "\nint[] curveVertexCounts.timeSamples = {0: [4], 2: [2, 2]}")
    assert "/rope: curveVertexCounts is sampled in time and changes at time code 2" in errors(Reader(tmp_path), text)


def strands(count: int, gap: float, diameter: float = 2e-3) -> Scene:
    """Straight strands of five points that touch each other, side by side along z."""
    x = np.zeros((count, 5, 3))
    x[..., 0], x[..., 2] = 0.01 * np.arange(5), gap * np.arange(count)[:, None]
    scene = Scene(frames=1)
    scene.add(Rods("/strands", x, [5] * count, diameter, self_collision=True))
    return scene


@pytest.mark.parametrize("counts, said", [([4, 1], "2 strands sum to 5, the least is 1, of strand 1; there are 5 points"),
                                          ([6, -1], "2 strands sum to 5, the least is -1, of strand 1; there are 5 points"),
                                          ([9], "1 strands sum to 9, the least is 9, of strand 0; there are 5 points"),
                                          ([], "0 strands sum to 0; there are 5 points")])
def test_counts_that_do_not_fit_are_named_by_their_strand(counts, said):
    """The least was told as 0, whatever it was."""
    scene = strands(1, 0.0)
    scene.things("Rods")[0].counts = np.array(counts, int)
    (problem,) = [p for p in check_scene(scene) if p.fatal]
    assert said in problem.text


def test_an_edge_shorter_than_it_is_thick_is_told_with_a_diameter_that_is_not():
    def told(diameter: float) -> list[str]:
        return [p.text for p in check_scene(strands(1, 0.0, diameter)) if "thick" in p.text]
    (text,) = told(0.05)
    most = float(text.split("at most ")[1].removesuffix(" m"))
    assert most == 0.01 and told(most) == [] and told(1.01 * most)


def test_thousands_of_strands_in_one_place_are_refused_with_their_number_and_place():
    """Each would be near all others: half a million pairs, whose first frame did not end within minutes."""
    with pytest.raises(SceneError, match=r"/strands: 1000 points of strands .* within 0.0046 m of each other at \(0, 0, 0\) m"):
        Simulation(strands(1000, 0.0), device="cpu")


def test_strands_that_are_one_many_times_are_refused():
    """Fewer than are near all others; 17700 pairs of 240 edges."""
    with pytest.raises(SceneError, match="/strands: its strands are a tangle .* more than 1960 pairs of edges meet, such as /"):
        Simulation(strands(60, 0.0), device="cpu")
    assert [w for w in Simulation(strands(8, 0.0), device="cpu").warnings if "280 pairs of edges of strands meet" in w]


def test_strands_that_begin_in_each_other_are_told_with_the_place():
    scene = strands(2, 0.02)
    x = scene.things("Rods")[0].points
    x[5:] = x[:5, [2, 1, 0]] + np.array([0.015, 0.0, -0.025])                 # across the middle of the second edge
    (text,) = [w for w in Simulation(scene, device="cpu").warnings if "where they start" in w or "thick" in w]
    assert text.startswith("warning: /strands: 1 pairs of edges of strands meet where they start, such as /strands and /str")
    x[5:, 1] += 1e-3
    assert not [w for w in Simulation(scene, device="cpu").warnings if "meet" in w]


def wide(count: int, diameter: float = 2e-3) -> Scene:
    """Strands of a metre in 19 edges, 0.1 mm apart."""
    scene = strands(count, 1e-4, diameter)
    scene.gravity, scene.substeps = (0.0, 0.0, 0.0), 4
    rods = scene.things("Rods")[0]
    rods.points = np.zeros((count, 20, 3))
    rods.points[..., 0], rods.points[..., 2] = np.linspace(0.0, 1.0, 20), 1e-4 * np.arange(count)[:, None]
    rods.points, rods.counts = rods.points.reshape(-1, 3), np.full(count, 20)
    return scene


def test_strands_thicker_than_their_spacing_are_told_with_the_width_that_does():
    (text,) = Simulation(wide(2), device="cpu").warnings
    assert text.startswith("warning: /strands: 55 pairs of edges of strands begin nearer than they are thick, such as /strands")
    assert "0.0001 m apart where they keep 0.002 m" in text and "give widths of at most 0.0001 m there" in text
    assert Simulation(wide(2, 1e-4), device="cpu").warnings == []
    with pytest.raises(SceneError, match=r"/strands: at least \d+ pairs .* than half .* give widths of at most 0.0001 m"):
        Simulation(wide(100), device="cpu")


def test_thirty_strands_in_one_another_are_solved_with_whatever_room_there_is(monkeypatch):
    """Points had room for 48 of their 174 pairs, and solved with forces that were not mutual until Newton's method gave up: no
    frame in a minute. What room there is at first changes no bit."""
    found = []
    for room in (48, 256):
        monkeypatch.setattr("wsim.physics.rods.touch.ROOM", room)
        sim = Simulation(wide(30), device="cpu")
        sim.run(2)
        assert sim.plan.method("rods").indicators(None, None)["rod_iterations"] < int(MOST)
        assert not [w for w in sim.warnings if "left corrections" in w]
        found.append(sim.positions("/strands"))
    assert np.array_equal(*found) and np.diff(found[0].reshape(30, 20, 3)[..., 2], axis=0).min() > 2e-3        # in order, apart


@pytest.mark.parametrize("along, what", [(0.0, "1 points begin inside of /ball, the deepest, 2, by 0.005 m"),
                                         (0.005, "1 edges, between their points, begin inside of /ball, the deepest, 2, by")])
def test_strands_that_begin_in_a_collider_are_told_with_their_point_or_edge(along, what):
    """Points 1 cm apart, and a ball of 5 mm: a cloth was told of it, strands were thrown out without a word."""
    scene, place = strands(1, 0.0), np.eye(4)
    place[0, 3] = 0.02 + along
    scene.collider("/ball", Sphere(0.005 - 1e-4 * (along > 0.0)), motion=Motion.still(place))
    (text,) = [p.text for p in check_scene(scene) if "inside" in p.text]
    assert text.startswith(what) and "fix: move one of both" in text
    scene.things("Rods")[0].pin("/pin", [2, 3])
    assert [p for p in check_scene(scene) if "points begin inside" in p.text] == []


def test_a_rope_that_colliders_leave_no_room_is_told_how_deep_it_was():
    """Two boxes that close and go 6 cm into each other: it said to give more substeps, and nothing else."""
    scene = strands(1, 0.0, 0.01)
    scene.frames, scene.things("Rods")[0].points = 4, 10.0 * scene.things("Rods")[0].points
    for k, side in enumerate((-1.0, 1.0)):
        frames = np.tile(np.eye(4), (3, 1, 1))
        frames[:, 1, 3] = side * np.array([0.2, 0.05, -0.05])
        scene.collider(f"/jaw{k}", Box((0.2, 0.08, 0.2)), motion=Motion(np.array([0.0, 0.03, 0.06]), frames))
    sim = Simulation(scene, device="cpu")
    sim.run()
    (text,) = [w for w in sim.warnings if "deep" in w]
    assert "/strands: points were 0.0" in text and "give more room, or smaller widths" in text
    assert np.isfinite(sim.positions()).all()


def test_positions_of_rods_are_asked_for_by_path():
    sim = Simulation(strands(2, 0.1), device="cpu", worlds=2)
    assert np.allclose(sim.positions("/strands", 1), sim.scene.things("Rods")[0].points)
    assert sim.velocities().shape == (10, 3)
    for asked in (("/rope",), ("/strands", 2)):
        with pytest.raises(SceneError, match=r"0 prims with points of that path; there are \['/strands'\] in worlds 0 to 1"):
            sim.positions(*asked)
    with pytest.raises(SceneError, match=r"has 0 prims with points on the device of that path; there are \[\]"):
        sim.positions("/strands", device=True)


def test_distances_of_segments_are_those_of_a_dense_grid():
    """Of random, parallel and vanishing ones: not above the least of 101 x 101 places, and below it by a step at most."""
    a, b = np.random.default_rng(0).normal(size=(2, 60, 2, 3))
    b[:20, 1] = b[:20, 0] + 1.5 * (a[:20, 1] - a[:20, 0])
    b[20:30, 1] = b[20:30, 0]
    s = np.linspace(0.0, 1.0, 101)[None, :, None]
    p, q = (each[:, :1] + s * (each[:, 1:] - each[:, :1]) for each in (a, b))
    least = np.linalg.norm(p[:, :, None] - q[:, None], axis=-1).min(axis=(1, 2))
    found = segment_distances(a, b)
    assert (found <= least + 1e-12).all() and (least - found).max() < 0.05


@pytest.mark.parametrize("prims, said", [(1, "1 rod prim; "), (2, "2 rod prims; ")])
def test_prims_of_rods_are_counted_as_such(prims, said):
    """They were 1 rods and 2 rodss."""
    scene = strands(2, 0.1)
    for k in range(1, prims):
        scene.add(Rods(f"/more{k}", STRAIGHT, [4]))
    assert describe_scene_contents(scene).startswith(said)
