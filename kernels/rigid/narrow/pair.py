"""Narrow phase: the manifold of any two convex shapes, of whose kinds only those of a scene are compiled.

    plane    any     corners of the lowest face             sphere   closed   signed distance of its centre
    box      box     separating axes, clipped faces         capsule  capsule, box     nearest places of a segment
    else             GJK, and EPA where the cores overlap; clipped faces

A shape is in the frame of its kind; A's frame carries the arithmetic, so that nothing is lost far from the scene's origin.
"""

from functools import cache
from itertools import combinations_with_replacement

import warp as wp

from wsim.kernels.contact.collider.shape import BOX, CAPSULE, CONE, CYLINDER, PLANE, SPHERE, convex_distance_func
from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.lists.manifold import manifold_makers, manifold_type
from wsim.kernels.rigid.narrow.box import box_pair_func
from wsim.kernels.rigid.narrow.capsule import box_capsule_func, capsule_pair_func
from wsim.kernels.rigid.narrow.clip import ALIGNED, clip_types, face_manifold_func
from wsim.kernels.rigid.narrow.face import support_face_func
from wsim.kernels.rigid.narrow.feature import feature_key_func
from wsim.kernels.rigid.narrow.gjk import gjk_nearest_func
from wsim.kernels.rigid.narrow.plane import plane_manifold_func
from wsim.kernels.rigid.narrow.shape import CORNERS, KINDS, hull_type, shape_extent_funcs, shape_type

CLOSED = ("plane", "sphere", "box", "capsule", "cylinder", "cone")


def pairs_of_kinds(kinds) -> frozenset[tuple[str, str]]:
    """Pairs of these kinds, each with its kinds in the order of their numbers; no two planes."""
    order = sorted(set(kinds), key=KINDS.__getitem__)
    return frozenset(p for p in combinations_with_replacement(order, 2) if p != ("plane", "plane"))


def pairs_without_closed_form(pairs) -> frozenset[tuple[str, str]]:
    """Those of the pairs that have no closed form."""
    done = {("box", "box"), ("box", "capsule"), ("capsule", "capsule")}
    return frozenset((a, b) for a, b in pairs if a != "plane" and (a, b) not in done and not (a == "sphere" and b in CLOSED))


def most_face_corners(kinds) -> int:
    """Corners of the faces of these kinds, at most."""
    return CORNERS if "hull" in kinds else 8 if {"cylinder", "cone"} & set(kinds) else 4


@cache
def shape_nearest_func(pairs: frozenset[tuple[str, str]], real):
    """Function (a, b, hulls, R, p, margin) -> Nearest of two shapes, a of the lower kind and no plane."""
    t, Shape, Hulls, Nearest = types(real), shape_type(real), hull_type(real), clip_types(real).Nearest
    boxes, both, lines = (pair in pairs for pair in (("box", "box"), ("capsule", "capsule"), ("box", "capsule")))
    balls = frozenset(b for a, b in pairs if a == "sphere" and b in CLOSED)
    ball, further = bool(balls), pairs_without_closed_form(pairs)
    sought = frozenset(kind for pair in further for kind in pair)
    search = bool(further)
    phi_of = convex_distance_func(tuple(sorted(balls)))
    of_boxes, of_capsules, of_both, of_any = (box_pair_func(real), capsule_pair_func(real), box_capsule_func(real),
                                              gjk_nearest_func(sought, real))
    round_kinds = max((KINDS[b] for b in balls), default=0)

    @wp.func
    def from_ball(a: Shape, b: Shape, R: t.mat33, p: t.vec3):
        phi, n = phi_of(b.kind, b.size, -(wp.transpose(R) * p))
        near = Nearest()
        near.n = R * n
        near.gap = phi - a.size[0]
        near.x = (real(-0.5) * (a.size[0] + phi)) * near.n
        return near

    @wp.func
    def nearest_of_shapes(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: t.vec3, margin: real):
        near = Nearest()
        known = bool(False)
        if ball:
            if a.kind == SPHERE and b.kind <= round_kinds:
                near = from_ball(a, b, R, p)
                known = True
        if boxes:
            if a.kind == BOX and b.kind == BOX:
                near = of_boxes(a.size, b.size, R, p)
                known = True
        if lines:
            if a.kind == BOX and b.kind == CAPSULE:
                near = of_both(a.size, b.size, R, p)
                known = True
        if both:
            if a.kind == CAPSULE and b.kind == CAPSULE:
                near = of_capsules(a.size, b.size, R, p)
                known = True
        if search:
            if not known:
                near = of_any(a, b, H, R, p, margin)
        return near

    return nearest_of_shapes


@cache
def manifold_completion_func(kinds: frozenset[str], real, outer: bool = False):
    """Function (a, b, hulls, R, p, near, margin) -> Manifold of two shapes whose nearest places are known; see `reduction`."""
    t, Shape, Hulls, Manifold, of = types(real), shape_type(real), hull_type(real), manifold_type(real), clip_types(real)
    corners = most_face_corners(kinds)
    radius, size = shape_extent_funcs(real)
    place, touch, room = support_face_func(kinds, real), face_manifold_func(real, corners, outer), 4 * corners
    vec3, Nearest = t.vec3, of.Nearest
    hull, key_of, rolls = "hull" in kinds, feature_key_func(real), bool({"cylinder", "cone"} & kinds)

    @wp.func
    def has_rim_or_line(kind: int):
        """Whether it has a line or a rim that lies where the normal says: on a face, along the normal of that."""
        return kind == CYLINDER or kind == CONE

    @standalone_function
    @wp.func
    def complete_manifold(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: t.vec3, near: Nearest, margin: real):
        m = Manifold()
        if near.gap <= margin:
            PA = scratch(shape=(wp.static(room),), dtype=vec3)
            PB = scratch(shape=(wp.static(room),), dtype=vec3)
            sa = of.Side()
            sb = of.Side()
            sa.r = radius(a)
            sb.r = radius(b)
            count_a, number_a, f_a = place(a, H, -near.n, PA)
            d_b = near.n
            if rolls:
                if has_rim_or_line(b.kind) and wp.dot(f_a, near.n) < -real(ALIGNED):
                    d_b = -f_a
            count_b, number_b, f_b = place(b, H, wp.transpose(R) * d_b, PB)
            if rolls:
                if has_rim_or_line(a.kind) and wp.dot(R * f_b, near.n) > real(ALIGNED):
                    count_a, number_a, f_a = place(a, H, -(R * f_b), PA)
            sa.count = count_a
            sa.number = number_a
            sa.f = f_a
            sb.count = count_b
            sb.number = number_b
            sb.f = R * f_b
            for i in range(count_b):
                PB[i] = R * PB[i] + p
            m = touch(PA, sa, PB, sb, near, margin, wp.min(size(a, H), size(b, H)))
            if hull:
                if m.count == 1 and m.key[0] == 0:
                    m.key[0] = key_of(a, b, H, R, near.n)
        return m

    return complete_manifold


@cache
def ordered_manifold_func(pairs: frozenset[tuple[str, str]], real):
    """Function (a, b, hulls, R, p, margin) -> Manifold in A's frame, a of the lower kind, b in the pose (R, p) there."""
    t, Shape, Hulls, Manifold = types(real), shape_type(real), hull_type(real), manifold_type(real)
    kinds = frozenset(kind for pair in pairs for kind in pair)
    planes, others = any(a == "plane" for a, _ in pairs), any(a != "plane" for a, _ in pairs)
    on_plane, near_of, completed = (plane_manifold_func(kinds, real, most_face_corners(kinds)), shape_nearest_func(pairs, real),
                                    manifold_completion_func(kinds, real))

    @wp.func
    def ordered_pair_manifold(a: Shape, b: Shape, H: Hulls, R: t.mat33, p: t.vec3, margin: real):
        m = Manifold()
        if planes:
            if a.kind == PLANE:
                m = on_plane(b, H, R, p, margin)
        if others:
            if a.kind != PLANE:
                m = completed(a, b, H, R, p, near_of(a, b, H, R, p, margin), margin)
        return m

    return ordered_pair_manifold


@cache
def narrow_phase_func(pairs: frozenset[tuple[str, str]], real):
    """Function (a, b, hulls, pose_a, pose_b, margin) -> Manifold of the shapes of these pairs (`pairs_of_kinds`): n in the
    world's axes, places from where pose_a is, in the world's axes too [m]. Poses are from one origin, quaternions (x, y, z, w),
    unit."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    made = ordered_manifold_func(pairs, real)
    _single, flipped, turned = manifold_makers(real)

    @standalone_function
    @wp.func
    def narrow_phase_manifold(a: Shape, b: Shape, H: Hulls, pose_a: t.transform, pose_b: t.transform, margin: real):
        first = a
        second = b
        A = rotation_to_matrix(wp.transform_get_rotation(pose_a))
        B = rotation_to_matrix(wp.transform_get_rotation(pose_b))
        d = wp.transform_get_translation(pose_b) - wp.transform_get_translation(pose_a)
        if a.kind > b.kind:                                    # one call: inlined twice, a GPU compiles for long
            first = b
            second = a
            C = A
            A = B
            B = C
            d = -d
        m = turned(made(first, second, H, wp.transpose(A) * B, wp.transpose(A) * d, margin), A)
        if a.kind > b.kind:
            m = flipped(m, d)
        return m

    return narrow_phase_manifold
