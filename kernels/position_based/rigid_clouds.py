"""Rigid clusters whose points are balls: a contact takes the inverse mass of the whole cluster, split by all that press it.

    K = (1 + contacts of the cluster) (1 / M + |r|^2 / I_least)        in the place of m_i w_i of grains.py

That is no less than what the cluster shows along any direction, so that all contacts at once do not overshoot. A projection of
the cluster follows each iteration, and makes of what a point was pushed the motion of the whole.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.grains import grain_structs
from wsim.kernels.position_based.neighbours import neighbour_structs


@cache
def rigid_count_kernel(real, module):
    """Kernel over places, behind `contact_kernel`: contacts that press each rigid cluster."""
    N, S = neighbour_structs(real), grain_structs(real)

    def count_rigid_contacts(c: N.CellTable, g: S.GrainTable):
        k = wp.tid()
        piece = g.piece[c.order[k]]
        if piece >= 0 and g.inverse[k] > real(0.0):
            wp.atomic_add(g.pressed, piece, int(wp.round(g.split[k] / g.inverse[k])) - 1)

    return wp.kernel(count_rigid_contacts, name=f"grains_rigid_count_{types(real).name}", module=module, enable_backward=False)


@cache
def rigid_split_kernel(real, module):
    """Kernel over places, behind `rigid_count_kernel`: a rigid cluster answers a contact as a whole, split into as many parts
    as contacts press it. A point alone has a small part of its mass, and needed as many iterations."""
    N, S = neighbour_structs(real), grain_structs(real)

    def split_rigid_clusters(c: N.CellTable, g: S.GrainTable):
        k = wp.tid()
        p = c.order[k]
        if g.piece[p] >= 0:
            g.split[k] = real(1 + g.pressed[g.piece[p]]) * g.whole[p]

    return kernel_over_cores(split_rigid_clusters, f"grains_rigid_split_{types(real).name}", module)
