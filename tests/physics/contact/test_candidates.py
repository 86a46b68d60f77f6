"""Lists of faces against the tree of a mesh: the same contacts, wherever and whenever a list was made."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels.contact import candidates, mesh
from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.contact.project import contact_tables
from wsim.kernels.math.real import types
from wsim.physics.contact.broad import ROOM

KINDS = {"solid": SOLID, "sheet": SHEET}


def bowl(n: int, closed: bool, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A bumpy sphere of n x 2n faces, or the half of one: points (p, 3) [m], triangles (t, 3)."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(0.0, np.pi, n + 1), np.linspace(0.0, 2.0 * np.pi, 2 * n, endpoint=False), indexing="ij")
    radius = 1.0 + 0.1 * rng.normal(size=u.shape)
    radius[0], radius[-1] = 1.0, 1.0
    points = radius[..., None] * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    number = np.arange(u.size).reshape(u.shape)
    number[0], number[-1] = number[0, 0], number[-1, 0]
    a, b, c, d = number[:-1], number[1:], np.roll(number[1:], -1, axis=1), np.roll(number[:-1], -1, axis=1)
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    triangles = triangles[(triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])
                          & (triangles[:, 2] != triangles[:, 0])]
    points = points.reshape(-1, 3)
    return points, triangles if closed else triangles[points[triangles].mean(axis=1)[:, 2] < 0.0]


def both(kind: str, real, points, triangles, ends: np.ndarray, strays: np.ndarray, radius: float):
    """What tree and list say of paths (n, 2, 3); lists are made `strays` away, with `radius`."""
    kinds = (kind,)
    plain, listed, number = mesh.mesh_touch_func(kinds, real), candidates.listed_touch_func(kinds, real), KINDS[kind]
    t, (Rows, Points) = types(real), contact_tables(real)
    vec = t.vec3
    module = f"test_candidates_{kind}_{real.__name__}"

    @wp.kernel(module=module, enable_backward=False)
    def ask(c: Rows, L: Points, q0: wp.array(dtype=vec), q1: wp.array(dtype=vec), stray: wp.array(dtype=vec), R: float,
            out: wp.array2d(dtype=vec)):
        i = wp.tid()
        m = c.of.mesh[0]
        candidates.make_face_list(m, L, 0, i, wp.vec3f(q1[i] + stray[i]), R, 0.0)
        margin = wp.length(q1[i] - q0[i]) + real(0.002)
        C, n, p, s0, slip = plain(number, m, 0, real(1.0), q0[i], q1[i], real(0.01), margin)
        out[0, i] = vec(C, s0, real(0.0))
        out[1, i] = n
        C, n, p, s0, slip = listed(c, L, 0, i, 0, wp.matrix_from_rows(q0[i], q1[i]), t.vec2(real(0.01), margin))
        out[2, i] = vec(C, s0, real(0.0))
        out[3, i] = n

    surface = wp.Mesh(wp.array(points, dtype=wp.vec3f), wp.array(triangles.ravel(), dtype=int), support_winding_number=True)
    n, c, L = len(ends), Rows(), Points()
    c.of.kind, c.of.mesh = wp.array([number], dtype=int), wp.array([surface.id], dtype=wp.uint64)
    c.of.size = wp.array([(1.0, 0.0, 0.0)], dtype=vec)
    L.w, L.slot = wp.ones(n, dtype=real), wp.zeros(1, dtype=int)
    L.count, L.place = wp.zeros(n, dtype=int), wp.zeros(n, dtype=wp.vec3f)
    L.room, L.far = ROOM, wp.zeros(n * ROOM, dtype=float)
    L.radius, L.face = wp.zeros(n, dtype=float), wp.zeros(n * ROOM, dtype=int)
    out = wp.zeros((4, n), dtype=vec)
    wp.launch(ask, n, [c, L, *(wp.array(a, dtype=vec) for a in (ends[:, 0], ends[:, 1], strays)), radius, out])
    return out.numpy(), L.count.numpy()


@pytest.mark.parametrize("kind", ["solid", "sheet"])
@pytest.mark.parametrize("faces", [6, 40], ids=["few faces", "more than a list has room for"])
def test_a_list_tells_what_the_tree_tells(kind, faces):
    points, triangles = bowl(faces, kind == "solid", 3)
    rng = np.random.default_rng(7)
    n = 20_000
    on = points[triangles[rng.integers(len(triangles), size=n)]]
    share = rng.dirichlet([0.3, 0.3, 0.3], size=n)                 # many near edges and corners
    q0 = np.einsum("nk,nkj->nj", share, on) + rng.normal(scale=0.02, size=(n, 3))
    ends = np.stack([q0, q0 + rng.normal(scale=0.02, size=(n, 3))], axis=1)
    strays = rng.normal(scale=0.02, size=(n, 3))
    radius = 0.02 * 6.0 * 3.0 + 0.1                                # no path or stray is as long
    said, count = both(kind, wp.float64, points, triangles, ends, strays, radius)
    assert (count > ROOM).mean() > 0.9 if faces == 40 else (count <= ROOM).any()
    met = said[0, :, 0] < 1.0e29
    assert met.mean() > 0.5 and np.array_equal(met, said[2, :, 0] < 1.0e29)
    differ = np.abs(said[0] - said[2]).max(axis=1)[met]
    # where faces are equally near, float32 may name either: gaps agree to its rounding. A side is told apart by nobody at an
    # edge that is met within rounding

    assert (differ > 1.0e-5).mean() < 1.0e-3
