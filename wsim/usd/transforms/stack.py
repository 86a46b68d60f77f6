"""Xform stacks with splines as `wsim.scene.curve.Stack`, and back: each op by its own curve, exactly as USD evaluates it at any
time code, whatever lies above it.

    op                                   read                                        written
    a constant                           a matrix                                    xformOp:transform
    translateX, rotateY, scaleZ ...      a part by its spline or samples             the same op, a spline
    translate, rotateXYZ, scale ...      a part for each axis, straight samples      -
    orient                               turns by slerp                              -
    transform                            a matrix by its elements                    xformOp:transform, samples

Other motions within a stack are written as matrices at their keys and at the frames between.
"""

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.stack import ELEMENTS, SCALE, SHIFT, TURN
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms.curves import author_curve, read_curve
from wsim.usd.transforms.matrix import row_matrix

NAMES = {SHIFT: "translate", TURN: "rotate", SCALE: "scale"}
KINDS = {name: what for what, name in NAMES.items()}


def stack_parts(reading: StageReading, ops: list) -> list | None:
    """Parts of ops, outermost first; None where one cannot be followed between its samples."""
    found = []
    for op in ops:
        own = _xform_op_parts(reading, op)
        if own is None:
            return None
        found += own
    return found


def _xform_op_parts(reading: StageReading, op: UsdGeom.XformOp) -> list | None:
    units, attribute = reading.units, op.GetAttr()
    if not attribute.ValueMightBeTimeVarying():
        M = np.array(op.GetOpTransform(reading.start)).T.copy()
        M[:3, 3] *= units.metres
        return [M]
    name = str(UsdGeom.XformOp.GetOpTypeToken(op.GetOpType()))
    kind = "hold" if reading.stage.GetInterpolationType() == Usd.InterpolationTypeHeld else "linear"
    base = next((k for k in KINDS if name.startswith(k)), "")
    if base:
        return _axis_parts(attribute, units, KINDS[base], name[len(base):] or "XYZ", kind, op.IsInverseOp())
    if op.IsInverseOp() or name not in ("transform", "orient"):
        return None
    codes = attribute.GetTimeSamples()
    times, values = units.time(np.array(codes)), [attribute.Get(code) for code in codes]
    if name == "orient":
        q = np.array([(*v.GetImaginary(), v.GetReal()) for v in values], np.float64)
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        return [Motion.through(times, np.zeros((len(q), 3)), q, kind)]
    M = np.array(values).swapaxes(1, 2).copy()
    M[:, :3, 3] *= units.metres
    return [Part(ELEMENTS, Curve(times, M, kind))]


def _axis_parts(attribute: Usd.Attribute, units: StageUnits, what: str, axes: str, kind: str, inverse: bool) -> list | None:
    """A part for each of the axes (letters), which act first to last."""
    factor = {SHIFT: units.metres, TURN: np.pi / 180.0, SCALE: 1.0}[what]
    if inverse and what == SCALE:
        return None
    factor = -factor if inverse else factor
    if len(axes) == 1:
        curve = read_curve(attribute, units, lambda code: float(attribute.Get(code)) * factor, factor)
        return [Part(what, Curve(curve.times, curve.values, kind) if curve.plain else curve, "XYZ".index(axes))]
    codes = attribute.GetTimeSamples()
    values = np.array([attribute.Get(code) for code in codes], np.float64).reshape(len(codes), -1) * factor
    columns = {letter: values[:, "XYZ".index(letter)] for letter in axes}
    order = axes if inverse else axes[::-1]                    # outermost, which acts last, first
    return [Part(what, Curve(units.time(np.array(codes)), columns[letter], kind), "XYZ".index(letter)) for letter in order]


def author_stack(prim: Usd.Prim, stack: Motion, units: StageUnits, write_matrix) -> list[UsdGeom.XformOp]:
    """Ops of a stack, outermost first. write_matrix(attribute, motion): samples of a motion on a matrix attribute."""
    ops = []
    assert isinstance(stack, Stack)
    for k, A in enumerate(stack.inner):
        if isinstance(A, Part) and A.what != ELEMENTS:
            name = f"xformOp:{NAMES[A.what]}{'XYZ'[A.axis]}:part{k}"
            attribute = prim.CreateAttribute(name, Sdf.ValueTypeNames.Double, False)
            factor = {SHIFT: units.metres, TURN: np.pi / 180.0, SCALE: 1.0}[A.what]
            author_curve(attribute, A.curve, units, _attribute_setter(attribute, factor), factor)
        else:
            attribute = prim.CreateAttribute(f"xformOp:transform:part{k}", Sdf.ValueTypeNames.Matrix4d, False)
            if isinstance(A, np.ndarray):
                attribute.Set(row_matrix(A, units))
            elif isinstance(A, Part):
                for time, M in zip(A.curve.times.tolist(), A.curve.values, strict=True):
                    attribute.Set(row_matrix(M, units), Usd.TimeCode(units.code(time)))
            else:
                write_matrix(attribute, A)
        ops.append(UsdGeom.XformOp(attribute))
    return ops


def _attribute_setter(attribute: Usd.Attribute, factor: float):
    """Puts a value in SI units at a time code."""
    def set_scaled_value(value, code) -> None:
        attribute.Set(float(value) / factor, code)
    return set_scaled_value
