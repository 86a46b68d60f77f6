"""Explicit steps on a CPU: one thread takes every spring once and adds its force to both ends, then moves the lower one.

    F = (k (1 - L / |r|) + k tau (n.dv~) / |r|) r,   r = (x_j - x_i) + (d_j - d_i),   f_i += F,  f_j -= F

and the points as kernels/explicit.py moves them. A spring stands at its lower end, so that once those of point i are taken no
other reads d_i or adds to f_i any more: i is moved in place, and a substep is one pass. In C++ with Clang's vectors, which any
CPU computes, since Warp's indexing of arrays costs several times the arithmetic: points are four wide (x, y, z, 0), and what a
spring reads and writes of its other end is one cache line of them; springs go in lots, where eight share a root and a division.
32 x 32 cloth, 5826 springs, a substep: 16 us in float32, 24 us in float64; one scalar spring after the other, and the points in
a second pass, took 38 and 37 us (Xeon with AVX-512 at about 2.5 GHz, least of many runs).
Coincident points have no direction to pull in: 0. It has no adjoint; gradients take the gathered kernels.
"""

from functools import cache

import warp as wp

from wsim.kernels.explicit import steps
from wsim.kernels.real import types
from wsim.kernels.spring import net

NEAR, OWN = ("x", "d", "q", "f"), ("v", "carry", "slip", "gw")      # of a point in the room; gw: gravity, inverse mass
STRIDE = 4 * len(NEAR)               # reals from point to point in the part of the room that springs read
LOT = 128              # springs that are taken together, unless one point has more: their r stay in the fastest cache
MOST = 2.0             # length over rest length from which an edge is suspect
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
    const int *start = s.start.data, *others = s.other.data;
    vec *near = (vec*)(((unsigned long long)room.data + 63) / 64 * 64);
    vec *own = near + 4 * n, *R = own + 4 * n, *U = R + s.lot + 8;
    {real}* P = ({real}*)(U + s.lot + 8);
"""

# Points p to q, whose springs are a lot: r of every spring, what it pulls with, and then point by point the sum f.
SPRINGS = """
        q = p + 1;
        while (q < n && start[q + 1] - start[p] <= s.lot) ++q;
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

WATCH = """if (t == count - 1)
                for (int l = 0; l < 8 && c + l < start[q]; ++l)
                    torn |= s.rest.data[c + l] > 0 && !(length[l] <= most * s.rest.data[c + l]);"""

PULL = """
    const {real} *X = (const {real}*)x.data, *D = (const {real}*)d.data + 3 * n * source, *V = D + 6 * n;
    for (int i = 0; i < n; ++i) {{
        vec* here = near + 4 * i;
        here[0] = load(X, i); here[1] = load(D, i); here[2] = load(V, i); here[3] = zero;
    }}
    for (int p = 0, q; p < n; p = q) {{
        {springs}
    }}
#endif
"""
KEEP = "store(({real}*)f_out.data, i, f);"

# Numbers below 1e-38 count as 0 meanwhile: what dies away along an axis without forces would take four times the time.
MARCH = """
    #if defined(__x86_64__)
    const unsigned modes = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(modes | 0x8040);
    #endif
    {real} *X = ({real}*)p.x.data, *E = ({real}*)p.d.data, *Q = ({real}*)p.q.data, *V = ({real}*)p.v.data,
           *C = ({real}*)p.carry.data, *S = ({real}*)p.slip.data;
    const int *object = c.object.data, pins = c.target.shape[1], count = step.count + (step.close > 0);
    const {real} most = {most};
    bool torn = false;
    for (int i = 0; i < n; ++i) {{
        vec *here = near + 4 * i, *mine = own + 4 * i;
        here[0] = load(X, i); here[1] = load(E, i); here[2] = load(Q, i); here[3] = zero;
        mine[0] = load(V, i); mine[1] = load(C, i); mine[2] = p.frame ? zero : load(S, i);
        mine[3] = load((const {real}*)c.gravity.data, object[i]); mine[3][3] = c.w.data[i];
    }}
    for (int t = 0; t < count; ++t) {{
        const bool closes = t == step.count;
        const {real} kick = closes ? step.close : t > 0 ? step.later : step.kick, drift = closes ? 0 : step.drift;
        const {real}* target = (const {real}*)c.target.data + 3 * pins * (step.row + t * step.stride);
        for (int p = 0, q; p < n; p = q) {{
            {springs}
        }}
    }}
    for (int i = 0; i < n; ++i) {{
        const vec *here = near + 4 * i, *mine = own + 4 * i, x1 = here[0] + here[1];
        if (p.frame) {{
            store(X, i, x1); store(E, i, (here[1] - (x1 - here[0])) + mine[2]);
        }} else {{
            store(E, i, here[1]); store(Q, i, here[2]); store(S, i, mine[2]);
        }}
        store(V, i, mine[0]); store(C, i, mine[1]);
    }}
    #if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(modes);
    #endif
    if (torn && p.frame && p.status.data[0] < 1) p.status.data[0] = 1;
#endif
"""
MOVE = """
            const vec x0 = here[0], d0 = here[1], v0 = here[2];
            vec* mine = own + 4 * i;
            here[3] = zero;
            if (mine[3][3] > 0) {{
                const vec g = __builtin_shufflevector(mine[3], zero, 0, 1, 2, 4);
                const vec a = mine[3][3] * f + g - c.decay.data[object[i]] * v0;
                const vec y = kick * a + mine[1], v = mine[0], v1 = v + y;
                mine[0] = v1;
                mine[1] = y - (v1 - v);
                const vec z = drift * v1 + mine[2], d1 = d0 + z;
                mine[2] = z - (d1 - d0);
                here[1] = d1;
                here[2] = v1 + step.ahead * a;
            }} else {{
                const int pin = c.pin.data[i];
                const vec d1 = drift > 0 && pin >= 0 ? load(target, pin) - x0 : d0;
                here[1] = d1;
                here[2] = (d1 - d0) / step.h;
                if (drift > 0) mine[0] = here[2];
            }}
"""


@cache
def list_of(real):
    """Struct of the springs, each once: reads only."""

    @wp.struct
    class List:
        start: wp.array(dtype=int)           # springs of which a point is the lower end: start[i]:start[i + 1], (points + 1,)
        lower: wp.array(dtype=int)           # STRIDE times the lower end, (springs,); only where points are uneven
        other: wp.array(dtype=int)           # STRIDE times the higher end, (springs,)
        rest: wp.array(dtype=real)           # length [m], (springs + EIGHT,)
        k: wp.array(dtype=real)              # [N/m], (springs + EIGHT,)
        damping: wp.array(dtype=real)        # k tau [N s/m], (springs + EIGHT,); only when damped
        lot: int                             # springs that are taken together at most, a multiple of EIGHT

    return List


@cache
def moving(real):
    """Struct of what changes, each (points,): read and written."""
    vec3 = types(real).vec3

    @wp.struct
    class Moving:
        x: wp.array(dtype=vec3)              # position at the start of the frame [m]
        d: wp.array(dtype=vec3)              # displacement since then [m]
        q: wp.array(dtype=vec3)              # velocity that damping sees [m/s]
        v: wp.array(dtype=vec3)              # velocity [m/s]
        carry: wp.array(dtype=vec3)          # remainder of v
        slip: wp.array(dtype=vec3)           # remainder of d
        status: wp.array(dtype=int)          # becomes at least 1 where a spring ends longer than MOST times its rest length
        frame: int                           # 1: the call takes a frame, d is the remainder of x before it and after; no slip

    return Moving


def lot(most: int) -> int:
    """`List.lot` where a point is the lower end of so many springs at most."""
    return EIGHT * -(-max(LOT, most) // EIGHT)


def room(real, points: int, lot: int, device) -> wp.array:
    """Room for points in the layout above, and for r, differences of velocities and pulls of a lot."""
    return wp.zeros(points * (len(NEAR) + len(OWN)) + 3 * (lot + EIGHT) + LINE, dtype=types(real).vec4, device=device)


def _code(text: str, then: str, real, damped: bool, even: bool, watch: str = "") -> str:
    """The C++ of `text`, with the springs in it, `watch` after lots of them, and `then` after those of each point."""
    name = "float" if real is wp.float32 else "double"
    gather = GATHER[even].format(real=name, apart=APART if damped else "")
    scatter = SCATTER[even].format(real=name, then=then.format(real=name))
    springs = SPRINGS.format(real=name, gather=gather, scatter=scatter, damping=DAMPING if damped else "", watch=watch)
    return ROOM.format(real=name) + text.format(real=name, springs=springs, most=MOST)


@cache
def pull(real, module, damped: bool, even: bool):
    """Kernel, launched over 1: the sums of the springs' forces [N], the first n entries of f, where elements have forces too.
    d as in kernels/explicit.py."""
    vec3, vec4, List = types(real).vec3, types(real).vec4, list_of(real)

    @wp.func_native(_code(PULL, KEEP, real, damped, even))
    def springs(n: int, s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, f_out: wp.array(dtype=vec3),
                room: wp.array(dtype=vec4)): ...

    @wp.kernel(module=module, enable_backward=False)
    def pull(s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, f_out: wp.array(dtype=vec3),
             room_out: wp.array(dtype=vec4)):
        springs(x.shape[0], s, x, d, source, f_out, room_out)

    return pull


@cache
def march(real, module, damped: bool, even: bool):
    """Kernel, launched over 1: `Step.count` substeps of kicks and drifts, and a last kick where `Step.close` is not 0."""
    vec4, List, Net, Step, Moving = types(real).vec4, list_of(real), net(real), steps(real), moving(real)

    @wp.func_native(_code(MARCH, MOVE, real, damped, even, WATCH))
    def substeps(n: int, c: Net, s: List, step: Step, p: Moving, room: wp.array(dtype=vec4)): ...

    @wp.kernel(module=module, enable_backward=False)
    def march(c: Net, s: List, step: Step, p_out: Moving, room_out: wp.array(dtype=vec4)):
        substeps(p_out.x.shape[0], c, s, step, p_out, room_out)

    return march
