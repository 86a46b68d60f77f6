"""A box of cells that is solved within a larger one, whose air is at rest elsewhere: rows that it takes and gives back, and the
box that smoke and heat fill.

Air that is pushed out of the way of something of size R moves as a dipole, u ~ (R / r)^3 at a distance r: open sides at r, with
pressure 0, are wrong by about that much, and twice as far away by an eighth of it.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions
from wsim.kernels.math.real import types

SMOKE, HEAT = 1e-3, 0.03                # what is told of: 1 is dense; a degree lifts as g / 300


@cache
def window_take_kernel(dim: int, real, module):
    """Kernel over the rows of a window, of shape `some`, whose first stands at `first` of `whole`: q_out of q there."""
    f = grid_functions(dim, real)

    def copy_to_window(some: wp.vec3i, whole: wp.vec3i, first: wp.vec3i, q: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = q[flat_cell_index(f.place(c, some) + first, whole)]

    return wp.kernel(copy_to_window, name=f"window_take_{f.name}", module=module, enable_backward=False)


@cache
def window_give_kernel(dim: int, real, module):
    """Kernel over the rows of a window: the reverse of `window_take_kernel`."""
    f = grid_functions(dim, real)

    def copy_from_window(some: wp.vec3i, whole: wp.vec3i, first: wp.vec3i, q: wp.array(dtype=real),
                         q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[flat_cell_index(f.place(c, some) + first, whole)] = q[c]

    return wp.kernel(copy_from_window, name=f"window_give_{f.name}", module=module, enable_backward=False)


@cache
def window_rest_kernel(dim: int, real, module):
    """Kernel over all rows: `value` where they are not of the window."""
    f = grid_functions(dim, real)

    def fill_outside_window(some: wp.vec3i, whole: wp.vec3i, first: wp.vec3i, value: real, q_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, whole) - first
        within = i[0] >= 0 and i[1] >= 0 and i[2] >= 0 and i[0] < some[0] and i[1] < some[1] and i[2] < some[2]
        if not within:
            q_out[c] = value

    return wp.kernel(fill_outside_window, name=f"window_rest_{f.name}", module=module, enable_backward=False)


@cache
def window_extent_kernel(dim: int, smoky: bool, hot: bool, real, module):
    """Kernel over the cells of a window: for each axis, how far from the high end of the whole box the first cell with
    something is, and how far from its low end the last one is, each counted with itself; 0: there is none. reach_out: (6,)."""
    f, t = grid_functions(dim, real), types(real)

    def smoke_extent(some: wp.vec3i, whole: wp.vec3i, first: wp.vec3i, smoke: wp.array(dtype=real), heat: wp.array(dtype=real),
                     reach_out: wp.array(dtype=int)):
        c = wp.tid()
        found = bool(False)  # noqa: UP018
        if wp.static(smoky):
            found = wp.abs(smoke[c]) > real(wp.static(SMOKE))
        if wp.static(hot):
            found = found or wp.abs(heat[c]) > real(wp.static(HEAT))
        if found:
            i = f.place(c, some) + first
            for a in range(3):
                low = whole[a] - i[a]
                if reach_out[a] < low:
                    wp.atomic_max(reach_out, a, low)
                if reach_out[3 + a] < i[a] + 1:
                    wp.atomic_max(reach_out, 3 + a, i[a] + 1)

    name = f"window_reach{'_smoke' * smoky}{'_heat' * hot}_{dim}d_{t.name}"
    return wp.kernel(smoke_extent, name=name, module=module, enable_backward=False)
