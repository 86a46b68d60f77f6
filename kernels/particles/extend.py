"""What is known on the faces of a liquid, into the air and into obstacles: a layer of faces a launch, each the mean of those
beside it that layers before have reached (Bridson 2015, section 7.4). Exact where the field is the same everywhere. From layer
KEPT on faces keep what particles there have brought: drops in the air are not dragged along. Nothing comes through a thin wall.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs

KEPT = 3


@cache
def velocity_extension_kernel(dim: int, thin: bool, real, module):
    """Kernel over the faces of an axis: known, the layer of each face, 1: it is the liquid's; 0: not yet. Faces of this layer
    are written, those of layers before are read. cut: bits of thin walls (walls.py)."""
    S, f = grid_structs(real), grid_functions(dim, real)

    def extend_velocity(g: S.Grid, axis: int, layer: int, mass: wp.array(dtype=real), cut: wp.array(dtype=int),
                        u_out: wp.array(dtype=real), known_out: wp.array(dtype=int)):
        c = wp.tid()
        if known_out[c] == 0:
            shape = f.faces(g, axis)
            i = f.place(c, shape)
            sum = real(0.0)
            count = real(0.0)
            around = int(wp.static(2 * dim))                   # a variable: the loop is compiled once
            for m in range(around):
                b = m // 2
                j = wp.vec3i(i[0], i[1], i[2])
                j[b] = i[b] + 2 * (m % 2) - 1
                if g.periodic[b] != 0:
                    j[b] = (j[b] + shape[b]) % shape[b]
                if j[b] >= 0 and j[b] < shape[b]:
                    n = flat_cell_index(j, shape)
                    at = known_out[n]
                    if wp.static(thin):
                        of = n                                 # the lower one of the two
                        if m % 2 == 1:
                            of = c
                        if ((cut[of] >> b) & 1) != 0:
                            at = int(0)
                    if at > 0 and at < layer:
                        sum += u_out[n]
                        count += real(1.0)
            if count > real(0.0):
                if layer < KEPT or mass[c] == real(0.0):
                    u_out[c] = sum / count
                known_out[c] = layer

    return wp.kernel(extend_velocity, name=f"extend{'_thin' * thin}_{f.name}", module=module, enable_backward=False)
