"""What a method hands to a result, each frame: by prim path, in SI units and world space. NumPy only.

A prim that is not in the scene's stage is made in the result. How each kind is written: `wsim.usd.result.kinds.rows`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

VOLUME, DROPS = "_volume", "_drops"           # behind the name of a prim: where what its box holds is written
BESIDE = ("", VOLUME, DROPS)


@dataclass(frozen=True)
class PointSample:
    """Positions [m] (n, 3) and velocities [m/s] (n, 3) of a prim's own points, as many as it has at rest."""

    path: str
    positions: np.ndarray
    velocities: np.ndarray | None = None


@dataclass(frozen=True)
class TransformSample:
    """Local-to-world (4, 4) [m], rigid or with scale, column vectors."""

    path: str
    matrix: np.ndarray


@dataclass(frozen=True)
class ParticleSample:
    """Particles, of another number each frame: positions [m] (n, 3), widths (diameters) [m] (n,), ids (n,), which stay with a
    particle, velocities [m/s] (n, 3), linear colours, (3,) of all or (n, 3)."""

    path: str
    positions: np.ndarray
    widths: np.ndarray
    ids: np.ndarray
    velocities: np.ndarray | None = None
    colors: np.ndarray | None = None


@dataclass(frozen=True)
class InstanceSample:
    """Instances of a PointInstancer that move rigidly.

    path         prim path of the instancer
    numbers      which instances, (n,), in the order of its arrays
    matrices     what has moved each since the first frame, world, (n, 4, 4) [m], rigid
    centers      places about which they turn now, world (n, 3) [m]
    velocities   of those places, (n, 3) [m/s]
    spins        angular velocities, world (n, 3) [rad/s]
    """

    path: str
    numbers: np.ndarray
    matrices: np.ndarray
    centers: np.ndarray
    velocities: np.ndarray
    spins: np.ndarray


@dataclass(frozen=True)
class QuantitySample:
    """A number, or numbers (n,) such as joint values, as a sampled attribute of type double or double[]."""

    path: str
    name: str
    value: float | np.ndarray


@dataclass(frozen=True)
class VolumeSample:
    """Fields on a box of cubes along the world's axes, in an OpenVDB file a frame beside the layer.

    path      of the prim of the box: a UsdVol.Volume, else the volume is made beside it, with `VOLUME` behind its name
    low       corner of the box, world (3,) [m]              cell     edge of a cube [m]
    fields    by name, float32 or float16, at the centres of the cubes: (nx, ny, nz), or (nx, ny, nz, 3) of vectors, world [SI].
              A number that is 0 is not stored.
    units     of fields that have other ones on a stage, such as "m/s"
    """

    path: str
    low: np.ndarray
    cell: float
    fields: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ColourSample:
    """Linear colours of the points of a body or skin, (n, 3), in the author's order."""

    path: str
    values: np.ndarray


@dataclass(frozen=True)
class Joints:
    """Transforms of joints from their parents' spaces.

    path           prim path of the Skeleton
    joints         names, (joints,)
    translations   (joints, 3) [m]
    rotations      (joints, 4), unit quaternions (x, y, z, w)
    scales         (joints, 3) [1]
    shapes         names of blend shapes, (shapes,)
    weights        of those, (shapes,) [1]; None: there are none
    """

    path: str
    joints: tuple[str, ...]
    translations: np.ndarray
    rotations: np.ndarray
    scales: np.ndarray
    shapes: tuple[str, ...] = ()
    weights: np.ndarray | None = None


Sample = PointSample | TransformSample | Joints | InstanceSample | ParticleSample | QuantitySample | VolumeSample | ColourSample
