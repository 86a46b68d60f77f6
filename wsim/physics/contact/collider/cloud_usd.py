"""`PointCloud` <-> Points with widths, for sources of smoke and liquid: `load` and `author` of their modules `usd`."""

import numpy as np
from pxr import Usd, UsdGeom, Vt

from wsim.physics.contact.collider.point_cloud import PointCloud
from wsim.scene import Shape
from wsim.scene.curve import Curve, Motion
from wsim.scene.solids import SAME
from wsim.usd.attributes import author_times, read_times, to_usd_array
from wsim.usd.prims.colliders import author_shape, has_shape, load_shape
from wsim.usd.stage import StageReading, StageUnits
from wsim.usd.transforms import author_motion, read_placement, split_placement

SOURCES = "a Plane, Sphere, Cube, Capsule, Cylinder, Cone, Points with widths, or a closed Mesh"


def has_source_shape(prim: Usd.Prim) -> bool:
    """True of a prim that may be a source."""
    return prim.IsA(UsdGeom.Points) or has_shape(prim)


def load_source_shape(reading: StageReading, prim: Usd.Prim) -> tuple[Shape | PointCloud, Motion] | None:
    """Shape and motion of a source; None if it is broken (reported)."""
    if not prim.IsA(UsdGeom.Points):
        return load_shape(reading, prim)
    path, place = str(prim.GetPath()), read_placement(reading, prim)
    scales = np.linalg.svd(place.linear, compute_uv=False)
    if np.abs(scales - scales[0, 0]).max() > SAME * scales[0, 0]:
        reading.fail(path, "its scale differs by axis or changes in time, and balls stay round; author one scale for all axes")
        return None
    found = read_centers(reading, prim)
    radii = read_radii(reading, prim, len(found[0])) if found else None
    if found is None or radii is None:
        return None
    (points, poses), (frames, stretches) = found, split_placement(place)
    S = stretches[-1]
    poses = None if poses is None else poses.replaced(poses.values @ S)
    return PointCloud(points @ S, float(scales[0, 0]) * radii, poses), place.follow(frames)


def read_centers(reading: StageReading, prim: Usd.Prim) -> tuple[np.ndarray, Curve | None] | None:
    """Centres [m] and, of points that are sampled, the curve of them; None if they are broken (reported)."""
    attribute, units = UsdGeom.Points(prim).GetPointsAttr(), reading.units
    codes, noted = attribute.GetTimeSamples(), read_times(attribute, units)
    sets = [np.array(attribute.Get(code) or np.zeros((0, 3)), np.float32) * units.metres
            for code in (codes or [Usd.TimeCode.Default()])]
    if len(sets[0]) == 0:
        reading.fail(prim.GetPath(), "has no points; author point3f[] points and float[] widths")
        return None
    wrong = next((k for k, points in enumerate(sets) if len(points) != len(sets[0])), None)
    if wrong is not None:
        reading.fail(prim.GetPath(), f"its number of points changes, from {len(sets[0])} to {len(sets[wrong])} at time code "
                     f"{codes[wrong]:g}; a source keeps its points: author those that come later outside of the domain")
        return None
    if len(codes) < 2 and noted is None:
        return sets[0], None
    default = attribute.Get(Usd.TimeCode.Default())
    points = sets[0] if default is None or len(default) != len(sets[0]) else np.array(default, np.float32) * units.metres
    times = units.time(np.array(codes)) if noted is None or len(noted) != len(codes) else noted
    return points, Curve(times, np.array(sets))


def read_radii(reading: StageReading, prim: Usd.Prim, count: int) -> np.ndarray | None:
    """Half the widths at the start, in metres: one, or `count`; None if they are broken (reported)."""
    attribute = UsdGeom.Points(prim).GetWidthsAttr()
    widths = np.array(attribute.Get(reading.start) or [], np.float64)
    if len(widths) not in (1, count):
        found = f"has {len(widths)} widths and {count} points" if len(widths) else "has no widths: its points have no size"
        reading.fail(prim.GetPath(), f"{found}; author float[] widths, one or {count}")
        return None
    if attribute.ValueMightBeTimeVarying():
        reading.warn(attribute.GetPath(), "is animated; its value at startTimeCode is held")
    return 0.5 * reading.units.metres * widths


def author_source_shape(stage: Usd.Stage, thing, units: StageUnits) -> Usd.Prim:
    """Defines the prim of a source, as `load_source_shape` reads it."""
    cloud = thing.shape
    if not isinstance(cloud, PointCloud):
        return author_shape(stage, thing, units, 0)
    points = UsdGeom.Points.Define(stage, thing.path)
    author_motion(points.GetPrim(), thing.motion, units, 0)
    widths = Vt.FloatArray.FromNumpy(np.asarray(2.0 / units.metres * cloud.radii, np.float32))
    points.CreateWidthsAttr(widths)
    points.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(widths) == 1 else UsdGeom.Tokens.vertex)
    keys = [(Usd.TimeCode.Default(), cloud.points)]
    if cloud.poses is not None:
        keys += [(Usd.TimeCode(units.code(time)), value)
                 for time, value in zip(cloud.poses.times.tolist(), cloud.poses.values, strict=True)]
    for code, centers in keys:
        places = to_usd_array(centers, "point3f[]", units.metres)
        points.GetPointsAttr().Set(places, code)
        each = Vt.FloatArray.FromNumpy(np.float32(2.0 / units.metres) * cloud.radius_of.astype(np.float32))
        points.CreateExtentAttr().Set(UsdGeom.Points.ComputeExtent(places, each), code)
    if cloud.poses is not None:
        author_times(points.GetPointsAttr(), cloud.poses.times)
    return points.GetPrim()
