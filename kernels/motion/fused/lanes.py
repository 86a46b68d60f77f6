"""What the threads of a point exchange within frames of one launch, and how they share the faces of the point's list of
candidates (kernels/contact/candidates.py): what is found is what one thread finds.

    nearest   a face each, then the least of (distance, face) of the threads of a point, which bounds the next faces
    side      whether the point is before a face, each; where not all say so, or none, weighted normals of a face each, summed
              in the order of the list
    hit       as nearest, of (length of the ray, face)

All threads of a warp call these, with `on` not 0 where there is something to do: they exchange what they found.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import candidates
from wsim.kernels.math.face import (
    FAR,
    angle_weighted_normal,
    edge_length,
    equal_distance,
    face_distance,
    nearer_face,
    query_box,
    side_of_face,
    sooner_face_hit,
)
from wsim.kernels.math.real import types


@cache
def warp_lane_functions(lanes: int, real):
    """(group, lowest, least, anywhere, of_lane): the mask of threads of a point that say 1; the first in a mask, or -1, and its
    first n; whether any thread of the warp says not 0; the vector of a thread of the point. All threads of a warp call them."""
    vec3 = types(real).vec3

    @wp.func_native(warp_code(f"return (int)(__ballot_sync(0xffffffffu, said) >> ({lanes} * (threadIdx.x % 32 / {lanes}))"
                              f" & {(1 << lanes) - 1}u);", "return said;"))
    def lane_mask(said: int) -> int: ...

    @wp.func_native(warp_code("return __ffs(mask) - 1;", "return mask - 1;"))
    def lowest_lane(mask: int) -> int: ...

    @wp.func_native("""int kept = 0;
    for (int k = 0; k < n && mask; ++k, mask &= mask - 1) kept |= mask & -mask;
    return kept;""")
    def first_lanes(mask: int, n: int) -> int: ...

    @wp.func_native(warp_code("return __any_sync(0xffffffffu, said);", "return said;"))
    def any_lane(said: int) -> int: ...

    @wp.func_native(warp_code(f"""wp::vec_t<3, wp::{real.__name__}> r;
    for (int k = 0; k < 3; ++k) r[k] = __shfl_sync(0xffffffffu, a[k], lane, {lanes});
    return r;""", "return a;"))
    def of_lane(a: vec3, lane: int) -> vec3: ...

    return lane_mask, lowest_lane, first_lanes, any_lane, of_lane


def warp_code(text: str, alone: str) -> str:
    """Code of a function of a warp; on a CPU, of the one thread that a point has there."""
    return f"#if defined(__CUDA_ARCH__)\n    {text}\n#else\n    {alone}\n#endif\n"


@wp.func_native("""
    union { float a; unsigned b; } c;
    c.a = far + 0.0f;
    return (wp::uint64)c.b << 32 | (unsigned)face;""")
def distance_key(far: float, face: int) -> wp.uint64:
    """A number that is less where far >= 0 is, and where that is equal the face is; -1 is behind all faces."""
    ...


@wp.func_native("""
    union { float a; unsigned b; } c;
    c.b = (unsigned)(key >> 32);
    return c.a;""")
def far_of(key: wp.uint64) -> float: ...


@wp.func_native("return (int)(unsigned)key;")
def face_of(key: wp.uint64) -> int: ...


@wp.func_native(warp_code("__syncwarp();", ""))
def synchronise_warp(): ...


@cache
def least_number_function(lanes: int):
    """Function: the least number of the threads of a point."""
    @wp.func_native(warp_code(f"""for (int o = {lanes} / 2; o > 0; o >>= 1) {{
        const wp::uint64 other = __shfl_xor_sync(0xffffffffu, key, o, {lanes});
        key = other < key ? other : key;
    }}
    return key;""", "return key;"))
    def least_lane_number(key: wp.uint64) -> wp.uint64: ...

    return least_lane_number


@wp.func
def listed_face_count(L: Any, s: int, i: int, on: int):
    """Faces of a list, 0 where there is none to read."""
    count = int(0)
    if on != 0:
        count = L.count[s * L.w.shape[0] + i]
        if count > L.room:
            count = 0
    return count


@wp.func
def face_at(L: Any, s: int, i: int, j: int):
    return (s * L.room + j) * L.w.shape[0] + i


@wp.func
def face_list_overflows(L: Any, s: int, i: int, on: int):
    """Whether the tree is to be asked."""
    asked = bool(False)
    if on != 0:
        asked = L.count[s * L.w.shape[0] + i] > L.room
    return asked


@wp.func
def listed_face_within(L: Any, s: int, i: int, j: int, count: int, last: float):
    """1 where face j of a list may be within `last`."""
    more = int(0)
    if j < count:
        if not L.far[face_at(L, s, i, j)] > last:
            more = 1
    return more


@cache
def face_list_functions(lanes: int):
    """(nearest, side, hit), of kernels/contact/candidates.py, by `lanes` threads; lane: number of the thread; on: see above."""
    group, _, _, anywhere, of_lane = warp_lane_functions(lanes, wp.float32)
    first_of = least_number_function(lanes)

    @wp.func
    def nearest_face_in_list(mesh: wp.uint64, L: Any, s: int, i: int, q: wp.vec3f, near: float, lane: int, on: int):
        dist = float(FAR)
        first = int(-1)
        face = int(0)
        gone = float(0.0)
        if face_list_overflows(L, s, i, on):
            low, high = query_box(q, near)
            query = wp.mesh_query_aabb(mesh, low, high)
            while wp.mesh_query_aabb_next(query, face):
                dist, first = nearer_face(mesh, face, q, dist, first)
        count = listed_face_count(L, s, i, on)
        if count > 0:
            gone = candidates.list_reach_bound(L, s * L.w.shape[0] + i, q, 0.0)
        j = int(lane)
        more = listed_face_within(L, s, i, j, count, near + gone)
        while anywhere(more) != 0:
            if more != 0:
                dist, first = nearer_face(mesh, L.face[face_at(L, s, i, j)], q, dist, first)
            key = first_of(distance_key(dist, first))
            dist = far_of(key)
            first = face_of(key)
            j += lanes
            more = listed_face_within(L, s, i, j, count, wp.min(dist, near) + gone)
        if not dist < near:
            first = -1
        return first, dist

    @wp.func
    def listed_face_sides(mesh: wp.uint64, L: Any, at: wp.vec3i, q: wp.vec3f, p: wp.vec3f, ends: wp.vec2f, count: int):
        """1 where q is before some faces of a list, 2 where it is not, 3 where both are; ends: how far from q, in the list."""
        up = int(0)
        down = int(0)
        j = int(at[2])
        more = listed_face_within(L, at[0], at[1], j, count, ends[1])
        while anywhere(more) != 0:
            if more != 0:
                front = side_of_face(mesh, L.face[face_at(L, at[0], at[1], j)], q, p, ends[0])
                up = wp.where(front > 0, 1, up)
                down = wp.where(front < 0, 1, down)
            j += lanes
            more = listed_face_within(L, at[0], at[1], j, count, ends[1])
        return wp.where(group(up) != 0, 1, 0) + wp.where(group(down) != 0, 2, 0)

    @wp.func
    def side_of_mesh(mesh: wp.uint64, L: Any, at: wp.vec3i, q: wp.vec3f, nearest: int, dist: float, on: int):
        """at: slot, point and thread."""
        s = at[0]
        i = at[1]
        n = wp.vec3f()
        p = wp.vec3f()
        eps = float(0.0)
        last = float(0.0)
        face = int(0)
        if on != 0:
            eps = equal_distance(mesh, q) * edge_length(mesh)
            last = candidates.list_reach_bound(L, s * L.w.shape[0] + i, q, dist + eps)
            _dist, p = face_distance(mesh, nearest, q)
        count = listed_face_count(L, s, i, on)
        said = listed_face_sides(mesh, L, at, q, p, wp.vec2f(dist + eps, last), count)
        if face_list_overflows(L, s, i, on):
            said = 3
            low, high = query_box(q, dist + eps)
            query = wp.mesh_query_aabb(mesh, low, high)
            while wp.mesh_query_aabb_next(query, face):
                n += angle_weighted_normal(mesh, face, q, dist + eps, eps)
        j = int(at[2])
        count = wp.where(said == 3, count, 0)
        more = listed_face_within(L, s, i, j, count, last)
        while anywhere(more) != 0:
            part_of = wp.vec3f()
            if more != 0:
                part_of = angle_weighted_normal(mesh, L.face[face_at(L, s, i, j)], q, dist + eps, eps)
            for lane in range(lanes):
                n += of_lane(part_of, lane)
            j += lanes
            more = listed_face_within(L, s, i, j, count, last)
        before = said == 1
        if said == 3:
            before = wp.dot(n, q - p) > float(0.0)
        return wp.where(before, float(1.0), float(-1.0))

    @wp.func
    def first_listed_hit(mesh: wp.uint64, L: Any, at: wp.vec3i, start: wp.vec3f, way: wp.vec3f, length: float, on: int):
        """at: slot, point and thread."""
        s = at[0]
        i = at[1]
        t = length
        first = int(-1)
        face = int(0)
        last = float(0.0)
        if face_list_overflows(L, s, i, on):
            low, high = query_box(start + float(0.5) * length * way, float(0.5) * length)
            query = wp.mesh_query_aabb(mesh, low, high)
            while wp.mesh_query_aabb_next(query, face):
                t, first = sooner_face_hit(mesh, face, start, way, t, first)
        count = listed_face_count(L, s, i, on)
        if count > 0:
            last = candidates.list_reach_bound(L, s * L.w.shape[0] + i, start + length * way, length)
        j = int(at[2])
        more = listed_face_within(L, s, i, j, count, last)
        while anywhere(more) != 0:
            if more != 0:
                t, first = sooner_face_hit(mesh, L.face[face_at(L, s, i, j)], start, way, t, first)
            j += lanes
            more = listed_face_within(L, s, i, j, count, last)
        return face_of(first_of(distance_key(t, first)))

    return nearest_face_in_list, side_of_mesh, first_listed_hit
