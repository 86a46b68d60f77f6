"""Pushes of contact rows in a Newton step: their stiffness, their law at d, and what they add to forces and diagonal blocks.
Equations: kernels/contact/selfcontact/newton/law.py."""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.newton.law import (
    AHEAD,
    BLOCK,
    CHECK,
    DEPTH,
    LITTLE,
    MOVING,
    RENEW,
    STIFF,
    STORE,
    WRONG,
    contact_row_funcs,
    coulomb_law_func,
    law_type,
    row_sum_func,
)
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.newton import inverse_of, newton_structs


@cache
def row_stiffness_kernel(real, module):
    """Kernel over rows where a substep begins: k, and `away` with what is passed in it, by the prediction. A: the system
    without contacts. Rows with a strand are not solved for."""
    t, Surfaces, Pairs, Laws, Matrix = (types(real), pairs.surface_type(real), pairs.pair_type(real), law_type(real),
                                        newton_structs(real).Matrix)
    State, passed = point_states(real), contact_row_funcs(real)[-1]

    @wp.kernel(module=module, enable_backward=False)
    def stiffen_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), A: Matrix, threads: int, law: Laws):
        near = near_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            ids = near.four[j]
            b = near.swept[4 * j + pairs.B]
            there = near.swept[4 * j + pairs.NORMAL]
            n = t.vec3(there[0], there[1], there[2])
            soft = real(0.0)
            for k in range(4):
                if ids[k] < law.points:
                    soft += b[k] * b[k] * wp.dot(n, A.P[ids[k]] * n)
                elif s.body[ids[k]] >= 0:
                    soft = real(-1.0e30)
            near.stiff[j] = real(0.0)
            near.rho[j] = real(-1.0)
            near.force[j] = t.vec3()
            if soft > real(0.0):
                near.stiff[j] = real(STIFF) / (soft * law.rate)
                away = there[3] + passed(s, at, law, ids, b, n, near.swept[4 * j + pairs.PUSH][3])
                near.swept[4 * j + pairs.NORMAL] = t.vec4(n[0], n[1], n[2], away)
            j += threads

    return stiffen_rows


@cache
def row_push_kernel(real, module):
    """Kernel over rows at d. act:

    PRESS    P+, rho, and diagonal blocks of the rows that push       RENEW   the same, behind P = P+ if a row is wrong, and the
             or would have in the step before                                 step settled
    CHECK    words[WRONG] becomes 1 where a push is wrong by what moves a row by more than DEPTH of what it keeps, words[MOVING]
             where the last step has moved a row by more than LITTLE of it
    STORE    P = P+                                                   LOOK    P+ and rho
    """
    t, Surfaces, Pairs, State, Laws = (types(real), pairs.surface_type(real), pairs.pair_type(real), point_states(real),
                                       law_type(real))
    (friction, levers, _, _, lacking, _), allowed = contact_row_funcs(real), coulomb_law_func(real)

    @wp.func
    def add_row_blocks(s: Surfaces, near: Pairs, law: Laws, j: int, ids: wp.vec4i, b: t.vec4, H: t.mat33):
        for k in range(4):
            i = ids[k]
            if i < law.points:
                part = real(BLOCK) * near.stiff[j] * b[k] * b[k] * s.w[i]
                for a in range(3):
                    wp.atomic_add(law.block, 6 * i + a, wp.int64(part * H[a, a]))
                    wp.atomic_add(law.block, 6 * i + 3 + a, wp.int64(part * H[a, (a + 1) % 3]))

    @wp.func
    def check_push_change(near: Pairs, j: int, C: real, lam: real, keep: real, words: wp.array(dtype=int)):
        wrong = wp.max(lam - near.stiff[j] * C, real(0.0)) - lam
        if wp.abs(wrong) > real(DEPTH) * near.stiff[j] * keep:
            wp.atomic_max(words, WRONG, 1)
        if wp.abs(C - near.last[j]) > real(LITTLE) * keep and wp.min(C, near.last[j]) < keep:
            wp.atomic_max(words, MOVING, 1)

    @wp.kernel(module=module, enable_backward=False)
    def renew_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), act: int, threads: int, law: Laws,
                   words: wp.array(dtype=int)):
        near = near_at[0]
        renews = act == STORE or (act == RENEW and words[WRONG] > 0 and words[MOVING] == 0)
        j = wp.tid()
        while j < near.rows[0]:
            if near.stiff[j] > real(0.0):
                ids = near.four[j]
                b = near.swept[4 * j + pairs.B]
                there = near.swept[4 * j + pairs.NORMAL]
                pushed = near.swept[4 * j + pairs.PUSH]
                n = t.vec3(there[0], there[1], there[2])
                P = t.vec3(pushed[0], pushed[1], pushed[2])
                mu = friction(s, ids, b)
                r, D, K = levers(s, at, ids, b)
                u = lacking(s, at, near, law, j, r, D, K)
                if act == CHECK:
                    check_push_change(near, j, wp.dot(u, n), wp.dot(P, n), pushed[3], words)
                else:
                    then, rho = allowed(n, P - near.stiff[j] * u, mu)
                    if renews:
                        near.swept[4 * j + pairs.PUSH] = t.vec4(then[0], then[1], then[2], pushed[3])
                        near.push[near.row[j]] = then
                        if act == RENEW:
                            then, rho = allowed(n, then - near.stiff[j] * u, mu)
                    if act <= RENEW and rho < real(0.0) and near.rho[j] == real(AHEAD):      # what stopped the step before
                        rho = real(0.0)
                        then = wp.min(-near.stiff[j] * wp.dot(u, n), real(0.0)) * n
                    near.force[j] = then
                    near.rho[j] = rho
                    near.last[j] = wp.dot(u, n)
                    if act <= RENEW and rho >= real(0.0):
                        across = wp.where(mu[0] > real(0.0), rho, real(0.0))
                        H = across * wp.identity(n=3, dtype=real) + (real(1.0) - across) * wp.outer(n, n)
                        add_row_blocks(s, near, law, j, ids, b, H)
            j += threads

    return renew_rows


@cache
def join_block_kernel(real, module):
    """Kernel over points: diagonal blocks with those of rows, their inverses, and what sums are scaled by."""
    t, Laws, Matrix = types(real), law_type(real), newton_structs(real).Matrix

    @wp.kernel(module=module, enable_backward=False)
    def join_blocks(w: wp.array(dtype=real), law: Laws, A_out: Matrix):
        i = wp.tid()
        law.scale[i] = real(0.0)
        if w[i] > real(0.0):
            P = A_out.P[i]
            part = real(1.0 / BLOCK) * law.rate / w[i]
            x, y, z = real(law.block[6 * i]), real(law.block[6 * i + 1]), real(law.block[6 * i + 2])
            xy, yz, zx = real(law.block[6 * i + 3]), real(law.block[6 * i + 4]), real(law.block[6 * i + 5])
            D = wp.inverse(P)
            if x + y + z > real(0.0):
                D += part * wp.matrix_from_rows(t.vec3(x, xy, zx), t.vec3(xy, y, yz), t.vec3(zx, yz, z))
                A_out.P[i] = inverse_of(D, A_out.own[i])
                for k in range(6):
                    law.block[6 * i + k] = wp.int64(0)
            law.scale[i] = real(1.0) / wp.trace(D)

    return join_blocks


@cache
def row_force_kernel(real, module):
    """Kernel over rows: sums of what rows push points by."""
    Surfaces, Pairs, State, Laws = pairs.surface_type(real), pairs.pair_type(real), point_states(real), law_type(real)
    (_, levers, _, share, _, _), add = contact_row_funcs(real), row_sum_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def give_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), threads: int, law: Laws):
        near = near_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            if near.rho[j] >= real(0.0):
                ids = near.four[j]
                b = near.swept[4 * j + pairs.B]
                r, D, K = levers(s, at, ids, b)
                P = (law.rate / law.ahead) * near.force[j]
                for k in range(4):
                    if ids[k] < law.points:
                        add(law, ids[k], share(r, D, K, b, P, k))
            j += threads

    return give_rows


@cache
def row_sum_transfer_kernel(real, module):
    """Kernel over points: adds `sign` times the sums to forces; the sums are zero again."""
    t, Laws = types(real), law_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def take_sums(law: Laws, sign: real, f: wp.array(dtype=t.vec3), f_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if law.scale[i] > real(0.0):
            part = sign / (real(pairs.SCALE) * law.scale[i])
            f_out[i] = f[i] + part * t.vec3(real(law.sum[3 * i]), real(law.sum[3 * i + 1]), real(law.sum[3 * i + 2]))
            for k in range(3):
                law.sum[3 * i + k] = wp.int64(0)

    return take_sums
