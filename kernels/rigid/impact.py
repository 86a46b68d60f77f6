"""Impacts: what would touch within a substep, faster than a rest, leaves with a part e of the speed (Newton's law).

    u = sqrt(u_n^2 + 2 a gap),  u_n < 0,  a = -n . (a_A - a_B)         speed at which the gap closes, under the forces
    u' = sqrt(e^2 u^2 - 2 a gap)                                       along n, now: the same bounce, seen from this height

so that the height of a bounce does not depend on the step. Points that meet in one substep are solved together: sweeps until
each has its u', with friction; what they have thrown then meets the next ones, round by round, as a blow runs through a row of
balls. e is the larger of both restitutions. Rests are those below REST times the speed that forces give in a substep.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.complementarity.impact_time import impact_time_shift_func
from wsim.kernels.rigid.contact import rig_type, surface_law_functions
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.kinds import ConstraintKind, at_once_func, by_colour
from wsim.kernels.rigid.lists.core import CORE
from wsim.kernels.rigid.soft_step import contact_goal_functions

ROUNDS, MET = 64, 1.0e-4           # MET: part of the speed to which the sweeps go
SWEEPS, REST = wp.constant(64), wp.constant(4.0)
STILL = wp.constant(2.5e-7)         # of the speed at which what overlaps is pushed apart: rounding, no blow
SOONER = wp.constant(1.01)         # what the soft steps would catch in this substep is an impact, whatever the rounding


def impact_func(kind: ConstraintKind, meet, real, met: float = MET, rounds: int = ROUNDS, timed: bool = False):
    """Function of a substep k of h [s], before its forces, of all contacts, which `kind` knows by their colours. met: part of
    the speed to which the sweeps of a round go. timed: they go on from the time of an impact (complementarity/impact_time.py).
    """
    mark, strike = impact_mark_functions(real, met, timed)
    after = by_colour(kind, impact_time_shift_func(real), meet, real)
    look, sweep = at_once_func(kind, mark, real), by_colour(kind, strike, meet, real)
    Rig, told, end_turn = rig_type(real), flag_reading_func(meet, real), world_turn_func(meet, real)

    @wp.func
    def resolve_impacts(i: int, threads: int, k: int, h: real, rig: Rig):
        for _round in range(int(rounds)):
            if _round > 0:
                end_turn(i, threads, rig)
            look(i, threads, k, h, 0, rig)
            if told(0, i, rig) == 0:
                break
            for _sweep in range(int(SWEEPS)):
                sweep(i, threads, k, h, 0, rig)
                if told(1, i, rig) == 0:
                    break
                end_turn(i, threads, rig)
            if timed:
                after(i, threads, k, h, 0, rig)

    return resolve_impacts


def flag_reading_func(meet, real):
    """Function (flag, i, rig): what a thread has said since this was asked last, and then forgets."""
    Rig = rig_type(real)

    @wp.func
    def flag_was_raised(flag: int, i: int, rig: Rig):
        meet()
        said = rig.work.flags[flag]
        meet()
        if i == 0:
            rig.work.flags[flag] = 0
        meet()                                       # before anyone may say it again
        return said

    return flag_was_raised


def world_turn_func(meet, real):
    """Function (i, threads, rig): behind a sweep, or all of them: worlds go on in which a contact missed its goal, as alone.
    flags (2 + 2 worlds,): what is told to all, then of each world whether it goes on, then whether it missed."""
    Rig = rig_type(real)

    @wp.func
    def end_world_turn(i: int, threads: int, rig: Rig):
        worlds = (rig.work.flags.shape[0] - 2) // 2
        if worlds > 1:
            for w in range(i, worlds, threads):
                rig.work.flags[2 + w] = rig.work.flags[2 + worlds + w]
                rig.work.flags[2 + worlds + w] = 0
            meet()

    return end_world_turn


@cache
def impact_mark_functions(real, met: float = MET, timed: bool = False):
    """(mark, strike): functions of a contact m, a look and a sweep; they tell by a flag what is left to do."""
    t, Rig, (friction_of, restitution_of) = types(real), rig_type(real), surface_law_functions(real)
    _, _, begun, _, pushed, ended, slip, rubbed = impulse_formulas(real)
    fastest = contact_goal_functions(real)[1]

    @wp.func
    def acceleration_of_frame(f: int, rig: Rig):
        a = t.vec3()
        if f < rig.b.w.shape[0]:
            a = rig.b.w[f] * rig.b.push[f]
        return a

    @wp.func
    def mark_impact_points(m: int, k: int, h: real, rig: Rig):
        """Whether a point of manifold m is thrown back in this round; their goals."""
        e = restitution_of(m, rig)
        some = bool(False)
        two = begun(m, k, rig)
        n = rig.c.n[m]
        a = -wp.dot(n,
                    acceleration_of_frame(rig.s.frame[rig.c.a[m]], rig) - acceleration_of_frame(rig.s.frame[rig.c.b[m]], rig))
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            rig.work.goal[j] = real(-1.0)
            rig.work.hit[j] = real(0.0)
            rig.work.scrape[j] = t.vec3()
            u = wp.dot(n, slip(two, j, rig))
            gap = wp.max(rig.work.now[j], real(0.0))
            speed = wp.sqrt(wp.max(u * u + real(2.0) * a * gap, real(0.0)))
            touches = gap + real(SOONER) * h * (u - h * wp.max(a, real(0.0))) < real(0.0)
            if e > real(0.0) and rig.c.key[j] != CORE and u < real(0.0) and touches:
                if speed > real(REST) * h * wp.abs(a) and speed > real(STILL) * fastest(m, rig):
                    if timed:
                        rig.work.goal[j] = u + (real(1.0) + e) * speed
                        rig.work.when[j] = real(2.0) * gap / (speed - u)
                    else:
                        rig.work.goal[j] = wp.sqrt(wp.max(e * e * speed * speed - real(2.0) * a * gap, real(0.0)))
                    some = True
        return some

    @wp.func
    def sweep_manifold_impact(m: int, k: int, rig: Rig):
        """One sweep over manifold m; the largest miss, as a part of the goal's own size."""
        two = begun(m, k, rig)
        n = rig.c.n[m]
        mu = friction_of(m, rig)
        miss = real(0.0)
        A = rig.work.A[m]
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            if rig.work.goal[j] >= real(0.0):
                u = wp.dot(n, slip(two, j, rig))
                before = rig.work.hit[j]
                hit = wp.max(before + (rig.work.goal[j] - u) / A[i, i], real(0.0))
                rig.work.hit[j] = hit
                two = pushed(two, j, (hit - before) * n, rig)
                miss = wp.max(miss, wp.abs(hit - before) / wp.max(hit, real(1.0e-30)))
                was = rig.work.scrape[j]
                rub = rubbed(was, slip(two, j, rig), n, rig.work.K[j], hit, mu)
                rig.work.scrape[j] = rub
                two = pushed(two, j, rub - was, rig)
        ended(two, rig)
        return miss

    @wp.func
    def flag_marked_impact(m: int, k: int, h: real, biased: int, rig: Rig):
        if mark_impact_points(m, k, h, rig):
            rig.work.flags[0] = 1
            rig.work.flags[2 + rig.s.world[rig.c.a[m]]] = 1

    @wp.func
    def flag_missed_impact(m: int, k: int, h: real, biased: int, rig: Rig):
        w = rig.s.world[rig.c.a[m]]
        if rig.work.flags[2 + w] == 1:
            if sweep_manifold_impact(m, k, rig) >= real(met):
                rig.work.flags[1] = 1
                rig.work.flags[2 + (rig.work.flags.shape[0] - 2) // 2 + w] = 1

    return flag_marked_impact, flag_missed_impact
