"""First hits of segments (kernels/contact/collider/segment.py) against the signed distances of the host, for every row of
shapes."""

import numpy as np
import pytest
import warp as wp

from tests.make.rows.rounded import ROW, Rounded
from wsim.kernels.contact.collider import shape as device
from wsim.kernels.contact.collider.segment import segment_queries
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.math.real import types
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane, Sphere, shape_row

SHAPES = [Plane(), Sphere(0.7), Box((0.5, 0.3, 0.6)), Capsule(0.3, 0.4), Cylinder(0.5, 0.4), Cone(0.6, 0.5),
          Rounded(0.6, 0.4, 0.15)]


def hits(kind: str, size, mesh: int, p: np.ndarray, q: np.ndarray, skin: float, real=wp.float64, slack: float = 0.0):
    t = types(real)
    ask = segment_queries((kind,), real)
    code = {"solid": SOLID, "sheet": SHEET}.get(kind)
    code = device.shape_code(kind) if code is None else code

    def meet(size: t.vec3, mesh: wp.uint64, p: wp.array(dtype=t.vec3), q: wp.array(dtype=t.vec3), skin: real,
             s_out: wp.array(dtype=real), n_out: wp.array(dtype=t.vec3), found_out: wp.array(dtype=int)):
        i = wp.tid()
        s, n = ask.first_hit(code, size, mesh, p[i], q[i], skin)
        s_out[i] = s
        n_out[i] = n
        found_out[i] = int(ask.between(code, size, mesh, p[i], q[i], real(wp.static(slack))))

    kernel = wp.kernel(meet, name=f"meet_{kind}_{t.name}", module="unique", enable_backward=False)
    s, n, found = wp.zeros(len(p), real), wp.zeros(len(p), t.vec3), wp.zeros(len(p), int)
    inputs = [t.vec3(*size), wp.uint64(mesh), wp.array(p, t.vec3), wp.array(q, t.vec3), real(skin)]
    wp.launch(kernel, len(p), inputs, [s, n, found], device="cpu")
    return s.numpy(), n.numpy(), found.numpy().astype(bool)


def segments(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.uniform(-1.2, 1.2, (count, 3)), rng.uniform(-1.2, 1.2, (count, 3))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_a_segment_stops_where_the_signed_distance_is_the_skin(shape):
    """A dense walk along each segment finds the same ones, and no earlier hit."""
    found = ROW if isinstance(shape, Rounded) else shape_row(shape)
    if found is ROW:
        from tests.make.rows import rounded
        device.add_convex_shape("rounded", rounded.formula)
    skin, (p, q) = 1e-3, segments()
    outside = found.distance(shape, p) > skin
    p, q = p[outside], q[outside]
    s, n, between = hits(found.kind, found.size(shape), 0, p, q, skin)
    walk = np.linspace(0.0, 1.0, 2001)[:, None, None]
    phi = found.distance(shape, (p + walk * (q - p)).reshape(-1, 3)).reshape(2001, -1)
    met, deep, clear = s < 1.0, phi.min(axis=0) < 0.5 * skin, phi.min(axis=0) > 3.0 * skin
    assert 50 < met.sum() < len(p) and met[deep].all() and not met[clear].any()
    at = p + s[:, None] * (q - p)
    assert np.abs(found.distance(shape, at[met]) - skin).max() < 0.02 * skin
    assert (np.einsum("ni,ni->n", n, q - p)[met] < 0.0).all() and np.linalg.norm(n[met], axis=1) == pytest.approx(1.0)
    assert between[phi.min(axis=0) < -1e-3].all() and not between[phi.min(axis=0) > 1e-3].any()


def test_a_way_out_of_a_shape_is_free_and_one_into_it_is_not():
    p, q = np.array([[0.4, 0.0, 0.0], [0.4, 0.0, 0.0]]), np.array([[1.0, 0.1, 0.0], [0.0, 0.0, 0.0]])
    s, _, between = hits("box", (0.5, 0.5, 0.5), 0, p, q, 1e-3)
    assert s.tolist() == [1.0, 0.0] and between.all()


def mesh_of_a_box() -> wp.Mesh:
    x = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.3, 0.3) for c in (-0.6, 0.6)])
    faces = np.array([0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]).reshape(6, 4)
    return wp.Mesh(wp.array(x, dtype=wp.vec3f, device="cpu"),
                   wp.array(np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]).ravel(), dtype=int, device="cpu"))


def test_a_segment_along_a_face_touches_a_mesh_as_it_touches_a_box():
    """Rays along a face miss it: a liquid's cells whose centres lie in a mesh wall are as shut as those in a box."""
    mesh, p = mesh_of_a_box(), np.array([[0.5, -0.2, 0.0], [0.5, 0.2, -0.1], [0.502, 0.0, 0.0], [0.9, 0.0, 0.0]])
    q = p + [[0.0, 0.1, 0.0], [0.0, 0.0, 0.2], [0.0, 0.1, 0.0], [-0.398, 0.0, 0.0]]
    for slack, expected in ((-1e-3, [True, True, False, False]), (-1e-2, [True, True, True, True])):
        for kind, size, number in (("box", (0.5, 0.3, 0.6), 0), ("solid", (0.0, 0.0, 0.0), mesh.id)):
            assert hits(kind, size, number, p, q, 1e-4, slack=slack)[2].tolist() == expected


@pytest.mark.parametrize("kind", ["solid", "sheet"])
@pytest.mark.parametrize("real", [wp.float32, wp.float64], ids=["float32", "float64"])
def test_points_that_press_on_a_mesh_without_a_skin_come_no_further(kind, real):
    """Again and again from where they were stopped: that is a rounding before the face, on it, or behind it."""
    mesh, rng = mesh_of_a_box(), np.random.default_rng(5)
    box, row = Box((0.5, 0.3, 0.6)), shape_row(Box((1, 1, 1)))
    x = rng.uniform(-1.2, 1.2, (2000, 3))
    x = x[row.distance(box, x) > 1e-2]
    for _ in range(8):
        way = rng.uniform(-0.25, 0.25, x.shape) - x
        s, _, _ = hits(kind, (0.0, 0.0, 0.0), mesh.id, x, x + way, 0.0, real)
        x = x + s[:, None] * way
        if real is wp.float32:
            x = x.astype(np.float32).astype(float)
        phi = row.distance(box, x)
        assert phi.min() > 0.0 and phi.max() < 2.0**-20 * 5.0                  # a rounding of what points and ways are, 5 m


@pytest.mark.parametrize("kind", ["solid", "sheet"])
def test_a_mesh_is_met_where_its_box_is_and_an_open_one_from_both_sides(kind):
    mesh = mesh_of_a_box()
    p, q = segments()
    outside = shape_row(Box((1, 1, 1))).distance(Box((0.5, 0.3, 0.6)), p) > 1e-2
    s, n, between = hits(kind, (0.0, 0.0, 0.0), mesh.id, p[outside], q[outside], 1e-4)
    exact, m, of_box = hits("box", (0.5, 0.3, 0.6), 0, p[outside], q[outside], 1e-4)
    met = exact < 1.0
    assert s[met] == pytest.approx(exact[met], abs=2e-3) and (s[~met] > 0.99).all() and (between == of_box)[met].all()
    assert np.abs(n - m)[met].max(axis=1).mean() < 0.02                     # but at edges
    inside = ~outside & (np.abs(q) > [0.51, 0.31, 0.61]).any(axis=1)
    s, _, between = hits(kind, (0.0, 0.0, 0.0), mesh.id, 0.9 * p[inside] * 0.9, q[inside], 1e-4)
    assert inside.any() and between.all() and (s == 1.0).all() == (kind == "solid")
