"""Explicit steps of sheets on a CPU: a frame in one launch, or a substep, as kernels/motion/fast_paths/march_cpu.py takes
springs.

    a substep    angles of hinges and forces of triangles | curvatures | forces of hinges | points gather forces, and move

Where a bar stands threads wait for each other; each takes an equal share of the packets and of the points. Sums of points are
gathered in one order, so the bits are those of one thread. Points move as in march_cpu.py, by the same text; a frame without
contacts is watched like there, and threads come and go as kernels/motion/fast_paths/threads.py has it.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import FLAT
from wsim.kernels.cloth.curvature import SLOTS
from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps
from wsim.kernels.motion.fast_paths import simd_sheets as packets
from wsim.kernels.motion.fast_paths.march_cpu import BOUNDED, HOLD, MOVE, march_set
from wsim.kernels.motion.fast_paths.simd_sheets import sheet_of
from wsim.kernels.motion.fast_paths.threads import APART, DONE, NEVER, STALLS, TEXTS, team_type

# A launch of its own is shared as kernels/motion/fast_paths/threads.py has it; else (among > 0) this is the part of thread
# `thread` of so many that are in a launch already (kernels/motion/fast_paths/thread_team.py).
MEET = """
    unsigned turn = among > 0 ? look({done} + rank) : 2 * t;
    auto share = [&](int n, int r) {{ return (int)((long long)n * r / walkers); }};
    auto meet = [&] {{
        if (walkers == 1) return;
        say({done} + rank, ++turn);
        for (int r = 0; r < walkers; ++r)
            if (r != rank) stalls += until([&] {{ return (signed)(look({done} + r) - turn) >= 0; }}, {never});
    }};
"""
MARCH = """
    {tools}
    {walk}
    if (among > 0) {{ rank = thread; walkers = among; }} else {{ {join} }}
    {meet}
    #if defined(__x86_64__)
    const unsigned modes = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(modes | 0x8040);
    #endif
    {real} *x = ({real}*)p.x.data, *d = ({real}*)p.d.data, *q = ({real}*)p.q.data, *v = ({real}*)p.v.data,
           *carry = ({real}*)p.carry.data, *slip = ({real}*)p.slip.data;
    const int *object = c.object.data, pins = c.target.shape[1], count = step.count + (step.close > 0);
    bool drag = false;
    for (int o = 0; o < c.decay.shape[0]; ++o) drag |= c.decay.data[o] != 0;
    const bool seen = {damped} || drag || !p.frame;
    const int begin = among > 0 ? 8 * group[share(blocks, rank)] : 0;
    const int stop = among > 0 ? 8 * group[share(blocks, rank + 1)] + (rank + 1 == walkers) : rank == 0 ? places + 1 : 0;
    for (int i = begin; i < stop; ++i) {{
        const int o = i < places ? order[i] : -1;
        X[i] = D[i] = Q[i] = V[i] = C[i] = S[i] = F[i] = zero;
        G[i] = vec{{0, 0, 0, 1}};
        if (o < 0) continue;
        X[i] = load(x, o); D[i] = load(d, o); Q[i] = load(q, o); V[i] = load(v, o);
        C[i] = load(carry, o); S[i] = p.frame ? zero : load(slip, o);
        G[i] = load((const {real}*)c.gravity.data, object[o]); G[i][3] = c.w.data[o];
    }}
    if (among > 0) meet();
    if (among > 0 || rank == 0) {{ {apart} }}
    {least}
    if (among == 0) {{ {open} }}
    {across}
    {angles}
    for (; t < count; ++t) {{
        const bool closes = t == step.count;
        const {real} kick = closes ? step.close : t > 0 ? step.later : step.kick, drift = closes ? 0 : step.drift;
        const {real}* target = (const {real}*)c.target.data + 3 * pins * (step.row + t * step.stride);
        {hold}
        for (int p0 = share(hinges, rank), last = share(hinges, rank + 1); p0 < last; p0 += 4) {{
            const int p1 = p0 + 4 < last ? p0 + 4 : last;
            eight sines[4], cosines[4], rates[4];
            for (int p = p0; p < p1; ++p) {{ {geometry} }}
            for (int p = p0; p < p1; ++p) {{ {strain} }}
        }}
        for (int p = share(triangles, rank); p < share(triangles, rank + 1); ++p) {{ {forces} }}
        meet();
        if (hinges > 0) {{
            for (int c = share(sheets, rank); c < share(sheets, rank + 1); ++c) {{ {curvature} }}
            meet();
            for (int p = share(hinges, rank); p < share(hinges, rank + 1); ++p) {{ {moments} }}
            meet();
        }}
        for (int b = share(blocks, rank); b < share(blocks, rank + 1); ++b) {{
            {most}
            for (int i = 8 * group[b]; i < 8 * group[b + 1]; i += 8) {{ {gather} }}
            for (int i = 8 * group[b]; i < 8 * group[b + 1]; i += 2) {{
                {move}
            }}
            {within}
        }}
        meet();
        if (among > 0) continue;
        {form}
        if (turn == 0 && walkers > 1) turn = 2 * t + 2;
    }}
    for (int i = 8 * group[share(blocks, rank)]; i < 8 * group[share(blocks, rank + 1)]; ++i) {{
        const int o = order[i];
        const vec x1 = X[i] + D[i];
        if (o < 0) continue;
        if (p.frame) {{
            store(x, o, x1); store(d, o, (D[i] - (x1 - X[i])) + S[i]);
        }} else {{
            store(d, o, D[i]); store(q, o, Q[i]); store(slip, o, S[i]);
        }}
        store(v, o, V[i]); store(carry, o, C[i]);
    }}
    #if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(modes);
    #endif
    {met}
    if (among > 0) {{
        if (stalls > 0) __atomic_fetch_add(desk + {apart_words} * {stalls_word}, stalls, __ATOMIC_RELAXED);
        return;
    }}
    {leave}
#endif
"""
PI = "3.14159265358979323846"


def march_code(real, damped: bool, bounded: bool) -> str:
    """The C++ of a march."""
    name, integer = ("float", "int") if real is wp.float32 else ("double", "long long")
    bounds = {key: text.format(real=name) if bounded else "" for key, text in BOUNDED.items()}
    rates = {"rate": packets.RATE if damped else "", "bend_rate": packets.BEND_RATE if damped else "",
             "fold_rate": packets.FOLD_RATE if damped else "",
             "alone_rate": packets.ALONE_RATE.format(real=name) if damped else ""}
    numbers = {"thin": packets.THIN, "flat": FLAT, "pi": PI, "sixth": "0.16666666666666666", "slots": SLOTS}
    texts = {"apart": packets.APART, "across": packets.ACROSS, "angles": packets.ANGLES[real], "geometry": packets.GEOMETRY,
             "strain": packets.STRAIN, "forces": packets.TRIANGLES, "curvature": packets.CURVATURE,
             "moments": packets.MOMENTS, "gather": packets.GATHER, "hold": HOLD}
    parts = {key: text.format(real=name, **numbers, **rates) for key, text in texts.items()}
    meet = MEET.format(done=DONE, never=NEVER)
    text = MARCH.format(real=name, damped=int(damped), meet=meet, move=MOVE.format(**bounds),
                        apart_words=APART, stalls_word=STALLS, **(TEXTS | bounds | parts))
    return packets.ROOM.format(real=name, integer=integer) + text


@cache
def sheet_march_kernel(real, module, damped: bool, bounded: bool = False):
    """Kernel, launched over 1: `count` substeps of kicks and drifts, and a last kick where `close` is not 0. bounded:
    frames are watched."""
    vec4, Sheet, Net, Step, Moving, Team = (types(real).vec4, sheet_of(real), spring_nets(real), explicit_steps(real),
                                            march_set(real), team_type())

    @wp.func_native(march_code(real, damped, bounded))
    def native_sheet_substeps(thread: int, among: int, c: Net, s: Sheet, step: Step, team: Team, p: Moving,
                              room: wp.array(dtype=vec4)): ...

    @wp.func(inline=False)                               # compiled once, for all kernels of the module
    def march_sheet_part(thread: int, among: int, c: Net, s: Sheet, step: Step, team: Team, p: Moving,
                         room: wp.array(dtype=vec4)):
        native_sheet_substeps(thread, among, c, s, step, team, p, room)

    @wp.kernel(module=module, enable_backward=False)
    def march_sheet(c: Net, s: Sheet, step: Step, team: Team, p_out: Moving, room_out: wp.array(dtype=vec4)):
        march_sheet_part(0, 0, c, s, step, team, p_out, room_out)

    march_sheet.part = march_sheet_part                  # of a thread of many, in another launch
    return march_sheet
