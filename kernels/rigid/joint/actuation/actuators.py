"""Actuators on the rows of joints: affine laws with a gear, and ranges of the control and the force, as MuJoCo has them.

    f = gain u + b_0 + b_1 l + b_2 l',    l = gear g,  u within the range of the control,  f within that of the force
    F = gear f                            on the coordinate g [N], [N m]

A motor has b = 0, a position servo gain = k, b = (0, -k, -c), a velocity servo gain = c, b = (0, 0, -c). In terms of g

    F = pull - k g - c g',   k = -gear^2 b_1,  c = -gear^2 b_2,  pull = gear (gain u + b_0)

so that k and c join those of drives (drives.py): steps are stable for every k and c.

(MuJoCo documentation, Computation, Actuation model.)
"""

from functools import cache

import warp as wp


@cache
def actuator_struct():
    """Struct of the actuators of all worlds, world behind world."""
    @wp.struct
    class ActuatorTable:
        first: wp.array2d(dtype=int)               # of rows of joints, [joint, row], and one more row: places in `entry`
        entry: wp.array(dtype=int)                 # actuators in the order of rows
        gear: wp.array(dtype=wp.float64)
        gain: wp.array(dtype=wp.float64)           # [N or N m per unit of u]
        bias: wp.array(dtype=wp.vec3d)             # b: [N], [N/m], [N s/m], or of turns
        control_range: wp.array(dtype=wp.vec2d)
        force_range: wp.array(dtype=wp.vec2d)      # of f [N], [N m]
        control: wp.array(dtype=wp.float64)        # u where it follows no curve; written by the host, or by a policy
        course: wp.array(dtype=int)                # column of `courses`, -1: none
        courses: wp.array2d(dtype=wp.float64)      # u at the start of a frame and the end of each substep

    return ActuatorTable


Actuators = actuator_struct()


@wp.struct
class ActuatorLaw:
    """F = pull - k g - c g', within low .. high."""
    k: wp.float64
    c: wp.float64
    pull: wp.float64
    low: wp.float64
    high: wp.float64


@wp.func
def actuator_law(e: int, s: int, part: wp.float64, A: Actuators):
    """Law of actuator e, at a part of substep s."""
    u = A.control[e]
    if A.course[e] >= 0:
        u = A.courses[s, A.course[e]]
        u = u + part * (A.courses[wp.min(s + 1, A.courses.shape[0] - 1), A.course[e]] - u)
    u = wp.clamp(u, A.control_range[e][0], A.control_range[e][1])
    gear = A.gear[e]
    law = ActuatorLaw()
    law.k = -gear * gear * A.bias[e][1]
    law.c = -gear * gear * A.bias[e][2]
    law.pull = gear * (A.gain[e] * u + A.bias[e][0])
    law.low = wp.min(gear * A.force_range[e][0], gear * A.force_range[e][1])
    law.high = wp.max(gear * A.force_range[e][0], gear * A.force_range[e][1])
    return law


@wp.func
def actuator_force(law: ActuatorLaw, g: wp.float64, rate: wp.float64):
    """F [N], [N m]."""
    return wp.clamp(law.pull - law.k * g - law.c * rate, law.low, law.high)


@wp.func
def is_saturated(law: ActuatorLaw, g: wp.float64, rate: wp.float64):
    """Whether F is one of its limits."""
    f = law.pull - law.k * g - law.c * rate
    return f <= law.low or f >= law.high


@wp.struct
class RowActuation:
    """Sum of the laws of a row in a substep: k, c, pull where it begins and where it ends; most: of the force of the row."""
    k: wp.float64
    c: wp.float64
    before: wp.float64
    last: wp.float64
    most: wp.float64


@wp.func(inline=False)
def row_actuation(j: int, r: int, s: int, g: wp.float64, rate: wp.float64, alone: int, A: Actuators):
    """Laws of row r of joint j in substep s. Those that are saturated where it begins pull with their limit. alone 1: the row
    has no other law. Then one servo with a symmetric limit is held to it wherever in the substep."""
    found = RowActuation()
    found.most = wp.float64(wp.inf)
    first = A.first[j, r]
    last = A.first[j, r + 1]
    for i in range(first, last):
        law = actuator_law(A.entry[i], s, wp.float64(0.0), A)
        then = actuator_law(A.entry[i], s, wp.float64(1.0), A)
        if alone == 1 and last == first + 1 and law.low == -law.high:
            found.most = law.high
            found.k = law.k
            found.c = law.c
            found.before = law.pull
            found.last = then.pull
        elif is_saturated(law, g, rate) or law.k + law.c == wp.float64(0.0):
            found.before += actuator_force(law, g, rate)
            found.last += actuator_force(then, g, rate)
        else:
            found.k += law.k
            found.c += law.c
            found.before += law.pull
            found.last += then.pull
    return found


@wp.func(inline=False)
def row_actuator_force(j: int, r: int, s: int, part: wp.float64, g: wp.float64, rate: wp.float64, A: Actuators):
    """F of all actuators of row r of joint j at a part of substep s [N], [N m]."""
    found = wp.float64(0.0)
    for i in range(A.first[j, r], A.first[j, r + 1]):
        found += actuator_force(actuator_law(A.entry[i], s, part, A), g, rate)
    return found
