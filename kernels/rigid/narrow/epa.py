"""Depth of two overlapping convex cores by the expanding polytope (van den Bergen 2001), in A's frame.

D = {a - b} holds 0. Of a polytope of places of D the face that is nearest to 0, with the outward normal f at the distance d, is
pushed out to the place w of D farthest along f, until f.w is d: every f.w bounds the depth from above, the least of them is the
answer, every least d from below. Distances have signs, so that the start need not hold 0: a tetrahedron of places that lie far
from one another, whatever GJK ended with. Faces that see w are taken away and what is left of their edges is joined to w.

n = -f, gap = -f.w. A face too thin for a normal is never pushed. There is room for VERTICES places: polyhedra come to rounding,
as do round shapes with one nearest place. Where a whole ring is as near (a place on the axis of a cone) it ends early, near the
answer, and says so: kernels/rigid/narrow/gjk.py goes on from there.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.eigen import machine_epsilon
from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.capsule import nearest_point_funcs
from wsim.kernels.rigid.narrow.shape import hull_type, shape_extent_funcs, shape_type, support_map_func

VERTICES = wp.constant(64)
FACES = wp.constant(160)
EDGES = wp.constant(96)
RAN_OUT = wp.constant(1)                 # key of an answer for which the room did not do
NEVER = wp.constant(1.0e30)              # distance of a face that has no normal


@cache
def polytope_functions(real) -> SimpleNamespace:
    """Functions on a polytope: vertices V, faces F of three in the order of their outward normals N, distances D."""
    t = types(real)
    vec3, vec3s, reals, threes, twos = (t.vec3, wp.array(dtype=t.vec3), wp.array(dtype=real), wp.array(dtype=wp.vec3i),
                                        wp.array(dtype=wp.vec2i))

    @wp.func(inline=False)
    def set_polytope_face(V: vec3s, F: threes, N: vec3s, D: reals, slot: int, f: wp.vec3i, tiny: real):
        a = V[f[0]]
        b = V[f[1]]
        c = V[f[2]]
        n = wp.cross(b - a, c - a)
        long = wp.length(n)
        F[slot] = f
        N[slot] = vec3()
        D[slot] = real(NEVER)
        if long > tiny * wp.max(wp.length(b - a), wp.length(c - a)):
            N[slot] = n / long
            D[slot] = wp.dot(n, a + b + c) / (real(3.0) * long)

    @wp.func
    def update_horizon_edges(E: twos, count: int, i: int, j: int):
        """The edge i j of a face that goes; two faces that go leave none between them."""
        found = int(-1)
        for e in range(count):
            pair = E[e]
            if pair[0] == j and pair[1] == i:
                found = e
        left = count
        if found >= 0:
            left = count - 1
            E[found] = E[left]
        elif count < EDGES:
            E[count] = wp.vec2i(i, j)
            left = count + 1
        return left

    @wp.func(inline=False)
    def remove_visible_faces(F: threes, N: vec3s, D: reals, E: twos, faces: int, w: vec3, pushed: int, tiny: real):
        """(faces, edges) left."""
        left = int(faces)
        edges = int(0)
        for k in range(faces):
            f = faces - 1 - k
            if wp.dot(N[f], w) > D[f] + tiny or f == pushed:
                corners = F[f]
                edges = update_horizon_edges(E, edges, corners[0], corners[1])
                edges = update_horizon_edges(E, edges, corners[1], corners[2])
                edges = update_horizon_edges(E, edges, corners[2], corners[0])
                left -= 1
                F[f] = F[left]
                N[f] = N[left]
                D[f] = D[left]
        return left, edges

    @wp.func
    def nearest_polytope_face(D: reals, faces: int):
        best = int(0)
        for f in range(1, faces):
            if D[f] < D[best]:
                best = f
        return best

    @wp.func(inline=False)
    def face_barycentrics(V: vec3s, f: wp.vec3i, n: vec3, d: real):
        """Of the corners of a face at the place n d of its plane, clamped to the face."""
        q = d * n
        a = wp.max(wp.dot(n, wp.cross(V[f[1]] - q, V[f[2]] - q)), real(0.0))
        b = wp.max(wp.dot(n, wp.cross(V[f[2]] - q, V[f[0]] - q)), real(0.0))
        c = wp.max(wp.dot(n, wp.cross(V[f[0]] - q, V[f[1]] - q)), real(0.0))
        return vec3(a, b, c) / (a + b + c)

    return SimpleNamespace(put=set_polytope_face, remove=remove_visible_faces, nearest=nearest_polytope_face,
                           weights=face_barycentrics)


@cache
def polytope_start_funcs(kinds: frozenset[str], real):
    """(far, tetrahedron): functions. far: place of D farthest along d, and where it is on A. """
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    vec3, vec3s = t.vec3, wp.array(dtype=t.vec3)
    farthest = support_map_func(kinds, real)
    aside, _nearest = nearest_point_funcs(real)

    @wp.func
    def minkowski_support(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, d: vec3):
        pa = farthest(a, H, d)
        return pa - (R * farthest(b, H, -(wp.transpose(R) * d)) + p), pa

    @wp.func(inline=False)
    def first_tetrahedron(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, start: vec3, V: vec3s, A: vec3s):
        """V, A: four places, the fifth the way out of D if it is flat. Returns (f, height): outward there, of the four."""
        d = start
        o = vec3()
        po = vec3()
        height = real(0.0)
        steps = int(6)                                         # along d and -d, a line's side, a plane's
        for k in range(steps):
            side = real(1 - 2 * (k % 2))
            if k == 2:
                d = aside(V[1] - V[0])
            if k == 4:
                d = wp.normalize(wp.cross(V[1] - V[0], V[2] - V[0]))
            w, pa = minkowski_support(a, b, H, R, p, side * d)
            if k < 2:
                V[k] = w
                A[k] = pa
            elif k % 2 == 0:
                o = w
                po = pa
            else:
                V[4] = o
                A[4] = po
                if -wp.dot(w, d) < wp.dot(o, d):
                    V[4] = w
                    A[4] = pa
                    side = real(1.0)
                if wp.abs(wp.dot(w - V[0], d)) < wp.abs(wp.dot(o - V[0], d)):
                    w = o
                    pa = po
                V[k // 2 + 1] = w
                A[k // 2 + 1] = pa
                height = wp.dot(w - V[0], d)
                o = -side * d
        if height > real(0.0):                                 # 0 1 2 is to face away from 3
            w = V[3]
            pa = A[3]
            V[3] = V[2]
            A[3] = A[2]
            V[2] = w
            A[2] = pa
        return o, wp.abs(height)

    return minkowski_support, first_tetrahedron


@cache
def epa_penetration_func(kinds: frozenset[str], real):
    """Function (a, b, hulls, R, p, d) -> Nearest of two shapes whose cores overlap or touch; d: a first direction, not 0."""
    t, Shape, Hulls, of = types(real), shape_type(real), hull_type(real), polytope_functions(real)
    vec3 = t.vec3
    radius, size = shape_extent_funcs(real)
    aside, nearest_of = nearest_point_funcs(real)
    far, tetrahedron = polytope_start_funcs(kinds, real)
    put, remove, nearest, weights = of.put, of.remove, of.nearest, of.weights

    @wp.func(inline=False)
    def expand_polytope(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, V: wp.array(dtype=vec3), A: wp.array(dtype=vec3),
                        radii: t.vec2):
        F = scratch(shape=(FACES,), dtype=wp.vec3i)
        N = scratch(shape=(FACES,), dtype=vec3)
        D = scratch(shape=(FACES,), dtype=real)
        E = scratch(shape=(EDGES,), dtype=wp.vec2i)
        tiny = real(2.0) * machine_epsilon(radii[0]) * (size(a, H) + size(b, H))
        faces = int(4)
        for k in range(faces):
            corners = wp.vec3i(0, 1, 2)
            if k > 0:
                corners = wp.vec3i(k - 1, 3, k % 3)
            put(V, F, N, D, k, corners, tiny)
        vertices = int(4)
        depth = real(NEVER)
        n = vec3()
        pa = vec3()
        left = int(RAN_OUT)
        while vertices < VERTICES:
            f = nearest(D, faces)
            w, pw = far(a, b, H, R, p, N[f])
            h = wp.dot(w, N[f])
            if h < depth:
                depth = h
                n = N[f]
                corners = F[f]
                lam = weights(V, corners, n, D[f])
                pa = lam[0] * A[corners[0]] + lam[1] * A[corners[1]] + lam[2] * A[corners[2]]
            if h - D[f] <= tiny:
                left = 0
                break
            faces, edges = remove(F, N, D, E, faces, w, f, tiny)
            if faces + edges > FACES:
                break
            V[vertices] = w
            A[vertices] = pw
            for e in range(edges):
                pair = E[e]
                put(V, F, N, D, faces + e, wp.vec3i(pair[0], pair[1], vertices), tiny)
            faces += edges
            vertices += 1
        return nearest_of(pa, pa - depth * n, -n, -depth, radii, left)

    @standalone_function
    @wp.func
    def epa_nearest_places(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: vec3, d: vec3):
        V = scratch(shape=(VERTICES,), dtype=vec3)
        A = scratch(shape=(VERTICES,), dtype=vec3)
        radii = t.vec2(radius(a), radius(b))
        start = d
        if wp.length_sq(d) <= real(0.0):
            start = aside(vec3(real(1.0), real(1.0), real(1.0)))
        f, height = tetrahedron(a, b, H, R, p, start, V, A)
        near = nearest_of(A[4], A[4] - wp.dot(V[4], f) * f, -f, -wp.dot(V[4], f), radii, 0)
        if height > real(1.0e-5) * (size(a, H) + size(b, H)):
            near = expand_polytope(a, b, H, R, p, V, A, radii)
        return near

    return epa_nearest_places
