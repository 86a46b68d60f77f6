"""Two triangle meshes against each other: contacts of one face of each. In the frame of mesh A; n from B to A.

Where the surfaces of two polyhedra touch, one of these is true of the places that touch (Ericson 2005, section 5.5.1; the
regions are those of kernels/rigid/narrow/triangle.py):

    corner of A, face of B    n = f_B,   n.(q - v) >= 0 for all neighbours q of the corner v       gap = n.(v - b)
    corner of B, face of A    n = -f_A,  n.(q - v) <= 0                                            gap = n.(a - v)
    edges                     n along e_A x e_B, in the region of B's edge, -n in that of A's      gap = n.(a - b)

and near touching, so long as the overlap is less than what stands out. So that each is met once, a corner belongs to one of its
faces, and an edge to one of both. Edges and corners that are flat or hollow touch nothing. What is beyond the margin, or deeper
than the reach, is left out. The back of a sheet counts where the middle of A is there.

    key    4 (hash of both features) + 0 corner of A, 1 corner of B, 2 edges
"""

from functools import cache

import warp as wp

from wsim.kernels.math.eigen import identity_like
from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.mesh import mesh_type
from wsim.kernels.rigid.narrow.triangle import normal_region_funcs

MOST = 12                               # contacts that are kept of a face; of more the deepest
BESIDE = wp.constant(1.0e-4)            # of a face or an edge: so far beyond its ends a place still is on it
SPREAD = wp.constant(0.5)               # of the overlap: as far beyond, too. Two hollows that cross touch at inner corners:
#                                         edges that rise by 30 degrees are nearest beyond their ends by half of the overlap
PARALLEL = wp.constant(1.0e-3)          # sine between edges that do not cross
OF_A, OF_B, EDGES = wp.constant(0), wp.constant(1), wp.constant(2)


@cache
def contact_record_type(real):
    """Vector of a contact: place (3), normal (3), gap."""
    return wp.types.vector(7, real)


@wp.func
def feature_key(a: int, b: int, what: int):
    """Key of the features a and b of a contact."""
    mixed = (wp.uint32(a) * wp.uint32(73856093)) ^ (wp.uint32(b) * wp.uint32(19349663) + wp.uint32(40503))
    return int((mixed ^ (mixed >> wp.uint32(15))) % wp.uint32(268435399)) * 4 + what


@cache
def contact_record_func(real):
    """Function (n, x, gap, number, found, key) that adds a contact to those of a face; key[MOST]: how many there are."""
    t, Record = types(real), contact_record_type(real)

    @wp.func
    def record_contact(n: t.vec3, x: t.vec3, gap: real, number: int, found: wp.array(dtype=Record), key: wp.array(dtype=int)):
        at = int(-1)
        count = int(key[MOST])
        if count < MOST:
            key[MOST] = count + 1
            at = count
        else:
            most = real(gap)
            for i in range(count):
                if found[i][6] > most:
                    most = found[i][6]
                    at = i
        if at >= 0:
            found[at] = Record(x[0], x[1], x[2], n[0], n[1], n[2], gap)
            key[at] = number

    return record_contact


@cache
def corner_contact_func(real):
    """Function (surfaces, where, X, Y, R, span, found, key): contact of a corner with a face. where: (point, face, whose); X:
    rows (place of the corner, normal of the face to its side, any); Y: the face; R: to the axes of the corner's mesh."""
    t, Surfaces, Record = types(real), mesh_type(real), contact_record_type(real)
    record, at_corner = contact_record_func(real), normal_region_funcs(real)[1]

    @wp.func
    def place_within_side(x: t.vec3, q: t.vec3, e: t.vec3, n: t.vec3, beyond: real):
        """Whether a place is no farther beyond the side e through q than that, and BESIDE of the triangle. n: cross product."""
        twice = wp.length(n)
        return wp.dot(n, wp.cross(e, x - q)) >= -twice * (real(BESIDE) * twice + beyond * wp.length(e))

    @wp.func
    def place_over_face(x: t.vec3, Y: t.mat33, beyond: real):
        """Whether a place lies over a triangle."""
        n = wp.cross(Y[1] - Y[0], Y[2] - Y[0])
        return (place_within_side(x, Y[0], Y[1] - Y[0], n, beyond) and place_within_side(x, Y[1], Y[2] - Y[1], n, beyond)
                and place_within_side(x, Y[2], Y[0] - Y[2], n, beyond))

    @wp.func
    def add_corner_contact(S: Surfaces, where: wp.vec3i, X: t.mat33, Y: t.mat33, R: t.mat33, span: t.vec3,
                           found: wp.array(dtype=Record), key: wp.array(dtype=int)):
        x = X[0]
        n = X[1]
        gap = wp.dot(n, x - Y[0])
        if gap <= span[1] and gap >= -span[0]:
            if place_over_face(x, Y, real(SPREAD) * wp.max(-gap, real(0.0))) and at_corner(S, where[0], R, -n):
                middle = x - (real(0.5) * gap) * n
                if where[2] == OF_A:
                    record(n, middle, gap, feature_key(where[0], S.patch[where[1]], OF_A), found, key)
                else:
                    record(-n, middle, gap, feature_key(S.patch[where[1]], where[0], OF_B), found, key)

    return add_corner_contact


@cache
def edge_contact_func(real):
    """Function (surfaces, (face of A, edge, face of B, edge), X, Y, R, span, found, key): contact of two edges."""
    t, Surfaces, Record = types(real), mesh_type(real), contact_record_type(real)
    record, in_region = contact_record_func(real), normal_region_funcs(real)[0]

    @wp.func
    def triangle_normal(X: t.mat33):
        return wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))

    @wp.func
    def within_edge(s: real, square: real, beyond: real):
        """Whether the part s of an edge is no farther beyond its ends than that [m]; square: of its length."""
        more = real(BESIDE) + beyond / wp.sqrt(square)
        return s >= -more and s <= real(1.0) + more

    @wp.func
    def add_edge_contact(S: Surfaces, where: wp.vec4i, X: t.mat33, Y: t.mat33, R: t.mat33, span: t.vec3,
                         found: wp.array(dtype=Record), key: wp.array(dtype=int)):
        i = where[1]
        j = where[3]
        p = X[i]
        q = Y[j]
        d = X[(i + 1) % 3] - p
        e = Y[(j + 1) % 3] - q
        n = wp.cross(d, e)
        square = wp.length_sq(n)
        dd = wp.length_sq(d)
        ee = wp.length_sq(e)
        if square > real(PARALLEL) * real(PARALLEL) * dd * ee:
            s = wp.dot(wp.cross(q - p, e), n) / square                     # p + s d and q + u e are nearest
            u = wp.dot(wp.cross(q - p, d), n) / square
            n = n / wp.sqrt(square)
            gap = wp.dot(n, p - q)
            most = real(SPREAD) * wp.abs(gap)                              # beyond the ends, as if it were an overlap
            if within_edge(s, dd, most) and within_edge(u, ee, most) and wp.abs(gap) <= wp.max(span[0], span[1]):
                f = triangle_normal(Y)
                if not in_region(S, R, e, f, S.beside[where[2]][j], n):
                    n = -n
                    gap = -gap
                beyond = real(SPREAD) * wp.max(-gap, real(0.0))
                near = gap <= span[1] and gap >= -span[0] and within_edge(s, dd, beyond) and within_edge(u, ee, beyond)
                if near and in_region(S, R, e, f, S.beside[where[2]][j], n):
                    if in_region(S, identity_like(R), d, triangle_normal(X), S.beside[where[0]][i], -n):
                        middle = real(0.5) * (p + s * d + q + u * e)
                        record(n, middle, gap, feature_key(3 * where[0] + i, 3 * where[2] + j, EDGES), found, key)

    return add_edge_contact


@cache
def face_pair_func(real):
    """Function (surfaces, (face of A, face of B), X, Y, R, span, found, key) that records the contacts of two faces.

    X, Y: corners in A's frame; R: from A's axes to B's; span: (reach, margin, 1 where B is closed) [m]; found, key: see
    `contact_record_func`."""
    t, Surfaces, Record = types(real), mesh_type(real), contact_record_type(real)
    corner, edge = corner_contact_func(real), edge_contact_func(real)

    @wp.func
    def planes_in_reach(X: t.mat33, q: t.vec3, n: t.vec3, span: t.vec3):
        """Whether a triangle comes near the plane through q."""
        h = X * n
        o = wp.dot(q, n)
        return wp.min(h) - o <= span[1] and wp.max(h) - o >= -span[0]

    @standalone_function
    @wp.func
    def record_face_contacts(S: Surfaces, where: wp.vec2i, X: t.mat33, Y: t.mat33, R: t.mat33, span: t.vec3,
                             found: wp.array(dtype=Record), key: wp.array(dtype=int)):
        f = wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
        g = wp.normalize(wp.cross(Y[1] - Y[0], Y[2] - Y[0]))
        if span[2] == real(0.0) and wp.dot(g, Y[0]) > real(0.0):
            g = -g
        if planes_in_reach(X, Y[0], g, span) and planes_in_reach(Y, X[0], f, span):
            own_a = S.corner[where[0]]
            own_b = S.corner[where[1]]
            three = int(3)                                     # variables: unrolled, a GPU compiles for long
            nine = int(9)
            for k in range(three):
                if own_a[k] == 1:
                    corner(S, wp.vec3i(S.face[where[0]][k], where[1], OF_A), wp.matrix_from_rows(X[k], g, g), Y,
                           identity_like(R), span, found, key)
                if own_b[k] == 1:
                    corner(S, wp.vec3i(S.face[where[1]][k], where[0], OF_B), wp.matrix_from_rows(Y[k], f, f), X,
                           R, span, found, key)
            sharp_a = S.sharp[where[0]]
            sharp_b = S.sharp[where[1]]
            for e in range(nine):
                if sharp_a[e // 3] == 1 and sharp_b[e % 3] == 1:
                    edge(S, wp.vec4i(where[0], e // 3, where[1], e % 3), X, Y, R, span, found, key)

    return record_face_contacts
