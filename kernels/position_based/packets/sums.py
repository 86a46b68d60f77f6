"""Sums over the neighbours of eight particles of a fluid together, on a CPU: a lane each (Clang's vectors).

The formulas are those of one particle (pair_sums.py). Particles with numbers behind each other have lists behind each other.
Lanes do not see each other, so that bits do not depend on what stands beside. A lane that has a pair in one place says so, and
is left to the function of one particle, which gives such a pair a direction. 20 480 particles with 38 entries each take
2.1 ms for pushes and 1.9 for densities; 12 ms one by one (a core of a Xeon).
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets import LANES
from wsim.kernels.position_based.pair_sums import MOST_RUBBED, NEAREST, REACHED, RUB, SLOPE, WEIGHT, pair_sums

# Of eight particles from `first` on: `row(a, j)`, columns of four numbers of them; `each(s, work)` calls work for every slot.
PACKET = """
#if !defined(__CUDA_ARCH__)
    typedef {real} R;
    typedef R four __attribute__((vector_size(4 * sizeof(R)), aligned(sizeof(R))));
    typedef R eight __attribute__((vector_size(8 * sizeof(R))));
    typedef {whole} flags __attribute__((vector_size(8 * sizeof(R))));
    struct Columns {{ eight x, y, z, w; }};
    const eight none = {{}};
    const flags no = {{}};
    const int size = lists.size, last = size - 1;
    const R H = R({reached}) * d, one = R(1) / H, HH = H * H;
    int k[8], most = 0;
    flags count;
    for (int l = 0; l < 8; ++l) {{
        k[l] = first + l < size ? first + l : last;
        const int own = first + l < size ? lists.count.data[first + l] : 0;
        count[l] = own;
        most = own > most ? own : most;
    }}
    auto rows = [](const void* a, const int* j) {{
        const four* p = (const four*)a;
        eight r[4];
        for (int l = 0; l < 4; ++l) r[l] = __builtin_shufflevector(p[j[l]], p[j[l + 4]], 0, 1, 2, 3, 4, 5, 6, 7);
        const eight a0 = __builtin_shufflevector(r[0], r[1], 0, 8, 1, 9, 4, 12, 5, 13);
        const eight b0 = __builtin_shufflevector(r[2], r[3], 0, 8, 1, 9, 4, 12, 5, 13);
        const eight a2 = __builtin_shufflevector(r[0], r[1], 2, 10, 3, 11, 6, 14, 7, 15);
        const eight b2 = __builtin_shufflevector(r[2], r[3], 2, 10, 3, 11, 6, 14, 7, 15);
        return Columns{{__builtin_shufflevector(a0, b0, 0, 1, 8, 9, 4, 5, 12, 13),
                        __builtin_shufflevector(a0, b0, 2, 3, 10, 11, 6, 7, 14, 15),
                        __builtin_shufflevector(a2, b2, 0, 1, 8, 9, 4, 5, 12, 13),
                        __builtin_shufflevector(a2, b2, 2, 3, 10, 11, 6, 7, 14, 15)}};
    }};
    flags met = no;
    const Columns own = rows({at}.data, k);
    eight {sums};
    for (int s = 0; s < most; ++s) {{
        int j[8];
        const int* list = lists.other.data + (long long)s * size;
        for (int l = 0; l < 8; ++l) j[l] = list[k[l]];
        const Columns far = rows({at}.data, j);
        const eight x = own.x - far.x, y = own.y - far.y, z = own.z - far.z, rr = x * x + y * y + z * z;
        const flags near = (rr < HH) & (s < count);
        met |= near & (rr == 0);
        const eight r = __builtin_elementwise_sqrt(rr), over = (near & (rr > 0)) ? 1 / r : none;
        const eight q = near ? 1 - r * one : none, qq = q * q;
        {work}
    }}
    wp::mat_t<8, 8, R> found;
    const eight column[8] = {{{columns}, met != 0 ? none + 1 : none}};
    for (int l = 0; l < 8; ++l) for (int c = 0; c < 8; ++c) found.data[l][c] = column[c][l];
    return found;
#else
    return wp::mat_t<8, 8, {real}>();
#endif
"""
DENSITY = {"at": "at", "sums": "W = none + 1, X = none, Y = none, Z = none, S = none", "columns":
           "R({weight}) * W, R({slope}) * one * X, R({slope}) * one * Y, R({slope}) * one * Z, "
           "R({slope}) * R({slope}) * one * one * S, none, none", "work": """
        const eight by = qq * over;
        W += qq * q; X += by * x; Y += by * y; Z += by * z; S += qq * qq;"""}
PUSH = {"at": "at", "sums": "X = none, Y = none, Z = none, A = none, B = none, C = none", "columns":
        "R({slope}) * one * X, R({slope}) * one * Y, R({slope}) * one * Z, A, B, C, none", "work": """
        const eight by = (own.w + far.w) * qq * over, gap = R({nearest}) * d - r, part = (near & (gap > 0)) ? gap * over : none;
        X += by * x; Y += by * y; Z += by * z; A += part * x; B += part * y; C += part * z;"""}
FLOW = {"at": "y", "sums": "X = none, Y = none, Z = none", "columns": "X, Y, Z, none, none, none, none", "work": """
        const Columns u = rows(v.data, k), o = rows(v.data, j);
        const eight rubbed = R({rub}) * h * (own.w + far.w) * one * qq * over;
        const eight a = o.x - u.x, b = o.y - u.y, c = o.z - u.z, rub = rubbed < R({most}) ? rubbed : none + R({most});
        const eight along = R(1.5) * R({weight}) * (u.w + o.w) * qq * q * (a * x + b * y + c * z) * over * over;
        const flags apart = near & (rr > 0);
        X += apart ? rub * a + along * x : none; Y += apart ? rub * b + along * y : none;
        Z += apart ? rub * c + along * z : none;"""}


@cache
def packet_sums(real) -> SimpleNamespace:
    """The functions of `pair_sums` for LANES particles from k on, on a CPU: a matrix with a row of each, in which the last
    number is 1 where pairs in one place leave the row to `pair_sums`."""
    t, N = types(real), neighbour_structs(real)
    places, found = wp.array(dtype=t.vec4), wp.types.matrix((LANES, 8), real)
    numbers = {"weight": WEIGHT, "slope": SLOPE, "nearest": NEAREST, "rub": RUB, "most": MOST_RUBBED}
    names = {"real": "float", "whole": "int"} if real is wp.float32 else {"real": "double", "whole": "long long"}

    def packet_code(how: dict[str, str]) -> str:
        return PACKET.format(reached=REACHED, **names, **{name: text.format(**numbers) for name, text in how.items()})

    @wp.func_native(packet_code(DENSITY))
    def density_of_packet(at: places, lists: N.PairLists, first: int, d: real) -> found: ...

    @wp.func_native(packet_code(PUSH))
    def push_of_packet(at: places, lists: N.PairLists, first: int, d: real) -> found: ...

    @wp.func_native(packet_code(FLOW))
    def flow_of_packet(y: places, v: places, lists: N.PairLists, first: int, d: real, h: real) -> found: ...

    return SimpleNamespace(density=density_of_packet, push=push_of_packet, flow=flow_of_packet)


@cache
def row_sums(lanes: int, real) -> SimpleNamespace:
    """The functions of `packet_sums` for one particle (lanes 1) or LANES of them, pairs in one place included."""
    t, N, one = types(real), neighbour_structs(real), pair_sums(real)
    places, found = wp.array(dtype=t.vec4), wp.types.matrix((lanes, 8), real)
    packet = packet_sums(real) if lanes > 1 else None
    single = lanes == 1

    @wp.func
    def density_of_rows(at: places, lists: N.PairLists, first: int, d: real):
        out = found()
        if wp.static(not single):
            out = packet.density(at, lists, first, d)
        for m in range(wp.static(lanes)):
            if wp.static(single) or out[m, 7] != real(0.0):
                weight, G, square = one.density(at, lists, first + m, d)
                out[m, 0] = weight
                out[m, 1] = G[0]
                out[m, 2] = G[1]
                out[m, 3] = G[2]
                out[m, 4] = square
        return out

    @wp.func
    def push_of_rows(at: places, lists: N.PairLists, first: int, d: real):
        out = found()
        if wp.static(not single):
            out = packet.push(at, lists, first, d)
        for m in range(wp.static(lanes)):
            if wp.static(single) or out[m, 7] != real(0.0):
                move, apart = one.push(at, lists, first + m, d)
                out[m, 0] = move[0]
                out[m, 1] = move[1]
                out[m, 2] = move[2]
                out[m, 3] = apart[0]
                out[m, 4] = apart[1]
                out[m, 5] = apart[2]
        return out

    @wp.func
    def flow_of_rows(y: places, v: places, lists: N.PairLists, first: int, d: real, h: real):
        out = found()
        if wp.static(not single):
            out = packet.flow(y, v, lists, first, d, h)
        else:
            given = one.flow(y, v, lists, first, d, h)
            for a in range(3):
                out[0, a] = given[a]
        return out

    return SimpleNamespace(density=density_of_rows, push=push_of_rows, flow=flow_of_rows)
