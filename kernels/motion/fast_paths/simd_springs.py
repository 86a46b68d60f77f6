"""Springs on a CPU: every one is taken once, and its force added to both ends.

    F = (k (1 - L / |r|) + k tau (n.dv~) / |r|) r,   r = (x_i - x_j) + (d_i - d_j),   f_i -= F,  f_j += F

In C++ with Clang's vectors, which any CPU computes, since Warp's indexing of arrays costs several times the arithmetic: points
are four wide (x, y, z, and what nobody reads) and move by two, springs go in packets of EIGHT, which share a root and a
division. Points stand in groups of EIGHT, and blocks are groups whose springs come together: those with the same distance from
end to end, of most points of a group, are a run, read and written by vectors and without indices, and its missing lanes pull
at nothing; the others are loose, and neighbours among them have no point in common, whose sum one would wait for
(wsim/physics/motion/fast_paths/simd_springs.py). x_i - x_j stays for a frame. Coincident points have no direction to pull in:
0. The text goes into the functions of kernels/motion/fast_paths/march_cpu.py. It has no adjoint; gradients take the gathered
kernels.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

EIGHT = 8              # points of a group, springs of a packet
FOUR = 4               # reals of a point
ROWS = 8               # of the room, each of all places: see ROOM
LANES = (0, 2, 4, 6, 1, 3, 5, 7)       # which spring of a packet has rest, k and damping of each lane
LINE = 64 // 16        # points of float32 in a cache line, with which the room begins

# Of points: four wide, two of them, eight springs, and how these are turned into each other.
VECTORS = """
#if !defined(__CUDA_ARCH__)
    typedef {real} vec __attribute__((vector_size(4 * sizeof({real}))));
    typedef {real} vec4u __attribute__((vector_size(4 * sizeof({real})), aligned(sizeof({real}))));
    typedef {real} eight __attribute__((vector_size(8 * sizeof({real}))));
    typedef {real} entries __attribute__((vector_size(8 * sizeof({real})), aligned(sizeof({real}))));
    typedef {real} two __attribute__((vector_size(8 * sizeof({real})), aligned(4 * sizeof({real}))));
    struct Columns {{ eight x, y, z; }};
    const vec zero = {{}};
    const eight none = {{}};
    auto load = [](const {real}* a, int i) {{ return vec{{a[3 * i], a[3 * i + 1], a[3 * i + 2], 0}}; }};
    auto store = []({real}* a, int i, vec v) {{ a[3 * i] = v[0]; a[3 * i + 1] = v[1]; a[3 * i + 2] = v[2]; }};
    auto at = [](vec* row, int i) -> two& {{ return *(two*)(row + i); }};
    auto end = [](vec* row, unsigned reals) -> vec& {{ return *(vec*)(({real}*)row + reals); }};
    auto pair = [](vec a, vec b) {{ return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7); }};
    auto first = [](eight a) {{ return __builtin_shufflevector(a, a, 0, 1, 2, 3); }};
    auto second = [](eight a) {{ return __builtin_shufflevector(a, a, 4, 5, 6, 7); }};
    auto columns = [](const eight* r) {{                                                   // lanes 0 2 4 6, 1 3 5 7
        const eight a = __builtin_shufflevector(r[0], r[1], 0, 8, 1, 9, 4, 12, 5, 13);     // xxyy xxyy
        const eight b = __builtin_shufflevector(r[2], r[3], 0, 8, 1, 9, 4, 12, 5, 13);
        const eight c = __builtin_shufflevector(r[0], r[1], 2, 10, 3, 11, 6, 14, 7, 15);   // zz.. zz..
        const eight d = __builtin_shufflevector(r[2], r[3], 2, 10, 3, 11, 6, 14, 7, 15);
        return Columns{{__builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13),
                        __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15),
                        __builtin_shufflevector(c, d, 0, 1, 8, 9, 4, 5, 12, 13)}};
    }};
"""
# Rows: displacement, force, position, velocity that damping sees, velocity, remainders of both, gravity with inverse mass
ROOM = VECTORS + """
    struct Ends {{ unsigned low, high; }};
    const int blocks = s.start.shape[0] - 1, places = s.order.shape[0], *order = s.order.data, *group = s.group.data,
              *runs = s.runs.data, *start = s.start.data;
    const Ends* ends = (const Ends*)s.ends.data;
    vec *D = (vec*)(((unsigned long long)room.data + 63) / 64 * 64), *F = D + s.row, *X = F + s.row, *Q = X + s.row,
        *V = Q + s.row, *C = V + s.row, *S = C + s.row, *G = S + s.row, *E = G + s.row;
    bool torn = false, watched = false;
    auto pull = [&](eight* r, const eight* u, int c) {{                                    // r becomes F
        const Columns a = columns(r);
        const eight rest = *(const entries*)(s.rest.data + c);
        const eight length = __builtin_elementwise_sqrt(a.x * a.x + a.y * a.y + a.z * a.z);
        const eight over = length > 0 ? 1 / length : none;
        eight by = *(const entries*)(s.k.data + c) * (length - rest) * over;
        {damping}
        {watch}
        r[0] *= __builtin_shufflevector(by, by, 0, 0, 0, 0, 4, 4, 4, 4);
        r[1] *= __builtin_shufflevector(by, by, 1, 1, 1, 1, 5, 5, 5, 5);
        r[2] *= __builtin_shufflevector(by, by, 2, 2, 2, 2, 6, 6, 6, 6);
        r[3] *= __builtin_shufflevector(by, by, 3, 3, 3, 3, 7, 7, 7, 7);
    }};
"""
DAMPING = """const Columns b = columns(u);
        by += *(const entries*)(s.damping.data + c) * over * over * (a.x * b.x + a.y * b.y + a.z * b.z);"""

# What does not change while x stays.
APART = """
    for (int e = 0; e < start[blocks]; ++e) E[e] = end(X, ends[e].low) - end(X, ends[e].high);
"""
# The springs of block b: the runs of its groups, and those that are loose.
SPRINGS = """
        int e = start[b];
        for (int g = group[b]; g < group[b + 1]; ++g) {{
            if (runs[g] == 0) continue;
            eight d[4], q[4], f[4] = {{none, none, none, none}};
            for (int l = 0; l < 4; ++l) {{ d[l] = at(D, 8 * g + 2 * l); q[l] = at(Q, 8 * g + 2 * l); }}
            for (int run = runs[g]; run > 0; --run, e += 8) {{
                const int j = ends[e].high / 4;
                eight r[4], u[4];
                for (int l = 0; l < 4; ++l) {{
                    r[l] = at(E, e + 2 * l) + (d[l] - at(D, j + 2 * l));
                    u[l] = q[l] - at(Q, j + 2 * l);
                }}
                pull(r, u, e);
                for (int l = 0; l < 4; ++l) {{ f[l] += r[l]; at(F, j + 2 * l) += r[l]; }}
            }}
            for (int l = 0; l < 4; ++l) at(F, 8 * g + 2 * l) -= f[l];
        }}
        for (; e < start[b + 1]; e += 8) {{
            eight r[4], u[4];
            for (int l = 0; l < 4; ++l) {{
                const Ends m = ends[e + 2 * l], o = ends[e + 2 * l + 1];
                r[l] = at(E, e + 2 * l) + pair(end(D, m.low) - end(D, m.high), end(D, o.low) - end(D, o.high));
                u[l] = pair(end(Q, m.low) - end(Q, m.high), end(Q, o.low) - end(Q, o.high));
            }}
            pull(r, u, e);
            for (int l = 0; l < 4; ++l) {{
                const Ends m = ends[e + 2 * l], o = ends[e + 2 * l + 1];
                end(F, m.low) -= first(r[l]);
                end(F, m.high) += first(r[l]);
                end(F, o.low) -= second(r[l]);
                end(F, o.high) += second(r[l]);
            }}
        }}
"""


@cache
def list_of(real):
    """Struct of the springs, each once: reads only."""

    @wp.struct
    class List:
        order: wp.array(dtype=int)           # point of each place in the arrays, or -1, (places,)
        group: wp.array(dtype=int)           # first group of each block, (blocks + 1,)
        runs: wp.array(dtype=int)            # of each group, (places / EIGHT,)
        start: wp.array(dtype=int)           # first slot of each block, (blocks + 1,)
        ends: wp.array(dtype=wp.uint64)      # FOUR times the place of the lower end, and 2^32 times that of the other, (slots,)
        rest: wp.array(dtype=real)           # length [m], (slots,)
        k: wp.array(dtype=real)              # [N/m], (slots,)
        damping: wp.array(dtype=real)        # k tau [N s/m], (slots,); only when damped
        row: int                             # places from row to row of the room

    return List


def padded_row_length(places: int) -> int:
    """`List.row`: at least one place more; from row to row no multiple of a page, or loads wait for what is stored at the same
    place of another (64 x 64 cloth: 7 % of the time)."""
    return (places + 63) // 128 * 128 + 72


def march_buffer(real, row: int, slots: int, device) -> wp.array:
    """Room for the rows, and for x_i - x_j of each slot."""
    return wp.zeros(ROWS * row + slots + LINE, dtype=types(real).vec4, device=device)


def packet_code(text: str, real, damped: bool, watch: str = "", texts: dict | None = None) -> str:
    """The C++ of `text`, with the springs of block b in it, `watch` after the lengths of a packet, and other pieces by name."""
    name = "float" if real is wp.float32 else "double"
    room = ROOM.format(real=name, damping=DAMPING if damped else "", watch=watch)
    return room + text.format(real=name, springs=SPRINGS.format(), apart=APART.format(), **(texts or {}))
