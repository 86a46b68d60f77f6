"""The pressure of a box without obstacles, directly, by fast diagonalisation (Lynch, Rice, Thomas 1964): A is the sum of one
operator an axis, A = sum_a T_a, each with eigenvectors Q_a and eigenvalues l_a, so that

    A^-1 b = Q (Q^T b / (l_0 + l_1 + l_2)),    Q = Q_0 x Q_1 x Q_2:    a dense product along each axis, there and back

T_a is 2 -1, closed ends 1, open ends 3, or around: cosines, sines and waves are its eigenvectors. What is 0 in the sum, the
constant of a sealed box, is left out. A product goes by tiles, of whole rows of threads on CUDA; work n^4 for n^3 cells.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import functions
from wsim.kernels.math.real import types

ROWS, COLUMNS, DEEP = 16, 64, 16          # of a tile of a product, and of the sum along


@cache
def left(real, module):
    """Kernel over tiles (batch, rows, columns): y_out[b] = A x[b]."""

    def left(A: wp.array2d(dtype=real), x: wp.array3d(dtype=real), y_out: wp.array3d(dtype=real)):
        b, i, j = wp.tid()
        sum = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=real)
        for k in range((A.shape[1] + DEEP - 1) // DEEP):
            a = wp.tile_load(A, shape=(ROWS, DEEP), offset=(i * ROWS, k * DEEP))
            c = wp.tile_load(x[b], shape=(DEEP, COLUMNS), offset=(k * DEEP, j * COLUMNS))
            wp.tile_matmul(a, c, sum)
        wp.tile_store(y_out[b], sum, offset=(i * ROWS, j * COLUMNS))

    return wp.kernel(left, name=f"diagonal_left_{types(real).name}", module=module, enable_backward=False)


@cache
def right(real, module):
    """Kernel over tiles (batch, rows, columns): y_out[b] = x[b] A."""

    def right(A: wp.array2d(dtype=real), x: wp.array3d(dtype=real), y_out: wp.array3d(dtype=real)):
        b, i, j = wp.tid()
        sum = wp.tile_zeros(shape=(ROWS, COLUMNS), dtype=real)
        for k in range((A.shape[0] + DEEP - 1) // DEEP):
            a = wp.tile_load(x[b], shape=(ROWS, DEEP), offset=(i * ROWS, k * DEEP))
            c = wp.tile_load(A, shape=(DEEP, COLUMNS), offset=(k * DEEP, j * COLUMNS))
            wp.tile_matmul(a, c, sum)
        wp.tile_store(y_out[b], sum, offset=(i * ROWS, j * COLUMNS))

    return wp.kernel(right, name=f"diagonal_right_{types(real).name}", module=module, enable_backward=False)


@cache
def divide(dim: int, real, module):
    """Kernel over cells: y over the sum of the eigenvalues of each axis, which stand one behind the other; 0 where that is
    below `least`."""
    f = functions(dim, real)

    def divide(n: wp.vec3i, values: wp.array(dtype=real), least: real, y_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, n)
        sum = values[i[0]] + values[n[0] + i[1]]
        if wp.static(dim == 3):
            sum += values[n[0] + n[1] + i[2]]
        y_out[c] = wp.where(sum > least, y_out[c] / sum, real(0.0))

    return wp.kernel(divide, name=f"diagonal_divide_{f.name}", module=module, enable_backward=False)
