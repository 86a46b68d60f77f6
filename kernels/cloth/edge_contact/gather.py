"""Contact planes of sites at points (kernels/cloth/edge_contact/sites.py), behind those that a point has of its own.

Sites of a point with about the same normal count as one, of which the nearest is kept. What of an overlap was there where the
substep began, the point is carried out of without velocity, as kernels/contact/search.py does.

A plane stands still while one point is moved. In sweeps other constraints move all points of a site, so before each further
sweep its planes are renewed by the gap of the site, n.d_k' >= n.d_k - s_k C(d): an edge may turn about the collider as its
forces say, and what a plane has pushed is given back where its site has come away.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.edge_contact.sites import sharp_sites
from wsim.kernels.contact.project import contact_tables, read_type, slot_type
from wsim.kernels.math.marks import owns_points
from wsim.kernels.math.real import types

ALIKE = 0.6            # cosine of normals between which sites of a point count as one


@cache
def site_share_function(real):
    """Function (points, S, site, i) -> s_k of point i, kernels/cloth/edge_contact/sites.py."""
    Points, Sharp = contact_tables(real)[1], sharp_sites(real)

    @wp.func
    def site_point_share(points: Points, S: Sharp, site: int, i: int):
        p = S.corner[site]
        beta = S.beta[site]
        K = real(0.0)
        own = real(0.0)
        for v in range(3):
            K += points.w[p[v]] * beta[v] * beta[v]
            if p[v] == i:
                own += beta[v]
        return points.w[i] * own / K

    return site_point_share


@cache
def site_gather_kernel(real, module):
    """Kernel over points: contact planes of sites behind those that a point has, and how far it is carried out of overlaps."""
    t, (Rows, Points), Read, Slots, Sharp = (types(real), contact_tables(real), read_type(real), slot_type(real),
                                             sharp_sites(real))
    vectors, share_of = wp.array(dtype=t.vec3), site_share_function(real)

    @wp.func
    def find_alike_slot(s: Slots, first: int, end: int, n: t.vec3, row: int):
        """The slot of a point from j on that has about the normal n and the same collider, or `end`."""
        j = int(first)
        while j < end and (s.row[j] != row or wp.dot(s.n[j], n) < real(ALIKE)):
            j += s.points
        return j

    def gather_edges(c: Rows, points: Points, at: Read, S: Sharp, s: Slots, d_out: vectors, a_out: vectors, push_out: vectors):
        i = wp.tid()
        count = s.count[i]
        own_first = int(count)
        S.begin[i] = own_first
        carried = t.vec3()
        d = at.d[i]
        if S.touched[i] != 0 and points.w[i] > real(0.0):
            for k in range(S.start[i], S.start[i + 1]):
                site = S.site[k]
                if S.met[site] >= 0:
                    share = share_of(points, S, site, i)
                    C = S.C[site]
                    over = wp.max(-C[1], real(0.0))
                    out = wp.min(over, c.recovery * c.h)
                    n = S.n[site]
                    gap = share * (C[0] + over - out)
                    j = find_alike_slot(s, own_first * s.points + i, wp.min(count, s.capacity) * s.points + i, n, S.met[site])
                    if j >= s.points * count:                        # of the same side: what is nearest counts
                        count += 1
                        carried += (share * out) * n
                    elif s.b[j] + wp.dot(s.n[j], d) <= gap:
                        j = s.points * s.capacity
                    if j < s.points * s.capacity:
                        s.row[j] = S.met[site]
                        s.n[j] = n
                        s.b[j] = gap - wp.dot(n, d)
                        s.u[j] = S.u[site]
                        s.site[j] = site
                        push_out[j] = t.vec3()
            if count > s.capacity:
                wp.atomic_max(s.wanted, 0, count)
            s.count[i] = wp.min(count, s.capacity)
            if wp.dot(carried, carried) > real(0.0):
                d_out[i] = d + carried
                a_out[i] = at.a[i] + carried

    return owns_points(wp.kernel(gather_edges, name=f"gather_edges_{t.name}", module=module, enable_backward=False))


@cache
def site_plane_kernel(real, module):
    """Kernel over points: the planes of sites at displacements d."""
    t, (Rows, Points), Read, Slots, Sharp = (types(real), contact_tables(real), read_type(real), slot_type(real),
                                             sharp_sites(real))
    share_of = site_share_function(real)

    def renew_edges(c: Rows, points: Points, at: Read, S: Sharp, s: Slots):
        i = wp.tid()
        if S.touched[i] != 0:
            for slot in range(S.begin[i], s.count[i]):
                j = slot * s.points + i
                site = s.site[j]
                p = S.corner[site]
                beta = S.beta[site]
                n = S.n[site]
                C = S.base[site] - wp.dot(n, S.u[site]) * (c.h * real(at.k % S.every))
                for v in range(3):
                    C += beta[v] * wp.dot(n, at.x[p[v]] + at.d[p[v]])
                over = wp.max(-S.C[site][1], real(0.0))
                C += over - wp.min(over, c.recovery * c.h)
                s.b[j] = share_of(points, S, site, i) * C - wp.dot(n, at.d[i])

    return wp.kernel(renew_edges, name=f"renew_edges_{t.name}", module=module, enable_backward=False)
