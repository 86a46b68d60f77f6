"""Explicit steps on a CPU: points move as soon as their springs are summed, so that a substep is one pass over the springs.

A spring stands at its lower end and is added to both (kernels/motion/fast_paths/simd_springs.py): once those of a block of
points are taken no other reads d_i or adds to f_i of its points any more, and they are moved in place, as
kernels/motion/explicit.py moves them, two at a time. Other threads may follow pass by pass
(kernels/motion/fast_paths/threads.py); the order of all sums is that of one thread,
and so are the bits. 32 x 32 cloth, 5826 springs, a substep: 7.2 us in float32, 11.8 us in float64; points and loose springs one
after the other took 15.0 and 19.8 us (EPYC of 2022 at about 3.6 GHz, one thread, least of many runs).

A frame without contacts (`bounded`) is watched: a block of points keeps the largest |d| along each axis of a pass, and the
vector of the three must be no longer than the least clearance of its points (kernels/motion/free_flight_test.py), in every
pass. That is no more than sqrt(3) times too cautious, and costs a product and a maximum for two points. What is not finite is
left to the guard of the points.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps
from wsim.kernels.motion.fast_paths import simd_springs
from wsim.kernels.motion.fast_paths.simd_springs import list_of
from wsim.kernels.motion.fast_paths.threads import TEXTS, team_type

MOST = 2.0             # length over rest length from which an edge is suspect

PULL = """
    const {real} *x0 = (const {real}*)x.data, *d0 = (const {real}*)d.data + 3 * n * source, *q0 = d0 + 6 * n;
    for (int i = 0; i <= places; ++i) {{
        const int o = i < places ? order[i] : -1;
        X[i] = o < 0 ? zero : load(x0, o); D[i] = o < 0 ? zero : load(d0, o); Q[i] = o < 0 ? zero : load(q0, o); F[i] = zero;
    }}
    {apart}
    for (int b = 0; b < blocks; ++b) {{
        {springs}
    }}
    for (int i = 0; i < places; ++i)
        if (order[i] >= 0) store(({real}*)f_out.data, order[i], F[i]);
#endif
"""
WATCH = f"for (int l = 0; watched && l < 8; ++l) torn |= rest[l] > 0 && !(length[l] <= {MOST} * rest[l]);"
# Numbers below 1e-38 count as 0 meanwhile: what dies away along an axis without forces would take four times the time.
MARCH = """
    {tools}
    {walk}
    {join}
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
    for (int i = 0; i <= places && rank == 0; ++i) {{
        const int o = i < places ? order[i] : -1;
        X[i] = D[i] = Q[i] = V[i] = C[i] = S[i] = F[i] = zero;
        G[i] = vec{{0, 0, 0, 1}};
        if (o < 0) continue;
        X[i] = load(x, o); D[i] = load(d, o); Q[i] = load(q, o); V[i] = load(v, o);
        C[i] = load(carry, o); S[i] = p.frame ? zero : load(slip, o);
        G[i] = load((const {real}*)c.gravity.data, object[o]); G[i][3] = c.w.data[o];
    }}
    if (rank == 0) {{ {apart} }}
    {least}
    {open}
    for (; t < count; ++t) {{
        const bool closes = t == step.count;
        const {real} kick = closes ? step.close : t > 0 ? step.later : step.kick, drift = closes ? 0 : step.drift;
        const {real}* target = (const {real}*)c.target.data + 3 * pins * (step.row + t * step.stride);
        {hold}
        watched = t == count - 1;
        for (int l = 0; l < 3; ++l) {{
            {before}
            for (int b = leg[l]; b < leg[l + 1]; ++b) {{
                {springs}
                {most}
                for (int i = 8 * group[b]; i < 8 * group[b + 1]; i += 2) {{
                    {move}
                }}
                {within}
            }}
            {after}
        }}
        {form}
    }}
    for (int i = 8 * group[leg[0]]; i < 8 * group[leg[3]]; ++i) {{
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
    if (torn && p.frame && p.status.data[0] < 1) p.status.data[0] = 1;
    {met}
    {leave}
#endif
"""
MOVE = """
                    const eight g = at(G, i), d0 = at(D, i), v0 = at(V, i);
                    eight a = __builtin_shufflevector(g, g, 3, 3, 3, 3, 7, 7, 7, 7) * at(F, i)
                            + __builtin_shufflevector(g, none, 0, 1, 2, 8, 4, 5, 6, 8);
                    if (drag) a -= pair(zero + decay(i), zero + decay(i + 1)) * at(Q, i);
                    const eight y = kick * a + at(C, i), v1 = v0 + y, z = drift * v1 + at(S, i), d1 = d0 + z;
                    at(F, i) = none;
                    at(V, i) = v1;
                    at(C, i) = y - (v1 - v0);
                    at(D, i) = d1;
                    {widen}
                    at(S, i) = z - (d1 - d0);
                    if (seen) at(Q, i) = v1 + step.ahead * a;
                    if (!(g[3] > 0 && g[7] > 0)) {{
                        hold(i, g[3], first(d0), first(v0));
                        hold(i + 1, g[7], second(d0), second(v0));
                    }}
"""
# What bounds a frame without contacts: before the passes, by block, and behind them.
BOUNDED = {"least": """
    for (int b = 0; b < blocks && p.frame && rank == 0; ++b) {{
        {real} least = 1e30;
        for (int i = 8 * group[b]; i < 8 * group[b + 1]; ++i)
            if (order[i] >= 0) least = !(p.room.data[order[i]] > least) ? p.room.data[order[i]] : least;
        p.least.data[b] = least > 0 ? least * least : -1;
    }}
    bool met = false;""", "most": "eight wide = none;",
           "widen": "const eight square = d1 * d1; wide = square > wide ? square : wide;",
           "within": """if (p.frame) {{
                    const vec far = __builtin_elementwise_max(first(wide), second(wide));
                    met |= !(far[0] + far[1] + far[2] <= p.least.data[b]);
                }}""", "met": "if (met) p.met.data[0] = 1;"}
# Points that no force moves, after all; and the drag of others.
HOLD = """
        auto decay = [&](int i) {{ return order[i] < 0 ? 0 : c.decay.data[object[order[i]]]; }};
        auto hold = [&](int i, {real} w, vec d0, vec v0) {{
            if (w > 0) return;
            const int pin = c.pin.data[order[i]];
            D[i] = drift > 0 && pin >= 0 ? load(target, pin) - X[i] : d0;
            Q[i] = (D[i] - d0) / step.h;
            V[i] = drift > 0 ? Q[i] : v0;
            C[i] = S[i] = zero;
        }};
"""


@cache
def march_set(real):
    """Struct of what changes, each (points,): read and written."""
    vec3 = types(real).vec3

    @wp.struct
    class MarchingPoints:
        x: wp.array(dtype=vec3)              # position at the start of the frame [m]
        d: wp.array(dtype=vec3)              # displacement since then [m]
        q: wp.array(dtype=vec3)              # velocity that damping sees [m/s]
        v: wp.array(dtype=vec3)              # velocity [m/s]
        carry: wp.array(dtype=vec3)          # remainder of v
        slip: wp.array(dtype=vec3)           # remainder of d
        status: wp.array(dtype=int)          # becomes at least 1 where a spring ends longer than MOST times its rest length
        room: wp.array(dtype=real)           # clearance [m]; only where a frame is bounded by it
        least: wp.array(dtype=real)          # room: square of the least one of each block [m^2], (blocks,)
        met: wp.array(dtype=int)             # becomes 1 where a point goes further
        frame: int                           # 1: the call takes a frame, d is the remainder of x before it and after; no slip

    return MarchingPoints


@cache
def spring_pull_kernel(real, module, damped: bool):
    """Kernel, launched over 1: the sums of the springs' forces [N], the first n entries of f, where elements have forces too.
    d as in kernels/motion/explicit.py."""
    vec3, vec4, List = types(real).vec3, types(real).vec4, list_of(real)

    @wp.func_native(simd_springs.packet_code(PULL, real, damped))
    def native_spring_pull(n: int, s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int,
                           f_out: wp.array(dtype=vec3), room: wp.array(dtype=vec4)): ...

    @wp.kernel(module=module, enable_backward=False)
    def pull_springs(s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, f_out: wp.array(dtype=vec3),
                     room_out: wp.array(dtype=vec4)):
        native_spring_pull(x.shape[0], s, x, d, source, f_out, room_out)

    return pull_springs


@cache
def cpu_march_kernel(real, module, damped: bool, bounded: bool = False):
    """Kernel, launched over 1: `count` substeps of kicks and drifts, and a last kick where `close` is not 0. bounded:
    frames are watched."""
    name = "float" if real is wp.float32 else "double"
    bounds = {key: text.format(real=name) if bounded else "" for key, text in BOUNDED.items()}
    texts = TEXTS | bounds | {"move": MOVE.format(**bounds), "hold": HOLD.format(real=name), "damped": int(damped)}
    vec4, List, Net, Step, Moving, Team = (types(real).vec4, list_of(real), spring_nets(real), explicit_steps(real),
                                           march_set(real), team_type())

    @wp.func_native(simd_springs.packet_code(MARCH, real, damped, WATCH, texts))
    def native_march_substeps(c: Net, s: List, step: Step, team: Team, p: Moving, room: wp.array(dtype=vec4)): ...

    @wp.kernel(module=module, enable_backward=False)
    def march_points(c: Net, s: List, step: Step, team: Team, p_out: Moving, room_out: wp.array(dtype=vec4)):
        native_march_substeps(c, s, step, team, p_out, room_out)

    return march_points
