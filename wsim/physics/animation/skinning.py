"""Joint transforms and skinned points on the host, in NumPy and float64: the formulas that kernels/animation/skeleton.py and
kernels/animation/skin.py evaluate on a device, and their test.

    local      L_j(t) = T_j R_j diag(s_j) of animated joints, T and s linear in time, R by slerp; else the rest transform
    world      W_j = W_parent(j) L_j,  W_root = L_root                               (levels of the tree one after the other)
    skinning   A_j = W_j B_j^-1                                                      B_j: bind transforms
    linear     x_i = sum_c w_ic A_j(i,c) G p_i                                       G: the mesh's space to the skeleton's
    dual       A_j = R_j S_j + t_j (polar);  x_i = Q_i (sum_c w_ic S_j) G p_i,  Q_i = sum_c +-w_ic q_j / |...| with q_j the unit
               dual quaternion of (R_j, t_j), the sign such that its real part agrees with that of the largest weight

Linear blend is a convex sum of matrices, which shrinks what twists; dual quaternions blend rigidly (Kavan, Collins, Zara,
O'Sullivan 2008, Geometric skinning with approximate dual quaternion blending, section 4). A stretch is blended linearly before
the rotation, as UsdSkel does. Of a skeleton that is scaled itself, its stretch comes last.
"""

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import rotation
from wsim.scene.curve import Curve

if TYPE_CHECKING:
    from wsim.physics.animation.objects import BlendShape, Skeleton, Skinned

PAIRS = 1 << 21        # of a place and a triangle, looked at together: memory against calls
ROUNDED = 1e-6         # of the size of a mesh, by which squares of distances that are sums may be wrong; larger: more triangles

def joints_by_depth(parents: np.ndarray) -> list[np.ndarray]:
    """Joints by how many are above them: roots first. Raises ValueError where a joint is above itself."""
    depth = np.full(len(parents), -1)
    depth[parents < 0] = 0
    for _ in range(len(parents)):
        open_ = np.flatnonzero(depth < 0)
        if not len(open_):
            break
        above = depth[parents[open_]]
        depth[open_] = np.where(above >= 0, above + 1, -1)
    if (depth < 0).any():
        raise ValueError(f"joint {int(np.argmax(depth < 0))} is above itself")
    return [np.flatnonzero(depth == k).astype(np.int32) for k in range(int(depth.max(initial=-1)) + 1)]


def is_singular_transform(M: np.ndarray) -> np.ndarray:
    """True for each of the transforms (n, 4, 4) that has no inverse."""
    lengths = np.linalg.norm(M[:, :3, :3], axis=1)
    return ~(np.abs(np.linalg.det(M[:, :3, :3])) > 1e-12 * lengths.max(axis=1) ** 3)


def parent_space_transforms(world: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Transforms (joints, 4, 4) from a joint's parent's space, of those in the skeleton's; where a parent flattens, as they
    are."""
    found, none = world.copy(), is_singular_transform(world)
    for j, parent in enumerate(parents):
        if 0 <= parent < len(world) and not none[parent]:
            found[j] = np.linalg.solve(world[parent], world[j])
    return found


def sample_joint_animation(skeleton: "Skeleton", times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translations (times, joints, 3) [m], rotations (times, joints, 4) and scales (times, joints, 3) at times [s]."""
    T, Q, S = skeleton.translations, skeleton.orientations, skeleton.scales
    assert T is not None and S is not None
    b = np.searchsorted(skeleton.times, times, side="right")
    last = len(skeleton.times) - 1
    a, b = np.clip(b - 1, 0, last), np.clip(b, 0, last)
    way = skeleton.times[b] - skeleton.times[a]
    s = np.where(way > 0.0, (times - skeleton.times[a]) / np.where(way > 0.0, way, 1.0), 0.0)
    turned = rotation.slerp(Q[a], Q[b], np.broadcast_to(s[:, None], Q[a].shape[:2]))
    return T[a] + s[:, None, None] * (T[b] - T[a]), turned, S[a] + s[:, None, None] * (S[b] - S[a])


def local_joint_transforms(skeleton: "Skeleton", times: np.ndarray) -> np.ndarray:
    """L of all joints, (times, joints, 4, 4)."""
    found = np.tile(skeleton.rest, (len(times), 1, 1, 1))
    if skeleton.translations is not None:
        T, Q, S = sample_joint_animation(skeleton, times)
        moved = np.tile(np.eye(4), (*T.shape[:2], 1, 1))
        moved[..., :3, :3] = rotation.quaternion_to_matrix(Q) * S[..., None, :]
        moved[..., :3, 3] = T
        found[:, skeleton.animated] = moved[:, skeleton.animated]
    return found


def skeleton_space_transforms(parents: np.ndarray, L: np.ndarray) -> np.ndarray:
    """W of all joints, (times, joints, 4, 4), level by level."""
    W = L.copy()
    for level in joints_by_depth(parents)[1:]:
        W[:, level] = W[:, parents[level]] @ L[:, level]
    return W


def skinning_transforms(skeleton: "Skeleton", times: np.ndarray) -> np.ndarray:
    """A of all joints, (times, joints, 4, 4), in the skeleton's space."""
    times = np.asarray(times, np.float64)
    return skeleton_space_transforms(skeleton.parents, local_joint_transforms(skeleton, times)) @ np.linalg.inv(skeleton.bind)


def bind_space_points(skin: "Skinned") -> np.ndarray:
    """G p, (n, 3) [m]."""
    return skin.points @ skin.geom[:3, :3].T + skin.geom[:3, 3]


def skin_points(skin: "Skinned", A: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Points (times, n, 3) [m] of skinning transforms (times, joints, 4, 4)."""
    form = linear_blend_skinning if skin.method == "classicLinear" else dual_quaternion_skinning
    base, parts, weights = bind_space_points(skin), blend_shape_offsets(skin, times), skin.parts
    out = np.empty((len(A), len(base), 3))
    for k, each in enumerate(A):
        p = base if parts is None else base + parts[k] @ skin.geom[:3, :3].T
        out[k] = form(p, skin.joints, weights, each)
    return out if skin.skeleton.stretch is None else out @ skin.skeleton.stretch.T


def linear_blend_skinning(p: np.ndarray, joints: np.ndarray, weights: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Linear blend of points p (n, 3) by transforms A (joints, 4, 4); joints, weights: (n, m)."""
    out = np.zeros((len(p), 3))
    for c in range(joints.shape[1]):
        M = A[joints[:, c], :3]
        out += weights[:, c, None] * (np.einsum("nij,nj->ni", M[:, :, :3], p) + M[:, :, 3])
    return out


def dual_quaternion_parts(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quaternions q (..., 4) of transforms (..., 4, 4), their dual parts t q / 2 (..., 4), and stretches S (..., 3, 3)."""
    R, S = rotation.polar_decomposition(A[..., :3, :3])
    q = rotation.matrix_quat(R)
    t = np.concatenate([A[..., :3, 3], np.zeros((*A.shape[:-2], 1))], axis=-1)
    return q, 0.5 * rotation.quat_product(t, q), S


def dual_quaternion_skinning(p: np.ndarray, joints: np.ndarray, weights: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Dual quaternion blend, arguments as of `linear_blend_skinning`."""
    q, d, S = dual_quaternion_parts(A)
    pivot = q[joints[np.arange(len(p)), np.argmax(weights, axis=1)]]
    real, other, stretch = np.zeros((len(p), 4)), np.zeros((len(p), 4)), np.zeros((len(p), 3, 3))
    for c in range(joints.shape[1]):
        j, w = joints[:, c], weights[:, c, None]
        sign = np.where((q[j] * pivot).sum(axis=1, keepdims=True) < 0.0, -w, w)
        real, other, stretch = real + sign * q[j], other + sign * d[j], stretch + w[..., None] * S[j]
    return apply_dual_quaternions(real, other, np.einsum("nij,nj->ni", stretch, p))


def apply_dual_quaternions(q: np.ndarray, d: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Points moved by dual quaternions that are not unit yet: R p + 2 vec(d q*) / |q|^2."""
    size = (q * q).sum(axis=1, keepdims=True)
    shift = rotation.quat_product(d, rotation.quat_conjugate(q))[:, :3]
    return rotation.quat_rotate(q / np.sqrt(size), p) + 2.0 * shift / size


# blend shapes

def part_weights(shape: "BlendShape", weight: np.ndarray) -> np.ndarray:
    """Weights (times, knots) of offsets at weights (times,): linear between knots and 0, and on beyond the outermost."""
    knots = np.concatenate([[0.0], shape.knots])
    order = np.argsort(knots, kind="stable")
    a = np.clip(np.searchsorted(knots[order], weight, side="right") - 1, 0, len(knots) - 2)
    low, high = order[a], order[a + 1]
    s = (weight - knots[low]) / (knots[high] - knots[low])
    found, each = np.zeros((len(weight), len(knots))), np.arange(len(weight))
    found[each, low], found[each, high] = 1.0 - s, s
    return found[:, 1:]


def shape_weights(skin: "Skinned", shape: "BlendShape", times: np.ndarray) -> np.ndarray:
    """Weight of a blend shape at times [s], (times,): of the animation, or by the joint that drives it."""
    bones = skin.skeleton
    if shape.joint >= 0:
        if bones.translations is not None and bones.animated[shape.joint]:
            q = sample_joint_animation(bones, times)[1][:, shape.joint]
        else:
            q = np.tile(rotation.matrix_quat(rotation.polar_decomposition(bones.rest[shape.joint, :3, :3])[0]), (len(times), 1))
        target = rotation.unit_quat(np.array(shape.rotation))
        angle = np.linalg.norm(rotation.quaternion_logarithm(rotation.quat_product(rotation.quat_conjugate(target), q)), axis=1)
        s = np.clip(1.0 - angle / shape.width, 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s)
    if bones.weights is None or shape.name not in bones.shapes:
        return np.zeros(len(times))
    curve = Curve(bones.weights.times, bones.weights.values[:, bones.shapes.index(shape.name)])
    return curve.weights(times) @ curve.values


def blend_shape_offsets(skin: "Skinned", times: np.ndarray) -> np.ndarray | None:
    """Offsets (times, n, 3) [m] of all blend shapes, in the mesh's space; None where there are none."""
    if not skin.blends:
        return None
    found = np.zeros((len(times), len(skin.points), 3))
    for shape in skin.blends:
        parts = part_weights(shape, shape_weights(skin, shape, times))
        for k, each in enumerate(np.einsum("tk,kni->tni", parts, shape.offsets)):
            np.add.at(found[k], shape.points, each)
    return found


# places on skinned triangles

def points_over_triangles(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places (..., k, 3) of (u, v, h) over triangles (..., k, 3, 3): u x0 + v x1 + (1 - u - v) x2 + h n."""
    x0, x1, x2 = (corners[..., c, :] for c in range(3))
    u, v, h = (places[:, c, None] for c in range(3))
    n = np.cross(x1 - x0, x2 - x0)
    size = np.linalg.norm(n, axis=-1, keepdims=True)
    return u * x0 + v * x1 + (1.0 - u - v) * x2 + h * n / np.where(size > 0.0, size, 1.0)


def triangle_axes(corners: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of triangles (..., 3, 3): x along the first edge, z along the normal; 1 where there is no area."""
    e = corners[..., 1, :] - corners[..., 0, :]
    n = np.cross(e, corners[..., 2, :] - corners[..., 0, :])
    size = np.linalg.norm(n, axis=-1)[..., None, None]
    x, z = (v / np.where((length := np.linalg.norm(v, axis=-1, keepdims=True)) > 0.0, length, 1.0) for v in (e, n))
    return np.where(size > 0.0, np.stack([x, np.cross(z, x), z], axis=-1), np.eye(3))


def triangle_coordinates(corners: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(u, v, h), (k, 3), of places x (k, 3) over triangles (k, 3, 3) that have an area."""
    x0, x1, x2 = (corners[:, c] for c in range(3))
    n = np.cross(x1 - x0, x2 - x0)
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    M = np.stack([x0 - x2, x1 - x2, n], axis=2)
    return np.linalg.solve(M, (x - x2)[:, :, None])[..., 0]


def nearest_triangles(corners: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Number of the triangle among (t, 3, 3) with an area that is nearest to each place (k, 3); of equals the first.

    The middle of a triangle bounds the distance from above, and a ball about it from below: few triangles remain for a place.
    Raises ValueError where no triangle has an area."""
    edges = corners[:, 1:] - corners[:, :1]
    sound = np.flatnonzero(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 0.0)
    if not len(sound):
        raise ValueError(f"none of its {len(corners)} triangles has an area")
    middle = corners[sound].mean(axis=1)
    radius = np.linalg.norm(corners[sound] - middle[:, None], axis=2).max(axis=1)
    origin = middle.mean(axis=0)
    M, found = middle - origin, np.zeros(len(x), np.int64)
    size = np.abs(M).max() + np.abs(x - origin).max(initial=0.0)
    step = max(1, PAIRS // len(sound))
    for a in range(0, len(x), step):
        X = x[a:a + step] - origin
        away = np.sqrt(np.maximum((X * X).sum(1)[:, None] - 2.0 * X @ M.T + (M * M).sum(1), 0.0))
        near = away - radius <= away.min(axis=1, keepdims=True) + ROUNDED * size
        place, triangle = np.nonzero(near)
        d = triangle_distances(corners[sound[triangle]], x[a + place])
        order = np.lexsort((triangle, d, place))
        found[a:a + step] = sound[triangle[order[np.searchsorted(place, np.arange(len(X)))]]]
    return found


def triangle_distances(corners: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Distance [m] of each place (k, 3) to its own triangle (k, 3, 3), which has an area."""
    e0, e1 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    away, n = x - corners[:, 0], np.cross(e0, e1)
    nn = (n * n).sum(1)
    u = (np.cross(away, e1) * n).sum(1) / nn
    v = (np.cross(e0, away) * n).sum(1) / nn
    over = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    best = np.where(over, np.abs((away * n).sum(1)) / np.sqrt(nn), np.inf)
    for c in range(3):
        a, e = corners[:, c], corners[:, (c + 1) % 3] - corners[:, c]
        ee = (e * e).sum(1)
        s = np.clip(((x - a) * e).sum(1) / np.where(ee > 0.0, ee, 1.0), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(x - a - s[:, None] * e, axis=1))
    return best
