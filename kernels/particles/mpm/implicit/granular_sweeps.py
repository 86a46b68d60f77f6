"""Stress of sand at the end of an implicit step, by Gauss-Seidel over cells of 8 colours (Daviet, Bertails-Descoubes 2016,
section 4: friction in the style of Moreau for the strain of a cell; Klar et al. 2016 for the cone).

    D = sym grad v in the middle of a cell,  v_a = v_a* + h / m_a sum_cells V S grad N_a,  S = -stress
    p = tr S / 3 >= -width / slope,  h tr D + opening >= 0,  one of them with "=";   |dev S| <= slope p + width, and below it
    dev D = 0, else dev D = -lambda dev S: sand is rigid until it flows, and then keeps its volume

A sweep changes S of a cell by -omega D / w, cuts it to the cone, and adds the force to the cell's corners. w bounds the
eigenvalues of the cell's own response, h V sum_a (grad N_a)(grad N_a)^T / m_a. Cells of one colour share no corner. Colliders
hold corners after each sweep. The residual is the root mean square of h w |dS| / omega, a strain.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.implicit.contacts import contact_functions
from wsim.kernels.particles.mpm.implicit.granular_tables import granular_tables
from wsim.kernels.particles.mpm.tables import CELLS, point_tables

COLOURS = 8
TURNS = wp.constant(3)             # of Newton for a cell that slides
SAID = 3                           # words of the status: sweeps, steps that missed the tolerance, worst residual [% of it]
FINEST = wp.constant(1048576.0)    # parts of the square of the tolerance in which squares of residuals are summed
MOST_PARTS = wp.constant(1.0e12)   # of them that one cell may count


@cache
def sweep_kernels(kinds: tuple[str, ...], real, module) -> SimpleNamespace:
    """Kernels: sweep_color over 8 cells a block; hold_corners over corners."""
    t, T, sand, contact = types(real), point_tables(real), granular_tables(real), contact_functions(kinds, real)
    vec6, vec8i, mat84 = wp.types.vector(6, real), wp.types.vector(8, int), wp.types.matrix((8, 4), real)

    @wp.func
    def size_squared(S: vec6):
        """Of a symmetric tensor: xx, yy, zz, yz, zx, xy."""
        return S[0] * S[0] + S[1] * S[1] + S[2] * S[2] + real(2.0) * (S[3] * S[3] + S[4] * S[4] + S[5] * S[5])

    @wp.func
    def slide_stress(S: vec6, w: vec6, most: real):
        """S_i w_i / (w_i + alpha) of the size `most`, alpha >= 0, of a stress that is beyond the cone: Newton from below."""
        size = wp.sqrt(size_squared(S))
        found = S
        if size > most:
            alpha = wp.min(w) * (size - most) / wp.max(most, real(1.0e-6) * size)
            turns = int(TURNS)
            for _ in range(turns):
                slope = real(0.0)
                for n in range(6):
                    found[n] = S[n] * w[n] / (w[n] + alpha)
                now = size_squared(found)
                for n in range(6):
                    part = real(1.0)
                    if n > 2:
                        part = real(2.0)
                    slope += part * found[n] * found[n] / (w[n] + alpha)
                size = wp.sqrt(now)
                alpha += wp.max((size - most) * size / wp.max(slope, real(1.0e-30)), real(0.0))
            found = wp.min(most / wp.max(size, real(1.0e-30)), real(1.0)) * found
        return found

    @wp.func
    def solve_cell(S: vec6, D: vec6, Q: vec6, rule: t.vec4, h: real, omega: real):
        """Change of a cell's stress, and the weights w of it. Q: h V sym(sum_a (grad N_a)(grad N_a)^T / m_a)."""
        third = real(1.0 / 3.0)
        zero = real(0.0)
        p = third * (S[0] + S[1] + S[2])
        least = zero
        if rule[2] > zero:
            least = -rule[3] / rule[2]
        change = wp.max(p - omega * (D[0] + D[1] + D[2] + rule[1] / h) / (Q[0] + Q[1] + Q[2]), least) - p
        now = D + change * Q
        mean = third * (now[0] + now[1] + now[2])
        off = wp.max(wp.max(wp.abs(Q[4]) + wp.abs(Q[5]), wp.abs(Q[5]) + wp.abs(Q[3])), wp.abs(Q[3]) + wp.abs(Q[4]))
        diagonal = wp.max(wp.max(Q[0], Q[1]), Q[2]) + off
        half = real(0.5)
        w = vec6(diagonal, diagonal, diagonal, half * (Q[1] + Q[2]) + off, half * (Q[2] + Q[0]) + off,
                 half * (Q[0] + Q[1]) + off)
        trial = vec6()
        for n in range(3):
            trial[n] = S[n] - p - omega * (now[n] - mean) / w[n]
            trial[n + 3] = S[n + 3] - omega * now[n + 3] / w[n + 3]
        p += change
        found = slide_stress(trial, w, wp.max(rule[2] * p + rule[3], zero))
        for n in range(3):
            found[n] = found[n] + p
        return found - S, w

    @wp.func
    def gather_strain(corners: sand.SandCorners, rows: vec8i, part: real):
        """Rate of strain [1/s] in the middle of a cell, part^2 times its answer to an impulse, and the corners' velocities and
        inverse masses; part: 1 / (4 dx)."""
        found = mat84()
        x = t.vec3()
        y = t.vec3()
        z = t.vec3()
        Q = vec6()
        half = real(0.5)
        for n in range(8):
            v = corners.v[rows[n]]
            found[n] = v
            a = t.vec3(v[3])
            if v[3] < real(0.0):
                a = corners.free[rows[n]]
            u = t.vec3(v[0], v[1], v[2])
            d = real(2 * (n // 4) - 1)
            e = real(2 * ((n // 2) % 2) - 1)
            f = real(2 * (n % 2) - 1)
            x += d * u
            y += e * u
            z += f * u
            Q += vec6(a[0], a[1], a[2], half * e * f * (a[1] + a[2]), half * f * d * (a[2] + a[0]),
                      half * d * e * (a[0] + a[1]))
        D = part * vec6(x[0], y[1], z[2], half * (y[2] + z[1]), half * (z[0] + x[2]), half * (x[1] + y[0]))
        return D, (part * part) * Q, found

    @wp.func
    def push_corners(corners: sand.SandCorners, rows: vec8i, at: mat84, S: vec6, push: real):
        """Adds the impulse of a cell's stress; colliders take what they do not let a corner follow."""
        for n in range(8):
            row = rows[n]
            d = push * real(2 * (n // 4) - 1)
            e = push * real(2 * ((n // 2) % 2) - 1)
            f = push * real(2 * (n % 2) - 1)
            force = t.vec3(S[0] * d + S[5] * e + S[4] * f, S[5] * d + S[1] * e + S[3] * f, S[4] * d + S[3] * e + S[2] * f)
            v = at[n]
            dv = v[3] * force
            if v[3] < real(0.0):
                dv = wp.cw_mul(corners.free[row], force)
                corners.held[row] = corners.held[row] + dv + v[3] * force
            corners.v[row] = v + t.vec4(dv[0], dv[1], dv[2], real(0.0))

    def sweep_color(g: T.BlockGrid, cells: sand.SandCells, corners: sand.SandCorners, color: int, omega: real, tolerance: real,
                    clock: wp.array(dtype=real), total: wp.array(dtype=wp.int64)):
        """tolerance above 0: the residual is added to the total."""
        b = wp.tid() // 8
        if b >= wp.min(g.used[0], g.key.shape[0]):
            return
        s = wp.tid() % 8
        local = 16 * (2 * (s // 4) + color // 4) + 4 * (2 * ((s // 2) % 2) + (color // 2) % 2) + 2 * (s % 2) + color % 2
        cell = b * CELLS + local
        if g.count[cell] == 0:
            return
        rows = sand.corner_rows(g, b, local)
        rule = cells.rule[cell]
        h = clock[0]
        part = real(0.25) / g.dx
        D, Q, at = gather_strain(corners, rows, part)
        if Q[0] + Q[1] + Q[2] <= real(0.0):                    # colliders hold all its corners
            return
        diagonal = cells.S[cell]
        shear = cells.R[cell]
        S, w = solve_cell(vec6(diagonal[0], diagonal[1], diagonal[2], shear[0], shear[1], shear[2]), D, (h * rule[0]) * Q, rule,
                          h, omega)
        cells.S[cell] = diagonal + t.vec3(S[0], S[1], S[2])
        cells.R[cell] = shear + t.vec3(S[3], S[4], S[5])
        push_corners(corners, rows, at, S, h * rule[0] * part)
        if tolerance > real(0.0):
            r = h / (omega * tolerance)
            more = r * r * size_squared(wp.cw_mul(w, S))
            wp.atomic_add(total, 0, wp.int64(wp.min(more * real(FINEST), real(MOST_PARTS))))
            wp.atomic_add(total, 1, wp.int64(1))

    def hold_corners(g: T.BlockGrid, corners: sand.SandCorners, contacts: sand.CornerContacts, clock: wp.array(dtype=real)):
        row = wp.tid()
        if row // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        count = corners.count[row]
        if count <= 0:
            return
        v = corners.v[row]
        free = t.vec3(v[0], v[1], v[2]) - corners.held[row]
        held, along = contact.hold_corner(contacts, row, count, free, clock[0])
        corners.v[row] = t.vec4(held[0], held[1], held[2], v[3])
        corners.held[row] = held - free
        corners.free[row] = -v[3] * along

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)
            for k in (sweep_color, hold_corners)}
    return SimpleNamespace(**made)


@cache
def solve_kernels(real, module) -> SimpleNamespace:
    """Kernels of one thread: begin_solve; check_residual after some sweeps, of at most `most`. word: of the frame's status, see
    SAID."""
    name = types(real).name

    def begin_solve(total: wp.array(dtype=wp.int64), sweeps: wp.array(dtype=int)):
        total[0] = wp.int64(0)
        total[1] = wp.int64(0)
        sweeps[0] = 1
        sweeps[1] = 0

    def check_residual(done: int, most: int, total: wp.array(dtype=wp.int64), sweeps: wp.array(dtype=int),
                       word: wp.array(dtype=int)):
        part = float(total[0]) / (float(FINEST) * wp.max(float(total[1]), 1.0))
        total[0] = wp.int64(0)
        total[1] = wp.int64(0)
        sweeps[1] = sweeps[1] + done
        word[0] = word[0] + done
        if part <= 1.0 or sweeps[1] >= most:
            sweeps[0] = 0
            percent = int(wp.min(100.0 * wp.sqrt(part), 1.0e9))
            word[2] = wp.max(word[2], percent)
            if part > 1.0:
                word[1] = word[1] + 1

    made = {k.__name__: wp.kernel(k, name=f"mpm_sand_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (begin_solve, check_residual)}
    return SimpleNamespace(**made)
