"""Tables of joints on a device. They are numbered island by island, in the order in which they are eliminated.

A joint has six rows: three shifts, twist, two swings (kernels/rigid/joint/coordinates.py). Each is free, locked at `low` or
held within low .. high, and may be driven.

An island is what joints connect: its joints share no dynamic body with other islands.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.joint.actuation.actuators import Actuators

FREE, LOCKED, LIMITED = wp.constant(0), wp.constant(1), wp.constant(2)
NONE, FORCE, ACCELERATION = wp.constant(0), wp.constant(1), wp.constant(2)      # of a drive; of a row that is not active: NONE
HELD, DRIVEN, LOWEST, HIGHEST = wp.constant(1), wp.constant(2), wp.constant(3), wp.constant(4)     # of an active row
TOP, BOTTOM = wp.constant(5), wp.constant(6)           # of a drive that gives all that it has, up or down: no equation
FAR = wp.constant(wp.float64(1.0e300))       # [m/s], [rad/s] beyond which a limit is that cannot be met


@cache
def joint_table_structs():
    """(Joints, Linked): what no stage writes, and all of it with what a substep writes. [joint, row] where of rows."""
    @wp.struct
    class JointTable:
        a: wp.array(dtype=int)                       # rows of bodies; -1: the anchor
        b: wp.array(dtype=int)
        at_a: wp.array(dtype=wp.vec3d)               # from the centre of mass, in principal axes [m]
        at_b: wp.array(dtype=wp.vec3d)
        turn_a: wp.array(dtype=wp.quatd)             # the joint's frame to principal axes
        turn_b: wp.array(dtype=wp.quatd)
        apart: wp.array(dtype=wp.vec3d)              # origin of b from that of a [m]
        form: wp.array(dtype=int)
        closed: wp.array(dtype=int)                  # 1: its island has a loop
        alone: wp.array(dtype=int)                   # 1: no other joint moves its bodies
        cone: wp.array(dtype=wp.vec2d)               # 1 / half angle [1/rad]
        kind: wp.array2d(dtype=int)
        low: wp.array2d(dtype=wp.float64)            # [m], [rad]
        high: wp.array2d(dtype=wp.float64)
        drive: wp.array2d(dtype=int)
        stiffness: wp.array2d(dtype=wp.float64)      # [N/m], [N m/rad]; of accelerations [1/s^2]
        damping: wp.array2d(dtype=wp.float64)        # [N s/m], [N m s/rad]; [1/s]
        target: wp.array2d(dtype=wp.float64)         # [m], [rad]
        speed: wp.array2d(dtype=wp.float64)          # [m/s], [rad/s]
        most: wp.array2d(dtype=wp.float64)           # [N], [N m]; of accelerations too
        breaking: wp.array(dtype=wp.vec2d)           # [N], [N m]
        w: wp.array(dtype=wp.float64)                # of bodies [1/kg]
        linked: wp.array(dtype=int)                  # of bodies: 1: a joint has it
        first_joint: wp.array(dtype=int)             # of islands, and one more
        first_body: wp.array(dtype=int)
        body: wp.array(dtype=int)
        first_near: wp.array(dtype=int)              # of joints, and one more: blocks below the diagonal
        near: wp.array(dtype=int)                    # joint of the block's row
        first_target: wp.array(dtype=int)
        target_block: wp.array(dtype=int)            # block that a product of two such blocks is taken from
        moving: int
        anchor_x: wp.array2d(dtype=wp.vec3d)         # [substep where moving, else 0; joint], from its origin [m]
        anchor_q: wp.array2d(dtype=wp.quatd)
        anchor_v: wp.array2d(dtype=wp.vec3d)
        anchor_o: wp.array2d(dtype=wp.vec3d)
        aiming: int                                  # 1: targets and speeds vary in time, [end of a substep, joint, row]
        aim: wp.array3d(dtype=wp.float64)            # in the place of target and speed; first where the frame begins
        pace: wp.array3d(dtype=wp.float64)
        actuated: int                                # 1: some rows have actuators
        actuators: Actuators

    @wp.struct
    class LinkedBodies:
        t: JointTable
        quarters: wp.array(dtype=int)                # of the twist, counted on
        broken: wp.array(dtype=int)
        given: wp.array(dtype=wp.float64)            # work of drives that ask for a speed, in the frame [J]
        X: wp.array(dtype=wp.vec3d)                  # bodies: place from the origin, orientation, I^-1
        Q: wp.array(dtype=wp.quatd)
        S: wp.array(dtype=wp.mat33d)
        dp: wp.array(dtype=wp.vec3d)                 # what a place is taken by, less the momentum behind the forces
        dL: wp.array(dtype=wp.vec3d)
        p: wp.array(dtype=wp.vec3d)                  # momenta before the forces of the substep
        L: wp.array(dtype=wp.vec3d)
        P: wp.array(dtype=wp.vec3d)                  # impulses of a sweep
        T: wp.array(dtype=wp.vec3d)
        touched: wp.array(dtype=int)
        axis: wp.array(dtype=wp.mat33d)
        turn: wp.array(dtype=wp.mat33d)
        r_a: wp.array(dtype=wp.vec3d)
        r_b: wp.array(dtype=wp.vec3d)
        now: wp.array2d(dtype=wp.float64)            # coordinates where the substep begins
        hold: wp.array2d(dtype=wp.float64)           # impulses of the substep [N s], [N m s]
        push: wp.array2d(dtype=wp.float64)
        early: wp.array2d(dtype=wp.vec2d)            # laws of a drive (drives.py): 1 / a, and what is added to u
        late: wp.array2d(dtype=wp.vec4d)             # 1 / a', W at g = g' = 0, d / h, m
        beside: wp.array2d(dtype=wp.vec2d)           # backward Euler, as `early`
        soft: wp.array2d(dtype=wp.float64)           # of a drive now: Gamma, and the impulse that it gives at most
        give: wp.array2d(dtype=wp.float64)
        limit: wp.array2d(dtype=wp.float64)          # of a driven row in the substep: force at most, with actuators
        under: wp.array2d(dtype=wp.float64)          # what a row asks for: rates beyond its lowest end, or of a lock
        over: wp.array2d(dtype=wp.float64)           # beyond its highest
        much: wp.array2d(dtype=wp.float64)           # of a drive
        change: wp.array2d(dtype=wp.float64)         # of rates by what rhs adds
        turned: wp.array2d(dtype=wp.float64)         # (D M^-1 D^T)_rr / 2 of the change D of rows in a substep
        ease: wp.array2d(dtype=wp.float64)           # what is added to the diagonal of A
        active: wp.array2d(dtype=int)                # what the factor is of
        next: wp.array2d(dtype=int)                  # what is to act
        rhs: wp.array2d(dtype=wp.float64)
        block: wp.array(dtype=wp.float64)            # 36 a block: diagonal ones of all joints, then those below

    return JointTable, LinkedBodies
