"""Springs on a CPU: every one is taken once, and its force added to both ends.

    F = (k (1 - L / |r|) + k tau (n.dv~) / |r|) r,   r = (x_j - x_i) + (d_j - d_i),   f_i += F,  f_j -= F

A spring stands at its lower end. In C++ with Clang's vectors, which any CPU computes, since Warp's indexing of arrays costs
several times the arithmetic: points are four wide (x, y, z, 0), and what a spring reads and writes of its other end is one
cache line of them; springs go in lots, where eight share a root and a division. Coincident points have no direction to pull
in: 0. The text goes into the functions of kernels/march.py. It has no adjoint; gradients take the gathered kernels.
"""

from functools import cache

import warp as wp

from wsim.kernels.real import types

NEAR, OWN = ("x", "d", "q", "f"), ("v", "carry", "slip", "gw")      # of a point in the room; gw: gravity, inverse mass
STRIDE = 4 * len(NEAR)               # reals from point to point in the part of the room that springs read
LOT = 128              # springs that are taken together, unless one point has more: their r stay in the fastest cache
LINE = 64 // 16        # points of float32 in a cache line, with which the room begins: else runs differ by 1.7 times
EIGHT = 8              # of them share a root and a division; so many entries past the last are read and left alone

ROOM = """
#if !defined(__CUDA_ARCH__)
    typedef {real} vec __attribute__((vector_size(4 * sizeof({real}))));
    typedef {real} eight __attribute__((vector_size(8 * sizeof({real}))));
    typedef {real} entries __attribute__((vector_size(8 * sizeof({real})), aligned(sizeof({real}))));
    struct Columns {{ eight x, y, z; }};
    const vec zero = {{}};
    auto load = [](const {real}* a, int i) {{ return vec{{a[3 * i], a[3 * i + 1], a[3 * i + 2], 0}}; }};
    auto store = []({real}* a, int i, vec v) {{ a[3 * i] = v[0]; a[3 * i + 1] = v[1]; a[3 * i + 2] = v[2]; }};
    auto pair = [](vec a, vec b) {{ return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7); }};
    auto columns = [&](const vec* r) {{
        const eight a = pair(r[0], r[4]), b = pair(r[1], r[5]), c = pair(r[2], r[6]), d = pair(r[3], r[7]);
        const eight ac = __builtin_shufflevector(a, c, 0, 8, 1, 9, 4, 12, 5, 13);          // xxyy xxyy
        const eight bd = __builtin_shufflevector(b, d, 0, 8, 1, 9, 4, 12, 5, 13);
        const eight za = __builtin_shufflevector(a, c, 2, 10, 3, 11, 6, 14, 7, 15);        // zz00 zz00
        const eight zb = __builtin_shufflevector(b, d, 2, 10, 3, 11, 6, 14, 7, 15);
        return Columns{{__builtin_shufflevector(ac, bd, 0, 8, 1, 9, 4, 12, 5, 13),
                        __builtin_shufflevector(ac, bd, 2, 10, 3, 11, 6, 14, 7, 15),
                        __builtin_shufflevector(za, zb, 0, 8, 1, 9, 4, 12, 5, 13)}};
    }};
    const int *start = s.start.data, *others = s.other.data, *order = s.order.data;
    vec *near = (vec*)(((unsigned long long)room.data + 63) / 64 * 64), *own = near + 4 * n;
"""

# Points p to q, whose springs are a lot: r of every spring, what it pulls with, and then point by point the sum f.
SPRINGS = """
        q = p + 1;
        while (q < end && start[q + 1] - start[p] <= s.lot) ++q;
        vec *r = R, *u = U;
        {gather}
        r = R; u = U; {real}* pull = P;
        for (int c = start[p]; c < start[q]; c += 8, r += 8, u += 8, pull += 8) {{
            const Columns a = columns(r);
            const eight length = __builtin_elementwise_sqrt(a.x * a.x + a.y * a.y + a.z * a.z);
            const eight over = length > 0 ? 1 / length : eight{{}};
            eight by = *(const entries*)(s.k.data + c) * (length - *(const entries*)(s.rest.data + c)) * over;
            {damping}
            {watch}
            *(eight*)pull = by;
        }}
        r = R; pull = P;
        {scatter}
"""
# The two ways to visit springs, the same sums in the same order: point by point, what points have in registers; or spring by
# spring, where numbers of springs change from point to point and the end of an inner loop is guessed wrong each time. The
# cloth above: 0.94 ms a frame of 55 substeps against 1.2; a garment's mesh of 19k springs: 128 ms of 857 substeps against 73.
GATHER = {
    True: """
        for (int i = p; i < q; ++i) {{
            const vec *here = near + 4 * i, x0 = here[0], d0 = here[1];
            for (int c = start[i], end = start[i + 1]; c < end; ++c) {{
                const vec* other = (vec*)(({real}*)near + others[c]);
                *r++ = (x0 - other[0]) + (d0 - other[1]);
                {apart}
            }}
        }}""",
    False: """
        for (int c = start[p], end = start[q]; c < end; ++c) {{
            const vec *here = (vec*)(({real}*)near + s.lower.data[c]), *other = (vec*)(({real}*)near + others[c]);
            *r++ = (here[0] - other[0]) + (here[1] - other[1]);
            {apart}
        }}""",
}
SCATTER = {
    True: """
        for (int i = p; i < q; ++i) {{
            vec* here = near + 4 * i;
            vec f = here[3];
            for (int c = start[i], end = start[i + 1]; c < end; ++c, ++r, ++pull) {{
                const vec F = *pull * *r;
                f -= F;
                ((vec*)(({real}*)near + others[c]))[3] += F;
            }}
            {then}
        }}""",
    False: """
        for (int c = start[p], end = start[q]; c < end; ++c, ++r, ++pull) {{
            const vec F = *pull * *r;
            ((vec*)(({real}*)near + s.lower.data[c]))[3] -= F;
            ((vec*)(({real}*)near + others[c]))[3] += F;
        }}
        for (int i = p; i < q; ++i) {{
            vec* here = near + 4 * i;
            const vec f = here[3];
            {then}
        }}""",
}
APART = "*u++ = here[2] - other[2];"
DAMPING = """const Columns b = columns(u);
            by += *(const entries*)(s.damping.data + c) * over * over * (a.x * b.x + a.y * b.y + a.z * b.z);"""

# Where r, differences of velocities and pulls of a lot stand.
SCRATCH = """
    vec *R = own + 4 * n + 3 * (s.lot + 8) * rank, *U = R + s.lot + 8;
    {real}* P = ({real}*)(U + s.lot + 8);
"""


@cache
def list_of(real):
    """Struct of the springs, each once: reads only."""

    @wp.struct
    class List:
        order: wp.array(dtype=int)           # points as they stand here, by their places in the arrays, (points,)
        start: wp.array(dtype=int)           # springs of which a point is the lower end: start[i]:start[i + 1], (points + 1,)
        lower: wp.array(dtype=int)           # STRIDE times the lower end, (springs,); only where points are uneven
        other: wp.array(dtype=int)           # STRIDE times the higher end, (springs,)
        rest: wp.array(dtype=real)           # length [m], (springs + EIGHT,)
        k: wp.array(dtype=real)              # [N/m], (springs + EIGHT,)
        damping: wp.array(dtype=real)        # k tau [N s/m], (springs + EIGHT,); only when damped
        lot: int                             # springs that are taken together at most, a multiple of EIGHT

    return List


def lot(most: int) -> int:
    """`List.lot` where a point is the lower end of so many springs at most."""
    return EIGHT * -(-max(LOT, most) // EIGHT)


def room(real, points: int, lot: int, threads: int, device) -> wp.array:
    """Room for points in the layout above, and for r, differences of velocities and pulls of a lot of each thread."""
    size = points * (len(NEAR) + len(OWN)) + 3 * (lot + EIGHT) * threads + LINE
    return wp.zeros(size, dtype=types(real).vec4, device=device)


def code(text: str, then: str, real, damped: bool, even: bool, watch: str = "", **texts) -> str:
    """The C++ of `text`, with the springs of points p to q in it, `watch` after a lot of them, `then` after those of a point,
    and other pieces by name. What stands about them says n, the number of points, and end, where q stops."""
    name = "float" if real is wp.float32 else "double"
    gather = GATHER[even].format(real=name, apart=APART if damped else "")
    scatter = SCATTER[even].format(real=name, then=then.format(real=name))
    springs = SPRINGS.format(real=name, gather=gather, scatter=scatter, damping=DAMPING if damped else "", watch=watch)
    scratch = SCRATCH.format(real=name)
    return ROOM.format(real=name) + text.format(real=name, springs=springs, scratch=scratch, **texts)
