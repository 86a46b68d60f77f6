"""Joints as the device has them: a distance apart, no cone without a width, the twist about the only axis that turns; rows."""

from math import inf

import numpy as np

from wsim.geometry import rotation
from wsim.kernels.rigid.joint import tables
from wsim.kernels.rigid.joint.coordinates import CONE, DISTANCE, GENERAL
from wsim.physics.rigid.joints.joint import AXES, Drive, Joint
from wsim.physics.rigid.joints.joint import DISTANCE as LENGTH

TABLES = ("limits", "drives", "armature", "friction", "mimics")            # of a joint, by coordinate


def device_rows(joint: Joint) -> list[Joint]:
    """A joint as those of the device: a distance beside limits of shifts is one of its own."""
    apart = LENGTH in joint.limits or LENGTH in joint.drives
    others = {name for name in (*joint.limits, *joint.drives) if name != LENGTH}
    if not apart or not others and joint.cone is None:
        return [joint]

    def part_of_joint(far: bool) -> Joint:
        def part_rows(table):
            return {name: value for name, value in table.items() if (name == LENGTH) == far}
        values = vars(joint) | {name: part_rows(getattr(joint, name)) for name in TABLES}
        return Joint(**values | ({"cone": None} if far else {}))
    return [part_of_joint(False), part_of_joint(True)]


def drop_cone(joint: Joint) -> Joint:
    """The same joint without a cone that is none: one of no width is a range of the other swing."""
    if joint.cone is None or joint.cone != (inf, inf) and min(joint.cone) > 0.0:
        return joint
    range_of = {name: (-c, c) for name, c in zip(AXES[4:], joint.cone, strict=True) if c < inf}
    return Joint(**vars(joint) | {"cone": None, "limits": joint.limits | range_of})


def rename_twist_axis(joint: Joint) -> Joint:
    """The same joint with its axes named anew, so that the twist is about the one axis that turns, if no other does: a swing of
    half a turn has no direction."""
    free = [k for k, name in enumerate(AXES[3:]) if not joint.locked(name)]
    if len(free) != 1 or free == [0]:
        return joint
    k = free[0]
    q = rotation.matrix_quat(np.eye(3)[:, [k, (k + 1) % 3, (k + 2) % 3]])

    def rename_axes(table: dict) -> dict:
        def renamed_axis(name: str) -> str:
            return name if name == LENGTH else name[:-1] + "XYZ"["XYZ".index(name[-1]) - k]
        return {renamed_axis(name): value for name, value in table.items()}
    turns = {name: rotation.quat_product(getattr(joint, name), q) for name in ("turn0", "turn1")}
    return Joint(**vars(joint) | turns | {name: rename_axes(getattr(joint, name)) for name in TABLES})


def joint_form_code(joint: Joint) -> int:
    """What its coordinates are (kernels/rigid/joint/coordinates.py)."""
    if LENGTH in joint.limits or LENGTH in joint.drives:
        return int(DISTANCE)
    return int(CONE if joint.cone is not None else GENERAL)


def inverse_cone_angles(joint: Joint) -> tuple[float, float]:
    """1 / half angle [1/rad], 0 where it is free."""
    y, z = joint.cone or (inf, inf)
    return 1.0 / y, 1.0 / z


def joint_row_columns(joint: Joint) -> dict[str, list]:
    """What the six rows of a joint are."""
    names = ("kind", "drive", "low", "high", "stiffness", "damping", "target", "speed", "most")
    found: dict[str, list] = {name: [] for name in names}
    form = joint_form_code(joint)
    for k, name in enumerate(AXES):
        name = LENGTH if form == DISTANCE and k == 0 else name
        low, high = joint.limits.get(name, (-inf, inf))
        kind = tables.LOCKED if low >= high else tables.LIMITED if low > -inf or high < inf else tables.FREE
        if form == CONE and k > 3:
            low, high, kind = 0.0, inf, tables.LIMITED if k == 4 else tables.FREE
        drive = joint.drives.get(name, Drive())
        on = kind != tables.LOCKED and (drive.stiffness > 0.0 or drive.damping > 0.0)
        found["kind"].append(int(kind))
        found["drive"].append(int(on and (tables.ACCELERATION if drive.acceleration else tables.FORCE)))
        for column, value in (("low", low), ("high", high), ("stiffness", drive.stiffness), ("damping", drive.damping),
                              ("target", drive.target), ("speed", drive.speed), ("most", drive.most)):
            found[column].append(value)
    return found
