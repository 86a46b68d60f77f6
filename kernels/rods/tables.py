"""Tables of strands: arrays of (points of the longest strand, strands), so that threads of neighbours read neighbours. All in
float64: strains are differences of positions of 1e-9 of a strand's length.
"""

import warp as wp


@wp.struct
class RodTable:
    """Constants of strands. An edge has the number of its first point; the last point has none."""

    points: wp.array(dtype=int)                     # of each strand
    own: wp.array(dtype=int)                        # those but copies (seam.py); only where a strand is closed
    length: wp.array2d(dtype=wp.float64)            # rest length of an edge [m]
    A: wp.array2d(dtype=wp.float64)                 # stretching stiffness of an edge over its length [N/m]
    B: wp.array2d(dtype=wp.float64)                 # bending stiffness at a point over the length it stands for [N m]
    C: wp.array2d(dtype=wp.float64)                 # twisting stiffness likewise [N m]
    rest: wp.array2d(dtype=wp.vec3d)                # curvatures and twist at rest
    m: wp.array2d(dtype=wp.float64)                 # mass of a point [kg]
    J: wp.array2d(dtype=wp.float64)                 # inertia of an edge about itself [kg m^2]
    hold: wp.array2d(dtype=int)                     # row of Holds of a point; -1: it is free
    clamped: wp.array2d(dtype=int)                  # 1: both points of an edge are held by one pin, and its frame too
    radius: wp.array2d(dtype=wp.float64)            # of a point [m]
    origin: wp.array(dtype=wp.vec3d)                # what x is relative to [m], one for each strand
    gravity: wp.array(dtype=wp.vec3d)               # [m/s^2], one for each strand
    friction: wp.array(dtype=wp.vec2d)              # static, dynamic, one for each strand
    wind: wp.array(dtype=wp.vec3d)                  # [m/s], one for each strand; this and below only where there is air
    decay: wp.array(dtype=wp.float64)               # rate of a strand's velocities [1/s]
    across: wp.array2d(dtype=wp.float64)            # drag of an edge across its axis over the speed squared [kg/m]
    along: wp.array2d(dtype=wp.float64)             # and along it
    tau: wp.array(dtype=wp.float64)                 # relaxation time of a strand's elastic forces [s]; only where some have one
    load_row: wp.array2d(dtype=int)                 # of a point in `load_force`, -1: no load; both only where there are loads
    load_force: wp.array2d(dtype=wp.vec3d)          # forces of loads on points [N], where substeps end, (substeps, rows)


@wp.func
def is_own_point(S: RodTable, i: int, k: int):
    """True if a point is no copy of another."""
    if S.own:
        return i < S.own[k]
    return True


@wp.func
def contact_mass(S: RodTable, i: int, k: int):
    """Mass [kg] that contacts of a point go by: of a copy that of the point itself, to the part that the copy has of it."""
    if S.own:
        if i >= S.own[k]:
            return S.m[i - S.own[k], k]
    return S.m[i, k]


@wp.func
def point_of_copy(S: RodTable, i: int, k: int):
    """The point that point i is a copy of, else itself."""
    if S.own:
        if i >= S.own[k]:
            return i - S.own[k]
    return i


@wp.func
def mass_with_copy(S: RodTable, i: int, k: int):
    """Mass [kg] of a point, and that of its copy."""
    m = S.m[i, k]
    if S.own:
        if i + S.own[k] < S.points[k]:
            m += S.m[i + S.own[k], k]
    return m


@wp.struct
class RodPins:
    """Points that pins hold, and directors of edges."""

    pin: wp.array(dtype=int)
    place: wp.array(dtype=wp.vec3d)                 # in the pin's frame [m]
    director: wp.array(dtype=wp.vec3d)              # in the pin's frame
    frame: wp.array2d(dtype=wp.mat44d)              # of pins at the ends of substeps, (substeps, pins)


@wp.struct
class RodMotion:
    """State of points and edges."""

    x: wp.array2d(dtype=wp.vec3d)                   # position [m] relative to the strand's origin
    v: wp.array2d(dtype=wp.vec3d)                   # velocity [m/s]
    s: wp.array2d(dtype=wp.vec3d)                   # step before [m]
    u: wp.array2d(dtype=wp.vec3d)                   # velocity before [m/s]
    d: wp.array2d(dtype=wp.vec3d)                   # material director of an edge, across its tangent
    phi: wp.array2d(dtype=wp.float64)               # twist at a point [rad]
    begun: wp.array2d(dtype=int)                    # 1: a point, and its edge, carry on the step before; 0: they start anew
    stick: wp.array2d(dtype=wp.vec3d)               # bristle of a point that touches a collider [m]
    load: wp.array2d(dtype=wp.float64)              # normal force on it [N]
    stick1: wp.array2d(dtype=wp.vec3d)              # of both places where an edge touches a collider between its points:
    stick2: wp.array2d(dtype=wp.vec3d)              # bristles [m]
    load1: wp.array2d(dtype=wp.float64)             # normal forces on it [N]; only where there are colliders
    load2: wp.array2d(dtype=wp.float64)
    w: wp.array2d(dtype=wp.vec3d)                   # of edges: spin about the tangent [rad/s], turn before [rad], spin before


@wp.struct
class RodTrial:
    """A substep that is being solved for, and the factors of its system (blocks of 4: three of a point, one of its edge)."""

    x: wp.array2d(dtype=wp.vec3d)
    d: wp.array2d(dtype=wp.vec3d)
    phi: wp.array2d(dtype=wp.float64)
    turn: wp.array2d(dtype=wp.float64)              # of edges about their tangents in this substep [rad]
    pull: wp.array2d(dtype=wp.float64)              # tension of edges, as the last correction had it [N]
    slip: wp.array2d(dtype=wp.vec3d)                # over a collider [m], 0 of a point without friction; this and four more
    load: wp.array2d(dtype=wp.float64)              # where strands meet colliders alone: normal force as that had it [N];
                                                    # rows of edges' first and second places behind those of points
    change: wp.array2d(dtype=wp.float64)            # how much that changed it [N]
    hit: wp.array2d(dtype=wp.vec4d)                 # normal of a contact times its stiffness [N/m], and its normal force [N]
    lean: wp.array2d(dtype=wp.vec3d)                # friction of one that slips over - mu N, as that had it
    edge: wp.array2d(dtype=int)                     # what an edge has had between its points (kernels/rods/contact.py)
    inside: wp.array2d(dtype=wp.vec3d)              # of edges that touch a collider: y, normal force [N], how deep [m]
    bristle: wp.array2d(dtype=wp.vec3d)             # and their bristles [m]
    drawn: wp.array(dtype=wp.float64)               # of strands: farthest a point is drawn to a collider, or anew in one [m]
    near: wp.array2d(dtype=wp.mat44d)               # factor towards the next point
    far: wp.array2d(dtype=wp.mat44d)                # towards the one behind it
    z: wp.array2d(dtype=wp.vec4d)                   # right-hand side, then correction
    seam: wp.array2d(dtype=wp.mat44d)               # of closed strands (seam.py), (strands, 3); this and one more only of these
    slack: wp.array2d(dtype=wp.vec4d)               # what forces of the seam move
    pivot: wp.array2d(dtype=wp.mat44d)              # inverse of the diagonal's; this and b only of such as are closed,
    b: wp.array2d(dtype=wp.vec4d)                   # or meet others: right-hand side; below only of these
    press: wp.array2d(dtype=wp.vec3d)               # force of other edges on a point [N]
    stiff: wp.array2d(dtype=wp.mat33d)              # its stiffness [N/m]
    along: wp.array2d(dtype=wp.mat33d)              # and that towards the next point
    given: wp.array2d(dtype=wp.vec3d)               # force of surfaces on a point [N]; only where strands meet them
    lift: wp.array2d(dtype=wp.vec3d)                # force of rigid bodies on it [N]; only where strands meet them
    firm: wp.array2d(dtype=wp.mat33d)               # and its stiffness, bodies held [N/m]
    bridge: wp.array2d(dtype=wp.mat33d)             # and that towards the next point, of edges between them


@wp.struct
class EdgePairs:
    """What pairs of edges have (kernels/rods/edges/touch.py), by pair, besides the list's; `of`, `many` by point."""

    kept: wp.array(dtype=wp.float64)               # distance that it keeps now [m]; negative: not known yet
    k: wp.array(dtype=wp.float64)                  # [N/m]
    stick: wp.array(dtype=wp.vec3d)                # bristle [m]
    load: wp.array(dtype=wp.float64)               # normal force of the substep before [N]
    f: wp.array(dtype=wp.vec3d)                    # force on the first edge [N]
    K: wp.array(dtype=wp.mat33d)                   # its stiffness [N/m]
    s: wp.array(dtype=wp.vec3d)                    # bristle where the substep ends [m]
    N: wp.array(dtype=wp.float64)                  # normal force there [N]
    cross: wp.array2d(dtype=wp.vec3d)              # K by what the first, second edge moves, (pairs, 2)
    rough: wp.array(dtype=int)                     # of worlds: > 0, friction is as stiff along its slip as across
    of: wp.array2d(dtype=int)                      # 4 pair + corner, (points, room)
    many: wp.array(dtype=int)                      # of them, by point; may be more than there is room for
    on: wp.array2d(dtype=int)                      # those of them that press, and how many
    ons: wp.array(dtype=int)


@wp.struct
class RodContacts:
    """Contacts of strands with rigid bodies (kernels/rigid/touch/strands.py): by flat row of a point, which the edge behind it
    shares, and their number there, (points, room); by site (kernels/rigid/touch/strand_contacts.py), (points, 3); by body."""

    many: wp.array(dtype=int)                       # contacts of a row; may be more than there is room for
    body: wp.array2d(dtype=int)                     # of a contact
    u: wp.array2d(dtype=wp.float64)                 # where on the edge; 0: of the point
    arm: wp.array2d(dtype=wp.vec3d)                 # from the body's centre of mass to that place [m]
    f: wp.array2d(dtype=wp.vec3d)                   # force on the strand there [N]
    K: wp.array2d(dtype=wp.mat33d)                  # its stiffness [N/m]
    N: wp.array2d(dtype=wp.float64)                 # normal force of the deepest contact of a site [N]
    load: wp.array2d(dtype=wp.float64)              # normal force that its friction goes by [N]
    s: wp.array2d(dtype=wp.vec3d)                   # bristle there where the substep ends [m]
    deep: wp.array2d(dtype=wp.float64)              # how deep that is [m]
    pull: wp.array(dtype=wp.vec3d)                  # of rows: force of a tie that is not yet in its spring [N]
    near: wp.array(dtype=int)                       # of worlds: 1, a body may be met in this substep
    rough: wp.array(dtype=int)                      # of worlds: those of `CoupledRods`, and three more
    count: wp.array(dtype=int)
    on: wp.array(dtype=int)
    back: wp.array(dtype=int)
    first: wp.array(dtype=int)                      # first body of each world, and their number, (worlds + 1,)
    start: wp.array(dtype=int)                      # contacts of each body, and their number, (bodies + 1,)
    slot: wp.array(dtype=int)                       # row * room + number of a contact, in the order of bodies
    P: wp.array(dtype=wp.mat33d)                    # of D: inverse of its first block, its second, inverse of the rest
    X: wp.array(dtype=wp.mat33d)
    H: wp.array(dtype=wp.mat33d)
    y: wp.array2d(dtype=wp.vec3d)                   # motion [m] and turn [rad] of bodies, (bodies, 2)
    size: wp.array(dtype=wp.float64)                # radius of a body [m]: of one below an edge corrections are measured by it
    push: wp.array(dtype=wp.vec3d)                  # force on a point of bodies that move by y [N]
    left: wp.array(dtype=wp.float64)                # greatest correction of a place of contact [m]
    ahead: wp.array(dtype=wp.float64)               # force along the last step, and along the correction, of a body
    gain: wp.array(dtype=wp.float64)


@wp.struct
class RodStep:
    """A substep of h [s], the one of that number in its frame."""

    h: wp.float64
    at: int
