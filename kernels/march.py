"""Explicit steps on a CPU: one thread takes every spring once and adds its force to both ends, then every point.

    F = (k (1 - L / |r|) + k tau (n.dv~) / |r|) r,   r = (x_j - x_i) + (d_j - d_i),   f_i += F,  f_j -= F

and the points as kernels/explicit.py moves them. In C++, since Warp's indexing of arrays costs several times the arithmetic
(32 x 32 cloth, 5826 springs, forces: 68 us against 210 us in a Warp loop and 277 us gathered; one run on two busy cores).
It has no adjoint; gradients take the gathered kernels.
"""

from functools import cache

import warp as wp

from wsim.kernels.explicit import steps
from wsim.kernels.real import types
from wsim.kernels.spring import net

SPRINGS = """
#if !defined(__CUDA_ARCH__)
    const int n = x.shape[0];
    const {real}* X = (const {real}*)x.data;
    const {real}* D = (const {real}*)d.data + 3 * n * source;
    const {real}* Q = (const {real}*)d.data + 3 * n * (2 + source);
    const int *first = s.start.data, *others = s.other.data;
    const {real} *rest_of = s.rest.data, *k_of = s.k.data;
    {real}* F = ({real}*)f.data;
    for (int i = 0; i < 3 * n; ++i) F[i] = 0;
    for (int p = 0, i = 0; p < n; ++p, i += 3) {{
        const {real} x0 = X[i], x1 = X[i + 1], x2 = X[i + 2], d0 = D[i], d1 = D[i + 1], d2 = D[i + 2];
        {real} f0 = F[i], f1 = F[i + 1], f2 = F[i + 2];
        for (int c = first[p]; c < first[p + 1]; ++c) {{
            const int j = 3 * others[c];
            const {real} rx = (X[j] - x0) + (D[j] - d0), ry = (X[j + 1] - x1) + (D[j + 1] - d1),
                         rz = (X[j + 2] - x2) + (D[j + 2] - d2);
            const {real} length = {root}(rx * rx + ry * ry + rz * rz), over = length > 0 ? 1 / length : 0;
            {real} pull = k_of[c] - k_of[c] * rest_of[c] * over;
            {damping}
            f0 += pull * rx; f1 += pull * ry; f2 += pull * rz;
            F[j] -= pull * rx; F[j + 1] -= pull * ry; F[j + 2] -= pull * rz;
        }}
        F[i] = f0; F[i + 1] = f1; F[i + 2] = f2;
    }}
#endif
"""
DAMPING = """pull += s.damping.data[c] * over * over
             * (rx * (Q[j] - Q[i]) + ry * (Q[j + 1] - Q[i + 1]) + rz * (Q[j + 2] - Q[i + 2]));"""

POINTS = """
#if !defined(__CUDA_ARCH__)
    const int n = x.shape[0], pins = c.target.shape[1];
    const {real} *G = (const {real}*)c.gravity.data, *F = (const {real}*)f.data, *X = (const {real}*)x.data;
    const {real}* T = (const {real}*)c.target.data + 3 * step.row * pins;
    {real} *D = ({real}*)d.data + 3 * n * step.source, *E = ({real}*)d.data + 3 * n * (1 - step.source);
    {real} *Q = D + 6 * n, *R = E + 6 * n, *V = ({real}*)v.data, *C = ({real}*)carry.data;
    for (int i = 0; i < n; ++i) {{
        const {real} w = c.w.data[i], decay = c.decay.data[c.object.data[i]];
        const {real}* g = G + 3 * c.object.data[i];
        for (int k = 0, j = 3 * i; k < 3; ++k, ++j) {{
            if (w > 0) {{
                const {real} a = w * F[j] + g[k] - decay * Q[j];
                const {real} y = step.kick * a + C[j], v1 = V[j] + y;
                C[j] = y - (v1 - V[j]);
                V[j] = v1;
                const {real} z = step.drift * v1 + C[3 * n + j], d1 = D[j] + z;
                C[3 * n + j] = z - (d1 - D[j]);
                E[j] = d1;
                R[j] = v1 + step.ahead * a;
            }} else {{
                const bool moves = step.drift > 0 && c.pin.data[i] >= 0;
                E[j] = moves ? T[3 * c.pin.data[i] + k] - X[j] : D[j];
                R[j] = (E[j] - D[j]) / step.h;
                if (step.drift > 0) V[j] = R[j];
            }}
        }}
    }}
#endif
"""


@cache
def list_of(real):
    """Struct of the springs, each once: reads only."""

    @wp.struct
    class List:
        start: wp.array(dtype=int)           # springs of which a point is the lower end: start[i]:start[i + 1], (points + 1,)
        other: wp.array(dtype=int)           # higher end, (springs,)
        rest: wp.array(dtype=real)           # length [m], (springs,)
        k: wp.array(dtype=real)              # [N/m], (springs,)
        damping: wp.array(dtype=real)        # k tau [N s/m], (springs,); only when damped

    return List


@cache
def _springs(real, damped: bool):
    """Function: f of the points (its first n entries) becomes the sum of their springs' forces [N]."""
    vec3, List = types(real).vec3, list_of(real)
    name, root = ("float", "sqrtf") if real is wp.float32 else ("double", "sqrt")
    code = SPRINGS.format(real=name, root=root, damping=DAMPING if damped else "")

    @wp.func_native(code)
    def springs(s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, f: wp.array(dtype=vec3)): ...

    return springs


@cache
def pull(real, module, damped: bool):
    """Kernel, launched over 1: the sums of the springs' forces, where elements have forces too."""
    vec3, List, every = types(real).vec3, list_of(real), _springs(real, damped)

    @wp.kernel(module=module, enable_backward=False)
    def pull(s: List, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, f_out: wp.array(dtype=vec3)):
        every(s, x, d, source, f_out)

    return pull


@cache
def march(real, module, damped: bool):
    """Kernel, launched over 1: `Step.count` substeps of kicks and drifts; f is room for the forces."""
    vec3, List, Net, Step = types(real).vec3, list_of(real), net(real), steps(real)
    every = _springs(real, damped)

    @wp.func_native(POINTS.format(real="float" if real is wp.float32 else "double"))
    def points(c: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), v: wp.array(dtype=vec3),
               carry: wp.array(dtype=vec3), step: Step): ...

    @wp.kernel(module=module, enable_backward=False)
    def march(c: Net, s: List, x: wp.array(dtype=vec3), step: Step, d_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3),
              carry_out: wp.array(dtype=vec3), f_out: wp.array(dtype=vec3)):
        t = step
        for _k in range(step.count):
            every(s, x, d_out, t.source, f_out)
            points(c, f_out, x, d_out, v_out, carry_out, t)
            t.source = 1 - t.source
            t.row += step.stride
            t.kick = step.later

    return march
