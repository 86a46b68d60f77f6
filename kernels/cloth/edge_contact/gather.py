"""Contact planes of sites at points (kernels/cloth/edge_contact/sites.py), behind those that a point has of its own.

Sites of a point with about the same normal count as one, of which the nearest is kept. What of an overlap was there where the
substep began, the point is carried out of without velocity, as kernels/contact/search.py does.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.edge_contact.sites import sharps
from wsim.kernels.contact.project import read, slots, tables
from wsim.kernels.math.real import types

ALIKE = 0.6            # cosine of normals between which sites of a point count as one


@cache
def gather(real, module):
    """Kernel over points: contact planes of sites behind those that a point has, and how far it is carried out of overlaps."""
    t, (Rows, Points), Read, Slots, Sharp = types(real), tables(real), read(real), slots(real), sharps(real)
    vectors = wp.array(dtype=t.vec3)

    @wp.func
    def alike(s: Slots, first: int, end: int, n: t.vec3, row: int):
        """The slot of a point from j on that has about the normal n and the same collider, or `end`."""
        j = int(first)
        while j < end and (s.row[j] != row or wp.dot(s.n[j], n) < real(ALIKE)):
            j += s.points
        return j

    def gather_edges(c: Rows, points: Points, at: Read, S: Sharp, s: Slots, d_out: vectors, a_out: vectors, push_out: vectors):
        i = wp.tid()
        count = s.count[i]
        own_first = int(count)
        carried = t.vec3()
        d = at.d[i]
        if S.touched[i] != 0 and points.w[i] > real(0.0):
            for k in range(S.start[i], S.start[i + 1]):
                site = S.site[k]
                if S.met[site] >= 0:
                    p = S.corner[site]
                    beta = S.beta[site]
                    K = real(0.0)
                    own = real(0.0)
                    for v in range(3):
                        K += points.w[p[v]] * beta[v] * beta[v]
                        if p[v] == i:
                            own += beta[v]
                    share = points.w[i] * own / K
                    C = S.C[site]
                    over = wp.max(-C[1], real(0.0))
                    out = wp.min(over, c.recovery * c.h)
                    n = S.n[site]
                    gap = share * (C[0] + over - out)
                    j = alike(s, own_first * s.points + i, wp.min(count, s.capacity) * s.points + i, n, S.met[site])
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
                        push_out[j] = t.vec3()
            if count > s.capacity:
                wp.atomic_max(s.wanted, 0, count)
            s.count[i] = wp.min(count, s.capacity)
            if wp.dot(carried, carried) > real(0.0):
                d_out[i] = d + carried
                a_out[i] = at.a[i] + carried

    return wp.kernel(gather_edges, name=f"gather_edges_{t.name}", module=module, enable_backward=False)
