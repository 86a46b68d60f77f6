"""Distance of two convex cores (Gilbert, Johnson, Keerthi 1988) in A's frame; where they overlap, EPA (epa.py beside this).

The difference D = {a - b} is nearest to 0 at v. A simplex of at most four places of D is kept, v is its nearest; the place w
of D farthest along -v bounds the distance from below by v.w / |v|. Of a simplex the nearest part is found by trying all: the
inside of a triangle where all three areas are above 0, else the best edge; of a tetrahedron the best triangle, unless 0
is inside. So a flat or needle-shaped simplex has a nearest place too, and the distance falls with each step or the end is
reached.

Every tolerance is a number of roundings of the two sizes. Near one another the direction of v is rounding; a triangle's plane
is not, and where the bound does not prove the distance EPA has the word whether the two overlap.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.eigen import machine_epsilon
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.capsule import nearest_point_funcs
from wsim.kernels.rigid.narrow.clip import clip_types
from wsim.kernels.rigid.narrow.epa import NEVER, RAN_OUT, epa_penetration_func
from wsim.kernels.rigid.narrow.shape import hull_type, shape_extent_funcs, shape_type, support_map_func

MOST = wp.constant(64)                   # steps; polyhedra take 3 to 10, two rims up to 30
NEARLY = wp.constant(1.0e-2)             # of the sizes: further apart, a distance needs no proof by EPA
CLOSE = wp.constant(8.0)                 # roundings: the distance is known, or 0


@cache
def simplex_functions(real) -> SimpleNamespace:
    """Functions of the nearest place to 0 of simplices: weights of four places, 0 of those that do not count."""
    t = types(real)
    vec4, rows = t.vec4, wp.types.matrix((4, 3), real)

    @wp.func
    def simplex_place(W: rows, lam: vec4):
        return lam[0] * W[0] + lam[1] * W[1] + lam[2] * W[2] + lam[3] * W[3]

    @wp.func
    def nearest_on_simplex_edge(W: rows, i: int, j: int):
        e = W[j] - W[i]
        ee = wp.dot(e, e)
        s = real(0.0)
        if ee > real(0.0):
            s = wp.clamp(-wp.dot(W[i], e) / ee, real(0.0), real(1.0))
        lam = vec4()
        lam[i] = real(1.0) - s
        lam[j] = s
        return lam

    @wp.func
    def nearest_on_simplex_face(W: rows, i: int, j: int, k: int):
        a = W[i]
        b = W[j]
        c = W[k]
        n = wp.cross(b - a, c - a)
        nn = wp.dot(n, n)
        u = wp.dot(n, wp.cross(b, c))
        v = wp.dot(n, wp.cross(c, a))
        w = wp.dot(n, wp.cross(a, b))
        lam = nearest_on_simplex_edge(W, i, j)
        if u > real(0.0) and v > real(0.0) and w > real(0.0) and nn > real(0.0):
            lam = vec4()
            lam[i] = u / (u + v + w)
            lam[j] = v / (u + v + w)
            lam[k] = w / (u + v + w)
        else:
            second = nearest_on_simplex_edge(W, j, k)
            third = nearest_on_simplex_edge(W, k, i)
            if wp.length_sq(simplex_place(W, second)) < wp.length_sq(simplex_place(W, lam)):
                lam = second
            if wp.length_sq(simplex_place(W, third)) < wp.length_sq(simplex_place(W, lam)):
                lam = third
        return lam

    @wp.func
    def nearest_in_tetrahedron(W: rows):
        """(weights, whether 0 is inside)."""
        inside = bool(True)
        best = vec4()
        least = real(1.0e30)
        corners = int(4)                                       # a variable: unrolled, a GPU compiles for long
        for o in range(corners):                               # the corner across
            i = wp.where(o == 0, 1, 0)
            j = wp.where(o < 2, 2, 1)
            k = wp.where(o < 3, 3, 2)
            n = wp.cross(W[j] - W[i], W[k] - W[i])
            across = wp.dot(n, W[o] - W[i])
            if wp.dot(n, W[i]) * across >= real(0.0):          # 0 and the corner lie on two sides, or there is no volume
                inside = False
            lam = nearest_on_simplex_face(W, i, j, k)
            far = wp.length_sq(simplex_place(W, lam))
            if far < least:
                least = far
                best = lam
        return best, inside

    return SimpleNamespace(place=simplex_place, edge=nearest_on_simplex_edge, triangle=nearest_on_simplex_face,
                           tetrahedron=nearest_in_tetrahedron)


@cache
def simplex_reduction_func(real):
    """Function (W, A, count) -> (W, A, count, weights): the part of the simplex nearest to 0; 4 places if it holds 0."""
    t, s = types(real), simplex_functions(real)
    vec4, rows = t.vec4, wp.types.matrix((4, 3), real)
    edge, triangle, tetrahedron = s.edge, s.triangle, s.tetrahedron

    @wp.func
    def reduce_simplex(W: rows, A: rows, count: int):
        lam = vec4()
        lam[0] = real(1.0)
        inside = bool(False)
        if count == 2:
            lam = edge(W, 0, 1)
        elif count == 3:
            lam = triangle(W, 0, 1, 2)
        elif count == 4:
            lam, inside = tetrahedron(W)
        kept = int(count)
        weights = vec4()
        if not inside:
            kept = 0
            for i in range(4):
                if lam[i] > real(0.0):
                    w = W[i]
                    a = A[i]
                    W[kept] = w
                    A[kept] = a
                    weights[kept] = lam[i]
                    kept += 1
        return W, A, kept, weights

    return reduce_simplex


@cache
def separation_axis_func(real):
    """Function (W, count, v) -> unit vector along v. By itself it rounds by the size over |v|: of a triangle wider than |v| it
    comes from the plane, of an edge it is made to be across."""
    vec3, rows = types(real).vec3, wp.types.matrix((4, 3), real)

    @wp.func
    def separation_axis(W: rows, count: int, v: vec3):
        n = v
        if count > 1:
            e = W[1] - W[0]
            if count == 3:
                m = wp.cross(e, W[2] - W[0])
                long = wp.max(wp.length_sq(e), wp.max(wp.length_sq(W[2] - W[0]), wp.length_sq(W[2] - W[1])))
                if wp.dot(m, m) > wp.dot(v, v) * long:
                    n = m
                    if wp.dot(m, v) < real(0.0):
                        n = -m
            elif count == 2:
                n = v - (wp.dot(v, e) / wp.dot(e, e)) * e
        length = wp.length(n)
        if length <= real(0.0):
            n = v
            length = wp.length(v)
        return n / length

    return separation_axis


@cache
def gjk_search_func(kinds: frozenset[str], real):
    """Function (a, b, hulls, R, p, most) -> (W, A, weights, count, v, distance, how): the search itself. How it ended: 0 at
    the nearest places, 1 where the cores overlap or touch, 2 with the bound `distance` above `most` [m], 3 near, no proof."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    vec3, rows, farthest, place, reduced = (t.vec3, wp.types.matrix((4, 3), real), support_map_func(kinds, real),
                                            simplex_functions(real).place,
         simplex_reduction_func(real))
    _radius, size = shape_extent_funcs(real)
    toward = separation_axis_func(real)

    @wp.func
    def is_simplex_vertex(W: rows, count: int, w: vec3):
        found = bool(False)
        for i in range(count):
            if wp.length_sq(W[i] - w) == real(0.0):
                found = True
        return found

    @wp.func(inline=False)
    def search_gjk_distance(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, most: real):
        W = rows()
        A = rows()
        weights = t.vec4()
        count = int(0)
        tiny = real(CLOSE) * machine_epsilon(most) * (size(a, H) + size(b, H))
        v = -p
        if wp.length(v) <= tiny:
            v = vec3(real(1.0), real(0.0), real(0.0))
        far = real(1.0e30)
        least = -far
        how = int(0)
        steps = int(MOST)
        for _k in range(steps):
            n = toward(W, count, v)
            pa = farthest(a, H, -n)
            w = pa - (R * farthest(b, H, wp.transpose(R) * n) + p)
            bound = wp.dot(n, w)
            least = wp.max(least, bound)
            if bound > most:
                how = 2
                far = bound
            if bound > most or far - bound <= real(0.25) * tiny or is_simplex_vertex(W, count, w):
                break
            U = W
            B = A
            U[count] = w
            B[count] = pa
            U, B, left, lam = reduced(U, B, count + 1)
            u = place(U, lam)
            if left == 4 or wp.length(u) <= tiny:
                how = 1
            if how == 1 or wp.length(u) >= far:
                break
            W = U
            A = B
            count = left
            weights = lam
            v = u
            far = wp.length(v)
        if how == 0 and far - least > tiny and far < real(NEARLY) * (size(a, H) + size(b, H)):
            how = 3
        return W, A, weights, count, v, far, how

    return search_gjk_distance


@cache
def gjk_nearest_func(kinds: frozenset[str], real):
    """Function (a, b, hulls, R, p, margin) -> Nearest of two shapes, B in the pose (R, p) in A's frame. Beyond the margin n and
    the gap are a bound: they are apart by that much along n."""
    t, Shape, Hulls, Nearest = types(real), shape_type(real), hull_type(real), clip_types(real).Nearest
    vec3, place, search = t.vec3, simplex_functions(real).place, gjk_search_func(kinds, real)
    radius, _size = shape_extent_funcs(real)
    _aside, nearest = nearest_point_funcs(real)
    farthest, inner, toward = support_map_func(kinds, real), epa_penetration_func(kinds, real), separation_axis_func(real)

    @wp.func
    def epa_where_overlapping(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, v: vec3, how: int):
        """Nearest by EPA where GJK asks for it; the key says whether it ran out of room."""
        near = Nearest()
        near.gap = real(1.0)
        if how == 1 or how == 3:
            near = inner(a, b, H, R, p, v)
        return near

    @wp.func
    def core_depth_along(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, n: vec3):
        """Depth of the cores along n."""
        return wp.dot(n, R * farthest(b, H, wp.transpose(R) * n) + p) - wp.dot(n, farthest(a, H, -n))

    @wp.func(inline=False)
    def gjk_nearest_places(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, margin: real):
        """Where EPA ran out of room, B pushed out along n by twice the depth has nearest places with a better n: as long as the
        depth along it falls."""
        radii = t.vec2(radius(a), radius(b))
        near = Nearest()
        most = margin + radii[0] + radii[1]
        shift = vec3()
        depth = real(0.0)
        steps = int(MOST)
        for k in range(steps):
            W, A, weights, count, v, far, how = search(a, b, H, R, p - shift, most)
            n = toward(W, count, v)
            pa = place(A, weights)
            more = int(0)
            if k == 0:
                near = epa_where_overlapping(a, b, H, R, p, v, how)
                more = near.key
                near.key = 0
                if how == 2:
                    near.n = v / wp.length(v)
                    near.gap = far - radii[0] - radii[1]
                elif how == 0 or (how == 3 and near.gap + radii[0] + radii[1] > real(0.0)):
                    near = nearest(pa, pa - far * n, n, far, radii, 0)
                    more = 0
            elif how == 0 or how == 3:
                less = core_depth_along(a, b, H, R, p, n)
                if less < depth * (real(1.0) - machine_epsilon(depth)):
                    near = nearest(pa, pa + less * n, n, -less, radii, 0)
                    more = RAN_OUT
            if more != RAN_OUT:
                break
            depth = -(near.gap + radii[0] + radii[1])
            shift = real(2.0) * depth * near.n
            most = real(NEVER)
        return near

    return gjk_nearest_places
