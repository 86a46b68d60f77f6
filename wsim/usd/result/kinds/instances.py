"""Instances of a PointInstancer that bodies move: positions and orientations in its own frame.

An instance stands at W T O S P (column vectors): W of the instancer, T and O its position and orientation, S its scale, P of
the prototype. What has moved rigidly by D since the first frame has T O = W^-1 D W (T O)_0, which is rigid where W is, up to a
scale. Instances that nothing moves stay. Velocities are per second, angular ones in degrees.
"""

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, Vt

from wsim.geometry import rotation
from wsim.scene import Problem, SceneError
from wsim.scene.samples import InstanceSample
from wsim.usd.result.kinds.beside import SidecarFiles


def instancer_orientations(instancer: UsdGeom.PointInstancer, code, n: int) -> np.ndarray:
    """Quaternions (n, 4) (x, y, z, w); orientationsf counts before orientations."""
    for attribute in (instancer.GetOrientationsfAttr(), instancer.GetOrientationsAttr()):
        values = attribute.Get(code) if attribute else None
        if values:
            return rotation.unit_quat(np.array([[*q.GetImaginary(), q.GetReal()] for q in values], np.float64))
    return np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))


def _instancer_vec3_array(values) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _authored_vectors_or_zero(attribute: Usd.Attribute, code, n: int) -> np.ndarray:
    values = attribute.Get(code)
    return np.zeros((n, 3)) if not values or len(values) != n else np.array(values, np.float64)


def instancer_attribute_values(prim: Usd.Prim, sample: InstanceSample, code: float,
                               beside: SidecarFiles) -> list[tuple[Usd.Attribute, Any]]:
    """(attribute, value) at a time code. Raises SceneError where the prim is no instancer or has other instances."""
    instancer, stage = UsdGeom.PointInstancer(prim), prim.GetStage()
    start = stage.GetStartTimeCode()
    values = instancer.GetPositionsAttr().Get(start) if instancer else None
    k, metres = sample.numbers, UsdGeom.GetStageMetersPerUnit(stage)
    if values is None or len(values) <= k.max(initial=-1):
        raise SceneError(Problem(str(prim.GetPath()), "is no PointInstancer with as many instances as bodies move"))
    x = np.array(values, np.float64)
    n = len(x)
    q = instancer_orientations(instancer, start, n)
    W = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetLocalToWorldTransform(prim)).T
    W[:3, 3] *= metres
    D, back = sample.matrices, np.linalg.inv(W)
    M = back @ D @ W
    turn = M[:, :3, :3] / np.cbrt(np.linalg.det(M[:, :3, :3]))[:, None, None]
    x[k] = np.einsum("nij,nj->ni", M[:, :3, :3], x[k]) + M[:, :3, 3] / metres
    q[k] = rotation.quat_product(rotation.matrix_quat(turn), q[k])
    v, w = (_authored_vectors_or_zero(a, start, n)
            for a in (instancer.GetVelocitiesAttr(), instancer.GetAngularVelocitiesAttr()))
    world = (W[:3, :3] @ x[k].T).T * metres + W[:3, 3]
    rates = sample.velocities + np.cross(sample.spins, world - sample.centers)
    v[k] = (back[:3, :3] @ rates.T).T / metres
    w[k] = np.degrees((W[:3, :3].T @ sample.spins.T).T / np.cbrt(np.linalg.det(W[:3, :3])))
    quats = Vt.QuatfArray.FromNumpy(np.ascontiguousarray(q, np.float32))
    found = [(instancer.GetPositionsAttr(), _instancer_vec3_array(x)), (instancer.CreateOrientationsfAttr(), quats),
             (instancer.CreateVelocitiesAttr(), _instancer_vec3_array(v)),
             (instancer.CreateAngularVelocitiesAttr(), _instancer_vec3_array(w))]
    return found
