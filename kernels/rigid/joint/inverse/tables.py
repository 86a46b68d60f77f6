"""Tables of one tree of joints, shared by many copies ("arms") that are solved for at once: a thread each.

What differs between arms stands in arrays (row, arm), so that threads of neighbours read neighbours. Links, degrees of freedom
and coordinates are those of `wsim.kernels.rigid.joint.tree.tables`; only the links that something asks about are here.
"""

import warp as wp


@wp.struct
class ArmTable:
    """Constants of the tree."""

    parent: wp.array(dtype=int)                  # of links: a link before it, or -1
    at_a: wp.array(dtype=wp.vec3d)               # origin of frame a from the parent's centre, in its principal axes [m]
    turn_a: wp.array(dtype=wp.quatd)             # frame a to the parent's principal axes
    at_b: wp.array(dtype=wp.vec3d)
    turn_b: wp.array(dtype=wp.quatd)
    mass: wp.array(dtype=wp.float64)             # [kg]
    moments: wp.array(dtype=wp.vec3d)            # principal moments [kg m^2]
    force: wp.array(dtype=wp.vec3d)              # outer force [N] and torque about the centre [N m], with the weight
    torque: wp.array(dtype=wp.vec3d)
    slides: wp.array(dtype=int)
    ball: wp.array(dtype=int)                    # 1: the joint's rotation is a ball, else hinges
    first_dof: wp.array(dtype=int)               # of links, and one more
    first_coordinate: wp.array(dtype=int)        # of links, and one more
    axis: wp.array(dtype=wp.vec3d)               # of dofs
    point: wp.array(dtype=wp.vec3d)              # of dofs: where a hinge turns, from the origin of frame b in its axes [m]
    turns: wp.array(dtype=int)                   # of dofs: 1: it turns, 0: it slides
    armature: wp.array(dtype=wp.float64)         # of dofs [kg], [kg m^2]
    moves: wp.array(dtype=int)                   # of dofs: 0: it stays
    low: wp.array(dtype=wp.float64)              # of coordinates: limits [m], [rad]; infinite where there are none
    high: wp.array(dtype=wp.float64)
    coordinate: wp.array(dtype=int)              # of dofs: coordinate that it moves alone; -1: of a ball


@wp.struct
class ArmGoals:
    """What points and directions of links are asked for."""

    link: wp.array(dtype=int)
    point: wp.array(dtype=wp.vec3d)              # from the link's centre of mass, in its principal axes [m]
    own: wp.array(dtype=wp.quatd)                # frame of the body to the link's principal axes
    length: wp.array(dtype=wp.vec2d)             # weights: of the distance [1], of the angle [m/rad]; 0: not asked for
    on_path: wp.array2d(dtype=int)               # (goals, dofs): 1: the dof moves the link
    at: wp.array2d(dtype=wp.vec3d)               # wanted places [m], (goals, arms)
    turn: wp.array2d(dtype=wp.quatd)             # wanted orientations of the body


@wp.struct
class ArmWork:
    """What a thread works with, (rows, threads)."""

    arm: wp.array(dtype=int)                     # of threads: arm that it solves for

    X: wp.array2d(dtype=wp.vec3d)                # of links: centre of mass [m], and principal axes to the world
    Q: wp.array2d(dtype=wp.quatd)
    S: wp.array2d(dtype=wp.vec3d)                # of dofs: axis in the world, and a place on it [m]
    pivot: wp.array2d(dtype=wp.vec3d)
    J_p: wp.array2d(dtype=wp.vec3d)              # of dofs: how they move the goal in hand, and turn it
    J_r: wp.array2d(dtype=wp.vec3d)
    q: wp.array2d(dtype=wp.float64)              # coordinates: accepted, and tried
    trial: wp.array2d(dtype=wp.float64)
    A: wp.array2d(dtype=wp.float64)              # J^T J, lower triangle row by row, and J^T e, where accepted and where tried
    g: wp.array2d(dtype=wp.float64)
    A_trial: wp.array2d(dtype=wp.float64)
    g_trial: wp.array2d(dtype=wp.float64)
    L: wp.array2d(dtype=wp.float64)              # Cholesky factor
    step: wp.array2d(dtype=wp.float64)


@wp.struct
class ArmStarts:
    """Solutions from several places to begin from. Arms whose first start did not lead to the goal try all others."""

    start: wp.array2d(dtype=wp.float64)          # coordinates of the first, (rows, arms)
    ratio: wp.array(dtype=wp.float64)            # of dofs: steps of the R sequence
    best: wp.array2d(dtype=wp.float64)           # coordinates of the best, (rows, arms)
    found: wp.array(dtype=wp.vec4d)              # of arms: E [m^2], largest distance [m], largest angle [rad], steps
    failed: wp.array(dtype=int)                  # of arms: 1: the first start did not lead to the goal
    rank: wp.array(dtype=int)                    # sum of `failed` up to an arm, itself too
    who: wp.array(dtype=int)                     # arms that failed, in their order
    tries: wp.array(dtype=wp.vec4d)              # as `found`, (others of an arm behind those of the arm before)
    tried: wp.array2d(dtype=wp.float64)          # coordinates of these, (rows, arms * others)
