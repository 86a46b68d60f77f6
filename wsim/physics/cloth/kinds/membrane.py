"""Triangle strain of a cloth of the model "membrane". NumPy.

Compliances are those of plane stress, (uu, uv, shear, vv) = (1 / s, -nu / (s t)^1/2, 1 / shear, 1 / t) / area of warp s and
weft t, a live stiffness each. Of B = Dm^-1, the edges e_b of a triangle in its frame (u, v), where u is the axis a in its
plane, and Q the gradient by B: with P = -B^T Q B^T, that by Dm, and dn.e_b = -n.de_b, the frame turns by  t sum_b B_bv n.de_b,
t = n.a / |a - n n.a|,  and so

    by e_b:   P_ub u + P_vb v + t (sum_c P_uc Dm_vc - P_vc Dm_uc) B_bv n
"""

import numpy as np

from wsim.kernels.cloth.constraint import MEMBRANE
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import ClothConstraintKind
from wsim.scene import Cloth

LEAST = 1e-6           # shear over stretch that a membrane has at least: without shear it still has a direction


def membrane_constraints(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    """Rest values are the inverses of the edge matrices in the planes of the triangles, shapes 1 / area."""
    assert isinstance(body.source, Cloth)
    local, areas = flat_edge_matrices(body.rest[body.triangles - body.first])
    good, fabric = areas > 0.0, body.source.material
    k = {name: np.array([getattr(fabric, name)]) for name in ("stretch", "shear", "weft", "poisson")}
    if body.source.stretches is not None:
        from wsim.physics.cloth.painted import of_triangles
        k = of_triangles(body, body.source, good, k)
    return [Constraints("membrane", body.triangles[good], np.linalg.inv(local[good]), 1.0 / areas[good], k,
                        fabric.damping)]


def flat_edge_matrices(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edge matrices Dm (columns: edges 01 and 02 in the plane of the triangle [m]) and areas [m^2] of corners (t, 3, 3).

    The first axis (warp) is the projection of the longest axis-aligned direction that all triangles share: x of the rest
    shape where the triangle is not perpendicular to it, else y.
    """
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = np.linalg.norm(np.cross(e1, e2), axis=1)
    _, u, v, _ = warp_weft_frame(corners)
    Dm = np.stack([np.stack([(u * e1).sum(1), (u * e2).sum(1)], 1), np.stack([(v * e1).sum(1), (v * e2).sum(1)], 1)], 1)
    return Dm, 0.5 * double


def warp_weft_frame(corners: np.ndarray) -> tuple[np.ndarray, ...]:
    """Unit normal n, warp u, weft v of triangles (t, 3, 3), each (t, 3), and n.a / |a - n n.a| of the axis a of warp, (t,)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(normal, axis=1)
    n = normal / np.where(double > 0, double, 1.0)[:, None]
    u, across = np.array([1.0, 0.0, 0.0]) - n * n[:, :1], n[:, 0].copy()
    bad = np.linalg.norm(u, axis=1) < 0.1
    u[bad], across[bad] = np.array([0.0, 1.0, 0.0]) - n[bad] * n[bad, 1:2], n[bad, 1]
    size = np.linalg.norm(u, axis=1)
    u /= size[:, None]
    return n, u, np.cross(n, u), across / size


def thread_stiffness(r: Constraints) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness along warp and weft [N/m]; a weft of 0 is as the warp."""
    stretch, weft = r.stiffness["stretch"], r.stiffness["weft"]
    return stretch, np.where(weft > 0.0, weft, stretch)


def membrane_compliance(r: Constraints) -> np.ndarray:
    stretch, weft = thread_stiffness(r)
    shear, nu = np.maximum(r.stiffness["shear"], LEAST * stretch), r.stiffness["poisson"]
    one = np.stack(np.broadcast_arrays(1.0 / stretch, -nu / np.sqrt(stretch * weft), 1.0 / shear, 1.0 / weft), axis=-1)
    return r.shape[:, None] * one


def membrane_slopes(r: Constraints, body: PointBody) -> np.ndarray:
    """U = I at rest: C_uu sees b_u r_u, C_vv b_v r_v, the shear b_u r_v + b_v r_u, b the row of Dm^-1 of a point."""
    p = body.rest[r.ids - body.first]
    E = np.stack([p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]], axis=1)              # (m, point, 3)
    axes = np.einsum("mkc,mki->mci", r.rest, E)                               # F_u, F_v: the unit axes at rest
    b = np.concatenate([-r.rest.sum(1, keepdims=True), r.rest], axis=1)       # (m, point, uv)
    u, v = axes[:, None, 0], axes[:, None, 1]
    return np.stack([b[:, :, :1] * u, b[:, :, 1:] * v, b[:, :, :1] * v + b[:, :, 1:] * u], axis=1)


def by_stiffness(r: Constraints, name: str, by: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    return _by_poisson(r, by) if name == "poisson" else _by_threads(r, name, by * stiffness)


def membrane_stiffness_gradient(r: Constraints, name: str, by: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    if name == "poisson":
        return -by[:, 1] * r.shape / np.sqrt(np.prod(thread_stiffness(r), axis=0))
    return _by_threads(r, name, -by * alpha)


def _by_threads(r: Constraints, name: str, parts: np.ndarray) -> np.ndarray:
    """Of each triangle by one of its stiffnesses, from those by the logarithms of its table, (uu, uv, shear, vv); uu is in
    proportion to stretch, vv to weft, uv to the root of both; a weft of 0 stands for stretch."""
    from wsim.scene.values.coverage import gradient_refusal
    value = r.stiffness[name]
    assert r.body is not None
    same = r.stiffness["weft"] <= 0.0
    if name == "weft" and same.any():
        raise gradient_refusal("weft", r.body.path)
    clamped = r.stiffness["shear"] < LEAST * r.stiffness["stretch"]
    if name == "shear" and clamped.any():
        raise gradient_refusal("shear", r.body.path, least=LEAST)
    powers = np.array({"shear": (0.0, 0.0, 1.0, 0.0), "weft": (0.0, 0.5, 0.0, 1.0), "stretch": (1.0, 0.5, 0.0, 0.0)}[name])
    if name == "stretch":
        powers = np.where(same[:, None], (1.0, 1.0, 0.0, 1.0), powers) + (0.0, 0.0, 1.0, 0.0) * clamped[:, None]
    return (parts * powers).sum(axis=1) / value


def _by_poisson(r: Constraints, by: np.ndarray) -> np.ndarray:
    """Of each triangle, from those by its stiffness: uu, uv, vv are (s, nu sqrt(s t), t) / (shape (1 - nu^2)), s and t those of
    warp and weft. Where nu is 0 uv has no logarithm."""
    nu, (warp, weft) = r.stiffness["poisson"], thread_stiffness(r)
    straight, across = by[:, 0] * warp + by[:, 3] * weft, by[:, 1] * np.sqrt(warp * weft)
    return (2.0 * nu * straight + (1.0 + nu**2) * across) / (r.shape * (1.0 - nu**2)**2)


def membrane_rest_gradient(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray,
                           by_value: np.ndarray | None) -> None:
    p = shape.body.rest[r.ids - shape.body.first]
    shape.areas(r.ids, -by_shape * r.shape**2)
    B, Dm = r.rest, np.linalg.inv(r.rest)
    P = -np.einsum("tji,tjk,tlk->til", B, by_rest, B)
    n, u, v, tilt = warp_weft_frame(p)
    turn = np.einsum("tb,tb->t", P[:, 0], Dm[:, 1]) - np.einsum("tb,tb->t", P[:, 1], Dm[:, 0])
    e = (P[:, 0, :, None] * u[:, None] + P[:, 1, :, None] * v[:, None]
         + (turn * tilt)[:, None, None] * B[:, :, 1, None] * n[:, None])
    shape.add(r.ids, np.concatenate([-e.sum(axis=1, keepdims=True), e], axis=1))


KIND = ClothConstraintKind(MEMBRANE, membrane_constraints, weight=4.0, packets=True, compliance=membrane_compliance,
                           slopes=membrane_slopes, by_stiffness=by_stiffness,
                           by_compliance=membrane_stiffness_gradient, at_rest=membrane_rest_gradient)
