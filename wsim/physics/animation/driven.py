"""Joints that rigid bodies drive, as a sample for results: transforms of all joints from their parents' spaces. NumPy only.

    driven      W_j(t) = M(t)^-1 X_b(t) X_b(0)^-1 M(0) W_j(0)     X_b: body to world, M: skeleton to world with its stretch
    others      W_j(t) = W_parent(t) L_j(t)                       L: as animated, else at rest
    written     L_j = W_parent^-1 W_j = T R diag(s)

A body keeps to its joint as it does where the scene begins, wherever its centre and its shapes are.
"""

import numpy as np

from wsim.geometry import rotation
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import Skeleton
from wsim.scene.samples import Joints


def skeleton_to_world(bones: Skeleton, time: float) -> np.ndarray:
    """The skeleton's space to world, stretch and all, (4, 4) [m]."""
    M = bones.motion.at(time).copy()
    if bones.stretch is not None:
        M[:3, :3] = M[:3, :3] @ bones.stretch
    return M


def driven_joint_sample(bones: Skeleton, moved: dict[str, np.ndarray], time: float) -> Joints:
    """moved: X(t) X(0)^-1 of the bodies, (4, 4) [m], by path; time [s]."""
    L = skinning.local_joint_transforms(bones, np.array([0.0, time]))
    start = skinning.skeleton_space_transforms(bones.parents, L[:1])[0]
    begun, back = skeleton_to_world(bones, 0.0), np.linalg.inv(skeleton_to_world(bones, time))
    found, W = L[1].copy(), np.tile(np.eye(4), (len(bones.joints), 1, 1))
    for level in skinning.joints_by_depth(bones.parents):
        for j in level.tolist():
            parent, body = bones.parents[j], bones.bodies.get(bones.joints[j])
            above = np.eye(4) if parent < 0 else W[parent]
            if body is not None:
                found[j] = np.linalg.solve(above, back @ moved[body] @ begun @ start[j])
            W[j] = above @ found[j]
    R, S = rotation.polar_decomposition(found[:, :3, :3])
    names, values = bones.shapes, None
    if bones.weights is not None:
        values = bones.weights.at(time)
    return Joints(bones.path, bones.joints, found[:, :3, 3], rotation.matrix_quat(R), np.diagonal(S, axis1=1, axis2=2).copy(),
                  names, values)
