"""Vector-Jacobian product of places on skinned points with respect to joint angles and weights of blend shapes, in NumPy and
float64: the chain of wsim/physics/animation/skinning.py backwards.

A joint's angle is a rotation vector e [rad] on its right, R exp(e). What hangs on the joint moves by the generator

    dA_i = G A_i,   G = K [e]x K^-1,   K = W_parent [R | T]                   for all joints i on the joint and below it

so that moments N_i = dL/dG of each joint, added from the leaves to the roots, give all angles at once. Of linear blend
N_i = sum w g (A_i p, 1)^T; of dual quaternions (rigid joints) N_i holds the gradients by a turn omega and a shift v, where

    dq = omega q / 2,   d' = t' q' / 2,   t' = t + omega x t + v

Between keys R = R_a exp(s phi), phi = log(R_a^-1 R_b):

    e = (exp(-s phi) - s J(s phi) J(-phi)^-1) e_a + s J(s phi) J(phi)^-1 e_b           J: right Jacobian of SO(3)

(Sola, Deray, Atchuthan 2018, A micro Lie theory, eq. 143, 144.) Gradients by the dual quaternion itself are by complex steps.
"""

from typing import Any

import numpy as np

from wsim.geometry import rotation
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import LINEAR, Follow, Skeleton, Skinned
from wsim.scene.curve import Curve

STEP = 1e-30           # of complex steps: exact, nothing is subtracted


def cross_product_matrix(v: np.ndarray) -> np.ndarray:
    """[v]x, (..., 3, 3)."""
    K = np.zeros((*v.shape[:-1], 3, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = np.moveaxis(v, -1, 0)
    return K - np.swapaxes(K, -1, -2)


def right_rotation_jacobian(v: np.ndarray) -> np.ndarray:
    """Right Jacobian J (..., 3, 3): exp(v + d) = exp(v) exp(J d) to first order."""
    a = np.linalg.norm(v, axis=-1)[..., None, None]
    small = a < 1e-4
    b = np.where(small, 1.0, a)
    K = cross_product_matrix(v)
    first = np.where(small, 0.5 - a * a / 24.0, (1.0 - np.cos(b)) / b ** 2)
    second = np.where(small, 1.0 / 6.0 - a * a / 120.0, (b - np.sin(b)) / b ** 3)
    return np.eye(3) - first * K + second * K @ K


def key_interval_jacobians(bones: Skeleton, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Keys a, b (times,) around each time, and the matrices (times, joints, 3, 3) by which e follows from e_a and e_b."""
    last = len(bones.times) - 1
    b = np.searchsorted(bones.times, times, side="right")
    a, b = np.clip(b - 1, 0, last), np.clip(b, 0, last)
    way = bones.times[b] - bones.times[a]
    s = np.where(way > 0.0, (times - bones.times[a]) / np.where(way > 0.0, way, 1.0), 0.0)[:, None]
    phi = rotation.quaternion_logarithm(rotation.quat_product(rotation.quat_conjugate(bones.orientations[a]),
                                                              bones.orientations[b]))
    part = s[..., None] * phi
    J, s = right_rotation_jacobian(part), s[..., None, None]
    by_a = (rotation.quaternion_to_matrix(rotation.quaternion_exponential(-part)) - s * J
            @ np.linalg.inv(right_rotation_jacobian(-phi)))
    return a, b, by_a, s * J @ np.linalg.inv(right_rotation_jacobian(phi))


def over_triangles_adjoint(corners: np.ndarray, places: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Gradients by corners (..., k, 3, 3) of `skinning.points_over_triangles`, from those by places (..., k, 3)."""
    x0, x1, x2 = (corners[..., c, :] for c in range(3))
    u, v, h = (places[:, c, None] for c in range(3))
    e, f = x1 - x0, x2 - x0
    n = np.cross(e, f)
    size = np.linalg.norm(n, axis=-1, keepdims=True)
    size, n = np.where(size > 0.0, size, 1.0), n / np.where(size > 0.0, size, 1.0)
    by_n = h * (g - n * (n * g).sum(-1, keepdims=True)) / size
    by_e, by_f = np.cross(f, by_n), np.cross(by_n, e)
    return np.stack([u * g - by_e - by_f, v * g + by_e, (1.0 - u - v) * g + by_f], axis=-2)


def linear_skinning_adjoint(skin: Skinned, p: np.ndarray, A: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (joints, 3, 4) and the gradients by bound points (n, 3), of one pose."""
    N, by_p, weights = np.zeros((len(A), 3, 4)), np.zeros_like(p), skin.parts
    q = np.concatenate([p, np.ones((len(p), 1))], axis=1)
    for c in range(skin.joints.shape[1]):
        M, w = A[skin.joints[:, c]], weights[:, c, None]
        np.add.at(N, skin.joints[:, c], (w * g)[:, :, None] * np.einsum("nij,nj->ni", M, q)[:, None, :])
        by_p += np.einsum("nij,ni->nj", M[:, :3, :3], w * g)
    return N, by_p


def _apply_complex_duals(q: np.ndarray, d: np.ndarray, p: np.ndarray) -> np.ndarray:
    """`skinning.apply_dual_quaternions`, of complex numbers too."""
    u, w, t, s = q[:, :3], q[:, 3:], d[:, :3], (q * q).sum(axis=1, keepdims=True)
    across = np.cross(u, p)
    return p + 2.0 / s * (w * across + np.cross(u, across) + w * t - d[:, 3:] * u - np.cross(t, u))


def dual_skinning_adjoint(skin: Skinned, p: np.ndarray, A: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N and gradients as `linear_skinning_adjoint` has them, of joints that turn and shift and are not scaled."""
    q, d, _ = skinning.dual_quaternion_parts(A)
    joints, weights = skin.joints, skin.parts
    pivot = q[joints[np.arange(len(p)), np.argmax(weights, axis=1)]]
    signs = np.where(np.einsum("ncq,nq->nc", q[joints], pivot) < 0.0, -weights, weights)
    real, other = (np.einsum("nc,ncq->nq", signs, each[joints]) for each in (q, d))
    by = np.zeros((2, len(p), 4))
    for k in range(4):
        step = np.zeros(4, complex)
        step[k] = 1j * STEP
        by[0, :, k] = (_apply_complex_duals(real + step, other + 0j, p) * g).sum(1).imag / STEP
        by[1, :, k] = (_apply_complex_duals(real + 0j, other + step, p) * g).sum(1).imag / STEP
    turns, shifts = np.zeros((len(A), 3)), np.zeros((len(A), 3))
    for c in range(joints.shape[1]):
        j, w = joints[:, c], signs[:, c, None]
        back = rotation.quat_conjugate(q[j])
        t = np.concatenate([A[j, :3, 3], np.zeros((len(p), 1))], axis=1)
        h = 0.5 * rotation.quat_product(by[1], back)[:, :3]
        turn = 0.5 * rotation.quat_product(by[0], back)[:, :3] + np.cross(t[:, :3], h)
        turn += 0.25 * rotation.quat_product(rotation.quat_product(-t, by[1]), back)[:, :3]
        np.add.at(turns, j, w * turn)
        np.add.at(shifts, j, w * h)
    unit = real / np.linalg.norm(real, axis=1, keepdims=True)
    return (np.concatenate([0.5 * cross_product_matrix(turns), shifts[:, :, None]], axis=2),
            rotation.quat_rotate(rotation.quat_conjugate(unit), g))


def joint_angle_gradients(bones: Skeleton, W: np.ndarray, L: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Gradients (joints, 3) by e of each joint at one time."""
    B = np.zeros((len(W), 4, 4))
    B[:, :3] = N
    for level in skinning.joints_by_depth(bones.parents)[:0:-1]:
        np.add.at(B, bones.parents[level], B[level])
    K = W.copy()
    for j, parent in enumerate(bones.parents.tolist()):
        own = L[j].copy()
        own[:3, :3] = rotation.polar_decomposition(own[:3, :3])[0]
        K[j] = own if parent < 0 else W[parent] @ own
    Z = np.swapaxes(K, 1, 2) @ B @ np.swapaxes(np.linalg.inv(K), 1, 2)
    return np.stack([Z[:, 2, 1] - Z[:, 1, 2], Z[:, 0, 2] - Z[:, 2, 0], Z[:, 1, 0] - Z[:, 0, 1]], axis=1)


def part_slopes(knots: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Derivatives (times, knots) of `skinning.part_weights`."""
    every = np.concatenate([[0.0], knots])
    order = np.argsort(every, kind="stable")
    a = np.clip(np.searchsorted(every[order], weight, side="right") - 1, 0, len(every) - 2)
    low, high, each = order[a], order[a + 1], np.arange(len(weight))
    found = np.zeros((len(weight), len(every)))
    found[each, low], found[each, high] = -1.0 / (every[high] - every[low]), 1.0 / (every[high] - every[low])
    return found[:, 1:]


def attachment_gradients(follow: Follow, times: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients by angles of the joints at the keys (keys, joints, 3) [1/rad], and by weights of blend shapes (keys, shapes),
    from gradients g (times, k, 3) [1/m] by `Follow.over(times)`."""
    skin, corners = follow.only_points()
    x = skin.over(times)
    turn = np.stack([skin.skeleton.motion.at(t)[:3, :3] for t in times])
    by_corners = over_triangles_adjoint(x[:, corners], np.asarray(follow.places, np.float64), g @ turn)
    by_x = np.zeros_like(x)
    for k, each in enumerate(by_corners):
        np.add.at(by_x[k], corners, each)
    return skinned_point_gradients(skin, times, by_x)


def skinned_point_gradients(skin: Skinned, times: np.ndarray, by_x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients as `attachment_gradients`, from those by `Skinned.over(times)`, (times, n, 3) [1/m]."""
    bones = skin.skeleton
    by_x = by_x if bones.stretch is None else by_x @ bones.stretch
    L = skinning.local_joint_transforms(bones, times)
    W = skinning.skeleton_space_transforms(bones.parents, L)
    A, base, offsets = (W @ np.linalg.inv(bones.bind), skinning.bind_space_points(skin),
                        skinning.blend_shape_offsets(skin, times))
    turning = bones.translations is not None
    around: Any = key_interval_jacobians(bones, times) if turning else ()
    turns, by_p = np.zeros((len(bones.times), len(bones.joints), 3)), np.zeros_like(by_x)
    for k in range(len(times)):
        p = base if offsets is None else base + offsets[k] @ skin.geom[:3, :3].T
        N, by_p[k] = (linear_skinning_adjoint if skin.method == LINEAR else dual_skinning_adjoint)(skin, p, A[k], by_x[k])
        if turning:
            a, b, by_a, by_b = around
            e = np.where(bones.animated[:, None], joint_angle_gradients(bones, W[k], L[k], N), 0.0)
            turns[a[k]] += np.einsum("jmi,jm->ji", by_a[k], e)
            turns[b[k]] += np.einsum("jmi,jm->ji", by_b[k], e)
    return turns, shape_gradients(skin, times, by_p @ skin.geom[:3, :3])


def shape_gradients(skin: Skinned, times: np.ndarray, by_p: np.ndarray) -> np.ndarray:
    """Gradients by weights of blend shapes at their keys, (keys, shapes), from those by points in the mesh's space (times, n,
    3)."""
    curve = skin.skeleton.weights
    if curve is None:
        return np.zeros((0, 0))
    found = np.zeros(curve.values.shape)
    for shape in skin.blends:
        if shape.joint < 0 and shape.name in skin.skeleton.shapes:
            slopes = part_slopes(shape.knots, skinning.shape_weights(skin, shape, times))
            each = np.einsum("tni,kni,tk->t", by_p[:, shape.points], shape.offsets, slopes)
            at = skin.skeleton.shapes.index(shape.name)
            found[:, at] += Curve(curve.times, curve.values[:, at]).weights(times).T @ each
    return found
