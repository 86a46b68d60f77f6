"""Explicit steps on a CPU: a point moves as soon as its springs are summed, so that a substep is one pass over the springs.

A spring stands at its lower end and is added to both (kernels/lots.py): once those of point i are taken no other reads d_i or
adds to f_i any more, and i is moved in place, as kernels/explicit.py moves it. Other threads may follow pass by pass
(kernels/abreast.py); the order of all sums is that of one thread, and so are the bits.
32 x 32 cloth, 5826 springs, a substep: 16 us in float32, 24 us in float64; one scalar spring after the other, and the points in
a second pass, took 38 and 37 us (Xeon with AVX-512 at about 2.5 GHz, one thread, least of many runs).
"""

from functools import cache

import warp as wp

from wsim.kernels import lots
from wsim.kernels.abreast import TEXTS, teams
from wsim.kernels.explicit import steps
from wsim.kernels.lots import list_of
from wsim.kernels.real import types
from wsim.kernels.spring import net

MOST = 2.0             # length over rest length from which an edge is suspect

PULL = """
    const {real} *X = (const {real}*)x.data, *D = (const {real}*)d.data + 3 * n * source, *V = D + 6 * n;
    const int rank = 0, end = n;
    {scratch}
    for (int i = 0; i < n; ++i) {{
        const int o = order[i];
        vec* here = near + 4 * i;
        here[0] = load(X, o); here[1] = load(D, o); here[2] = load(V, o); here[3] = zero;
    }}
    for (int p = 0, q; p < end; p = q) {{
        {springs}
    }}
#endif
"""
KEEP = "store(({real}*)f_out.data, order[i], f);"

WATCH = """if (t == count - 1)
                for (int l = 0; l < 8 && c + l < start[q]; ++l)
                    torn |= s.rest.data[c + l] > 0 && !(length[l] <= most * s.rest.data[c + l]);"""
# Numbers below 1e-38 count as 0 meanwhile: what dies away along an axis without forces would take four times the time.
MARCH = """
    {words}
    {scratch}
    #if defined(__x86_64__)
    const unsigned modes = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(modes | 0x8040);
    #endif
    {real} *X = ({real}*)p.x.data, *E = ({real}*)p.d.data, *Q = ({real}*)p.q.data, *V = ({real}*)p.v.data,
           *C = ({real}*)p.carry.data, *S = ({real}*)p.slip.data;
    const int *object = c.object.data, pins = c.target.shape[1], count = step.count + (step.close > 0);
    const {real} most = {most};
    bool torn = false;
    for (int i = 0; i < n && rank == 0; ++i) {{
        const int o = order[i];
        vec *here = near + 4 * i, *mine = own + 4 * i;
        here[0] = load(X, o); here[1] = load(E, o); here[2] = load(Q, o); here[3] = zero;
        mine[0] = load(V, o); mine[1] = load(C, o); mine[2] = p.frame ? zero : load(S, o);
        mine[3] = load((const {real}*)c.gravity.data, object[o]); mine[3][3] = c.w.data[o];
    }}
    {open}
    for (; t < count; ++t) {{
        const bool closes = t == step.count;
        const {real} kick = closes ? step.close : t > 0 ? step.later : step.kick, drift = closes ? 0 : step.drift;
        const {real}* target = (const {real}*)c.target.data + 3 * pins * (step.row + t * step.stride);
        for (int l = 0; l < 3; ++l) {{
            {before}
            for (int p = leg[l], q, end = leg[l + 1]; p < end; p = q) {{
                {springs}
            }}
            {after}
        }}
        {form}
    }}
    for (int i = leg[0]; i < leg[3]; ++i) {{
        const int o = order[i];
        const vec *here = near + 4 * i, *mine = own + 4 * i, x1 = here[0] + here[1];
        if (p.frame) {{
            store(X, o, x1); store(E, o, (here[1] - (x1 - here[0])) + mine[2]);
        }} else {{
            store(E, o, here[1]); store(Q, o, here[2]); store(S, o, mine[2]);
        }}
        store(V, o, mine[0]); store(C, o, mine[1]);
    }}
    #if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(modes);
    #endif
    if (torn && p.frame && p.status.data[0] < 1) p.status.data[0] = 1;
    {leave}
#endif
"""
MOVE = """
            const vec x0 = here[0], d0 = here[1], v0 = here[2];
            vec* mine = own + 4 * i;
            here[3] = zero;
            if (mine[3][3] > 0) {{
                const vec g = __builtin_shufflevector(mine[3], zero, 0, 1, 2, 4);
                const vec a = mine[3][3] * f + g - c.decay.data[object[order[i]]] * v0;
                const vec y = kick * a + mine[1], v = mine[0], v1 = v + y;
                mine[0] = v1;
                mine[1] = y - (v1 - v);
                const vec z = drift * v1 + mine[2], d1 = d0 + z;
                mine[2] = z - (d1 - d0);
                here[1] = d1;
                here[2] = v1 + step.ahead * a;
            }} else {{
                const int pin = c.pin.data[order[i]];
                const vec d1 = drift > 0 && pin >= 0 ? load(target, pin) - x0 : d0;
                here[1] = d1;
                here[2] = (d1 - d0) / step.h;
                if (drift > 0) mine[0] = here[2];
            }}
"""


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


@cache
def pull(real, module, damped: bool, even: bool):
    """Kernel, launched over 1: the sums of the springs' forces [N], the first n entries of f, where elements have forces too.
    d as in kernels/explicit.py."""
    vec3, vec4, List = types(real).vec3, types(real).vec4, list_of(real)

    @wp.func_native(lots.code(PULL, KEEP, real, damped, even))
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
    vec4, List, Net, Step, Moving, Team = types(real).vec4, list_of(real), net(real), steps(real), moving(real), teams()

    @wp.func_native(lots.code(MARCH, MOVE, real, damped, even, WATCH, most=MOST, **TEXTS))
    def substeps(n: int, c: Net, s: List, step: Step, team: Team, p: Moving, room: wp.array(dtype=vec4)): ...

    @wp.kernel(module=module, enable_backward=False)
    def march(c: Net, s: List, step: Step, team: Team, p_out: Moving, room_out: wp.array(dtype=vec4)):
        substeps(p_out.x.shape[0], c, s, step, team, p_out, room_out)

    return march
