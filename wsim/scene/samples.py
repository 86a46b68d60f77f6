"""What a method hands to a result, each frame: by prim path, in SI units and world space. NumPy only.

A prim that is not in the scene's stage is made in the result. How each kind is written: `wsim.usd.result.kinds.rows`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

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


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Contact points at the end of a frame, with forces of its last substep: n rows, in a fixed order.

    path0          prim paths of what the force acts on, (n,)
    path1          prim paths of the other side, (n,)
    world          number of the world, (n,)
    element        number of the point of a cloth or soft body at path0, in the author's order; -1 of a rigid body, (n,)
    point          places, world (n, 3) [m]: in the middle of the gap
    normal         unit vectors from path1 to path0, world (n, 3)
    gap            distances along the normal (n,) [m]; negative where both overlap
    normal_force   sizes of the normal forces, (n,) [N]
    friction       friction forces on path0, world (n, 3) [N]
    """

    path0: np.ndarray
    path1: np.ndarray
    world: np.ndarray
    element: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    normal_force: np.ndarray
    friction: np.ndarray

    def __len__(self) -> int:
        return len(self.path0)

    @property
    def force(self) -> np.ndarray:
        """Forces on path0, world (n, 3) [N]; on path1 the same with the other sign."""
        return self.normal_force[:, None] * self.normal + self.friction

    def rows(self, which: np.ndarray) -> "ContactPoints":
        """Rows by number or by mask."""
        return ContactPoints(*(getattr(self, f.name)[which] for f in fields(self)))

    def seen_from(self, path: str) -> "ContactPoints":
        """Contacts of a prim, with that prim at path0."""
        turn = (self.path1 == path) & (self.path0 != path)
        sign = np.where(turn, -1.0, 1.0)[:, None]
        found = ContactPoints(np.where(turn, self.path1, self.path0), np.where(turn, self.path0, self.path1), self.world,
                              np.where(turn, -1, self.element), self.point, sign * self.normal, self.gap, self.normal_force,
                              sign * self.friction)
        return found.rows(found.path0 == path)


@dataclass(frozen=True, eq=False)
class Controls:
    """Controls of actuators on the device.

    paths     prim paths of the actuators, in the order of the columns
    values    array (worlds, actuators) of doubles on the device, which kernels read in place; of an actuator that follows a
              curve it is not read until `Simulation.set` has set that control
    """

    paths: tuple[str, ...]
    values: Any


@dataclass(frozen=True, eq=False)
class JointStates:
    """Joint coordinates of all worlds, NumPy arrays or arrays on the device: a column each.

    paths       prim paths of the joints, one for each column
    axes        names of the coordinates, such as rotX (see `wsim.Joint`)
    position    (worlds, n) [m], [rad]
    velocity    (worlds, n) [m/s], [rad/s]
    """

    paths: tuple[str, ...]
    axes: tuple[str, ...]
    position: Any
    velocity: Any


@dataclass(frozen=True, eq=False)
class LinkStates:
    """Rigid bodies of all worlds, NumPy arrays or arrays on the device: a column each, world space.

    paths          prim paths of the bodies
    place          origins of their frames (worlds, n, 3) [m]
    rotation       quaternions (x, y, z, w) from their frames to the world (worlds, n, 4) [1]
    velocity       of those origins (worlds, n, 3) [m/s]
    spin           angular velocities (worlds, n, 3) [rad/s]
    contact_force  sums of the contact forces with bodies and colliders in the last substep (worlds, n, 3) [N]
    """

    paths: tuple[str, ...]
    place: Any
    rotation: Any
    velocity: Any
    spin: Any
    contact_force: Any


@dataclass(frozen=True, eq=False)
class ImuReadings:
    """Means over the last frame of an inertial measurement unit, in its own axes, NumPy arrays or arrays on the device.

    force    specific force: acceleration less gravity (worlds, 3) [m/s^2]
    spin     angular velocity (worlds, 3) [rad/s]
    """

    force: Any
    spin: Any


def join_contact_points(parts: Iterable[ContactPoints]) -> ContactPoints:
    """All rows behind each other."""
    none = np.zeros(0)
    empty = ContactPoints(none.astype(str), none.astype(str), none.astype(int), none.astype(int), np.zeros((0, 3)),
                          np.zeros((0, 3)), none, none, np.zeros((0, 3)))
    found = [empty, *parts]
    return ContactPoints(*(np.concatenate([getattr(each, f.name) for each in found]) for f in fields(ContactPoints)))
