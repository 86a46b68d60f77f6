"""Contact of near pairs with Coulomb friction, as sweeps over all pairs at once.

    C = away + n . sum_k b_k (d_k - e_k) - keep        lam' = max(lam - C / W, 0)        dx_k = w_k b_k (P' - P)
    T* = T - [sum_k b_k (d_k - a_k)]_t / W              T' = T* where |T*| <= mu_s lam', else mu_d lam' T* / |T*|

P = lam n + T is the push of a pair [m kg]: every pair adds P b_k to its points, and sum_k b_k = 0, so that momentum is kept;
its moment is taken back, and slip is that beside a common turn (kernels/contact/selfcontact/moment_correction.py).
n and b are those of the start of the substep. All pairs move at once (Jacobi), each as if its points were heavier:

    W = sum_k |b_k| w_k B_k,   B_k = sum of |b_k| over the pairs of point k

which bounds the rows of the matrix of all pairs (Gershgorin), so that sweeps settle; where pairs share no point it is the exact
mass. As mass splitting (Tonge, Benevolenski, Voroshilov 2012), with shares by weight in place of counts. A pair that begins
nearer than it is to be goes apart by `recovery` h at most.

Sweeps that go on (words[MORE] blocks of MORE) lead ahead, which takes k sweeps to where Jacobi's would take some k^2 (Nesterov
1983, as Su, Boyd, Candes 2016, eq. 1; begun anew every AGAIN sweeps: O'Donoghue, Candes 2015, section 3.1): with P' what a
sweep makes of the push that it found, and Q' what the one before made,

    P <- P' + k / (k + 3) (P' - Q')      k = 0, 1 ..., where all of these push; P' behind the last sweep of a block

Where one thread does all (`turns`, a CPU by XPBD) and a list is made in each substep (words[NARROW]), sweeps before those take
pairs in turn: each finds its points where those before it have put them (Gauss-Seidel), so that W is the exact mass, sum_k
b_k^2 w_k, and nothing is summed up. The list was made by one thread, too: its order is the same from run to run. Of one jam of
20,000 pairs that was looked at 250 sweeps of all at once left some nearer than half of what they keep, 24 in turn none. What
rests is pressed by all at once, which share it evenly: in turn their order would say which of many pairs bear it.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.moment_correction import held_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

SMALL = 1e-3           # of what a pair keeps: one that is as near to it takes part in the last sweep of an iteration only,
TAKES, NEARLY = 2, 1   # see `row_active_func`
BRIEF = 3              # sweeps of a call in which all rows are asked once
NEARLY_SO = 0.25       # of what a pair keeps: it is asked between sweeps as long as it is as near to that
DEPTH = 0.5            # of what a pair is to keep: sweeps go on while one would end nearer
SPARED = -2            # number of a sweep that is left out where pairs are taken in turn, which press as much as two at once
MORE, AGAIN = 24, 96   # sweeps of one block that leads ahead; those behind which it begins anew
RECOVERY = 0.5         # [m/s] at which surfaces leave an overlap of their thicknesses
CALM = 1e-4            # if it slips and errs by less than this over the substep, too [m/s]: what rests is this calm


@cache
def row_active_func(real):
    """Function (at, climb, calm, all, j, near): whether row j takes part in sweeps to come, or nearly does (TAKES, NEARLY).
    all 0: one that errs by less than SMALL and `calm` does not."""
    t = types(real)
    Pairs, State = pairs.pair_type(real), point_states(real)

    @wp.func
    def row_takes_part(at: State, climb: real, calm: real, all: int, j: int, near: Pairs):
        ids = near.four[j]
        b = near.swept[4 * j + pairs.B]
        there = near.swept[4 * j + pairs.NORMAL]
        push = near.swept[4 * j + pairs.PUSH]
        n = t.vec3(there[0], there[1], there[2])
        C = there[3] - wp.min(push[3], there[3] + climb)
        for k in range(4):
            C += b[k] * wp.dot(n, at.d[ids[k]] - at.e[ids[k]])
        small = wp.min(real(SMALL) * push[3], calm)
        if all > 0:
            small = real(0.0)
        takes = C < -small
        if not takes and wp.dot(t.vec3(push[0], push[1], push[2]), n) > real(0.0):
            takes = all > 0 or C > small
            if not takes:
                slip = t.vec3()
                for k in range(4):
                    slip += b[k] * (at.d[ids[k]] - at.a[ids[k]])
                takes = wp.length(slip - wp.dot(slip, n) * n) > small
        if takes:
            return TAKES
        return wp.where(C < real(NEARLY_SO) * push[3], NEARLY, 0)

    return row_takes_part


@wp.func
def all_rows_asked(k: int, count: int):
    """True if all rows are asked before sweep k of so many: before the first, and before the last of more than BRIEF; else
    those that nearly took part before the first."""
    return k == 0 or (k == count - 1 and count > BRIEF)


@wp.func
def whole_point_weight(b: Any):
    """Weight of a point in whole numbers; at least 1, since couples move all four."""
    return wp.max(int(wp.ceil(wp.abs(b) * type(b)(pairs.SHARES))), 1)


@cache
def active_row_kernel(real, module):
    """Kernel: which of the pairs within reach take part in the sweeps to come; their weights are summed up by point. k: number
    of the sweep, of how many, see `all_rows_asked`. Each of `threads` takes every threads-th pair."""
    Pairs, State, Sums, ask = pairs.pair_type(real), point_states(real), pairs.sum_type(real), row_active_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def lean_pairs(at: State, climb: real, calm: real, k: wp.vec2i, threads: int, near_at: wp.array(dtype=Pairs), to: Sums):
        near = near_at[0]
        all = all_rows_asked(k[0], k[1])
        i = wp.tid()
        while i < wp.where(all, near.rows[0], near.active[1]):
            j = int(i)
            if not all:
                j = near.seen[i]
            found = ask(at, climb, calm, wp.where(k[0] == k[1] - 1, 1, 0), j, near)
            if found == TAKES:
                near.on[wp.atomic_add(near.active, 0, 1)] = j
                for c in range(4):
                    wp.atomic_add(to.share, near.four[j][c], whole_point_weight(near.swept[4 * j + pairs.B][c]))
            if k[0] == 0 and found > 0:
                near.seen[wp.atomic_add(near.active, 1, 1)] = j
            i += threads

    return lean_pairs


@cache
def nesterov_func(real):
    """Function: k / (k + 3) of a sweep, by its number in its block; -1 where it does not lead ahead."""
    @wp.func
    def nesterov_factor(more: int, words: wp.array(dtype=int)):
        if more < 0:
            return real(-1.0)
        k = ((words[pairs.MORE] - 1) * MORE + more) % AGAIN
        return wp.where(more == MORE - 1, real(0.0), real(k) / real(k + 3))

    return nesterov_factor


@cache
def pair_sweep_func(real):
    """Function (at, h, climb, turn, lead, to) -> (h, change): pair h with the push of one sweep, which goes to its points; how
    far these come by that, less what is calm [m]. turn: at once, in turn. lead: see `nesterov_func`."""
    t = types(real)
    State, Sums = point_states(real), pairs.sum_type(real)
    fixed, (Held, _) = pairs.fixed_point_sum(real), held_type(real)

    @wp.func
    def push_after_projection(n: t.vec3, push: t.vec3, C: real, W: real, slip: t.vec3, mu: t.vec2):
        """The push of a pair after the sweep."""
        lam = wp.dot(push, n)
        T = push - lam * n
        lam = wp.max(lam - C / W, real(0.0))
        T = T - (slip - wp.dot(slip, n) * n) / W
        size = wp.length(T)
        if size > mu[0] * lam:
            T = (mu[1] * lam / size) * T
        return lam * n + T

    @wp.func
    def accelerated_push(lead: real, n: t.vec3, push: t.vec3, then: t.vec3, before: t.vec3):
        """The push that leads ahead of what the sweep has made of it."""
        if lead > real(0.0) and wp.dot(then, n) > real(0.0) and wp.dot(push, n) > real(0.0):
            ahead = then + lead * (then - before)
            if wp.dot(ahead, n) > real(0.0):
                return ahead
        return then

    @wp.func
    def add_point_motion(turn: bool, at: State, k: int, change: t.vec3, to: Sums):
        if turn:
            at.d[k] = at.d[k] + change
        else:
            fixed(to, k, change)

    @wp.func
    def sweep_one_pair(at: State, h: Held, climb: real, turn: bool, lead: real, to: Sums):
        o = at.d[h.ids[0]]
        q1 = at.d[h.ids[1]] - o
        q2 = at.d[h.ids[2]] - o
        q3 = at.d[h.ids[3]] - o
        way = h.b[1] * q1 + h.b[2] * q2 + h.b[3] * q3
        C = h.gap + wp.dot(h.n, way)
        push = h.push
        if C >= real(0.0) and wp.dot(push, push) == real(0.0):       # it did not push, and does not
            h.prior = t.vec3()
            return h, real(0.0)
        if h.W <= real(0.0):
            return h, real(0.0)
        turning = wp.cross(h.r[1], q1) + wp.cross(h.r[2], q2) + wp.cross(h.r[3], q3) - h.moment
        slip = (way - h.anchor) - wp.cross(h.K * turning, h.D)
        over = wp.where(turn or lead > real(0.0), real(1.0), real(pairs.OVER))
        then = push_after_projection(h.n, push, over * C, h.W, slip, h.mu)
        before = h.prior
        h.prior = then
        then = accelerated_push(lead, h.n, push, then, before)
        h.push = then
        back = h.K * wp.cross(h.D, then - push)
        for k in range(4):
            add_point_motion(turn, at, h.ids[k], h.w[k] * (h.b[k] * (then - push) - wp.cross(back, h.r[k])), to)
        return h, h.W * wp.length(then - push) - wp.min(real(SMALL) * h.keep, real(CALM / RECOVERY) * climb)

    return sweep_one_pair


@cache
def pair_write_func(real):
    """Function (h, j, near): writes what pair h of row j pushes with."""
    t = types(real)
    Pairs, (Held, _) = pairs.pair_type(real), held_type(real)

    @wp.func
    def write_pair_push(h: Held, j: int, near: Pairs):
        near.swept[4 * j + pairs.PRIOR] = t.vec4(h.prior[0], h.prior[1], h.prior[2], real(0.0))
        near.swept[4 * j + pairs.PUSH] = t.vec4(h.push[0], h.push[1], h.push[2], h.keep)
        near.push[near.row[j]] = h.push

    return write_pair_push


@cache
def pair_sweep_kernel(real, module, turns=False):
    """Kernel: one sweep of the pairs that take part. friction: static, dynamic, the mean of the four points'. more: number of a
    sweep in its block of those that lead ahead; -1: it does not; SPARED: nor is it taken in turn. threads: as
    `active_row_kernel`. turns: some are in turn."""
    Surfaces, Pairs, State, Sums = pairs.surface_type(real), pairs.pair_type(real), point_states(real), pairs.sum_type(real)
    (_, hold), act, write, lead_of = held_type(real), pair_sweep_func(real), pair_write_func(real), nesterov_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def press_pairs(s: Surfaces, at: State, climb: real, more: int, threads: int, near_at: wp.array(dtype=Pairs),
                    words: wp.array(dtype=int), to: Sums):
        near = near_at[0]
        turn = bool(turns) and more < 0 and words[pairs.NARROW] > 0
        if turn and more == SPARED:
            return
        lead = lead_of(more, words)
        j = wp.tid()
        most = real(0.0)
        while j < near.active[0]:
            h, change = act(at, hold(s, at, climb, turn, near.on[j], near, to), climb, turn, lead, to)
            write(h, near.on[j], near)
            most = wp.max(most, change)
            j += threads
        if turn and most <= real(0.0):
            near.active[0] = 0

    return press_pairs


@cache
def near_pair_flag_kernel(real, module):
    """Kernel: words[NEARER] becomes 1 where a pair ends nearer than DEPTH of where it is to be. first 1: words[MORE] begins, at
    one block of sweeps."""
    t = types(real)
    Pairs, State = pairs.pair_type(real), point_states(real)

    @wp.kernel(module=module, enable_backward=False)
    def nearer_pairs(at: State, climb: real, first: int, threads: int, near_at: wp.array(dtype=Pairs),
                     words: wp.array(dtype=int)):
        near = near_at[0]
        j = wp.tid()
        if j == 0 and first > 0:
            words[pairs.MORE] = 1
        while j < near.rows[0]:
            ids = near.four[j]
            b = near.swept[4 * j + pairs.B]
            there = near.swept[4 * j + pairs.NORMAL]
            n = t.vec3(there[0], there[1], there[2])
            end = there[3]
            for k in range(4):
                end += b[k] * wp.dot(n, at.d[ids[k]] - at.e[ids[k]])
            if end < real(DEPTH) * wp.min(near.swept[4 * j + pairs.PUSH][3], there[3] + climb):
                wp.atomic_max(words, pairs.NEARER, 1)
            j += threads

    return nearer_pairs


@cache
def sweep_count_kernel(module):
    """Kernel: counts sweeps, and ends them behind `most`."""
    @wp.kernel(module=module, enable_backward=False)
    def further_sweeps(most: int, words: wp.array(dtype=int)):
        words[pairs.MORE] = words[pairs.MORE] + 1
        if words[pairs.MORE] > most:
            words[pairs.NEARER] = 0

    return further_sweeps
