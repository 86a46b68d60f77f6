"""Reading a result back, and going on from it.

A result holds points and velocities rounded to float32 in the prim's frame. What an exact restart needs beyond
(positions as the solver has them, rounding remainders, BDF2's previous step) is stored for the last frame as custom
attributes of the prims:

    double wsim:restart:timeCode        the frame the fields belong to
    T[]    wsim:restart:fields:NAME     one field, bit for bit, flat; its shape is custom data `shape`
    string wsim:restart:file            of a large prim instead: a file with them, see `wsim.usd.result.kinds.sidecar`

Points and velocities alone restart too, to the order of accuracy; `RestartState.exact` says which it is.

A run that goes on writes a new layer that holds the earlier samples too. It cannot sublayer the earlier result: USD
takes all samples of an attribute from the strongest layer that has one, so that the first new sample would hide every
earlier one.
"""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, Vt

from wsim.scene import Deformable, Problem, Scene, SceneError
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.scene.methods import each_method_object, scene_skins
from wsim.scene.samples import BESIDE
from wsim.usd.clips import join_clips
from wsim.usd.prims.reactions import REACTION
from wsim.usd.result import crate, provenance
from wsim.usd.result.kinds import sidecar
from wsim.usd.result.kinds.beside import SidecarFiles
from wsim.usd.result.kinds.copies import copy_earlier_samples
from wsim.usd.result.samples import PRIMVARS, PrimFrame, body_prim, particle_of_each_vertex
from wsim.usd.stage import open_stage, usd_error_text

CODE, FIELDS = "wsim:restart:timeCode", "wsim:restart:fields:"
TYPES = {np.dtype(np.float32): (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray),
         np.dtype(np.float64): (Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray),
         np.dtype(np.int32): (Sdf.ValueTypeNames.IntArray, Vt.IntArray)}
STRESS = tuple(f"primvars:{name}" for name in (*PRIMVARS, "displayColor"))       # only where they are asked for
SAMPLED = ("points", "velocities", "extent", "normals", "primvars:normals", *STRESS)     # what a recorder samples on a body
NAME = re.compile(r"[A-Za-z_]\w*\Z")


@dataclass
class RestartState:
    """The state where an earlier run got to.

    frame_time_code   time code of the frame                frame      its number, counted from the scene's start
    positions         {path: (n, 3)} world [m]               velocities {path: (n, 3)} world [m/s]
    fields            {path: {name: array}} as stored, bit for bit; {} where none are
    exact             every body has its fields at that frame
    made              of which scene and how, see `wsim.usd.result.provenance`; {} where the result does not say
    notes             warnings, as of a scene
    """

    path: str
    frame_time_code: float
    frame: int
    positions: dict[str, np.ndarray]
    velocities: dict[str, np.ndarray]
    fields: dict[str, dict[str, np.ndarray]]
    exact: bool
    made: dict = field(default_factory=dict)
    notes: list[Problem] = field(default_factory=list)


def store_restart_fields(prim: Usd.Prim, code: float, fields: Mapping[str, np.ndarray],
                         beside: SidecarFiles | None = None) -> None:
    """Puts the restart fields of one body over its prim; large ones into a file, where there are files beside the layer."""
    prim.CreateAttribute(CODE, Sdf.ValueTypeNames.Double, True).Set(float(code))
    if beside and sidecar.exceeds_layer_size(fields):
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith(FIELDS):
                prim.RemoveProperty(attribute.GetName())
        return sidecar.store_restart_file(prim, code, fields, beside)
    if beside:
        sidecar.forget_restart_file(prim, beside)
    for name, value in fields.items():
        usd, vt = TYPES[value.dtype]
        attribute = prim.CreateAttribute(FIELDS + name, usd, True)
        attribute.Set(vt.FromNumpy(np.ascontiguousarray(value).reshape(-1)) if value.size else vt())
        attribute.SetCustomDataByKey("shape", Vt.IntArray(list(value.shape)))
    return None


def check_fields(path: str, fields: Mapping[str, np.ndarray]) -> None:
    """ValueError for what `store_restart_fields` cannot hold."""
    for name, value in fields.items():
        if not NAME.match(name):
            raise ValueError(f"restart field {name!r} of {path}: a name has letters, digits and underscores")
        if not isinstance(value, np.ndarray) or value.dtype not in TYPES:
            found = getattr(value, "dtype", type(value).__name__)
            raise ValueError(f"restart field {name!r} of {path} is {found}; allowed are NumPy arrays of float32, "
                             "float64 and int32")


def read_restart_fields(prim: Usd.Prim, folder: str) -> tuple[float, dict[str, np.ndarray]]:
    """(time code, fields) that `store_restart_fields` left on a prim of a layer in `folder`; (nan, {}) if nothing. Raises
    SceneError for a file of them that is not whole."""
    code = prim.GetAttribute(CODE).Get() if prim.HasAttribute(CODE) else None
    if code is not None and not isinstance(code, float):
        raise SceneError(Problem(str(prim.GetPath()), f"{CODE} is {code!r}; allowed is a number; restart from another result"))
    fields = sidecar.read_restart_file(prim, code, folder) if code is not None else {}
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName().startswith(FIELDS):
            fields[attribute.GetName()[len(FIELDS):]] = _decode_restart_field(attribute)
    return (code, fields) if code is not None else (math.nan, {})


def _decode_restart_field(attribute: Usd.Attribute) -> np.ndarray:
    """One restart field. Raises SceneError where its shape is not that of its numbers."""
    value, shape = attribute.Get(), attribute.GetCustomDataByKey("shape")
    numbers = np.array([] if value is None else value)
    try:
        if numbers.dtype in TYPES:
            return numbers.reshape([int(s) for s in shape])
    except (TypeError, ValueError):
        pass
    raise SceneError(Problem(str(attribute.GetPrim().GetPath()), f"its restart field {attribute.GetName()[len(FIELDS):]} has "
                             f"{numbers.size} values of {numbers.dtype} and shape {shape and list(shape)}; allowed are numbers "
                             "in the shape that custom data `shape` says; restart from another result"))


class ResultReader:
    """A result layer (or any stage with sampled points) to read: positions and velocities in SI units, world space.

    A result that is being written, or whose run was killed, is read as it was saved last; nothing is written to it.
    Raises SceneError if the file is missing or not readable.
    """

    def __init__(self, path):
        self.path = os.path.abspath(path)
        self.notes: list[Problem] = []
        self.stage = open_stage(self.path, notes=self.notes)
        self.fps = self.stage.GetTimeCodesPerSecond()

    def paths(self) -> list[str]:
        """Prims whose points are sampled in time."""
        return [str(p.GetPath()) for p in self.stage.Traverse()
                if p.IsA(UsdGeom.PointBased) and UsdGeom.PointBased(p).GetPointsAttr().GetNumTimeSamples()]

    def time_codes(self, path: str) -> list[float]:
        """Time codes of the samples of a body's points."""
        return UsdGeom.PointBased(self._point_prim(path)).GetPointsAttr().GetTimeSamples()

    def codes(self, path: str) -> list[float]:
        """Time codes of what is sampled on a prim: of points, else of whatever there is on it, below, and on its volume or
        particles."""
        prim = self.stage.GetPrimAtPath(path)
        if prim.IsA(UsdGeom.PointBased):
            return self.time_codes(path)
        found = [p for name in BESIDE if (p := self.stage.GetPrimAtPath(path + name))]
        return sorted({c for p in found for each in Usd.PrimRange(p) for attribute in each.GetAuthoredAttributes()
                       for c in attribute.GetTimeSamples()})

    def positions(self, path: str, code: float) -> np.ndarray:
        """World positions [m], (n, 3) float64; of a spring net one row a point of its curves."""
        prim = self._point_prim(path)
        return PrimFrame.of(prim, code).world_points(self._local_values(prim, UsdGeom.PointBased(prim).GetPointsAttr(), code))

    def velocities(self, path: str, code: float) -> np.ndarray | None:
        """World velocities [m/s], as `positions`; None if the result holds none."""
        prim = self._point_prim(path)
        base = UsdGeom.PointBased(prim)
        if not base.GetVelocitiesAttr().GetNumTimeSamples():
            return None
        local = self._local_values(prim, base.GetPointsAttr(), code)
        return PrimFrame.of(prim, code).world_velocities(self._local_values(prim, base.GetVelocitiesAttr(), code), local)

    def _point_prim(self, path: str) -> Usd.Prim:
        prim = self.stage.GetPrimAtPath(path)
        if not prim or not prim.IsA(UsdGeom.PointBased):
            raise SceneError(Problem(path, f"is not a prim with points in {self.path}; those with samples are "
                                     f"{', '.join(self.paths()) or 'none'}"))
        return prim

    def _local_values(self, prim: Usd.Prim, attribute: Usd.Attribute, code: float) -> np.ndarray:
        value = attribute.Get(code)
        if value is None:
            raise SceneError(Problem(str(prim.GetPath()), f"has no {attribute.GetName()} at time code {code:g} in "
                                     f"{self.path}"))
        return np.array(value, np.float64)


def load_restart(result_path, scene: Scene) -> RestartState:
    """State where the run that wrote `result_path` got to: its last whole frame, exactly if the restart fields are there.

    Raises SceneError if the file cannot be read, runs at another rate, lacks a body of the scene or its samples, or holds
    another mesh under its path. What else of the scene is another than it was is a note.
    """
    result = ResultReader(result_path)
    if not np.isclose(result.fps, scene.fps):
        raise SceneError(Problem(result.path, f"has {result.fps:g} time codes a second, the scene {scene.fps:g}; "
                                 "restart with the scene that the result was made from"))
    bodies = bodies_sampled_by_point(scene)
    others = {path: result.stage.GetPrimAtPath(path) for path in _output_paths(scene)}
    if lost := [path for path, prim in others.items() if not prim]:
        raise SceneError(Problem(lost[0], f"is not in {result.path}; restart from a result of this scene"))
    prims = {b.path: body_prim(result.stage, b.path, len(b.points)) for b in bodies} | others
    frames = _whole_frames(result, scene, list(prims))
    kept = {path: read_restart_fields(prim, os.path.dirname(result.path)) for path, prim in prims.items()}
    codes = {code for code, _ in kept.values()} & frames
    exact = all(f and {code} == codes for code, f in kept.values())
    code = codes.pop() if exact else max(frames)
    if lost := [path for path in others if kept[path][0] != code]:
        raise SceneError(Problem(lost[0], f"has no restart fields at frame {round(code - scene.start)} in {result.path}, and "
                                 "nothing else says where it was; restart from one that holds them, or run from the start"))
    restart = RestartState(result.path, code, round(code - scene.start), {}, {},
                           {path: f for path, (_, f) in kept.items() if exact or path in others}, exact,
                           provenance.read_provenance(result.stage.GetRootLayer()))
    restart.notes += provenance.warn_of_scene_changes(result.path, restart.made, scene)
    for body in bodies:
        _read_body(result, body, restart)
    if not exact:
        text = (f"holds points and velocities only, rounded to float32; the run goes on from frame {restart.frame} to "
                "the order of accuracy, not bit for bit")
        restart.notes.append(Problem(result.path, text, fatal=False))
    return restart


def _output_paths(scene: Scene) -> list[str]:
    """Prims that results hold what methods have of."""
    found = (getattr(t, "written", t.path) for row, t in each_method_object(scene) if type(t).__name__ not in row.unseen)
    return list(dict.fromkeys([*(b.path for b in scene.bodies() if b.is_counted_anew(scene)), *found]))


def is_whole_frame_code(code: float, scene: Scene, rate: float) -> bool:
    """True if a time code is that of a whole frame of the scene; rate in time codes a second."""
    frame = (code - scene.start) * scene.fps / rate
    return abs(frame - round(frame)) < 1e-6


def _whole_frames(result: ResultReader, scene: Scene, paths: list[str]) -> set[float]:
    """Time codes of whole frames that every body has. Raises SceneError if there is none."""
    frames, problems = None, []
    for path in paths:
        codes = {c for c in result.codes(path) if is_whole_frame_code(c, scene, result.fps)}
        if not codes:
            problems.append(Problem(path, f"has no frame in {result.path}; restart from a result of this scene"))
        frames = codes if frames is None else frames & codes
    if not frames:
        raise SceneError(problems or Problem(result.path, "holds no frame that all bodies have"))
    return frames


def _read_body(result: ResultReader, body: Deformable, restart: RestartState) -> None:
    """Positions and velocities of a body into `restart`."""
    path, code = body.path, restart.frame_time_code
    points, rates = result.positions(path, code), result.velocities(path, code)
    if rates is None and not restart.exact:
        raise SceneError(Problem(path, f"has no velocities in {result.path}, and no restart fields; restart from a "
                                 "result that was recorded with velocities"))
    map_ = particle_of_each_vertex(result.stage.GetPrimAtPath(path))
    if map_ is None:
        map_ = np.arange(len(body.points))
    places = np.zeros((len(body.points), 3))
    places[map_] = points
    restart.positions[path] = places
    if rates is not None:
        speeds = np.zeros_like(places)
        speeds[map_] = rates
        restart.velocities[path] = speeds


def copy_samples(restart: RestartState, stage: Usd.Stage, scene: Scene, beside: SidecarFiles) -> list[float]:
    """Copies what the earlier result recorded up to the restart into the stage's edit target, and the files that it names to
    those of this run; returns its time codes.

    Of a flattened result only bodies and skins: its other samples are the source's own.
    """
    try:
        layer = join_clips(crate.read_crate_layer(restart.path), os.path.dirname(os.path.realpath(restart.path)))
    except (Tf.ErrorException, OSError) as error:
        raise SceneError(Problem(restart.path, f"cannot be read any more: {usd_error_text(error)}")) from None
    wanted: list[tuple[str, tuple[str, ...]]] = [(b.path, SAMPLED) for b in bodies_sampled_by_point(scene)]
    wanted += [(skin.path, SAMPLED) for skin in scene_skins(scene)]
    wanted += [(p.path, (REACTION,)) for p in scene.pins]
    if layer.subLayerPaths:
        wanted += [(c.path, ("xformOp:transform",)) for c in scene.colliders]
    codes = copy_earlier_samples(layer, stage, restart, _output_paths(scene), beside)
    for path, names in wanted:
        for name in names:
            spec = layer.GetAttributeAtPath(f"{path}.{name}")
            times = [c for c in layer.ListTimeSamplesForPath(spec.path) if c <= restart.frame_time_code] if spec else []
            if times:
                prim = stage.GetPrimAtPath(path)
                attribute = prim.GetAttribute(name) or prim.CreateAttribute(name, spec.typeName, False)
                if spec.HasInfo("interpolation"):
                    attribute.SetMetadata("interpolation", spec.GetInfo("interpolation"))
                for c in times:
                    attribute.Set(layer.QueryTimeSample(spec.path, c), c)
                if name in (*STRESS, REACTION):             # else the last one would stay, where this run writes none
                    attribute.Set(Sdf.ValueBlock(), restart.frame_time_code + stage.GetTimeCodesPerSecond() / scene.fps)
                codes.update(times if name == "points" else ())
    return sorted(codes)
