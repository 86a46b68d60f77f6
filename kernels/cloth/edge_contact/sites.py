"""Contact of a sheet's edges and triangles with the sharp edges and corners of colliders, between the sheet's points.

A site lies on an edge or a triangle of the sheet, with weights beta_k of its points, sum 1. Its gap is C = sum_k beta_k C_k
along one normal n. What closes a gap of -C moves the points by

    dx_k = s_k (-C) n,    s_k = w_k beta_k / sum_j w_j beta_j^2        (w: inverse masses; the impulse acts at the site)

so each point gets a contact plane of its own (kernels/contact/project.py), n.d_k >= n.d_k* - s_k C, with d* as predicted. Every
solver then knows sites as it knows other contacts. With explicit steps, which predict all forces, this is the impulse at the
site; with others it keeps the edge from turning about the collider by more than was predicted, within one substep.

Edges: kernels/cloth/edge_contact/edge.py. Triangles: corner.py. Where two opposite faces of a thin plate are nearest to an edge
(|m| < FLAT), there is no site.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.cloth.edge_contact.corner import INNER, corner_height_function
from wsim.kernels.cloth.edge_contact.edge import AWAY, edge_distance_function, nearest_edge_function
from wsim.kernels.contact.collider.colliders import collider_frame_funcs
from wsim.kernels.contact.collider.shape import BOX
from wsim.kernels.contact.project import contact_tables, read_type
from wsim.kernels.contact.search import ball_is_reachable
from wsim.kernels.math.marks import owns_points
from wsim.kernels.math.real import types

FLAT = 0.2             # least |m|: of faces that meet at 23 degrees
FAR = -1
TURNS = 500            # normals that differ by less are of one face: an edge of length L sinks by L / TURNS^2 there


@cache
def sharp_sites(real):
    """Struct of what is between points: rows of colliders with sharp edges, and what was found in this substep."""
    t = types(real)

    @wp.struct
    class Sharp:
        first: wp.array(dtype=int)           # sharp rows of object o: first[o] .. first[o + 1] of `row`, (objects + 1,)
        row: wp.array(dtype=int)
        keep: wp.array(dtype=t.scalar)       # distance that sites keep of each of `row`, besides that of points [m]
        corner: wp.array(dtype=wp.vec3i)     # points of an edge (i, j, j), and of a triangle, (sites,)
        size: int                            # sites of a lot, which a thread takes together
        object: wp.array(dtype=int)          # of each lot, (lots,)
        lot: wp.array(dtype=int)             # points of lot l: lot[l] .. lot[l + 1] of `member`, (lots + 1,)
        member: wp.array(dtype=int)
        busy: wp.array(dtype=int)            # 1: `met` of a lot may be more than -1
        start: wp.array(dtype=int)           # sites of point i: start[i] .. start[i + 1] of `site`, (points + 1,)
        site: wp.array(dtype=int)
        points: int
        every: int                           # substeps of which the first looks for sites, see EVERY of the host
        q: wp.array(dtype=t.vec3)            # place in the frame of sharp row j of the object, at j * points + i [m]
        felt: wp.array(dtype=t.vec4)         # normal there, and distance [m]
        side: wp.array(dtype=int)            # number of that normal; FAR: no edge from there can touch the collider
        touched: wp.array(dtype=int)         # 1: a site of the point has a contact, (points,)
        begin: wp.array(dtype=int)           # contacts of the point before those of sites, (points,)
        met: wp.array(dtype=int)             # row of a site's contact, -1: none, (sites,)
        beta: wp.array(dtype=t.vec3)
        n: wp.array(dtype=t.vec3)
        u: wp.array(dtype=t.vec3)            # velocity of the collider there [m/s]
        base: wp.array(dtype=t.scalar)       # gap less n times the place, where the site was found [m]
        C: wp.array(dtype=t.vec2)            # gap, and gap where the substep began [m]

    return Sharp


@cache
def sharp_distance_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over points: where each is predicted to be in the frames of sharp colliders, and how far from them."""
    t, (Rows, Points), Read, Sharp = types(real), contact_tables(real), read_type(real), sharp_sites(real)
    shape = edge_distance_function(kinds, real)

    @wp.func
    def normal_number(n: t.vec3):
        """Number of a normal, the same of those that differ by less than 1 / TURNS."""
        h = real(TURNS)
        return (int(wp.round(h * (n[0] + real(1.0)))) * wp.static(2 * TURNS + 1) + int(wp.round(h * (n[1] + real(1.0))))) * (
            wp.static(2 * TURNS + 1)) + int(wp.round(h * (n[2] + real(1.0))))

    def feel_edges(c: Rows, points: Points, at: Read, sharp_out: Sharp):
        i = wp.tid()
        if at.k % sharp_out.every != 0:
            return
        o = points.object[i]
        x = at.x[i]
        d = at.d[i]
        sharp_out.touched[i] = 0
        for j in range(sharp_out.first[o], sharp_out.first[o + 1]):
            row = sharp_out.row[j]
            slot = (j - sharp_out.first[o]) * sharp_out.points + i
            reach = real(2.0) * (wp.length(d) + c.chord[row]) + points.reach[i] + sharp_out.keep[j] + c.skin
            side = int(FAR)
            if ball_is_reachable(c.ball[at.k, row], x, reach):
                T = c.of.pose[at.k + 1, row]
                q = wp.quat_rotate_inv(wp.transform_get_rotation(T), (x - wp.transform_get_translation(T)) + d)
                phi, n, _slip = shape(c.of.kind[row], c.of.size[row], c.of.mesh[row], q, reach)
                if phi < reach:
                    sharp_out.q[slot] = q
                    sharp_out.felt[slot] = t.vec4(n[0], n[1], n[2], phi)
                    side = normal_number(n)
            sharp_out.side[slot] = side

    return owns_points(wp.kernel(feel_edges, name=f"feel_edges_{'_'.join(kinds)}_{t.name}", module=module,
                                 enable_backward=False))


@cache
def site_detection_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over lots of sites: the collider that each site is deepest in, if any, its gap, its normal and its weights."""
    t, (Rows, Points), Read, Sharp = types(real), contact_tables(real), read_type(real), sharp_sites(real)
    mat34 = wp.types.matrix((3, 4), real)
    least, highest, (_, outside), boxes = (nearest_edge_function(kinds, real), corner_height_function(kinds, real),
                                           collider_frame_funcs(real), "box" in kinds)

    @wp.func
    def edge_dips_both_ways(e: t.vec3, f0: t.vec4, f1: t.vec4):
        """Whether an edge goes down towards the collider from both of its ends."""
        return (f0[0] * e[0] + f0[1] * e[1] + f0[2] * e[2] < real(0.0)) and (
            f1[0] * e[0] + f1[1] * e[1] + f1[2] * e[2] > real(0.0))

    @wp.func
    def height_above_plane(f: t.vec4, x: t.vec3, y: t.vec3, z: t.vec3):
        """Least height of a triangle above the tangent plane of its corner x [m]."""
        m = t.vec3(f[0], f[1], f[2])
        return f[3] + wp.min(wp.min(wp.dot(m, y - x), wp.dot(m, z - x)), real(0.0))

    @wp.func
    def may_hold_corner(kind: int, size: t.vec3, X: t.mat33, chord: real, f: mat34):
        """Whether a corner of the collider may be in a triangle: no tangent plane has all of it outside."""
        if boxes:
            if kind == BOX:
                middle = (X[0] + X[1] + X[2]) / real(3.0)
                for k in range(3):
                    if wp.abs(wp.abs(middle[k]) - size[k]) > real(2.0) * chord:
                        return False
        return (height_above_plane(f[0], X[0], X[1], X[2]) < real(0.0)
                and height_above_plane(f[1], X[1], X[2], X[0]) < real(0.0)
                and height_above_plane(f[2], X[2], X[0], X[1]) < real(0.0))

    @wp.func
    def on_edge(kind: int, size: t.vec3, mesh: wp.uint64, X: t.mat33, limits: t.vec2, f0: t.vec4, f1: t.vec4):
        r = limits[0]
        u, phi, m, slip = least(kind, size, mesh, wp.matrix_from_rows(X[0], X[1]), r + limits[1], f0, f1)
        steep = wp.length(m)
        C = real(AWAY)
        n = t.vec3()
        if phi < r + limits[1] and steep > real(FLAT) and u > real(INNER) and u < real(1.0) - real(INNER):
            n = m / steep
            C = wp.where(phi < real(0.0), phi / steep, phi) - r
        return C, t.vec3(real(1.0) - u, u, real(0.0)), n, slip

    @wp.func
    def site_gap(kind: int, size: t.vec3, mesh: wp.uint64, X: t.mat33, edge: bool, limits: t.vec2, f: mat34):
        """C, beta, normal in the collider's frame, slip. limits: distance kept, margin [m]; f: `felt` of the points."""
        C = real(AWAY)
        beta = t.vec3()
        m = t.vec3()
        slip = t.vec3()
        if edge:
            C, beta, m, slip = on_edge(kind, size, mesh, X, limits, f[0], f[1])
        else:
            out = f[0] + f[1] + f[2]
            C, beta, m = highest(kind, size, mesh, X, t.vec3(out[0], out[1], out[2]), limits[0] + limits[1])
            C = C - limits[0]
        return C, beta, m, slip

    @wp.func
    def sides_are_uneven(S: Sharp, lot: int):
        """Whether points of a lot are at different sides of a collider."""
        first = S.lot[lot]
        end = S.lot[lot + 1]
        o = S.object[lot]
        for j in range(S.first[o], S.first[o + 1]):
            slot = (j - S.first[o]) * S.points
            side = S.side[slot + S.member[first]]
            for k in range(first + 1, end):
                if S.side[slot + S.member[k]] != side:
                    return True
        return False

    @wp.func
    def follow_earlier_sites(c: Rows, at: Read, S: Sharp, lot: int, sharp_out: Sharp):
        """Gaps of sites that were found in an earlier substep, with the normals of then."""
        for site in range(lot * S.size, (lot + 1) * S.size):
            if S.met[site] >= 0:
                p = S.corner[site]
                beta = S.beta[site]
                n = S.n[site]
                x = beta[0] * at.x[p[0]] + beta[1] * at.x[p[1]] + beta[2] * at.x[p[2]]
                moved = beta[0] * at.d[p[0]] + beta[1] * at.d[p[1]] + beta[2] * at.d[p[2]]
                gone = c.h * wp.dot(n, S.u[site])
                C = S.base[site] + wp.dot(n, x + moved) - gone * real(at.k % S.every)
                sharp_out.C[site] = t.vec2(C, C - wp.dot(n, moved) + gone)

    @wp.func
    def clear_site_lot(S: Sharp, lot: int, sharp_out: Sharp):
        """No site of a lot has a contact."""
        if S.busy[lot] != 0:
            sharp_out.busy[lot] = 0
            for site in range(lot * S.size, (lot + 1) * S.size):
                sharp_out.met[site] = -1

    @wp.func
    def site_is_possible(c: Rows, S: Sharp, row: int, slot: int, p: wp.vec3i):
        """Whether a site may be nearer to a collider than its points, as their sides and tangent planes say."""
        side = S.side[slot + p[0]]
        two = S.side[slot + p[1]]
        three = S.side[slot + p[2]]
        if not ((side != two or side != three) and wp.min(side, wp.min(two, three)) > FAR):
            return False
        x0 = S.q[slot + p[0]]
        x1 = S.q[slot + p[1]]
        f0 = S.felt[slot + p[0]]
        f1 = S.felt[slot + p[1]]
        if p[1] == p[2]:
            return edge_dips_both_ways(x1 - x0, f0, f1)
        f = wp.matrix_from_rows(f0, f1, S.felt[slot + p[2]])
        return may_hold_corner(c.of.kind[row], c.of.size[row], wp.matrix_from_rows(x0, x1, S.q[slot + p[2]]), c.chord[row], f)

    def find_edges(c: Rows, points: Points, at: Read, S: Sharp, sharp_out: Sharp):
        lot = wp.tid()
        if at.k % S.every != 0:
            if S.busy[lot] != 0:
                follow_earlier_sites(c, at, S, lot, sharp_out)
            return
        if not sides_are_uneven(S, lot):
            clear_site_lot(S, lot, sharp_out)
            return
        sharp_out.busy[lot] = 1
        o = S.object[lot]
        for site in range(lot * S.size, (lot + 1) * S.size):
            p = S.corner[site]
            best = real(AWAY)
            sharp_out.met[site] = -1
            for j in range(S.first[o], S.first[o + 1]):
                slot = (j - S.first[o]) * S.points
                row = S.row[j]
                if not site_is_possible(c, S, row, slot, p):
                    continue
                X = wp.matrix_from_rows(S.q[slot + p[0]], S.q[slot + p[1]], S.q[slot + p[2]])
                f = wp.matrix_from_rows(S.felt[slot + p[0]], S.felt[slot + p[1]], S.felt[slot + p[2]])
                r = S.keep[j] + wp.max(points.reach[p[0]], points.reach[p[1]])
                margin = wp.length(at.d[p[0]]) + wp.length(at.d[p[1]]) + c.skin + c.stride[at.k, row]
                C, b, m, slip = site_gap(c.of.kind[row], c.of.size[row], c.of.mesh[row], X, p[1] == p[2], t.vec2(r, margin), f)
                if C < margin and C < best and wp.dot(b, t.vec3(points.w[p[0]], points.w[p[1]], points.w[p[2]])) > real(0.0):
                    best = C
                    p0 = b * X - (C + r) * m
                    n, way = outside(c.of.pose[at.k, row], c.of.pose[at.k + 1, row], c.of.step[at.k, row], m, p0, slip)
                    moved = b[0] * at.d[p[0]] + b[1] * at.d[p[1]] + b[2] * at.d[p[2]]
                    x = b[0] * at.x[p[0]] + b[1] * at.x[p[1]] + b[2] * at.x[p[2]]
                    sharp_out.met[site] = row
                    sharp_out.beta[site] = b
                    sharp_out.n[site] = n
                    sharp_out.u[site] = way / c.h
                    sharp_out.base[site] = C - wp.dot(n, x + moved)
                    sharp_out.C[site] = t.vec2(C, C - wp.dot(n, moved - way))
                    for v in range(3):
                        sharp_out.touched[p[v]] = 1

    return wp.kernel(find_edges, name=f"find_edges_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)
