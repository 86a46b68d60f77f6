"""Values of a grid between its rows, where all rows that count are within: the hot spots of advection, in plain code.

    between     linear, of 2^dim rows
    patch       tensor product of cubics through four rows (Lagrange; order 4), of 4^dim rows; `limited`: kept within the 2^dim
                in the middle (Fedkiw, Stam, Jensen 2001 clamp slopes; here the value, as Selle et al. 2008 do)

q is read through its pointer: rows stand one behind the other, those of the last axis next to each other. Through Warp's
arrays, whose strides are known only when it runs, a CPU takes 2.3 times as long for a patch, 1.9 times for a cell.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types

BETWEEN = {3: """
    typedef TYPE R;
    const R* p = q.data + first;
    const R* r = p + one;
    const R fx = f[0], fy = f[1], fz = f[2], gx = (R)1 - fx, gy = (R)1 - fy, gz = (R)1 - fz;
    return gx * (gy * (gz * p[0] + fz * p[1]) + fy * (gz * p[two] + fz * p[two + 1]))
         + fx * (gy * (gz * r[0] + fz * r[1]) + fy * (gz * r[two] + fz * r[two + 1]));
""", 2: """
    typedef TYPE R;
    const R* p = q.data + first;
    const R* r = p + one;
    const R fx = f[0], fy = f[1], gx = (R)1 - fx, gy = (R)1 - fy;
    return gx * (gy * p[0] + fy * p[1]) + fx * (gy * r[0] + fy * r[1]);
"""}

PATCH = """
    typedef TYPE R;
    const R* p = q.data + first;
    R w[DIM][4];
    for (int a = 0; a < DIM; ++a) {
        const R e = f[a], m = e - (R)1, n = e - (R)2, l = e + (R)1, sixth = (R)1 / (R)6;
        w[a][0] = -e * m * n * sixth;
        w[a][1] = l * m * n * (R)0.5;
        w[a][2] = -l * e * n * (R)0.5;
        w[a][3] = l * e * m * sixth;
    }
    R s0 = 0, s1 = 0, s2 = 0, s3 = 0, least = p[one + (DIM == 3 ? two : 0) + 1], most = least;
    for (int a = 0; a < 4; ++a) {
        R t0 = 0, t1 = 0, t2 = 0, t3 = 0;
        for (int b = 0; b < (DIM == 3 ? 4 : 1); ++b) {
            const R* r = p + a * one + b * two;
            const R v = DIM == 3 ? w[1][b] : (R)1;
            t0 += v * r[0]; t1 += v * r[1]; t2 += v * r[2]; t3 += v * r[3];
            if (LIMITED && (a == 1 || a == 2) && (DIM == 2 || b == 1 || b == 2)) {
                const R low = r[1] < r[2] ? r[1] : r[2], high = r[1] < r[2] ? r[2] : r[1];
                least = low < least ? low : least;
                most = high > most ? high : most;
            }
        }
        const R u = w[0][a];
        s0 += u * t0; s1 += u * t1; s2 += u * t2; s3 += u * t3;
    }
    const R* z = w[DIM - 1];
    const R value = z[0] * s0 + z[1] * s1 + z[2] * s2 + z[3] * s3;
    if (!LIMITED) return value;
    return value < least ? least : value > most ? most : value;
"""


def sampling_source(text: str, dim: int, real, limited: bool = False) -> str:
    kind = "float" if real is wp.float32 else "double"
    return text.replace("TYPE", kind).replace("DIM", str(dim)).replace("LIMITED", str(int(limited)))


@cache
def native_samplers(dim: int, real) -> SimpleNamespace:
    """Functions (q, first, one, two, f) -> value: between, patch, limited. first: lowest row; one, two: to the next row along
    the first axis and, in three dimensions, the second; f: fractions along the axes from the row in the middle, 0 .. 1."""
    t = types(real)

    @wp.func_native(sampling_source(BETWEEN[dim], dim, real))
    def native_linear_sample(q: wp.array(dtype=real), first: int, one: int, two: int, f: t.vec3) -> real:
        ...

    @wp.func_native(sampling_source(PATCH, dim, real))
    def native_cubic_patch(q: wp.array(dtype=real), first: int, one: int, two: int, f: t.vec3) -> real:
        ...

    @wp.func_native(sampling_source(PATCH, dim, real, True))
    def native_limited_cubic(q: wp.array(dtype=real), first: int, one: int, two: int, f: t.vec3) -> real:
        ...

    return SimpleNamespace(between=native_linear_sample, patch=native_cubic_patch, limited=native_limited_cubic)
