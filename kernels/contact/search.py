"""Search for contacts between points and colliders, once a substep, after prediction.

    x  position at the start of the substep [m]     d  predicted displacement [m]      a  anchor: v = (d - a) / g

Each point tries the colliders of its object, but for those whose bounding ball it cannot reach in this substep; where there
are many, a tree over the boxes about the balls (Warp's) names those that it may reach (`reachable_collider_func`), and the same
are tried. A contact is kept where the gap at the predicted place is under a margin of |dq| + skin, dq the motion relative to
the collider: constraints may still move the point. A point that started too near by s0 < 0 is carried out by the same
shift of d and a, hence without velocity, by at most `recovery` h; by what is then left its plane is moved back.

The plane of a mesh's face goes on beyond the face. Along it a point may come through the next one, where the mesh is hollow;
an open mesh has no inside that it would be brought back from. So a point that its first plane holds, and that goes further
along it than the distance that it keeps, is tried once more, by the way that is left: d - C n; what it meets there is a
further contact.

Contacts stand in the order of the colliders, so results are bitwise the same from run to run. Slots are a struct, of which a
tape keeps no versions: the search is run once more before its adjoint (kernels/contact/search_adjoint.py).
"""

# Device code: int(0) makes a variable of what would be a constant; `not a < b` is true where a is no number.
# ruff: noqa: UP018, SIM102

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import collide
from wsim.kernels.contact.collider.colliders import collider_frame_funcs, plane_is_far
from wsim.kernels.contact.mesh import SOLID
from wsim.kernels.contact.project import SUNK, contact_tables, read_type, slot_type
from wsim.kernels.math.marks import kernel_over_cores, owns_points, standalone_function
from wsim.kernels.math.real import substep_number, types

SUNK_FROM = 0.01       # part of the skin: overlaps under it are rounding and no reason to look deeper
ROOM = 8               # rows that a look into the tree lists at most: it looks again behind the last; most points need one look
MOST = 32              # rows that are listed so; a point that may reach more (a very fast one) tries each row of its object
NONE = 0x7fffffff      # a row that there is not
FURTHER = 8            # more faces of a mesh that a point may come to along the first in one substep
ALIKE = 1.0 - 2e-6     # cosine between two planes that are one but for rounding
SLACK = 1e-6  # of coordinates and radii, that boxes are larger by: 16 roundings of float32, `ball_is_reachable` has under 8


@wp.func
def ball_is_reachable(ball: Any, x: Any, bound: Any):
    """Whether a ball (centre, radius) comes within `bound` of x; not where x is no number."""
    away = x - type(x)(ball[0], ball[1], ball[2])
    return wp.dot(away, away) < (ball[3] + bound) * (ball[3] + bound)


@wp.func
def meets_again(c: Any, points: Any, i: int, row: int, C: Any, cosine: Any):
    """Whether a way along a face leads through another one, of a gap C behind it; cosine: between both."""
    return C < -(points.reach[i] + c.of.thick[row] - c.width) and cosine < type(C)(ALIKE)


@wp.func
def slides_on(c: Any, points: Any, at: wp.vec3i, C: Any, margin: Any, over: Any):
    """Whether a point that is held before a face of a mesh goes far enough along it to come through another one: further than
    what it keeps from all of them. at: row, i, k; over: how deep it begins."""
    r = points.reach[at[1]] + c.of.thick[at[0]] - c.width
    way = margin - c.skin - c.stride[at[2], at[0]]
    return c.of.kind[at[0]] >= SOLID and C < type(C)(0.0) and over <= type(C)(SUNK_FROM) * c.skin and way >= r


@cache
def ball_box_kernel(real, module):
    """Kernel over the balls of the tree: boxes [m] that hold them in substep k, rounded outward."""
    Rows = contact_tables(real)[0]

    def bound_ball_boxes(c: Rows, k: int, low_out: wp.array(dtype=wp.vec3f), high_out: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        ball = c.ball[k, c.leaf[i]]
        center = wp.vec3f(float(ball[0]), float(ball[1]), float(ball[2]))
        low, high = box_about_ball(center, float(ball[3]))
        low_out[i] = low
        high_out[i] = high

    return wp.kernel(bound_ball_boxes, name=f"box_balls_{types(real).name}", module=module, enable_backward=False)


@wp.func
def box_about_ball(center: wp.vec3f, radius: float):
    """Corners of a box about a ball that leaves room for rounding."""
    r = radius + SLACK * (radius + wp.max(wp.abs(center)))
    half = wp.vec3f(r, r, r)
    return center - half, center + half


@cache
def tree_root_kernel(module):
    """Kernel over objects: the node of a tree that is above the balls of each, -1 where it has none."""
    def find_tree_roots(tree: wp.uint64, root_out: wp.array(dtype=int)):
        o = wp.tid()
        root_out[o] = wp.bvh_get_group_root(tree, o)

    return wp.kernel(find_tree_roots, name="tree_roots", module=module, enable_backward=False)


@cache
def reachable_collider_func(real):
    """Function (c, o, k, x, bound, first) -> (rows, some, behind): the rows of object o from `first` on that a point may reach
    in substep k, ascending, `some` of them, all before row `behind`. rows[0] is NONE where each row is to be tried, or none."""
    t, Rows, list_of = types(real), contact_tables(real)[0], wp.types.vector(ROOM, int)

    @wp.func
    def insert_collider_row(rows: list_of, row: int):
        """Into an ascending list; the last is lost where it is full."""
        more = row
        for j in range(ROOM):
            less = wp.min(rows[j], more)
            more = wp.max(rows[j], more)
            rows[j] = less
        return rows

    @wp.func
    def list_reachable_colliders(c: Rows, o: int, k: int, x: t.vec3, bound: real, first: int):
        rows = list_of(NONE)
        end = c.first[o + 1]
        found = int(0)
        for j in range(c.start[o], c.start[o + 1]):
            row = c.endless[j]
            if row >= first and ball_is_reachable(c.ball[k, row], x, bound):
                rows = insert_collider_row(rows, row)
                found += 1
        low, high = box_about_ball(wp.vec3f(float(x[0]), float(x[1]), float(x[2])), float(bound))
        leaf = int(0)
        query = wp.bvh_query_aabb(c.tree, low, high, c.root[o])
        while wp.bvh_query_next(query, leaf):
            row = c.leaf[leaf]
            if row >= first and row < end and ball_is_reachable(c.ball[k, row], x, bound):
                rows = insert_collider_row(rows, row)
                found += 1
        some = wp.min(found, ROOM)
        behind = end
        if found > MOST:
            rows[0] = NONE
            some = end - first
        elif some == ROOM:
            behind = rows[ROOM - 1] + 1
        return rows, some, behind

    return list_reachable_colliders


@cache
def collider_contact_func(kinds: tuple[str, ...], real, listed: bool = False, cleared: bool = False):
    """Function (c, points, at: row, i and k, deep, x, d) -> (C, margin, s0, n, way) of point i and the collider of a row in
    substep k. They have a contact where C < margin; n and way are found only there. listed: faces of meshes by lists.
    cleared: meshes that a point is known to be far from are not asked (kernels/contact/candidates.py)."""
    t, (shapes, meshes), (Rows, Points) = types(real), collide.split_convex_and_meshes(kinds), contact_tables(real)
    touch, (inside, outside) = collide.collider_touch_func(shapes if listed else kinds, real), collider_frame_funcs(real)
    if listed:
        from wsim.kernels.contact import candidates
        among, refresh = candidates.listed_touch_func(meshes, real), candidates.list_refresh_func(real)
    if cleared:
        from wsim.kernels.contact.candidates import mesh_clearance_func
        is_far = mesh_clearance_func(real)

    @standalone_function
    @wp.func
    def point_collider_contact(c: Rows, points: Points, at: wp.vec3i, deep: int, x: t.vec3, d: t.vec3):
        row = at[0]
        i = at[1]
        k = at[2]
        T0 = c.of.pose[k, row]
        T1 = c.of.pose[k + 1, row]
        q0, q1 = inside(T0, T1, x, d)
        margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
        r = points.reach[i] + c.of.thick[row] - c.width                     # the hard contact behind a potential
        if cleared:
            if c.of.kind[row] >= SOLID and deep == 0:
                if is_far(c, points, row, i, k, wp.matrix_from_rows(q0, q1), margin + r):
                    return real(1.0e30), margin, real(0.0), t.vec3(), t.vec3()
        C, m, p, s0, slip = touch(c.of.kind[row], c.of.size[row], c.of.mesh[row], deep, q0, q1, r, t.vec2(margin, c.width))
        if listed:
            if c.of.kind[row] >= SOLID:
                ends = wp.matrix_from_rows(q0, q1)
                refresh(c, points, row, i, k, ends, margin + r)
                C, m, p, s0, slip = among(c, points, row, i, deep, ends, t.vec2(r, margin))
        n = t.vec3()
        way = t.vec3()
        if C < margin:
            n, way = outside(T0, T1, c.of.step[k, row], m, p, slip)
        return C, margin, s0, n, way

    return point_collider_contact


@cache
def point_contact_search_func(kinds: tuple[str, ...], real, broad: bool = False, listed: bool = False, cleared: bool = False):
    """Function (c, points, s, at: i, k and deep, x0, d0, push) -> carried: contacts of point i in substep k, and how far it is
    carried out of overlaps [m]; writes the slots and the mark of the point, and zeros its pushes. Other arguments:
    `contact_search_kernel`."""
    t, (Rows, Points) = types(real), contact_tables(real)
    Slots, meet, near = (slot_type(real), collider_contact_func(kinds, real, listed, cleared),
                         reachable_collider_func(real) if broad else None)
    vectors, turns = wp.array(dtype=t.vec3), 1 + FURTHER * bool(collide.split_convex_and_meshes(kinds)[1])
    if listed:
        from wsim.kernels.contact.candidates import expire_lists
    if cleared:
        from wsim.kernels.contact.candidates import deduct_mesh_deformation

    @wp.func
    def write_contact_slot(s: Slots, j: int, row: int, n: t.vec3, b: real, u: t.vec3, push: vectors):
        s.row[j] = row
        s.n[j] = n
        s.b[j] = b
        s.u[j] = u
        push[j] = t.vec3()

    @wp.func
    def meet_row(c: Rows, points: Points, s: Slots, at: wp.vec4i, before: int, way: t.mat33, push: vectors):
        """(contacts, SUNK or 0, carried) of point i with the collider of a row, added to `before` and to the last row of `way`:
        x0, d0, carried. at: row, i, k and deep."""
        row, i = at[0], at[1]
        count, mark, carried, d, last, turn = int(before), int(0), way[2], way[1], t.vec3(), int(0)
        while turn < turns:
            C, margin, s0, n, slip = meet(c, points, wp.vec3i(row, i, at[2]), at[3], way[0] + carried, d)
            if not wp.where(turn == 0, C < margin, meets_again(c, points, i, row, C, wp.dot(n, last))):
                break
            over = wp.max(-s0, real(0.0))
            out = wp.min(over, c.recovery * c.h)         # of the overlap; the rest may stay for now
            if over > real(SUNK_FROM) * c.skin:
                mark = SUNK
            if count < s.capacity:
                b = C + over - out - wp.dot(n, d + carried)
                write_contact_slot(s, count * s.points + i, row, n, b, slip / c.h, push)
            carried += out * n
            count += 1
            turn += 1
            if not slides_on(c, points, wp.vec3i(row, i, at[2]), C, margin, over):
                break
            d = d - (C + over) * n
            last = n
        return count, mark, carried

    @wp.func
    def find_point_contacts(c: Rows, points: Points, s: Slots, at: wp.vec3i, x0: t.vec3, d0: t.vec3, push: vectors):
        i, k = at[0], at[1]
        count, mark, carried = int(0), int(0), t.vec3()
        o = points.object[i]
        if listed:
            expire_lists(points, i, k)
        if cleared:
            deduct_mesh_deformation(c, points, o, i, k)
        if points.w[i] > real(0.0):
            bound = real(2.0) * wp.length(d0) + points.reach[i] + c.skin
            first = int(c.first[o])
            end = c.first[o + 1]
            while first < end:
                some = end - first
                behind = end
                if broad:
                    rows, some, behind = near(c, o, k, x0, bound, first)
                for j in range(some):
                    row = first + j
                    if broad:
                        row = wp.where(rows[0] < NONE, rows[wp.min(j, ROOM - 1)], row)
                    if plane_is_far(c, k, row, x0, bound) or not ball_is_reachable(c.ball[k, row], x0, bound):
                        continue
                    now = wp.vec4i(row, i, k, at[2])
                    count, sunk, carried = meet_row(c, points, s, now, count, wp.matrix_from_rows(x0, d0, carried), push)
                    mark = mark | sunk
                first = behind
        if count > s.capacity:
            wp.atomic_max(s.wanted, 0, count)
        s.count[i] = wp.min(count, s.capacity)
        s.mark[i] = mark
        return carried

    return find_point_contacts


@cache
def contact_search_kernel(kinds: tuple[str, ...], real, module, broad: bool = False, listed: bool = False,
                          cleared: bool = False):
    """Kernel over points: contacts of substep k. Reads x, d, a. broad: colliders are found by the tree of the table. listed:
    faces of meshes by lists, see kernels/contact/candidates.py; cleared: as `collider_contact_func`.

    d_out, a_out   written where a point is carried out of an overlap       push_out   of its contacts: zeroed
    struck_out     (may be None) not 0 where a point is in an overlap"""
    t, how = types(real), f"{'_tree' * broad}{'_listed' * listed}{'_cleared' * cleared}"
    name = f"search_{'_'.join(kinds)}_{t.name}{how}"
    (Rows, Points), Slots, Read, find = (contact_tables(real), slot_type(real), read_type(real),
                                         point_contact_search_func(kinds, real, broad, listed, cleared))
    vectors = wp.array(dtype=t.vec3)

    def search_collider_contacts(c: Rows, points: Points, at: Read, s: Slots, d_out: vectors, a_out: vectors, push_out: vectors,
                                 struck_out: wp.array(dtype=real)):
        i = wp.tid()
        now = wp.vec3i(i, substep_number(at.k, at.now), c.deep[0] | (s.mark[i] & SUNK))
        carried = find(c, points, s, now, at.x[i], at.d[i], push_out)
        if wp.dot(carried, carried) > real(0.0):
            d_out[i] = at.d[i] + carried
            a_out[i] = at.a[i] + carried
        if struck_out:
            struck_out[i] = real(s.mark[i] & SUNK)

    return owns_points(kernel_over_cores(search_collider_contacts, name, module))
