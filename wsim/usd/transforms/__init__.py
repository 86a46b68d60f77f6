"""Transforms over time: xform stacks of a stage <-> `wsim.scene.curve.Motion`.

Read. M(t) = A(t) diag(s(t)): A the local-to-world transform without a trailing scale op of the prim itself, s that
scale, so that the sizes of a box, which USD says by such a scale, come back to the bit. An animated transform has a
key at every time code authored on the prim or above it and at every frame between, so that frames see exactly what USD
says.

Written. A prim that moves has one matrix op, sampled at the keys and at the frames between them (USD interpolates a
matrix by its elements, Motion turns at constant speed); the exact times of the keys, and the kind of a motion, are noted
beside the samples, and a load uses them as long as the motion that they give agrees with the samples.

Stacks. Where a prim, or one above it, has a spline, or what turns carries the prim along an arc, `exact` is the same stack of
ops by their own curves (stack.py): between frames a tile of a turntable would go along chords, and slip below what it carries.
"""

from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from wsim.geometry.rotation import polar_decomposition
from wsim.scene import Problem, SceneError
from wsim.scene.curve import Motion
from wsim.usd.attributes import author_times, read_times
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms.curves import note_kind, read_kind
from wsim.usd.transforms.matrix import row_matrix
from wsim.usd.transforms.operations import check_xform_ops
from wsim.usd.transforms.splines import has_spline

MATRIX_OP = "xformOp:transform"
ROUNDING = 1e-14                   # of a matrix that is 1
COARSE = 1e-5                      # of the places of a motion along an arc; USD interpolates float32 to 1e-6
RIGID = 1e-9                       # |R^T R - I| below which a transform counts as rigid; float32 authoring gives 1e-7


@dataclass
class Placement:
    """times [s], (k,); frame, (k, 4, 4) local to world [m] less the trailing scale; scale, (k, 3); exact: the frame between
    keys, where it is no plain `Motion`."""

    times: np.ndarray
    frame: np.ndarray
    scale: np.ndarray
    exact: Motion | None = None

    @property
    def linear(self) -> np.ndarray:
        """3x3 parts with the scale, (k, 3, 3)."""
        return self.frame[:, :3, :3] * self.scale[:, None, :]

    @property
    def motion(self) -> Motion:
        whole = self.frame.copy()
        whole[:, :3, :3] = self.linear
        return self.follow(whole)

    def follow(self, frames: np.ndarray) -> Motion:
        """The motion with these transforms (k, 4, 4) [m] at the keys: exact where they are the frame with a constant matrix."""
        if self.exact is not None:
            own = np.linalg.solve(self.frame[0], frames[0])
            if np.abs(self.frame @ own - frames).max() <= RIGID * max(1.0, np.abs(frames).max()):
                from wsim.scene.curve import then
                return then(self.exact, own) if np.abs(own - np.eye(4)).max() > ROUNDING else self.exact
        return Motion(self.times, frames)


def read_placement(reading: StageReading, prim: Usd.Prim) -> Placement:
    """Motion of a prim, at its keys. Raises SceneError where an op of it, or of one above, is of another type than its name."""
    try:
        for xformable in _xformable_ancestors(prim):
            check_xform_ops(reading, xformable.GetPrim())
        exact = _noted_placement(reading, prim)
        if exact is not None:
            return exact
        codes = _transform_time_codes(reading, prim)
        times = np.zeros(1) if codes is None else reading.units.time(codes)
        found = _sampled_placement(reading, prim, [reading.units.start] if codes is None else codes, times)
        found.exact = None if codes is None else _exact_motion(reading, prim, found)
        return found
    except (Tf.ErrorException, TypeError, ValueError, IndexError):
        raise SceneError(Problem(str(prim.GetPath()), "its transform, or one above it, cannot be read: an xformOp has a value "
                                 "of another type than its name says; author its xformOps again")) from None


def _sampled_placement(reading: StageReading, prim: Usd.Prim, codes, times: np.ndarray) -> Placement:
    pairs = [_world_matrix_and_scale(reading, prim, float(code)) for code in codes]
    return Placement(times, np.array([a for a, _ in pairs]), np.array([s for _, s in pairs]))


def _world_matrix_and_scale(reading: StageReading, prim: Usd.Prim, code: float) -> tuple[np.ndarray, np.ndarray]:
    """Local to world [m] at a time code, less the trailing scale; that scale."""
    if code not in reading.xforms:
        reading.xforms[code] = UsdGeom.XformCache(Usd.TimeCode(code))
    cache = reading.xforms[code]
    xformable = UsdGeom.Xformable(prim)
    ops = xformable.GetOrderedXformOps() if xformable else []
    scale = np.ones(3)
    if _ends_with_scale(ops):
        value = ops[-1].Get(Usd.TimeCode(code))
        scale = scale if value is None else np.array([float(value[k]) for k in range(3)])
        matrix = Gf.Matrix4d(1.0)
        for op in ops[:-1]:                                    # row vectors: the last op acts first
            matrix = op.GetOpTransform(Usd.TimeCode(code)) * matrix
        if not xformable.GetResetXformStack():
            matrix = matrix * cache.GetParentToWorldTransform(prim)
    else:
        matrix = cache.GetLocalToWorldTransform(prim)
    M = np.array(matrix).T.copy()
    M[:3, 3] *= reading.units.metres
    return M, scale


def _ends_with_scale(ops: list) -> bool:
    """Whether a stack ends with a scale by three numbers."""
    return bool(ops) and ops[-1].GetOpType() == UsdGeom.XformOp.TypeScale and not ops[-1].IsInverseOp()


def _xformable_ancestors(prim: Usd.Prim) -> list[UsdGeom.Xformable]:
    """The prim and what is above it, up to where the stack is reset."""
    chain = []
    while prim and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            chain.append(xformable)
            if xformable.GetResetXformStack():
                break
        prim = prim.GetParent()
    return chain


def _transform_time_codes(reading: StageReading, prim: Usd.Prim) -> np.ndarray | None:
    """Time codes of every authored sample and the frames between them; None if nothing above the prim moves."""
    samples: set[float] = set()
    moves = splines = False
    for xformable in _xformable_ancestors(prim):
        for op in xformable.GetOrderedXformOps():
            attribute = op.GetAttr()
            samples.update(attribute.GetTimeSamples())
            splines = splines or attribute.HasSpline()
            moves = moves or splines or attribute.ValueMightBeTimeVarying()
    if not moves:
        return None
    first, last = (min(samples), max(samples)) if samples and not splines else (-np.inf, np.inf)
    frames = reading.units.start + np.arange(reading.frames + 1)
    frames = frames[(frames >= first) & (frames <= last)]      # USD holds the first and the last sample, as Motion does
    return np.unique(np.concatenate([frames, np.array(sorted(samples), np.float64)]))


def _exact_motion(reading: StageReading, prim: Usd.Prim, found: Placement) -> Motion | None:
    """Local to world less the trailing scale, by splines and along arcs; None where there are none, an op cannot be followed
    (noted where it is a spline), or an arc is not where `found` is at its keys (USD interpolates half floats coarsely)."""
    chain = [x.GetOrderedXformOps() for x in _xformable_ancestors(prim)]
    curved = any(has_spline(op.GetAttr()) for ops in chain for op in ops)
    if UsdGeom.Xformable(prim) and _ends_with_scale(chain[0]):
        chain[0] = chain[0][:-1]
    ops = [op for each in chain[::-1] for op in each]                # outermost first
    if not curved and not _turns_with_offset_below(ops, reading.start):
        return None
    from wsim.scene.curve import Stack
    from wsim.usd.transforms.stack import stack_parts
    try:
        inner = stack_parts(reading, ops)
    except ValueError as why:
        inner = None
        reading.warn(prim.GetPath(), f"{why} in its xformOps: they are evaluated at frames, and turn evenly between them")
    exact = None if inner is None else Stack(inner)
    if exact is None or curved:
        return exact
    away = np.abs(exact.sampled(found.times) - found.frame).max()
    return exact if away <= COARSE * max(1.0, np.abs(found.frame).max()) else None


def _turns_with_offset_below(ops: list, start: Usd.TimeCode) -> bool:
    """Whether an op that turns over time has an op of a place within it (ops outermost first)."""
    turns = [k for k, op in enumerate(ops) if op.GetAttr().ValueMightBeTimeVarying()
             and ("rotate" in op.GetName() or "orient" in op.GetName())]
    return bool(turns) and any(op.GetAttr().ValueMightBeTimeVarying() and "translate" in op.GetName()
                               or np.any(op.GetOpTransform(start).ExtractTranslation()) for op in ops[turns[0] + 1:])


def _noted_placement(reading: StageReading, prim: Usd.Prim) -> Placement | None:
    """The keys that `author_motion` noted, if the samples still say the same motion."""
    attribute = prim.GetAttribute(MATRIX_OP)
    times = read_times(attribute, reading.units)
    if times is None or any(_xform_ops_vary(x) for x in _xformable_ancestors(prim)[1:]):
        return None
    samples = np.array(attribute.GetTimeSamples(), np.float64)
    found = _sampled_placement(reading, prim, reading.units.code(times), times)
    try:
        motion = Motion(times, found.frame, **read_kind(attribute))
    except (TypeError, ValueError):
        return None
    tolerance = 1e-9 * max(1.0, float(np.abs(found.frame).max()))
    for code in samples:
        frame, scale = _world_matrix_and_scale(reading, prim, float(code))
        if np.abs(motion.at(reading.units.time(code)) - frame).max() > tolerance or np.any(scale != found.scale[0]):
            return None
    found.exact = None if motion.plain else motion
    return found


def _xform_ops_vary(xformable: UsdGeom.Xformable) -> bool:
    return any(op.GetAttr().ValueMightBeTimeVarying() for op in xformable.GetOrderedXformOps())


def split_rotation_scale(linear: np.ndarray, mirror: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """L = R S with R a rotation, shape (3, 3). Without shear S is diagonal, and a mirror image is a negative scale
    along axis `mirror`; with shear S is symmetric. A rotation within 1e-9 is returned untouched with S = 1.

    Raises ValueError if L is singular: there is no volume left to collide with.
    """
    gram = linear.T @ linear
    if np.abs(gram - np.eye(3)).max() < RIGID and np.linalg.det(linear) > 0:
        return linear, np.eye(3)
    lengths = np.sqrt(np.diag(gram))
    if not np.all(np.isfinite(linear)):
        raise ValueError("its transform holds NaN or infinity; author its xformOps again")
    if abs(np.linalg.det(linear)) <= 1e-12 * lengths.max() ** 3:
        raise ValueError("its transform flattens it (a scale is zero); give it scales other than zero")
    if np.abs(gram - np.diag(np.diag(gram))).max() > 1e-6 * lengths.max() ** 2:
        return polar_decomposition(linear)
    R = linear / lengths
    if np.linalg.det(R) < 0:
        R[:, mirror] *= -1
        lengths[mirror] *= -1
    return R, np.diag(lengths)


def split_placement(place: Placement) -> tuple[np.ndarray, np.ndarray]:
    """Rigid frames (keys, 4, 4) and what stretches before them (keys, 3, 3). Raises ValueError as `split_rotation_scale`."""
    frames, stretches = place.frame.copy(), np.zeros((len(place.frame), 3, 3))
    for k in range(len(frames)):
        frames[k][:3, :3], stretches[k] = split_rotation_scale(place.linear[k])
    return frames, stretches


def author_motion(prim: Usd.Prim, motion: Motion, units: StageUnits, frames: int) -> None:
    """Writes local-to-world `motion` on a prim, whose stack is reset if anything above it has a transform."""
    xformable = UsdGeom.Xformable(prim)
    if motion.kind == "stack":
        from wsim.usd.transforms.stack import author_stack
        ops = author_stack(prim, motion, units, lambda attribute, own: _author_matrix(attribute, own, units, frames))
        xformable.SetXformOpOrder(ops, _has_ops_above(prim))
        return
    attribute = prim.CreateAttribute(MATRIX_OP, Sdf.ValueTypeNames.Matrix4d, False)
    _author_matrix(attribute, motion, units, frames)
    xformable.SetXformOpOrder([UsdGeom.XformOp(attribute)], _has_ops_above(prim))


def _author_matrix(attribute: Usd.Attribute, motion: Motion, units: StageUnits, frames: int) -> None:
    if len(motion.times) == 1:
        attribute.Set(row_matrix(motion.values[0], units))
        if motion.times[0] != 0.0:
            author_times(attribute, motion.times)
    else:
        for time, M in zip(motion.times.tolist(), motion.values, strict=True):
            attribute.Set(row_matrix(M, units), Usd.TimeCode(units.code(time)))
        for code in _frame_codes_between_keys(motion.times, units, frames):
            attribute.Set(row_matrix(motion.at(units.time(code)), units), Usd.TimeCode(code))
        author_times(attribute, motion.times)
        if not motion.plain:
            note_kind(attribute, motion)


def _frame_codes_between_keys(times: np.ndarray, units: StageUnits, frames: int) -> np.ndarray:
    """Time codes of the frames between the first and the last key that are no key themselves."""
    keys = units.code(times)
    codes = units.start + np.arange(frames + 1)
    codes = codes[(codes > keys[0]) & (codes < keys[-1])]
    return np.array([c for c in codes.tolist() if np.abs(keys - c).min() > 1e-6])


def _has_ops_above(prim: Usd.Prim) -> bool:
    return any(x.GetOrderedXformOps() for x in _xformable_ancestors(prim.GetParent()))
