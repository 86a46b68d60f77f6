"""Each token of physics:approximation, what a concave body becomes by it, and one line for each bad mesh."""

import numpy as np
import pytest

from tests.physics.rigid.concave.meshes import bowl, ring
from wsim import Collider, Plane, Scene, Surface
from wsim.physics.rigid.contacts.features import contact_features, contact_reach
from wsim.physics.rigid.mass import body_inertia
from wsim.physics.rigid.solids import collider_parts, contact_shape_of, decomposition, faults
from wsim.physics.rigid.surfaces import adjacent_faces
from wsim.scene.check.scene import check_scene


@pytest.mark.parametrize("approximation, kind", [
    ("none", "mesh"), ("meshSimplification", "mesh"), ("sdf", "mesh"), ("convexHull", "hull"), ("boundingCube", "box"),
    ("boundingSphere", "sphere")])
def test_a_body_is_met_as_its_approximation_says(approximation, kind):
    assert contact_shape_of(Collider("/c", ring(1.0, 0.25), approximation=approximation), True).kind == kind


@pytest.mark.parametrize("wrong, said", [
    ("open", "is an open mesh"), ("flat", "encloses no volume"), ("crossed", "crosses itself")])
def test_a_mesh_that_cannot_be_met_as_it_is_gets_one_line(wrong, said):
    whole = ring(1.0, 0.25, 12, 8)
    quads = whole.indices.reshape(-1, 4)
    if wrong == "open":
        shape = Surface(whole.points, whole.counts[1:], quads[1:].ravel())
    elif wrong == "flat":
        points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]])
        shape = Surface(points, [3, 3, 3, 3], [0, 1, 2, 2, 1, 0, 0, 2, 3, 3, 2, 0])
    else:
        twice = np.concatenate([whole.points, whole.points + np.float32([0.6, 0.0, 0.0])])
        shape = Surface(twice, np.full(2 * len(quads), 4), np.concatenate([quads, quads + len(whole.points)]).ravel())
    scene = Scene()
    scene.collider("/floor", Plane())
    scene.body("/b", shape, mass=1.0, inertia=(1.0, 1.0, 1.0))
    found = [p for p in check_scene(scene) if p.path == "/b/shape" and said in p.text]
    assert len(found) == 1 and not found[0].fatal and "fix: " in found[0].text and len(found[0].text) < 300


def test_a_mesh_of_too_many_faces_is_told(monkeypatch):
    monkeypatch.setattr(faults, "FACES", 100)
    (problem,) = faults.check_concave_mesh(Collider("/c", ring(1.0, 0.25)), True)
    assert "1024 triangles" in problem.text and "fix: " in problem.text


def test_without_coacd_a_decomposition_is_the_mesh_and_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr(decomposition, "convex_parts", None)
    monkeypatch.setattr("wsim.physics.rigid.solids.convex_parts", _no_coacd)
    monkeypatch.setattr(faults, "coacd_is_installed", lambda: False)
    c = Collider("/c", ring(1.0, 0.25), approximation="convexDecomposition")
    assert contact_shape_of(collider_parts([c])[0], True).kind == "mesh"
    (problem,) = faults.check_concave_mesh(c, True)
    assert "wsim[decompose]" in problem.text and "its triangles" in problem.text


def _no_coacd(*_):
    raise ImportError("coacd")


def test_parts_come_from_the_cache_and_a_broken_file_is_made_anew(monkeypatch, tmp_path):
    """The cache asks coacd once for a mesh; mass and inertia are those of the mesh, not of its parts."""
    calls = []

    def two_halves(points, triangles):
        calls.append(len(points))
        return [points[points[:, 0] >= 0.0].astype(float), points[points[:, 0] <= 0.0].astype(float)]
    monkeypatch.setattr(decomposition, "_run_coacd", two_halves)
    monkeypatch.setenv("WSIM_PARTS", str(tmp_path))
    c = Collider("/c", ring(1.0, 0.25, 24, 8), approximation="convexDecomposition")

    def parts() -> list:
        decomposition.kept.clear()
        return collider_parts([c])
    first, second = parts(), parts()
    assert len(first) == len(second) == 2 and len(calls) == 1
    assert all(np.array_equal(a.shape.points, b.shape.points) for a, b in zip(first, second, strict=True))
    assert [contact_shape_of(p, True).kind for p in first] == ["hull", "hull"] and {p.path for p in first} == {"/c"}
    (file,) = tmp_path.iterdir()
    file.write_bytes(b"half a file")
    assert len(parts()) == 2 and len(calls) == 2
    decomposition.kept.clear()
    scene = Scene()
    plain, parted = (scene.body(f"/{name}", c.shape, approximation=name) for name in ("none", "convexDecomposition"))
    assert np.allclose(body_inertia(plain).moments, body_inertia(parted).moments, rtol=1e-12)


def test_coacd_leaves_the_hole_of_a_ring_open(tmp_path, monkeypatch):
    pytest.importorskip("coacd")
    monkeypatch.setenv("WSIM_PARTS", str(tmp_path))
    parts = collider_parts([Collider("/c", ring(0.01, 0.0025, 16, 8), approximation="convexDecomposition")])
    hulls = [contact_shape_of(p, True).hull for p in parts]
    assert len(hulls) > 4 and all((h.offsets < 0.0).any() for h in hulls)          # none holds the centre
    filled = sum(h.volume for h in hulls)
    assert 0.9 < filled / body_inertia(Scene().body("/r", ring(0.01, 0.0025, 16, 8), density=1.0)).mass < 1.3


def test_edges_and_corners_that_stand_out_are_those_of_the_outer_half_of_a_ring():
    """On the inner half edges across the ring are hollow; the reach is a quarter of the tube's diameter, but for facets."""
    shape = ring(1.0, 0.25)
    quads = shape.indices.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    points = shape.points.astype(float)
    found = contact_features(points, faces, adjacent_faces(faces))
    edges = points[np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)[found["sharp"] == 1]]
    across = np.abs(np.linalg.norm(edges[:, 0, :2], axis=1) - np.linalg.norm(edges[:, 1, :2], axis=1)) > 1e-6
    middle = np.linalg.norm(edges.mean(axis=1)[:, :2], axis=1)
    assert (middle[across] > 0.98).all() and (middle[~across] < 0.8).any()
    assert 0.9 < contact_reach(points, faces, True) / (0.25 * 0.5) < 1.02


def test_a_bowl_wound_inward_is_turned_over():
    met = contact_shape_of(Collider("/c", bowl(1.0, 0.1)), True)
    points, faces = met.mesh
    a, b, c = np.moveaxis(points[faces], 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0
