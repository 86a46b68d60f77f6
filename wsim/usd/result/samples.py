"""What a result puts over the prims: points, velocities, normals and extent of a body; a collider's transform.

USD has row vectors. With M(c) = [[L, 0], [t, 1]] the prim's local-to-world transform at time code c, u metres a unit
and r time codes a second, a world position p [m] and velocity v [m/s] are, in the prim's own frame and units,

    q = (p / u - t) L^-1                       w = (v / u - r (q L' + t')) L^-1         (' = d/dc)

so that q + w dt under a moving parent is where the point is at the next instant too. M' is the forward difference,
which is what transforms keyed at each frame do from this code on. Computed in float64; only q and w are rounded to
float32, in the prim's frame.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from wsim.geometry.normals import AuthoredNormals
from wsim.scene import Collider, Problem, SceneError
from wsim.usd.names import attribute_entry
from wsim.usd.stage import StageUnits

STEP = 1.0 / 16.0      # [time codes] of the forward difference
PRIMVARS = {"vonMises": "Pa", "strain": "1"}      # of soft bodies, where they are asked for: name and unit
SKELETON = "skel:skeleton"
PARTICLES = attribute_entry("Springs", "particles").attribute


@dataclass(frozen=True)
class PrimFrame:
    """A prim's frame at a time code: L (3, 3), t (3,) in stage units, their rates a second, metres a unit."""

    L: np.ndarray
    t: np.ndarray
    dL: np.ndarray
    dt: np.ndarray
    unit: float

    @staticmethod
    def of(prim: Usd.Prim, code: float) -> "PrimFrame":
        """Raises SceneError if the transform flattens space."""
        stage = prim.GetStage()
        M = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetLocalToWorldTransform(prim))
        size = np.linalg.norm(M[:3, :3], axis=1)
        if not np.isfinite(M).all() or abs(np.linalg.det(M[:3, :3])) <= 1e-9 * np.prod(size):
            raise SceneError(Problem(str(prim.GetPath()), f"has a transform without inverse at time code {code:g} (a "
                                     "scale of 0?); points cannot be brought into its frame. Give it another scale"))
        rate = np.zeros((4, 4))
        if transform_may_vary(prim):
            later = np.array(UsdGeom.XformCache(Usd.TimeCode(code + STEP)).GetLocalToWorldTransform(prim))
            rate = (later - M) * (stage.GetTimeCodesPerSecond() / STEP)
        return PrimFrame(M[:3, :3], M[3, :3], rate[:3, :3], rate[3, :3], UsdGeom.GetStageMetersPerUnit(stage))

    def points(self, p: np.ndarray) -> np.ndarray:
        """World positions [m] (n, 3) in this frame [units], float64."""
        return (p / self.unit - self.t) @ np.linalg.inv(self.L)

    def velocities(self, v: np.ndarray, q: np.ndarray) -> np.ndarray:
        """World velocities [m/s] at the local places q, in this frame [units/s]."""
        if not (self.dL.any() or self.dt.any()):
            return v @ (np.linalg.inv(self.L) / self.unit)
        return (v / self.unit - (q @ self.dL + self.dt)) @ np.linalg.inv(self.L)

    def world_points(self, q: np.ndarray) -> np.ndarray:
        return self.unit * (q @ self.L + self.t)

    def world_velocities(self, w: np.ndarray, q: np.ndarray) -> np.ndarray:
        return self.unit * (w @ self.L + q @ self.dL + self.dt)


def transform_may_vary(prim: Usd.Prim) -> bool:
    """True if the prim's transform, or one above it, may vary in time."""
    while prim and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable and xformable.TransformMightBeTimeVarying():
            return True
        if xformable and xformable.GetResetXformStack():
            return False
        prim = prim.GetParent()
    return False


def particle_of_each_vertex(prim: Usd.Prim) -> np.ndarray | None:
    """The body's point of each point of the prim, (vertices,); None where they are the same (meshes)."""
    value = prim.GetAttribute(PARTICLES).Get() if prim.HasAttribute(PARTICLES) else None
    return None if value is None else np.array(value, np.int64)


def body_prim(stage: Usd.Stage, path: str, count: int) -> Usd.Prim:
    """The prim of a body of `count` points. Raises SceneError where it cannot take a result."""
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    where = stage.GetRootLayer().identifier
    if not prim:
        raise SceneError(Problem(path, f"is not in {where}; if it was added in Python, write the scene first with "
                                 "wsim.save and load that file"))
    if prim.IsInstanceProxy():
        raise SceneError(Problem(path, f"is inside the instance {_enclosing_instances(prim)}, whose contents a layer cannot "
                                 "change; set instanceable = false there, or move the body out of it"))
    if not prim.IsA(UsdGeom.PointBased):
        raise SceneError(Problem(path, f"is a {prim.GetTypeName() or 'prim without type'}, which has no points; a body "
                                 "is a Mesh, TetMesh, BasisCurves or other UsdGeom.PointBased"))
    map_ = particle_of_each_vertex(prim)
    points = _default_points(prim)
    found = len(points) if map_ is None else int(map_.max(initial=-1)) + 1
    if map_ is not None and (len(map_) != len(points) or map_.min(initial=0) < 0):
        raise SceneError(Problem(path, f"{PARTICLES} has {len(map_)} entries for {len(points)} points; it names the "
                                 "particle, 0 or more, of each point"))
    if found != count:
        raise SceneError(Problem(path, f"has {found} points in {where}, the scene's body has {count}; load it again"))
    return prim


def _enclosing_instances(prim: Usd.Prim) -> str:
    """Paths of all instances around a proxy, outermost first."""
    found = []
    while prim and not prim.IsPseudoRoot():
        if prim.IsInstance():
            found.append(str(prim.GetPath()))
        prim = prim.GetParent()
    return " and ".join(reversed(found))


def _earliest_value(attribute: Usd.Attribute):
    """The default value, or the first sample where there is none."""
    value = attribute.Get()
    return attribute.Get(Usd.TimeCode.EarliestTime()) if value is None else value


def _default_points(prim: Usd.Prim) -> np.ndarray:
    value = _earliest_value(UsdGeom.PointBased(prim).GetPointsAttr())
    return np.zeros((0, 3), np.float32) if value is None else np.array(value)


class BodyWriter:
    """Samples of one body. The edit target of the prim's stage is the result layer.

    Blocked in the result, so that nothing stale of the source moves with the new points: accelerations, velocities and
    normals that are not written. `notes` gets a Problem where normals cannot follow.
    """

    def __init__(self, prim: Usd.Prim, *, velocities: bool, normals: bool, notes: list[Problem]):
        self.prim, self.map = prim, particle_of_each_vertex(prim)
        base = UsdGeom.PointBased(prim)
        self.points = base.GetPointsAttr()
        self.velocities = base.CreateVelocitiesAttr() if velocities else None
        self.extent = UsdGeom.Boundable(prim).CreateExtentAttr()
        self.padding = _half_width(prim)
        _block_attribute(base.GetAccelerationsAttr())
        _unbind_skeleton(prim)
        if not velocities:
            _block_attribute(base.GetVelocitiesAttr())
        self.normals: Usd.Attribute | None = None
        self.follow: AuthoredNormals | None = None
        if prim.IsA(UsdGeom.Mesh):
            self._mesh(UsdGeom.Mesh(prim), normals, notes)
        elif prim.IsA(UsdGeom.TetMesh):                    # of its surface; nobody but an old exporter authors them
            _block_attribute(base.GetNormalsAttr())
            _block_attribute(prim.GetAttribute("primvars:normals"))

    def _mesh(self, mesh: UsdGeom.Mesh, wanted: bool, notes: list[Problem]) -> None:
        counts = np.array(_earliest_value(mesh.GetFaceVertexCountsAttr()) or [], np.int64)
        scheme = mesh.GetSubdivisionSchemeAttr()
        if len(counts) and np.all(counts == 3) and scheme.Get() == UsdGeom.Tokens.catmullClark:
            scheme.Set(UsdGeom.Tokens.none)
        primvar = UsdGeom.PrimvarsAPI(self.prim).GetPrimvar("normals")
        plain = mesh.GetNormalsAttr()
        if primvar and primvar.HasAuthoredValue():
            attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
            values = primvar.ComputeFlattened(Usd.TimeCode.EarliestTime())
            _block_attribute(plain)
            _block_attribute(primvar.GetIndicesAttr())
        elif plain.HasAuthoredValue():
            attribute, interpolation, values = plain, mesh.GetNormalsInterpolation(), _earliest_value(plain)
        else:
            return
        if not wanted:
            _block_attribute(attribute)
            return
        try:
            indices = np.array(_earliest_value(mesh.GetFaceVertexIndicesAttr()))
            values = np.array(values, np.float64).reshape(-1, 3)
            self.follow = AuthoredNormals(_default_points(self.prim), counts, indices, values, interpolation)
            self.normals = attribute
        except ValueError as error:
            _block_attribute(attribute)
            notes.append(Problem(str(self.prim.GetPath()), f"{error}; the result has no normals there and viewers "
                                 "compute their own. Mend or remove the normals of the source", fatal=False))

    def sample(self, code: float, positions: np.ndarray, velocities: np.ndarray | None) -> list:
        """(attribute, value) of each sample at `code`, not yet set; world positions [m], velocities [m/s] (n, 3)."""
        frame = PrimFrame.of(self.prim, code)
        q = frame.points(positions)
        local = self._spread(q)
        bounds = np.stack([local.min(axis=0) - self.padding, local.max(axis=0) + self.padding])
        found = [(self.points, local), (self.extent, bounds)]
        if self.velocities and velocities is not None:
            found.append((self.velocities, self._spread(frame.velocities(velocities, q))))
        if self.normals and self.follow:
            found.append((self.normals, self.follow.at(local)))
        return [(a, Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(v, np.float32))) for a, v in found]

    def color(self, values: Mapping[str, np.ndarray]) -> list:
        """(attribute, value) of primvars [SI] by name, (n,) each, not yet set; a name of PRIMVARS, in the stage's unit."""
        api, units = UsdGeom.PrimvarsAPI(self.prim), StageUnits.of(self.prim.GetStage())
        return [(api.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex).GetAttr(),
                 Vt.FloatArray.FromNumpy((value / units.factor(PRIMVARS[name])).astype(np.float32)))
                for name, value in values.items()]

    def _spread(self, values: np.ndarray) -> np.ndarray:
        return values if self.map is None else values[self.map]


def _block_attribute(attribute: Usd.Attribute) -> None:
    if attribute and attribute.HasAuthoredValue():
        attribute.Block()


def _unbind_skeleton(prim: Usd.Prim) -> None:
    """Ends the binding to a skeleton of a prim below a SkelRoot: its points are where they belong, and no viewer may skin
    them once more."""
    above = [prim]
    while above[-1].GetParent():
        above.append(above[-1].GetParent())
    bound = [p for p in above if p.GetRelationship(SKELETON) and p.GetRelationship(SKELETON).HasAuthoredTargets()]
    if bound and any(p.GetTypeName() == "SkelRoot" for p in above):
        prim.AddAppliedSchema("SkelBindingAPI")
        prim.CreateRelationship(SKELETON, False).SetTargets([])


def _half_width(prim: Usd.Prim) -> float:
    """[units] that curves and points reach beyond their centres."""
    schema = next((s(prim) for s in (UsdGeom.Curves, UsdGeom.Points) if prim.IsA(s)), None)
    widths = _earliest_value(schema.GetWidthsAttr()) if schema else None
    return 0.5 * max(widths) if widths else 0.0


class ColliderWriter:
    """Transform samples of one collider, written only once its pose differs from what the scene's motion says.

    A pose is compared with the scene, not with the prim, whose frame may differ (axis, scale): the world is moved by
    D = pose motion^-1, and the prim with it. From the first difference on, all earlier samples are written as the
    source has them, because the strongest layer that holds a sample owns them all.
    """

    def __init__(self, stage: Usd.Stage, original: Callable[[], Usd.Stage], collider: Collider, codes: list[float]):
        """original() opens the source; codes are the time codes written so far, which the caller keeps adding to."""
        self.stage, self.open, self.collider, self.codes = stage, original, collider, codes
        self.op: Any = None                    # its transform op and the source's stage, once it has moved otherwise
        self.original: Any = None
        if stage.GetRootLayer().GetAttributeAtPath(f"{collider.path}.xformOp:transform"):     # an earlier run moved it
            self._begin()

    def write(self, code: float, time: float, pose: np.ndarray) -> None:
        """A world pose (4, 4) [m], columns, at `time` [s] from the scene's start.

        Raises SceneError if the prim is inside an instance or not there.
        """
        motion = self.collider.motion.at(time)
        D = np.asarray(pose, np.float64) @ np.linalg.inv(motion)
        if self.op is None:
            if np.allclose(pose, motion, rtol=1e-9, atol=1e-7):
                return
            self._begin()
        self._set_collider_sample(code, D)

    def _begin(self) -> None:
        path = self.collider.path
        prim = self.stage.GetPrimAtPath(path)
        if not prim or prim.IsInstanceProxy() or not prim.IsA(UsdGeom.Xformable):
            raise SceneError(Problem(path, "was moved, but is not a prim that a layer can move; it must be an "
                                     "Xformable outside instances in the scene's file"))
        self.original = self.open()
        xformable = UsdGeom.Xformable(prim)
        reset = xformable.GetResetXformStack()
        self.op = xformable.MakeMatrixXform()
        xformable.SetXformOpOrder([self.op], reset)
        written = set(self.op.GetTimeSamples())
        for code in self.codes:
            if code not in written:
                self._set_collider_sample(code, np.eye(4))

    def _set_collider_sample(self, code: float, D: np.ndarray) -> None:
        prim = self.stage.GetPrimAtPath(self.collider.path)
        unit = UsdGeom.GetStageMetersPerUnit(self.stage)
        move = np.array(D.T)
        move[3, :3] /= unit
        cache = UsdGeom.XformCache(Usd.TimeCode(code))
        world = np.array(cache.GetLocalToWorldTransform(self.original.GetPrimAtPath(prim.GetPath())))
        above = np.eye(4)
        if not UsdGeom.Xformable(prim).GetResetXformStack():
            above = np.array(UsdGeom.XformCache(Usd.TimeCode(code)).GetParentToWorldTransform(prim))
        self.op.Set(Gf.Matrix4d(world @ move @ np.linalg.inv(above)), code)
