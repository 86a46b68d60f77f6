"""Joints of a skeleton as a SkelAnimation below it, which the result makes its animation."""

from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from wsim.scene import Problem, SceneError
from wsim.scene.samples import Joints
from wsim.usd.result.kinds.beside import SidecarFiles

NAME = "simulated"                 # of the animation


def skeleton_attribute_values(prim: Usd.Prim, sample: Joints, code: float,
                              beside: SidecarFiles) -> list[tuple[Usd.Attribute, Any]]:
    """(attribute, value) at a time code. Raises SceneError where the prim is no Skeleton."""
    stage, skeleton = prim.GetStage(), UsdSkel.Skeleton(prim)
    if not skeleton:
        raise SceneError(Problem(str(prim.GetPath()), f"is a {prim.GetTypeName() or 'prim without type'}; joints are written "
                                 "to a Skeleton"))
    path = prim.GetPath().AppendChild(NAME)
    animation = UsdSkel.Animation(stage.GetPrimAtPath(path))
    if not animation or not animation.GetJointsAttr().HasAuthoredValue():
        animation = UsdSkel.Animation.Define(stage, path)
        animation.CreateJointsAttr(list(sample.joints))
        if sample.shapes:
            animation.CreateBlendShapesAttr(list(sample.shapes))
        UsdSkel.BindingAPI.Apply(prim).CreateAnimationSourceRel().SetTargets([Sdf.Path(path)])
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    found = [(animation.CreateTranslationsAttr(), _typed_usd_array(Vt.Vec3fArray, sample.translations / metres, np.float32)),
             (animation.CreateRotationsAttr(), _typed_usd_array(Vt.QuatfArray, sample.rotations, np.float32)),
             (animation.CreateScalesAttr(), _typed_usd_array(Vt.Vec3hArray, sample.scales, np.float16))]
    if sample.weights is not None:
        found.append((animation.CreateBlendShapeWeightsAttr(), _typed_usd_array(Vt.FloatArray, sample.weights, np.float32)))
    return found


def _typed_usd_array(kind: Any, values, dtype) -> Any:
    return kind.FromNumpy(np.ascontiguousarray(values, dtype))
