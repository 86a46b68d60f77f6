"""Samples of methods (`wsim.scene.samples`), put over the prims of a result: a row for each kind.

    Points      points, velocities, extent                        of a UsdGeom.PointBased
    Transform   xformOp:transform                                 of a UsdGeom.Xformable
    Instances   positions, orientationsf, velocities, angularVelocities, extent   of a UsdGeom.PointInstancer
    Particles   points, widths, ids, velocities, extent, colours  of a UsdGeom.Points
    Quantity    an attribute double or double[]                   of any prim
    Colour      primvars:displayColor of each point               of a UsdGeom.PointBased
    Joints      translations, rotations, scales of a SkelAnimation below a UsdSkel.Skeleton, see `wsim.usd.result.kinds.joints`
    Volume      assets filePath, a file a frame beside the layer  of a UsdVol.Volume, see `wsim.usd.result.kinds.volumes`
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from wsim.scene import Problem, SceneError
from wsim.scene.samples import (
    ColourSample,
    InstanceSample,
    Joints,
    ParticleSample,
    PointSample,
    QuantitySample,
    Sample,
    TransformSample,
    VolumeSample,
)
from wsim.usd import names
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.instances import instancer_attribute_values
from wsim.usd.result.samples import PrimFrame, particle_of_each_vertex, transform_may_vary
from wsim.usd.stage import applied_schemas

OP = "xformOp:transform"
Written = list[tuple[Usd.Attribute, Any]]           # (attribute, value), not yet set


@dataclass(frozen=True)
class ResultWriter:
    """type: of the prim that is made where none is there; write(prim, sample, time code, files) -> Written."""

    type: str
    write: Callable[[Usd.Prim, Any, float, SidecarFiles], Written]


def sample_attribute_values(stage: Usd.Stage, sample: Sample, code: float, beside: SidecarFiles) -> Written:
    """(attribute, value) of a sample at a time code, in the units of the stage, not yet set; its file is written. Raises
    SceneError where its prim cannot take it, OSError where the disk does not."""
    row = KINDS.get(type(sample))
    if row is None:
        known = ", ".join(kind.__name__ for kind in KINDS)
        raise SceneError(Problem("/", f"a method hands a {type(sample).__name__} to the result; there are {known}"))
    prim = stage.GetPrimAtPath(sample.path)
    if not prim:
        prim = stage.DefinePrim(sample.path, row.type)
    if not prim or prim.IsInstanceProxy():
        raise SceneError(Problem(sample.path, "is no prim that a layer can write over; the result needs it outside instances"))
    return row.write(prim, sample, code, beside)


def _vec3f_array(values: np.ndarray) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32).reshape(-1, 3))


def _require_schema(prim: Usd.Prim, schema: type) -> Any:
    found = schema(prim)
    if not found:
        raise SceneError(Problem(str(prim.GetPath()), f"is a {prim.GetTypeName() or 'prim without type'}; the result has "
                                 f"points for it, which want a {schema.__name__}"))
    return found


def _write_point_sample(prim: Usd.Prim, sample: PointSample, code: float, beside: SidecarFiles) -> Written:
    base, frame = _require_schema(prim, UsdGeom.PointBased), PrimFrame.of(prim, code)
    q = frame.points(np.asarray(sample.positions, np.float64).reshape(-1, 3))
    points = _vec3f_array(q)
    found = [(base.GetPointsAttr(), points), (base.CreateExtentAttr(), UsdGeom.PointBased.ComputeExtent(points))]
    if sample.velocities is not None:
        found.append((base.CreateVelocitiesAttr(),
                      _vec3f_array(frame.velocities(np.asarray(sample.velocities, np.float64), q))))
    return found


def _write_particle_sample(prim: Usd.Prim, sample: ParticleSample, code: float, beside: SidecarFiles) -> Written:
    """Widths as the prim's scale leaves them: of the cube root of its volume."""
    base, frame = _require_schema(prim, UsdGeom.Points), PrimFrame.of(prim, code)
    q = frame.points(np.asarray(sample.positions, np.float64).reshape(-1, 3))
    scale = frame.unit * np.cbrt(abs(np.linalg.det(frame.L)))
    widths = Vt.FloatArray.FromNumpy(np.broadcast_to(np.asarray(sample.widths) / scale, (len(q),)).astype(np.float32))
    points = _vec3f_array(q)
    found = [(base.GetPointsAttr(), points), (base.CreateWidthsAttr(), widths),
             (base.CreateIdsAttr(), Vt.Int64Array.FromNumpy(np.ascontiguousarray(sample.ids, np.int64))),
             (base.CreateExtentAttr(), UsdGeom.Points.ComputeExtent(points, widths))]
    if sample.velocities is not None:
        found.append((base.CreateVelocitiesAttr(),
                      _vec3f_array(frame.velocities(np.asarray(sample.velocities, np.float64), q))))
    if sample.colors is not None:
        found.append((_particle_colours(prim, np.ndim(sample.colors) > 1), _vec3f_array(sample.colors)))
    return found


def _particle_colours(prim: Usd.Prim, each: bool) -> Usd.Attribute:
    """displayColor of particles: one of each, or one of all. Indices that a source may have count no more."""
    kind = UsdGeom.Tokens.vertex if each else UsdGeom.Tokens.constant
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, kind)
    if primvar.IsIndexed():
        primvar.BlockIndices()
    return primvar.GetAttr()


def _write_transform_sample(prim: Usd.Prim, sample: TransformSample, code: float, beside: SidecarFiles) -> Written:
    """The transform op of a prim whose world matrix [m] that is. Below what moves, such as another body, its stack is reset:
    between samples, USD would turn its place about that of the body above."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable:
        raise SceneError(Problem(str(prim.GetPath()), "moves and is not Xformable; author it as an Xform or a shape"))
    first = not prim.GetStage().GetEditTarget().GetLayer().GetAttributeAtPath(prim.GetPath().AppendProperty(OP))
    reset = first and (xformable.GetResetXformStack() or _may_move(prim.GetParent()))
    ops = xformable.GetOrderedXformOps()
    op = ops[0] if len(ops) == 1 and ops[0].GetOpName() == OP else xformable.MakeMatrixXform()
    if reset:
        xformable.SetXformOpOrder([op], True)
    scale = UsdGeom.GetStageMetersPerUnit(prim.GetStage())
    above = np.array(xformable.ComputeParentToWorldTransform(Usd.TimeCode.Default())).T
    M = np.array(sample.matrix, np.float64)
    M[:3, 3] /= scale
    local = np.linalg.solve(np.eye(4) if xformable.GetResetXformStack() else above, M)
    return [(op.GetAttr(), Gf.Matrix4d(*local.T.ravel().tolist()))]


def _may_move(prim: Usd.Prim) -> bool:
    """True if a prim may move: its transform varies in time, or it is a rigid body or lies below one."""
    return transform_may_vary(prim) or any(names.RIGID_BODY in applied_schemas(prim.GetStage().GetPrimAtPath(path))
                                           for path in prim.GetPath().GetPrefixes())


def _write_quantity_sample(prim: Usd.Prim, sample: QuantitySample, code: float, beside: SidecarFiles) -> Written:
    several = np.ndim(sample.value) > 0
    kind = Sdf.ValueTypeNames.DoubleArray if several else Sdf.ValueTypeNames.Double
    attribute = prim.GetAttribute(sample.name) or prim.CreateAttribute(sample.name, kind, True)
    if not several:
        return [(attribute, float(sample.value))]
    return [(attribute, Vt.DoubleArray.FromNumpy(np.ascontiguousarray(sample.value, np.float64).reshape(-1)))]


def _write_volume_sample(prim: Usd.Prim, sample: VolumeSample, code: float, beside: SidecarFiles) -> Written:
    from wsim.usd.result.kinds.volumes import volume_attribute_values
    return volume_attribute_values(prim, sample, code, beside)


def _write_joint_sample(prim: Usd.Prim, sample: Joints, code: float, beside: SidecarFiles) -> Written:
    from wsim.usd.result.kinds.joints import skeleton_attribute_values
    return skeleton_attribute_values(prim, sample, code, beside)


def _write_colour_sample(prim: Usd.Prim, sample: ColourSample, code: float, beside: SidecarFiles) -> Written:
    """The indices that a source may have for its own colours count no more."""
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    if primvar.IsIndexed():
        primvar.BlockIndices()
    particles = particle_of_each_vertex(prim)
    return [(primvar.GetAttr(), _vec3f_array(sample.values if particles is None else sample.values[particles]))]


KINDS: dict[type, ResultWriter] = {
    PointSample: ResultWriter("Points", _write_point_sample),
    TransformSample: ResultWriter("Xform", _write_transform_sample),
    InstanceSample: ResultWriter("PointInstancer", instancer_attribute_values),
    Joints: ResultWriter("Skeleton", _write_joint_sample),
    ParticleSample: ResultWriter("Points", _write_particle_sample),
    QuantitySample: ResultWriter("", _write_quantity_sample),
    VolumeSample: ResultWriter("Volume", _write_volume_sample),
    ColourSample: ResultWriter("Points", _write_colour_sample),
}
