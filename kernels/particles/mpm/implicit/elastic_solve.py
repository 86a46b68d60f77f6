"""Newton's method for an implicit elastic step, and conjugate gradients for each of its steps, over nodes.

    R = m (v - v*) - f(v);  (m - df/dv) y = -R;  v += y                               f: impulses of stress, elastic_points.py
    w = A z,  gamma = r.z,  delta = z.w,  beta = gamma / gamma',  alpha = gamma / (delta - beta gamma / alpha')
    p = z + beta p,  s = w + beta s,  y += alpha p,  r -= alpha s,  z = P r           (Chronopoulos, Gear 1989; ' is the last)

P: elastic_precondition.py, which also keeps momentum. At a node that a collider holds r has no part along the normal. Coulomb
friction is a drag, of the load and the slip of the step of Newton before: mu load / max(slip, CREEP). Nodes change their
state where the last step of Newton was small. Sums are in float64, by blocks in the order of their keys.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.elastic_nodes import FREE, SLIDES, STICKS, node_rows, solve_functions
from wsim.kernels.particles.mpm.tables import CELLS, LAYER, point_tables
from wsim.kernels.particles.mpm.transfers import node_function
from wsim.kernels.solver.pcg import block_sum

CREEP = wp.constant(1.0e-4)        # cells a step: what moves by less along a collider is at rest
SETTLED = wp.constant(10.0)        # of the tolerance: after so small a step of Newton nodes may change their state
LAST = wp.constant(4)              # steps of Newton at the end, in which none does
SUMMERS = 256                      # threads that add up parts on CUDA


@cache
def solve_kernels(cpu: bool, real, module) -> SimpleNamespace:
    """Kernels over nodes: set_residual, multiply_nodes, update_nodes; rank_blocks over blocks."""
    t, T, N = types(real), point_tables(real), node_rows(real)
    gather, f = node_function(real), solve_functions(real)

    @wp.func
    def read_impulse(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), nodes: N, n: int):
        sum = t.vec4()
        if wp.static(cpu):                                     # noqa: SIM108 - one of them is compiled
            sum = nodes.f[n]
        else:
            sum = gather(g, sums, n // CELLS, n % CELLS)
        return f.head(sum)

    @wp.func
    def press_node(R: t.vec3, m: real, n: int, begun: bool, settled: bool, eps: real, nodes: N):
        """Residual that is left at a node within a collider, and 1 where it is pressed anew or no more: when settled."""
        hold = nodes.hold[n]
        normal = f.head(hold)
        state = hold[3]
        v = nodes.v[n]
        w = f.head(v) - f.head(nodes.wall[n])
        into = wp.dot(w, normal)
        slip = w - into * normal
        load = wp.dot(R, normal)
        if begun and state == real(SLIDES):
            nodes.load[n] = wp.max(load, real(0.0))
        if settled and state < real(STICKS):
            if state == real(FREE):
                if into < real(0.0):
                    state = real(SLIDES)
                    nodes.v[n] = v - f.row(into * normal, real(0.0))
            elif load < real(0.0):
                state = real(FREE)
            nodes.load[n] = wp.max(load, real(0.0))
            nodes.hold[n] = f.row(normal, state)
        drag = real(0.0)
        if state == real(SLIDES):
            speed = wp.length(slip)
            rub = nodes.wall[n][3]
            if speed < eps:
                rub = nodes.rub[n]
            drag = rub * nodes.load[n] / wp.max(speed, eps)
        nodes.drag[n] = drag
        changed = int(0)
        if state != hold[3]:
            changed = 1
        return f.filtered(nodes.hold[n], -R - drag * slip), changed

    def set_residual(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), clock: wp.array(dtype=real),
                     number: wp.array(dtype=wp.float64), flag: wp.array(dtype=int), nodes: N):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        star = nodes.star[n]
        m = star[3]
        r = t.vec3()
        if m > real(0.0):
            R = m * (f.head(nodes.v[n]) - f.head(star)) - read_impulse(g, sums, nodes, n)
            r = -R
            if nodes.hold[n][3] >= real(FREE):
                settled = number[5] <= wp.float64(SETTLED) and flag[2] < flag[4] - int(LAST)
                r, changed = press_node(R, m, n, flag[2] > 0, settled, real(CREEP) * g.dx / clock[0], nodes)
                if changed > 0:
                    flag[5] = 1
        nodes.r[n] = f.row(r, real(0.0))
        nodes.z[n] = t.vec4()
        nodes.p[n] = t.vec4()
        nodes.s[n] = t.vec4()
        nodes.y[n] = t.vec4()

    def multiply_nodes(g: T.BlockGrid, sums: wp.array2d(dtype=t.vec4), nodes: N):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        m = nodes.star[n][3]
        w = t.vec3()
        if m > real(0.0):
            w = f.filtered(nodes.hold[n], (m + nodes.drag[n]) * f.head(nodes.z[n]) - read_impulse(g, sums, nodes, n))
        nodes.w[n] = f.row(w, real(0.0))

    def update_nodes(g: T.BlockGrid, number: wp.array(dtype=wp.float64), nodes: N):
        n = wp.tid()
        if n // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        m = nodes.star[n][3]
        if m > real(0.0):
            alpha = real(number[1])
            beta = real(number[2])
            p = nodes.z[n] + beta * nodes.p[n]
            s = nodes.w[n] + beta * nodes.s[n]
            nodes.p[n] = p
            nodes.s[n] = s
            nodes.y[n] = nodes.y[n] + alpha * p
            r = nodes.r[n] - alpha * s
            nodes.r[n] = r
            nodes.z[n] = f.row(f.filtered(nodes.hold[n], nodes.inverse[n] * f.head(r)), real(0.0))

    def rank_blocks(g: T.BlockGrid, rank_out: wp.array(dtype=int)):
        """How many keys are smaller: blocks are numbered as threads come, and sums need one order."""
        b = wp.tid()
        used = wp.min(g.used[0], g.key.shape[0])
        if b < used:
            rank = int(0)
            for k in range(used):
                if g.key[k] < g.key[b]:
                    rank += 1
            rank_out[b] = rank

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'cpu_' * cpu}{t.name}", module=module, enable_backward=False)
            for k in (set_residual, multiply_nodes, update_nodes, rank_blocks)}
    return SimpleNamespace(**made)


@cache
def dot_kernel(cpu: bool, real, module):
    """Kernel over layers of blocks: parts of two sums, four a block, in the order of ranks: r.z and z.w, or, if they end a step
    of Newton, y.m y and masses."""
    t, T, N = types(real), point_tables(real), node_rows(real)

    def dot_nodes(g: T.BlockGrid, rank: wp.array(dtype=int), nodes: N, ends: bool, part_out: wp.array(dtype=wp.vec2d)):
        n = wp.tid()
        b = n * LAYER // CELLS
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        sum = wp.vec2d()
        cells = int(LAYER)
        for c in range(n * LAYER, n * LAYER + cells):
            if ends:
                m = nodes.star[c][3]
                y = nodes.y[c]
                sum += wp.vec2d(wp.float64(m * (y[0] * y[0] + y[1] * y[1] + y[2] * y[2])), wp.float64(m))
            else:
                r = nodes.r[c]
                z = nodes.z[c]
                w = nodes.w[c]
                sum += wp.vec2d(wp.float64(r[0] * z[0] + r[1] * z[1] + r[2] * z[2]),
                                wp.float64(w[0] * z[0] + w[1] * z[1] + w[2] * z[2]))
        at = int(b)
        if not wp.static(cpu):
            at = rank[b]
        part_out[(CELLS // LAYER) * at + n % (CELLS // LAYER)] = sum

    return wp.kernel(dot_nodes, name=f"mpm_dot_nodes_{'cpu_' * cpu}{t.name}", module=module, enable_backward=False)


@cache
def decision_kernels(real, module) -> SimpleNamespace:
    """Kernels of one block of threads, but begin_gradients of one. number: gamma, alpha, beta, gamma at the start, nothing, the
    last change [of the tolerance]; flag: Newton goes on, conjugate gradients go on, steps of Newton, iterations of this one,
    steps at most, a node has changed its state, there are colliders. word: iterations, steps that missed, worst change [%]."""
    T, name = point_tables(real), types(real).name

    @wp.func
    def sum_parts(g: T.BlockGrid, part: wp.array(dtype=wp.vec2d), thread: int, threads: int):
        sum = wp.vec2d()
        for n in range(thread, (CELLS // LAYER) * wp.min(g.used[0], g.key.shape[0]), threads):
            sum += part[n]
        return block_sum(sum[0]), block_sum(sum[1])

    def begin_gradients(number: wp.array(dtype=wp.float64), flag: wp.array(dtype=int)):
        number[0] = wp.float64(0.0)
        flag[1] = 1
        flag[3] = 0

    def check_newton(g: T.BlockGrid, part: wp.array(dtype=wp.vec2d), threads: int, tolerance: real,
                     clock: wp.array(dtype=real), number: wp.array(dtype=wp.float64), flag: wp.array(dtype=int),
                     word: wp.array(dtype=int)):
        a, m = sum_parts(g, part, wp.tid(), threads)
        if wp.tid() > 0:
            return
        speed = wp.sqrt(a / wp.max(m, wp.float64(1.0e-300)))
        share = speed * wp.float64(clock[0]) / wp.float64(tolerance * g.dx)
        settled = number[5] <= wp.float64(SETTLED)
        number[5] = share
        flag[2] = flag[2] + 1
        met = share <= wp.float64(1.0)
        flag[0] = 1
        if (met and (settled or flag[6] == 0) and flag[5] == 0) or flag[2] >= flag[4]:
            flag[0] = 0
            word[2] = wp.max(word[2], int(wp.min(wp.float64(100.0) * share, wp.float64(1.0e9))))
            if not met:
                word[1] = word[1] + 1
        flag[5] = 0

    def check_gradients(g: T.BlockGrid, part: wp.array(dtype=wp.vec2d), threads: int, share: real, most: int,
                        number: wp.array(dtype=wp.float64), flag: wp.array(dtype=int), word: wp.array(dtype=int)):
        gamma, delta = sum_parts(g, part, wp.tid(), threads)
        if wp.tid() > 0:
            return
        alpha = wp.float64(0.0)
        beta = wp.float64(0.0)
        if number[0] > wp.float64(0.0):
            beta = gamma / number[0]
            alpha = gamma / (delta - beta * gamma / number[1])
        elif delta > wp.float64(0.0):
            alpha = gamma / delta
            number[3] = gamma
        flag[3] = flag[3] + 1
        word[0] = word[0] + 1
        if not gamma > wp.float64(share * share) * number[3] or flag[3] >= most:
            flag[1] = 0
        if not (alpha > wp.float64(0.0) and gamma > wp.float64(0.0)):
            alpha = wp.float64(0.0)
            flag[1] = 0
        number[0] = gamma
        number[1] = alpha
        number[2] = beta

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (begin_gradients, check_newton, check_gradients)}
    return SimpleNamespace(**made)
