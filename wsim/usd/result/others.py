"""Samples of anything but points (`wsim.scene.samples`), put over the prims of a result."""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from wsim.scene import Problem, SceneError
from wsim.scene.samples import Colour, Sample, Transform
from wsim.usd.result.samples import particles_of

OP = "xformOp:transform"


def taken(stage: Usd.Stage, sample: Sample) -> tuple:
    """(attribute, value) of a sample, in the units of the stage. Raises SceneError where its prim cannot take it."""
    prim = stage.GetPrimAtPath(sample.path)
    if not prim or prim.IsInstanceProxy():
        raise SceneError(Problem(sample.path, "is no prim that a layer can write over; the result needs it outside instances"))
    if isinstance(sample, Transform):
        return _transform(prim, sample.matrix)
    if isinstance(sample, Colour):
        return _colour(prim, sample.values)
    return prim.GetAttribute(sample.name) or prim.CreateAttribute(sample.name, Sdf.ValueTypeNames.Double, True), sample.value


def _transform(prim: Usd.Prim, world: np.ndarray) -> tuple:
    """The transform op of a prim whose world matrix [m] that is. What is above it must stand still."""
    xformable = UsdGeom.Xformable(prim)
    if not xformable:
        raise SceneError(Problem(str(prim.GetPath()), "moves and is not Xformable; author it as an Xform or a shape"))
    ops = xformable.GetOrderedXformOps()
    op = ops[0] if len(ops) == 1 and ops[0].GetOpName() == OP else xformable.MakeMatrixXform()
    scale = UsdGeom.GetStageMetersPerUnit(prim.GetStage())
    above = np.array(xformable.ComputeParentToWorldTransform(Usd.TimeCode.Default())).T
    M = np.array(world, np.float64)
    M[:3, 3] /= scale
    local = np.linalg.solve(np.eye(4) if xformable.GetResetXformStack() else above, M)
    return op.GetAttr(), Gf.Matrix4d(*local.T.ravel().tolist())


def _colour(prim: Usd.Prim, colours: np.ndarray) -> tuple:
    """displayColor of each point; the indices that a source may have for its own count no more."""
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    if primvar.IsIndexed():
        primvar.BlockIndices()
    particles = particles_of(prim)
    colours = colours if particles is None else colours[particles]
    return primvar.GetAttr(), Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(colours, np.float32))
