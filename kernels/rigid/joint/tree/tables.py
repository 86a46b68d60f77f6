"""Tables of trees of rigid bodies in reduced (joint) coordinates.

A tree is made of links, which are rigid bodies. Each link has one joint, to its parent link or to what the tree hangs from.
Links are
numbered so that parents come first. The degrees of freedom of a joint stand in this order: slides along axes of frame a, then
either
hinges, each about an axis and a point that the ones before have turned, or a ball.

    q     coordinates: lengths of slides [m], angles of hinges [rad], the quaternion (x, y, z, w) of a ball
    qd    generalised velocities: [m/s], [rad/s]; of a ball its angular velocity along the axes of frame b
    H     joint-space inertia (mass) matrix, H qdd + C = tau

Spatial vectors are pairs (angular part, linear part at the point O), in axes of the world. O is the centre of mass of the
first link of
the tree. Places are relative to where that link began, in float64.

(Featherstone 2008, Rigid Body Dynamics Algorithms.)
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function

LOOP_SHIFT, LOOP_TURN, LOOP_MIMIC, LOOP_SPAN = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
vec5d = wp.types.vector(5, wp.float64)
vec6d = wp.types.vector(6, wp.float64)
mat66d = wp.types.matrix((6, 6), wp.float64)


@cache
def loop_struct():
    """Equations between coordinates of a tree, a row each (loops/equations.py)."""
    @wp.struct
    class TreeLoops:
        first_row: wp.array(dtype=int)               # of trees, and one more
        kind: wp.array(dtype=int)                    # of rows: LOOP_SHIFT, LOOP_TURN, LOOP_MIMIC, LOOP_SPAN
        a: wp.array(dtype=int)                       # a link, or -1: the world; of mimics the dof that follows, and is followed
        b: wp.array(dtype=int)
        c_a: wp.array(dtype=int)                     # of mimics: their coordinates
        c_b: wp.array(dtype=int)
        at_a: wp.array(dtype=wp.vec3d)               # place [m], axis: in principal axes of a link, or of the world
        at_b: wp.array(dtype=wp.vec3d)
        e_a: wp.array(dtype=wp.vec3d)
        e_b: wp.array(dtype=wp.vec3d)
        coefficients: wp.array(dtype=vec5d)          # of mimics: of powers 0 to 4; of spans: their length [m]
        first_value: wp.array(dtype=int)             # place of a row's J and Q, (dofs of the tree) each
        first_square: wp.array(dtype=int)            # of trees: of R, (rows, rows)
        J: wp.array(dtype=wp.float64)
        Q: wp.array(dtype=wp.float64)                # unit columns in the places of their rows
        R: wp.array(dtype=wp.float64)
        left: wp.array(dtype=wp.float64)             # of rows: size^2 of what others do not imply, and of the whole motion
        size: wp.array(dtype=wp.float64)
        order: wp.array(dtype=int)                   # rows of a tree by pivots
        rank: wp.array(dtype=int)                    # of trees
        C: wp.array(dtype=wp.float64)                # of rows: what is not closed [m], [rad]
        z: wp.array(dtype=wp.float64)                # of rows
        x: wp.array(dtype=wp.float64)                # of dofs
        like: wp.array(dtype=wp.float64)             # of dofs: rates of a stage before its linear system

    return TreeLoops


@cache
def pushed_link_struct():
    """What links are said to have where points and strands push them, and what a star works with (contact/pushed.py)."""
    @wp.struct
    class PushedLinks:
        p: wp.array(dtype=wp.vec3d)                  # of bodies: momenta as they were told last
        L: wp.array(dtype=wp.vec3d)
        J: wp.array(dtype=wp.vec3d)                  # of bodies: impulse that points get, its moment about the centre of mass
        M: wp.array(dtype=wp.vec3d)
        u: wp.array(dtype=wp.float64)                # of dofs: u before the star

    return PushedLinks


@cache
def string_struct():
    """Distances that stay within a range (loops/strings.py)."""
    @wp.struct
    class TreeStrings:
        first_row: wp.array(dtype=int)               # of trees, and one more
        joint: wp.array(dtype=int)
        a: wp.array(dtype=int)                       # a link, or -1: the world
        b: wp.array(dtype=int)
        at_a: wp.array(dtype=wp.vec3d)               # end [m]: in principal axes of a link, or of the world
        at_b: wp.array(dtype=wp.vec3d)
        hang: wp.array(dtype=wp.vec3d)               # where the start of the anchor stands
        drawn: wp.array(dtype=wp.vec3d)              # its velocity [m/s]
        low: wp.array(dtype=wp.float64)              # [m]
        high: wp.array(dtype=wp.float64)
        first_value: wp.array(dtype=int)             # place of Z, (dofs of the tree)
        Z: wp.array(dtype=wp.float64)
        response: wp.array(dtype=wp.float64)         # Z^T Z [1/kg], 0 where nothing acts
        length: wp.array(dtype=wp.float64)           # where the step begins [m], and the direction from a to b
        n: wp.array(dtype=wp.vec3d)
        base: wp.array(dtype=wp.float64)             # rate by what trees hang from [m/s]
        bend: wp.array(dtype=wp.float64)             # what is not linear in the rates [m]
        push: wp.array(dtype=wp.float64)             # impulse [N s], below 0: it pulls; that of the substep before it
        sum: wp.array(dtype=wp.float64)
        taut: wp.array(dtype=int)                    # sign of the impulse before

    return TreeStrings


@cache
def break_struct():
    """Joints that may break (substep/breaks.py)."""
    @wp.struct
    class TreeBreaks:
        some: int                                    # 1: joints may break
        may: wp.array(dtype=int)                     # of links: 1: its joint may
        broken: wp.array(dtype=int)                  # of joints
        ball: wp.array(dtype=int)                    # of links, of dofs: those of TreeTable while joints are whole
        axis: wp.array(dtype=wp.vec3d)
        armature: wp.array(dtype=wp.float64)
        friction: wp.array(dtype=wp.float64)
        x: wp.array(dtype=wp.vec3d)                  # of links, where a substep begins: centre of mass, origin of frame b,
        o: wp.array(dtype=wp.vec3d)
        p: wp.array(dtype=wp.vec3d)                  # momentum, and angular momentum about the centre
        L: wp.array(dtype=wp.vec3d)
        bear_f: wp.array(dtype=wp.vec3d)             # impulse of contacts in a substep, and its torque about the centre
        bear_t: wp.array(dtype=wp.vec3d)

    return TreeBreaks


@cache
def tree_structs():
    """(TreeTable, Trees): what no stage writes, and all of it with what a step writes."""
    @wp.struct
    class TreeTable:
        first_link: wp.array(dtype=int)              # of trees, and one more
        body: wp.array(dtype=int)                    # of links: row of the body
        parent: wp.array(dtype=int)                  # a link, or -1
        start: wp.array(dtype=wp.vec3d)              # centre of mass of the body at the start
        at_a: wp.array(dtype=wp.vec3d)               # origin of frame a from the parent's centre, in its principal axes [m]
        turn_a: wp.array(dtype=wp.quatd)             # frame a to the parent's principal axes
        at_b: wp.array(dtype=wp.vec3d)
        turn_b: wp.array(dtype=wp.quatd)
        mass: wp.array(dtype=wp.float64)             # [kg]
        moments: wp.array(dtype=wp.vec3d)            # principal moments [kg m^2]
        slides: wp.array(dtype=int)
        ball: wp.array(dtype=int)                    # 1: the joint's rotation is a ball, else hinges
        first_dof: wp.array(dtype=int)               # of links, and one more
        first_coordinate: wp.array(dtype=int)        # of links, and one more
        axis: wp.array(dtype=wp.vec3d)               # of dofs, unit: of slides in frame a, of hinges in what they turn
        point: wp.array(dtype=wp.vec3d)              # of dofs: where a hinge turns, from the origin of frame b in its axes [m]
        dof_parent: wp.array(dtype=int)              # the dof before it on the way to the root, or -1
        first_entry: wp.array(dtype=int)             # of dofs, and one more: row of H, the dof itself, then the way to the root
        joint: wp.array(dtype=int)                   # of links: number in JointTable, or -1: a free body
        row: wp.array(dtype=int)                     # of dofs: row of the joint in JointTable; of a ball 3, 4, 5
        armature: wp.array(dtype=wp.float64)         # of dofs: inertia of a rotor [kg], [kg m^2]
        friction: wp.array(dtype=wp.float64)         # of dofs: dry friction [N], [N m]
        first_level: wp.array(dtype=int)             # of trees, and one more: levels, by distance from the root
        level_start: wp.array(dtype=int)             # of levels, and one more: place in `by_level`
        by_level: wp.array(dtype=int)                # links
        first_child: wp.array(dtype=int)             # of links, and one more: place in `child`
        child: wp.array(dtype=int)                   # links, the last first
        last_dof: wp.array(dtype=int)                # of links: the last dof that moves it, or -1
        dof_link: wp.array(dtype=int)                # of dofs
        dof_end: wp.array(dtype=int)                 # of dofs: those behind it are the ones between, this one left out
        entry_dof: wp.array(dtype=int)               # of entries of H: the dof of their column
        entry_row: wp.array(dtype=int)               # and of their row
        first_step: wp.array(dtype=int)              # of trees, and one more: dofs equally far from the root, farthest first
        step_start: wp.array(dtype=int)              # of those, and one more: place in `step_entry`
        step_entry: wp.array(dtype=int)              # entries of their rows

    TreeLoops, PushedLinks = loop_struct(), pushed_link_struct()
    TreeStrings, TreeBreaks = string_struct(), break_struct()

    @wp.struct
    class Trees:
        t: TreeTable
        loops: TreeLoops
        links: PushedLinks
        strings: TreeStrings
        breaks: TreeBreaks
        q: wp.array(dtype=wp.float64)
        qd: wp.array(dtype=wp.float64)
        X: wp.array(dtype=wp.vec3d)                  # of links: centre of mass, and principal axes to the world
        Q: wp.array(dtype=wp.quatd)
        S_w: wp.array(dtype=wp.vec3d)                # of dofs: the joint's motion, angular and linear part
        S_v: wp.array(dtype=wp.vec3d)
        W: wp.array(dtype=wp.vec3d)                  # of links: spatial velocity
        V: wp.array(dtype=wp.vec3d)
        A_w: wp.array(dtype=wp.vec3d)                # spatial acceleration with qdd = 0
        A_v: wp.array(dtype=wp.vec3d)
        N: wp.array(dtype=wp.vec3d)                  # wrench of a link and of all behind it: torque about O, force
        F: wp.array(dtype=wp.vec3d)
        m: wp.array(dtype=wp.float64)                # of a link and all behind it: mass, first and second moment at O
        mc: wp.array(dtype=wp.vec3d)
        inertia: wp.array(dtype=wp.mat33d)
        H: wp.array(dtype=wp.float64)
        M: wp.array(dtype=wp.float64)                # inverse of the factor L, of many lanes (wide_factor.py)
        H_before: wp.array(dtype=wp.float64)         # at the start of a step, and the factors of W (steps.py)
        W_factors: wp.array(dtype=wp.float64)
        tau: wp.array(dtype=wp.float64)              # of dofs: generalised forces, then accelerations
        q_before: wp.array(dtype=wp.float64)         # where a step begins
        q_start: wp.array(dtype=wp.float64)          # where a substep begins that has parts
        qd_start: wp.array(dtype=wp.float64)
        qd_before: wp.array(dtype=wp.float64)
        rate: wp.array(dtype=wp.float64)             # of dofs: rates of coordinates in a stage, and their weighted sums
        rates: wp.array(dtype=wp.float64)
        mean: wp.array(dtype=wp.float64)
        gains: wp.array(dtype=wp.float64)            # weighted sum of accelerations
        u: wp.array(dtype=wp.float64)                # of dofs: velocities of sweeps (responses.py)
        column: wp.array(dtype=wp.float64)           # of rows of dofs: Z (responses.py), (dofs on the way to the root) each
        first_column: wp.array(dtype=int)            # of dofs
        mass: wp.array(dtype=wp.float64)             # of dofs: what a drive of an acceleration moves, 1 of others
        push: wp.array(dtype=wp.float64)             # of dofs: impulse of their limits in a step, and of their dry friction
        rub: wp.array(dtype=wp.float64)
        rub_most: wp.array(dtype=wp.float64)         # of dofs: impulse that their dry friction gives at most
        response: wp.array(dtype=wp.float64)         # of dofs: J H^-1 J^T, 0 where nothing acts
        first_tree: wp.array(dtype=int)              # of worlds, and one more
        link_of: wp.array(dtype=int)                 # of bodies
        tree_of: wp.array(dtype=int)                 # of links
        met: wp.array(dtype=int)                     # of links: 1: a contact needs its responses, 2: they are there
        first_answer: wp.array(dtype=int)            # of links: place of its responses
        last_answer: wp.array(dtype=int)             # of trees: the end of those of its links
        answer_link: wp.array(dtype=int)             # of rows of those: the link
        answer: wp.array(dtype=wp.float64)           # of links: Z (responses.py), (dofs on the way to the root, 6) each
        swing: wp.array(dtype=mat66d)                # of links: Z^T Z, spatial velocity by a wrench at O
        flags: wp.array(dtype=int)                   # of worlds, two each (contact/impacts.py)
        residual: wp.array(dtype=wp.float64)         # of worlds, of the last look [m/s], and the one at which sweeps end
        tolerance: wp.float64
        solref: wp.array(dtype=wp.vec2d)             # of shapes (contact/soft_model.py)
        solimp: wp.array(dtype=vec5d)
        left: wp.array(dtype=wp.float64)             # of trees: what the last sweep over limits changed, at most in a frame
        scheme: int                                  # of all trees, as `integrator`; -1: by the stiffness of their drives
        moves: int                                   # 1: some links hang from what moves (bases.py)
        hang: wp.array(dtype=wp.vec3d)               # of links: where the start of their anchor stands
        base_v: wp.array(dtype=wp.vec3d)             # of links that hang from what moves: its velocity, and spin
        base_w: wp.array(dtype=wp.vec3d)
        integrator: wp.array(dtype=int)              # of trees: how they step (steps.py)

    return TreeTable, Trees


Trees = tree_structs()[1]


@standalone_function
@wp.func
def tree_dofs(g: int, T: Trees):
    """(first, last) degree of freedom of a tree, the last one left out."""
    return wp.vec2i(T.t.first_dof[T.t.first_link[g]], T.t.first_dof[T.t.first_link[g + 1]])
