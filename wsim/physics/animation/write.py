"""`Skeleton`, `Skinned`, `Follow` -> UsdSkel: Skeleton, SkelAnimation, bindings and blend shapes below a
SkelRoot."""

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from wsim.physics.animation.objects import Follow, Skeleton, Skinned
from wsim.scene import Problem, SceneError
from wsim.usd import names
from wsim.usd.attributes import author_attribute as write
from wsim.usd.attributes import author_times
from wsim.usd.stage import StageUnits
from wsim.usd.transforms import author_motion

ANIMATION = "animation"            # child of a skeleton
JOINT, ROTATION, WIDTH = (names.attribute_entry("Corrective", field).attribute for field in ("joint", "rotation", "width"))
BODIES, DRIVEN = names.DRIVERS, names.attribute_entry("Skeleton", "driven").attribute


def _usd_matrix_in_units(M: np.ndarray, units: StageUnits) -> Gf.Matrix4d:
    M = np.array(M, np.float64)
    M[:3, 3] /= units.metres
    return Gf.Matrix4d(*M.T.ravel().tolist())


def _typed_vector_array(values, kind: Any = Vt.Vec3fArray) -> Any:
    return kind.FromNumpy(np.ascontiguousarray(values, np.float16 if kind is Vt.Vec3hArray else np.float32).reshape(-1, 3))


def _quatf_array(values: np.ndarray) -> Vt.QuatfArray:
    return Vt.QuatfArray.FromNumpy(np.ascontiguousarray(values, np.float32).reshape(-1, 4))


def make_skel_root(stage: Usd.Stage, *paths: str) -> None:
    """Makes the nearest prim above all of them a SkelRoot."""
    above = Sdf.Path(paths[0]).GetParentPath()
    for path in paths[1:]:
        above = above.GetCommonPrefix(Sdf.Path(path).GetParentPath())
    known = above
    while not known.IsAbsoluteRootPath():
        if stage.GetPrimAtPath(known) and stage.GetPrimAtPath(known).GetTypeName() == "SkelRoot":
            return
        known = known.GetParentPath()
    if above.IsAbsoluteRootPath():
        raise SceneError(Problem(paths[-1], f"and {paths[0]} have no prim above them that can be a SkelRoot; put both below "
                                 "one, as /man/bones and /man/body are"))
    UsdSkel.Root.Define(stage, above)


def author(stage: Usd.Stage, bones: Skeleton, units: StageUnits) -> None:
    """Defines the prims of a skeleton and of its animation."""
    make_skel_root(stage, bones.path)
    made = UsdSkel.Skeleton.Define(stage, bones.path)
    prim = made.GetPrim()
    author_motion(prim, bones.motion, units, 0)
    if bones.stretch is not None:
        S = np.eye(4)
        S[:3, :3] = bones.stretch
        UsdGeom.Xformable(prim).AddTransformOp(UsdGeom.XformOp.PrecisionDouble, "stretch").Set(_usd_matrix_in_units(S, units))
    made.CreateJointsAttr(list(bones.joints))
    made.CreateBindTransformsAttr(Vt.Matrix4dArray([_usd_matrix_in_units(M, units) for M in bones.bind]))
    made.CreateRestTransformsAttr(Vt.Matrix4dArray([_usd_matrix_in_units(M, units) for M in bones.rest]))
    if bones.translations is not None or bones.weights is not None:
        _author_skel_animation(stage, bones, f"{bones.path}/{ANIMATION}", units)
        UsdSkel.BindingAPI.Apply(prim).CreateAnimationSourceRel().SetTargets([Sdf.Path(f"{bones.path}/{ANIMATION}")])
    if bones.bodies:
        prim.AddAppliedSchema(names.WSIM_SKELETON)
        prim.CreateRelationship(BODIES, False).SetTargets([Sdf.Path(path) for path in bones.bodies.values()])
        prim.CreateAttribute(DRIVEN, Sdf.ValueTypeNames.TokenArray, False, Sdf.VariabilityUniform).Set(list(bones.bodies))


def _author_skel_animation(stage: Usd.Stage, bones: Skeleton, path: str, units: StageUnits) -> None:
    made = UsdSkel.Animation.Define(stage, path)
    moved = np.flatnonzero(bones.animated)
    made.CreateJointsAttr([bones.joints[j] for j in moved])
    if bones.translations is not None and bones.rotations is not None and bones.scales is not None:
        still = len(bones.times) == 1 and bones.times[0] == 0.0
        for k, time in enumerate(bones.times.tolist()):
            code = Usd.TimeCode.Default() if still else Usd.TimeCode(units.code(time))
            made.CreateTranslationsAttr().Set(_typed_vector_array(bones.translations[k, moved] / units.metres), code)
            made.CreateRotationsAttr().Set(_quatf_array(bones.rotations[k, moved]), code)
            made.CreateScalesAttr().Set(_typed_vector_array(bones.scales[k, moved], Vt.Vec3hArray), code)
        if not still:
            author_times(made.GetTranslationsAttr(), bones.times)
    if bones.weights is not None:
        made.CreateBlendShapesAttr(list(bones.shapes))
        still = not bones.weights.moves
        for time, value in zip(bones.weights.times.tolist(), bones.weights.values, strict=True):
            code = Usd.TimeCode.Default() if still else Usd.TimeCode(units.code(time))
            made.CreateBlendShapeWeightsAttr().Set(Vt.FloatArray.FromNumpy(np.asarray(value, np.float32)), code)
        if not still:
            author_times(made.GetBlendShapeWeightsAttr(), bones.weights.times)


def bind(stage: Usd.Stage, path: str, skin: Skinned, units: StageUnits) -> None:
    """Writes the bound points of a mesh and what moves them."""
    make_skel_root(stage, path, skin.skeleton.path)
    prim = stage.GetPrimAtPath(path)
    UsdGeom.Mesh(prim).GetPointsAttr().Set(_typed_vector_array(skin.points / units.metres))
    api = UsdSkel.BindingAPI.Apply(prim)
    api.CreateSkeletonRel().SetTargets([Sdf.Path(skin.skeleton.path)])
    m = skin.joints.shape[1]
    api.CreateJointIndicesPrimvar(False, m).Set(Vt.IntArray.FromNumpy(skin.joints.ravel()))
    api.CreateJointWeightsPrimvar(False, m).Set(Vt.FloatArray.FromNumpy(skin.weights.astype(np.float32).ravel()))
    api.CreateGeomBindTransformAttr().Set(_usd_matrix_in_units(skin.geom, units))
    method = prim.CreateAttribute("primvars:skel:skinningMethod", Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform)
    method.Set(skin.method)
    if skin.blends:
        _author_blend_shapes(stage, prim, api, skin, units)


def _author_blend_shapes(stage: Usd.Stage, mesh: Usd.Prim, api: UsdSkel.BindingAPI, skin: Skinned, units: StageUnits) -> None:
    paths = [mesh.GetPath().AppendChild(f"shape_{k}") for k in range(len(skin.blends))]
    api.CreateBlendShapesAttr([shape.name for shape in skin.blends])
    api.CreateBlendShapeTargetsRel().SetTargets(paths)
    for path, shape in zip(paths, skin.blends, strict=True):
        made = UsdSkel.BlendShape.Define(stage, path)
        made.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(shape.points))
        for k, knot in enumerate(shape.knots.tolist()):
            offsets = _typed_vector_array(shape.offsets[k] / units.metres)
            if knot == 1.0:
                made.CreateOffsetsAttr(offsets)
            else:
                between = made.CreateInbetween(f"part_{k}")
                between.SetOffsets(offsets), between.SetWeight(knot)
        if shape.joint >= 0:
            prim, kinds = made.GetPrim(), Sdf.ValueTypeNames
            prim.AddAppliedSchema(names.WSIM_CORRECTIVE)
            prim.CreateAttribute(JOINT, kinds.Token, False, Sdf.VariabilityUniform).Set(skin.skeleton.joints[shape.joint])
            x, y, z, w = map(float, shape.rotation)
            prim.CreateAttribute(ROTATION, kinds.Quatf, False, Sdf.VariabilityUniform).Set(Gf.Quatf(w, x, y, z))
            prim.CreateAttribute(WIDTH, kinds.Float, False, Sdf.VariabilityUniform).Set(float(np.degrees(shape.width)))


def attach(prim: Usd.Prim, target: str, follow: Follow, units: StageUnits) -> None:
    """Writes where an attachment holds its points: points or faces of a skinned mesh."""
    points = follow.faces is None
    prim.CreateRelationship(names.SRC1, False).SetTargets([Sdf.Path(target)])
    write(prim, "Pin", "type1", "point" if points else "face")
    write(prim, "Tie", "others", follow.corners[:, 0] if points else follow.faces)
    if not points:
        attribute = prim.CreateAttribute(names.attribute_entry("Pin", "places").attribute, Sdf.ValueTypeNames.Vector3fArray,
                                         False)
        attribute.Set(_typed_vector_array(follow.places / (1.0, 1.0, units.metres)))
