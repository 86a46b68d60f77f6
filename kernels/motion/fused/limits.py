"""Strain limits of sheets within frames of one launch (kernels/motion/fused/march.py): the sweep over coloured edges of
kernels/solver/xpbd.py, by the blocks that share the sheet, in CUDA.

    C = |(x1 - x0) + (d1 - d0)| - l > 0:    dlam = C / ((w0 + w1) |G|^2),   d0 += w0 dlam G,   d1 -= w1 dlam G

    x places where the substep began [m]    d displacements since [m]    l longest [m]    w [1/kg]    G direction of the edge

A block takes all edges at its points, one colour after the other; an edge between points of two blocks is taken by both, alike.
What edges that it does not take do to such a guest before it takes one again, the owner of the guest writes it (a letter), each
letter to a place of its own: nobody writes what may still be read. A sweep begins with the places of all guests, so that
neighbours are never a sweep apart; those have two places each, in turn. At the end of a colour the threads of a block wait for
each other, and for the letters of that colour. Lists: `wsim.physics.motion.fused.limits`.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.domain_decomposition import sheet_patch_table
from wsim.kernels.motion.fused.own import thread_points

LISTS = ("edge", "joint", "source", "colour", "arrive", "letter_begin", "letter", "first_begin", "first", "guest")
BLOCK, SLOT = 1, 11    # first bits of the block and of the place in a letter; bit 0: the end of the edge that it is about
ROOM = """
    constexpr int GUEST = S + INBOX;                                // first place of a sweep's beginning
    const unsigned colour_gates = (unsigned)__cvta_generic_to_shared(push + PUSHES);
    float4* const Y = (float4*)(push + PUSHES) + (COLOURS + 3) / 2;   // displacements in the substep; letters
    float* const weight = (float*)(Y + S + INBOX + 2 * GUESTS);
    float* const longest = weight + S;
    uint2* const joint = (uint2*)(longest + EDGES);                 // places of an edge's ends, and where they are read
    int* const colour = (int*)(joint + EDGES);
    int* const arrive = colour + COLOURS + 1;
    int* const letter_begin = arrive + COLOURS + 1;
    int* const letter = letter_begin + EDGES + 1;
    int* const first_begin = letter + LETTERS;
    int* const first = first_begin + OWN + 1;
"""
FILL = """
    const int t = THREAD;
    const int *const head = limits.head.data + 2 * KINDS * RANK, *const list = limits.list.data;
    const int *const points = h.list.data + h.head.data[2 * LISTS * RANK], there = h.head.data[2 * LISTS * RANK + 1];
    auto at = [=](int k, int i) { return list[head[2 * k] + i]; };
    for (int i = t; i < there; i += THREADS) weight[i] = c.w.data[points[i]];
    for (int e = t; e < head[1]; e += THREADS) {
        longest[e] = limits.longest.data[at(0, e)];
        joint[e] = make_uint2(at(1, e), at(2, e));
    }
    auto copy = [=](int k, int* into) { for (int i = t; i < head[2 * k + 1]; i += THREADS) into[i] = at(k, i); };
    copy(3, colour); copy(4, arrive); copy(5, letter_begin); copy(6, letter); copy(7, first_begin); copy(8, first);
    if (t == 0 && !GRID)
        for (int b = 0; b < COLOURS + 2; ++b)
            asm volatile("mbarrier.init.shared::cta.b64 [%0], %1;" :: "r"(colour_gates + 8 * b), "r"(THREADS / 32) : "memory");
"""
SWEEP = """
    const int t = THREAD, p = t / LANES, part = turn & 1, *const head = limits.head.data + 2 * KINDS * RANK;
    const int guests = limits.list.data[head[18]];
    const float4* const from = D + S * (sub & 1);
    float4 *const mail = (float4*)limits.mail.data, *const mine = mail + (INBOX + 2 * GUESTS) * RANK;
    auto tell = [=](int word, float4 a, unsigned gate) {
        const int block = word >> BLOCK & 0x3ff, slot = word >> SLOT;
        if (GRID) post(mail + (INBOX + 2 * GUESTS) * block + slot, a, turn + 1);
        else send(block, Y + S + slot, a, gate);
    };
    auto meet = [=](unsigned gate, int begin, int end, int phase) {
        if (GRID) {
            for (int i = begin + t; i < end; i += THREADS) Y[S + i] = fetch(mine + i, turn + 1);
            BLOCK_MEETS
        } else if (end > begin) {
            attend(gate, sizeof(float4) * (end - begin), phase);
        } else BLOCK_MEETS
    };
    if (own.point >= 0 && own.lane == 0) {
        const float4 a = make_float4(d[0], d[1], d[2], 0.f);
        Y[p] = a;
        for (int k = first_begin[p]; k < first_begin[p + 1]; ++k)
            tell(first[k] + (part * GUESTS << SLOT), a, colour_gates + 8 * part);
    }
    meet(colour_gates + 8 * part, INBOX + part * GUESTS, INBOX + part * GUESTS + guests, turn >> 1 & 1);
    for (int k = 0; k < COLOURS; ++k) {
        for (int e = colour[k] + t; e < colour[k + 1]; e += THREADS) {
            const uint2 word = joint[e];
            const int i = word.x & 0xffff, j = word.x >> 16;
            const int a = word.y & 0xffff, b = word.y >> 16;
            float4 d0 = Y[a + (a >= GUEST ? part * GUESTS : 0)], d1 = Y[b + (b >= GUEST ? part * GUESTS : 0)];
            const float4 X0 = X[i], X1 = X[j], A0 = from[i], A1 = from[j];
            const float x = ((X1.x + A1.x) - (X0.x + A0.x)) + (d1.x - d0.x), most = longest[e];
            const float y = ((X1.y + A1.y) - (X0.y + A0.y)) + (d1.y - d0.y);
            const float z = ((X1.z + A1.z) - (X0.z + A0.z)) + (d1.z - d0.z);
            const float far = x * x + y * y + z * z;
            if (far > most * most) {
                const float w0 = weight[i], w1 = weight[j], way = sqrtf(far), w = w0 + w1;
                const float share = w > 0.f ? (way - most) / (w * way) : 0.f;
                d0 = make_float4(d0.x + w0 * share * x, d0.y + w0 * share * y, d0.z + w0 * share * z, 0.f);
                d1 = make_float4(d1.x - w1 * share * x, d1.y - w1 * share * y, d1.z - w1 * share * z, 0.f);
            }
            Y[i] = d0;
            Y[j] = d1;
            for (int m = letter_begin[e]; m < letter_begin[e + 1]; ++m)
                tell(letter[m], letter[m] & 1 ? d1 : d0, colour_gates + 8 * (2 + k));
        }
        meet(colour_gates + 8 * (2 + k), arrive[k], arrive[k + 1], turn & 1);
    }
    wp::vec_t<3, wp::float32> swept;
    if (own.point >= 0 && own.lane == 0) { swept[0] = Y[p].x; swept[1] = Y[p].y; swept[2] = Y[p].z; }
    return swept;
#else
    return d;
"""


@cache
def strain_limits(real):
    """Struct of the limits: reads only, but for mail."""
    t = types(real)

    @wp.struct
    class StrainLimits:
        head: wp.array(dtype=int)            # first place in `list` and size of each of LISTS, (blocks * LISTS * 2,)
        list: wp.array(dtype=int)
        longest: wp.array(dtype=t.scalar)    # [m], (edges,)
        mail: wp.array(dtype=t.vec4)         # letters of a grid of blocks, with the turn that they are of; 0 at first

    return StrainLimits


def limit_memory_words(plan) -> int:
    """Shared memory of the limits of a plan [4 bytes]."""
    if not plan.edges:
        return 0
    places = plan.points + plan.inbox + 2 * plan.guests
    whole = (4 * ((plan.colours + 3) // 2 + places) + plan.points + 4 * plan.edges + 2 * (plan.colours + 1) + plan.letters
             + plan.own + 2 + plan.firsts)
    return -(-whole // 4) * 4


@cache
def limit_sweep_functions(real, plan, damped: bool):
    """(fill, sweep): functions of a block's threads, which all call them. fill: fills the block's memory, before `enter` of
    kernels/motion/fused/sheet.py; sweep: d of a point [m] behind a sweep of substep sub, of its first thread; turn: number of
    the sweep in the frame."""
    from wsim.kernels.motion.fused.sheet import ROOM as SHEET
    from wsim.kernels.motion.fused.sheet import cuda_function_text, sheet_code_constants
    Net, Sheets, Own, Limits, vec3 = (spring_nets(real), sheet_patch_table(real, plan.materials), thread_points(real),
                                      strain_limits(real), types(real).vec3)
    numbers = {"EDGES": plan.edges, "INBOX": plan.inbox, "GUESTS": plan.guests, "COLOURS": plan.colours,
               "LETTERS": plan.letters, "KINDS": len(LISTS), "BLOCK": BLOCK, "SLOT": SLOT}
    start = (f"{sheet_code_constants(plan, damped, False, True)}    constexpr int "
             f"{', '.join(f'{k} = {v}' for k, v in numbers.items())};\n"
             f"{SHEET}{ROOM}")

    @wp.func_native(cuda_function_text(start + FILL))
    def fill_limit_memory(c: Net, h: Sheets, limits: Limits): ...

    @wp.func_native(cuda_function_text(start + SWEEP))
    def sweep_strain_limits(limits: Limits, own: wp.ref[Own], d: vec3, sub: int, turn: int) -> vec3: ...

    return fill_limit_memory, sweep_strain_limits
