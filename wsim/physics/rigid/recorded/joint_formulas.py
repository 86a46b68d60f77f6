"""What joints do in a substep, as functions of all that they read (kernels/rigid/joint): impulses where it begins,
coordinates where it ends, velocities behind it.

    rest of a lock or limit     g(x', q') - goal - what is left of an error = 0
    rest of a drive             its laws of kernels/rigid/joint/drives.py, before and behind the places
    rest of what does not act   its impulse

All arrays have axes (..., joints, size): pose and then are x, theta of a, and of b: places from the origin and a turn before
the orientations `q_a`, `q_b` (`Q_a`, `Q_b` behind the substep).
"""

from dataclasses import dataclass

import numpy as np

from wsim.kernels.rigid.joint.coordinates import CONE, DISTANCE
from wsim.kernels.rigid.joint.elimination import EASE
from wsim.kernels.rigid.joint.rows import PULL, SPIN
from wsim.kernels.rigid.joint.steps import FAST
from wsim.kernels.rigid.joint.tables import ACCELERATION, DRIVEN, HELD, HIGHEST, LOWEST, NONE
from wsim.physics.rigid.recorded.drive_formulas import (
    DriveLaw,
    complex_drive_law,
    coupled_drive_masses,
    effective_drive_gains,
    reduce_locked_rows,
    row_effective_masses,
)
from wsim.physics.rigid.recorded.local import Values
from wsim.physics.rigid.recorded.rotation import (
    complex_quaternion_conjugate,
    complex_quaternion_product,
    complex_rotation_matrix,
    complex_swing_twist,
    complex_vector_length,
    matrix_times_vector,
    skew_symmetric_matrix,
    small_turn_applied,
    swing_rate_inverse,
    transpose_times_vector,
)

MOST = np.array([float(PULL)] * 3 + [float(SPIN)] * 3)


@dataclass
class RecordedJointTables:
    """Tables of all joints, (joints, ...), see kernels/rigid/joint/tables.py; still (joints, 2): sides that are no body."""

    at: tuple[np.ndarray, np.ndarray]
    turn: tuple[np.ndarray, np.ndarray]
    apart: np.ndarray
    form: np.ndarray
    closed: np.ndarray
    alone: np.ndarray
    cone: np.ndarray
    kind: np.ndarray
    drive: np.ndarray
    low: np.ndarray
    high: np.ndarray
    speed: np.ndarray
    most: np.ndarray
    still: np.ndarray


@dataclass
class PlacedJoints:
    """Coordinates g (..., 6), axis and turn (..., 3, 3), arms."""

    g: np.ndarray
    axis: np.ndarray
    turn: np.ndarray
    r_a: np.ndarray
    r_b: np.ndarray


def place_joint_frames(t: RecordedJointTables, pose: np.ndarray, q: tuple[np.ndarray, np.ndarray],
                       quarters: np.ndarray) -> PlacedJoints:
    """Frames as `lined` of kernels/rigid/joint/frames.py."""
    x, Q, p = [], [], []
    for k in (0, 1):
        x.append(pose[..., 6 * k:6 * k + 3] + (t.apart if k else 0.0))
        own = small_turn_applied(q[k], pose[..., 6 * k + 3:6 * k + 6])
        p.append(x[k] + matrix_times_vector(complex_rotation_matrix(own), t.at[k] + 0.0 * x[k]))
        Q.append(complex_quaternion_product(own, t.turn[k] + 0.0 * own))
    A = complex_rotation_matrix(Q[0])
    axis = np.swapaxes(A, -1, -2) + 0.0
    to = p[1] - p[0]
    shift = matrix_times_vector(axis, to)
    far = t.form == int(DISTANCE)
    if far.any():
        size = complex_vector_length(to)
        way = np.where((np.abs(size) > 0.0)[..., None], to / np.where(np.abs(size) > 0.0, size, 1.0)[..., None], A[..., :, 0])
        shift = np.where(far[:, None], np.stack([size, 0.0 * size, 0.0 * size], -1), shift)
        axis = np.where(far[:, None, None], np.stack([way, 0.0 * way, 0.0 * way], -2), axis)
    s, swing = complex_swing_twist(complex_quaternion_product(complex_quaternion_conjugate(Q[0]), Q[1]))
    turn = swing_rate_inverse(s, swing) @ np.swapaxes(A, -1, -2)
    cones = t.form == int(CONE)
    if cones.any():
        s, turn = cone_coordinates(t, s, turn, cones)
    phi = s[..., 0] + 2.0 * np.pi * np.round((quarters * 0.5 * np.pi - s[..., 0].real) / (2.0 * np.pi))
    g = np.concatenate([shift, phi[..., None], s[..., 1:]], axis=-1)
    return PlacedJoints(g, axis, turn, p[1] - x[0], p[1] - x[1])


def cone_coordinates(t: RecordedJointTables, s: np.ndarray, turn: np.ndarray,
                     cones: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rows where there is a cone, as `place_of` of kernels/rigid/joint/coordinates.py."""
    cone = np.where(cones[:, None], t.cone, 1.0)
    y, z = s[..., 1] * cone[:, 0], s[..., 2] * cone[:, 1]
    f = np.sqrt(y * y + z * z)
    size, some = 1.0 / cone.max(axis=1), np.abs(f) > 1.0e-9
    safe = np.where(some, f, 1.0)
    wy, wz = (np.where(some, -size * each * cone[:, k] / safe, 1.0 - k) for k, each in enumerate((y, z)))
    one = np.stack([s[..., 0], size * (1.0 - f), 0.0 * f], axis=-1)
    row = wy[..., None] * turn[..., 1, :] + wz[..., None] * turn[..., 2, :]
    rows = np.stack([turn[..., 0, :], row, 0.0 * row], axis=-2)
    return np.where(cones[:, None], one, s), np.where(cones[:, None, None], rows, turn)


def joint_jacobians(p: PlacedJoints) -> tuple[np.ndarray, np.ndarray]:
    """Rates of the coordinates by (v, omega) of a and of b, (..., 6, 6) each."""
    zero = np.zeros_like(p.axis)
    found = []
    for sign, r in ((-1.0, p.r_a), (1.0, p.r_b)):
        top = np.concatenate([sign * p.axis, -sign * p.axis @ skew_symmetric_matrix(r)], axis=-1)
        found.append(np.concatenate([top, np.concatenate([zero, sign * p.turn], axis=-1)], axis=-2))
    return found[0], found[1]


def world_inverse_inertias(pose: np.ndarray, q: tuple, mass: np.ndarray) -> list[np.ndarray]:
    """I^-1, world, of a and of b; mass: w, 1 / I of a, then of b."""
    found = []
    for s in (0, 1):
        R = complex_rotation_matrix(small_turn_applied(q[s], pose[..., 6 * s + 3:6 * s + 6]))
        found.append((R * mass[..., None, 4 * s + 1:4 * s + 4]) @ np.swapaxes(R, -1, -2))
    return found


def joint_side_velocities(momentum: np.ndarray, S: list, mass: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(v, omega) of a and of b, (..., 12); given: those of sides that are no body."""
    parts = []
    for s in (0, 1):
        v = mass[..., 4 * s:4 * s + 1] * momentum[..., 6 * s:6 * s + 3]
        parts += [v, matrix_times_vector(S[s], momentum[..., 6 * s + 3:6 * s + 6])]
    return np.concatenate(parts, axis=-1) + given


def joint_effective_mass(J: tuple, S: list, mass: np.ndarray) -> np.ndarray:
    """A_jj (..., 6, 6) of a joint by itself."""
    A: np.ndarray = np.zeros((6, 6))
    for s in (0, 1):
        w = mass[..., 4 * s, None, None] * np.eye(3)
        zero = np.zeros_like(w)
        M = np.concatenate([np.concatenate([w, zero], -1), np.concatenate([zero, S[s]], -1)], axis=-2)
        A = A + J[s] @ M @ np.swapaxes(J[s], -1, -2)
    return A


def joint_impulses(J: tuple, f: np.ndarray) -> np.ndarray:
    """(P, T) on a and on b, (..., 12)."""
    return np.concatenate([transpose_times_vector(J[0], f), transpose_times_vector(J[1], f)], axis=-1)


def unrecovered_joint_error(error: np.ndarray, h: float) -> np.ndarray:
    """Part of an error (..., 6) that stays behind a substep."""
    most = h * MOST
    return np.where(np.abs(error.real) <= most, 0.0, error - np.sign(error.real) * most)


@dataclass
class JointSubstep:
    """Constants of all joints in a substep; acts (joints, 6) of its rows (kernels/rigid/joint/tables.py), 0 of those that give
    what they have. full (joints, 6): rows that give all that they have."""

    t: RecordedJointTables
    h: float
    q: tuple[np.ndarray, np.ndarray]
    Q: tuple[np.ndarray, np.ndarray]
    quarters: np.ndarray
    given: np.ndarray
    acts: np.ndarray
    full: np.ndarray

    def held(self, v: Values) -> Values:
        """impulse (12) and rest (6) of the substep, of pose, then, momentum, placing, begun (momentum before the forces), f,
        mass, stiffness, damping, target."""
        t, h = self.t, self.h
        now, end = (place_joint_frames(t, v["pose"], self.q, self.quarters),
                    place_joint_frames(t, v["then"], self.Q, self.quarters))
        J, S = joint_jacobians(now), world_inverse_inertias(v["pose"], self.q, v["mass"])
        JJ = np.concatenate(J, axis=-1)
        line = now.g + h * matrix_times_vector(JJ, joint_side_velocities(v["placing"], S, v["mass"], self.given))
        part = self.part(v, S)[..., None]
        then = line + part * (end.g - line)
        goal = np.where((self.acts == int(HIGHEST)), t.high, t.low)
        goal = np.where(np.isfinite(goal), goal, 0.0)
        error = unrecovered_joint_error(now.g - goal, h)
        inside = (self.acts == int(LOWEST)) & (error.real > 0.0) | (self.acts == int(HIGHEST)) & (error.real < 0.0)
        error = np.where(inside, 0.0, error)
        law, pull = self.drives(v, now, joint_effective_mass(J, S, v["mass"]))
        begun = matrix_times_vector(JJ, joint_side_velocities(v["begun"], S, v["mass"], self.given))
        spring = v["f"] - 0.5 * pull - law.b * begun + law.a * (then - now.g) / h
        lock = (then - goal - error) / h
        on = np.isin(self.acts, (int(HELD), int(LOWEST), int(HIGHEST)))
        rest = np.where(on, lock, np.where(self.acts == int(DRIVEN), spring, v["f"] - np.where(self.full, v["f"].real, 0.0)))
        return {"impulse": joint_impulses(J, v["f"]), "rest": rest}

    def drives(self, v: Values, now: PlacedJoints, A: np.ndarray) -> tuple[DriveLaw, np.ndarray]:
        """Laws of drives, and h (k (target - g) + c speed) where the substep begins."""
        t, m, free = self.t, np.ones(A.shape[:-1]), np.ones(A.shape[:-1])
        if t.alone.any() or (t.drive == int(ACCELERATION)).any():
            A = reduce_locked_rows(t.kind, A)
            m, free = row_effective_masses(A), coupled_drive_masses(t.drive, A)
        k, c = effective_drive_gains(t.drive, m, v["stiffness"], v["damping"])
        return complex_drive_law(self.h**2 * k, self.h * c, free, t.alone), self.h * (k * (v["target"] - now.g) + c * t.speed)

    def masses(self, A: np.ndarray) -> np.ndarray:
        """Effective masses of drives of accelerations, 1 of other rows."""
        on = self.t.drive == int(ACCELERATION)
        return np.where(on, row_effective_masses(reduce_locked_rows(self.t.kind, A)),
                        1.0) if on.any() else np.ones(A.shape[:-1])

    def part(self, v: Values, S: list) -> np.ndarray:
        """Part of what is not linear that is believed, as `fast` of kernels/rigid/joint/steps.py."""
        spins = [complex_vector_length(matrix_times_vector(S[s], v["momentum"][..., 6 * s + 3:6 * s + 6]))
                 * ~self.t.still[:, s] for s in (0, 1)]
        spin = np.where(spins[0].real > spins[1].real, spins[0], spins[1])
        part = 2.0 - self.h * spin / float(FAST)
        return np.where(part.real > 1.0, 1.0, np.where(part.real < 0.0, 0.0, part))

    def loosed(self, v: Values) -> Values:
        """The same behind the places, of then, momentum, f, before (impulses that rows have given), mass, and origin (the pose
        where the substep begins), begun, stiffness, damping, target. Rows that would then pull at their limit give back what
        they have given."""
        t, start = self.t, place_joint_frames(self.t, v["origin"], self.q, self.quarters)
        J, S = joint_jacobians(start), world_inverse_inertias(v["origin"], self.q, v["mass"])
        A = joint_effective_mass(J, S, v["mass"])
        (law, pull), mass = self.drives(v, start, A), self.masses(A)
        begun = matrix_times_vector(np.concatenate(J, axis=-1), joint_side_velocities(v["begun"], S, v["mass"], self.given))
        end = place_joint_frames(self.t, v["then"], self.Q, self.quarters)
        J, S = joint_jacobians(end), world_inverse_inertias(v["then"], self.Q, v["mass"])
        rate = matrix_times_vector(np.concatenate(J, axis=-1), joint_side_velocities(v["momentum"], S, v["mass"], self.given))
        eased = float(EASE) * (self.t.closed == 0)[:, None] * np.einsum("...ii->...i",
                                                                        joint_effective_mass(J, S, v["mass"])) * v["f"]
        whole = v["f"] + v["before"]
        more = self.masses(joint_effective_mass(J, S, v["mass"])) / mass
        given = pull + law.b_last * begun - law.a_last * rate - law.d * (end.g - start.g) / self.h
        spring = v["f"] - more * (given - v["before"])
        full = whole - np.where(t.drive > int(NONE), whole.real, 0.0)
        rest = np.where(self.acts == int(HELD), rate + eased, np.where(self.acts == int(DRIVEN), spring,
                                                                       np.where(self.full, full, v["f"])))
        return {"impulse": joint_impulses(J, v["f"]), "rest": rest}
