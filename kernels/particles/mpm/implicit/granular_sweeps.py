"""Stress of sand at the end of an implicit step, by accelerated Gauss-Seidel over cells of 8 colours (Daviet,
Bertails-Descoubes 2016, section 4: friction in the style of Moreau for the strain of a cell; Klar et al. 2016 for the cone).

    D = sym grad v in the middle of a cell,  v_a = v_a* + h / m_a sum_cells V (S grad N_a + kappa G chi_a),  S = -stress
    E = kappa sum_a v_a chi_a^T,  chi = (yz, zx, xy, xyz) at corners of a cell over 4 dx: what D does not see
    p = tr S / 3 >= -width / slope,  h tr D + opening >= 0,  one of them with "="
    |(dev S, G)| <= slope p + width, and below it (dev D, E) = 0, else (dev D, E) = -lambda (dev S, G)

Sand is rigid until it flows, and then keeps its volume. E are the hourglass strains of Flanagan, Belytschko 1981. Without
their stress G, columns of cells turn like books on a shelf, pressures alternate, and slopes creep below the friction angle.
kappa^2 is the mean of (dev sym grad chi)^2 over a cell, and falls with the lightest corner, which G would push alone.

A sweep meets the condition of p in a cell, and changes (dev S, G) by -(dev D, E) / w, cut to the cone; w bounds the cell's own
response. Cells of one colour share no corner. After each sweep, stress goes on by (k - 1) / (k + 2) of its change (Nesterov
1983), anew in each group of sweeps, and not in one after a residual that grew. Velocities without colliders are linear in
stress and go along; then colliders hold corners. The residual is the root mean square of h w |dS|, a strain.
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
KAPPA = wp.constant(0.58)          # square root of 1/3, a little below the mean of chi = xy
SAID = 3                           # words of the status: sweeps, steps that missed the tolerance, worst residual [% of it]
FINEST = wp.constant(1048576.0)    # parts of the square of the tolerance in which squares of residuals are summed
MOST_PARTS = wp.constant(1.0e12)   # of them that one cell may count


@cache
def cell_functions(real) -> SimpleNamespace:
    """Functions of one cell, whose corners have velocities v and inverse masses a along each axis, (8, 3). part: 1 / (4 dx)."""
    t, sand = types(real), granular_tables(real)
    vec6, vec8i = wp.types.vector(6, real), wp.types.vector(8, int)
    mat34, mat83 = wp.types.matrix((3, 4), real), wp.types.matrix((8, 3), real)

    @wp.func
    def size_squared(S: vec6):
        """Of a symmetric tensor: xx, yy, zz, yz, zx, xy."""
        return S[0] * S[0] + S[1] * S[1] + S[2] * S[2] + real(2.0) * (S[3] * S[3] + S[4] * S[4] + S[5] * S[5])

    @wp.func
    def corner_signs(n: int):
        return t.vec3(real(2 * (n // 4) - 1), real(2 * ((n // 2) % 2) - 1), real(2 * (n % 2) - 1))

    @wp.func
    def hourglass(s: t.vec3):
        """Patterns of a corner: yz, zx, xy, xyz."""
        return t.vec4(s[1] * s[2], s[2] * s[0], s[0] * s[1], s[0] * s[1] * s[2])

    @wp.func
    def gather_corners(corners: sand.SandCorners, rows: vec8i):
        """v, a, and kappa."""
        v = mat83()
        a = mat83()
        sum = real(0.0)
        most = real(0.0)
        for n in range(8):
            at = corners.v[rows[n]]
            free = t.vec3(at[3])
            if at[3] < real(0.0):
                free = corners.free[rows[n]]
            for i in range(3):
                v[n, i] = at[i]
                a[n, i] = free[i]
            sum += wp.abs(at[3])
            most = wp.max(most, wp.abs(at[3]))
        return v, a, real(KAPPA) * sum / (real(8.0) * most)

    @wp.func
    def find_strain(v: mat83, part: real, kappa: real):
        """Rate of strain in the middle, and hourglass strain E [1/s]."""
        L = t.mat33()
        E = mat34()
        half = real(0.5)
        for n in range(8):
            s = corner_signs(n)
            u = t.vec3(v[n, 0], v[n, 1], v[n, 2])
            L += wp.outer(u, s)
            E += wp.outer(u, hourglass(s))
        D = part * vec6(L[0, 0], L[1, 1], L[2, 2], half * (L[1, 2] + L[2, 1]), half * (L[2, 0] + L[0, 2]),
                        half * (L[0, 1] + L[1, 0]))
        return D, (part * kappa) * E

    @wp.func
    def press_cell(v: mat83, a: mat83, p: real, rule: t.vec4, h: real, part: real):
        """The pressure that keeps the volume, and velocities with it; p: the pressure that velocities have."""
        push = h * rule[0] * part
        sum = real(0.0)
        rate = real(0.0)
        for n in range(8):
            s = corner_signs(n)
            for i in range(3):
                sum += a[n, i]
                rate += s[i] * v[n, i]
        least = real(0.0)
        if rule[2] > real(0.0):
            least = -rule[3] / rule[2]
        now = wp.max(p - (part * rate + rule[1] / h) / (push * part * sum), least)
        for n in range(8):
            s = corner_signs(n)
            for i in range(3):
                v[n, i] = v[n, i] + push * (now - p) * a[n, i] * s[i]
        return now, v

    @wp.func
    def shear_cell(S: vec6, G: mat34, D: vec6, E: mat34, p: real, now: real, rule: t.vec4, w: real):
        """Stress in the cone of the pressure `now`; p: that of S."""
        one = real(1.0)
        mean = (D[0] + D[1] + D[2]) / real(3.0)
        found = S - (one / w) * D
        for n in range(3):
            found[n] = found[n] - p + mean / w
        H = G - (one / w) * E
        most = wp.max(rule[2] * now + rule[3], real(0.0))
        size = wp.sqrt(size_squared(found) + wp.ddot(H, H))
        if size > most:
            found = (most / size) * found
            H = (most / size) * H
        for n in range(3):
            found[n] = found[n] + now
        return found, H

    @wp.func
    def corner_force(S: vec6, G: mat34, n: int):
        s = corner_signs(n)
        return t.vec3(S[0] * s[0] + S[5] * s[1] + S[4] * s[2], S[5] * s[0] + S[1] * s[1] + S[3] * s[2],
                      S[4] * s[0] + S[3] * s[1] + S[2] * s[2]) + G * hourglass(s)

    @wp.func
    def push_corners(corners: sand.SandCorners, rows: vec8i, a: mat83, S: vec6, G: mat34, push: real):
        """Adds the impulse of a cell's stress; colliders take what they do not let a corner follow."""
        for n in range(8):
            row = rows[n]
            force = push * corner_force(S, G, n)
            v = corners.v[row]
            dv = v[3] * force
            if v[3] < real(0.0):
                dv = wp.cw_mul(t.vec3(a[n, 0], a[n, 1], a[n, 2]), force)
                corners.held[row] = corners.held[row] + dv + v[3] * force
            corners.v[row] = v + t.vec4(dv[0], dv[1], dv[2], real(0.0))

    made = (size_squared, gather_corners, find_strain, press_cell, shear_cell, push_corners)
    return SimpleNamespace(**{f.func.__name__: f for f in made})


@cache
def sweep_kernels(kinds: tuple[str, ...], real, module) -> SimpleNamespace:
    """Kernels: sweep_color over 8 cells a block; extrapolate_cells over cells; hold_corners over corners."""
    t, T, sand, contact = types(real), point_tables(real), granular_tables(real), contact_functions(kinds, real)
    f, vec6 = cell_functions(real), wp.types.vector(6, real)

    @wp.func
    def largest_response(a: wp.types.matrix((8, 3), real)):
        found = real(0.0)
        for n in range(8):
            found = wp.max(found, wp.max(wp.max(a[n, 0], a[n, 1]), a[n, 2]))
        return real(8.0) * found

    def sweep_color(g: T.BlockGrid, cells: sand.SandCells, corners: sand.SandCorners, color: int, tolerance: real,
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
        v, a, kappa = f.gather_corners(corners, rows)
        peak = largest_response(a)
        if peak <= real(0.0):                                  # colliders hold all its corners
            return
        x = cells.S[cell]
        y = cells.R[cell]
        G = wp.matrix_from_rows(cells.G[0, cell], cells.G[1, cell], cells.G[2, cell])
        p = (x[0] + x[1] + x[2]) / real(3.0)
        now, v = f.press_cell(v, a, p, rule, h, part)
        D, E = f.find_strain(v, part, kappa)
        w = h * rule[0] * part * part * peak
        S, H = f.shear_cell(vec6(x[0], x[1], x[2], y[0], y[1], y[2]), G, D, E, p, now, rule, w)
        cells.S[cell] = t.vec3(S[0], S[1], S[2])
        cells.R[cell] = t.vec3(S[3], S[4], S[5])
        for i in range(3):
            cells.G[i, cell] = H[i]
            S[i] = S[i] - x[i]
            S[i + 3] = S[i + 3] - y[i]
        f.push_corners(corners, rows, a, S, kappa * (H - G), h * rule[0] * part)
        if tolerance > real(0.0):
            r = h * w / tolerance
            more = r * r * (f.size_squared(S) + wp.ddot(H - G, H - G))
            wp.atomic_add(total, 0, wp.int64(wp.min(more * real(FINEST), real(MOST_PARTS))))
            wp.atomic_add(total, 1, wp.int64(1))

    def extrapolate_cells(g: T.BlockGrid, cells: sand.SandCells, beta: real, sweeps: wp.array(dtype=int)):
        cell = wp.tid()
        if cell // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        if g.count[cell] == 0:
            return
        part = beta * real(sweeps[2])
        S = cells.S[cell]
        R = cells.R[cell]
        cells.S[cell] = S + part * (S - cells.S_last[cell])
        cells.R[cell] = R + part * (R - cells.R_last[cell])
        cells.S_last[cell] = S
        cells.R_last[cell] = R
        for i in range(3):
            G = cells.G[i, cell]
            cells.G[i, cell] = G + part * (G - cells.G_last[i, cell])
            cells.G_last[i, cell] = G

    def hold_corners(g: T.BlockGrid, corners: sand.SandCorners, contacts: sand.CornerContacts, beta: real,
                     sweeps: wp.array(dtype=int), clock: wp.array(dtype=real)):
        row = wp.tid()
        if row // CELLS >= wp.min(g.used[0], g.key.shape[0]):
            return
        v = corners.v[row]
        if v[3] == real(0.0):
            return
        now = t.vec3(v[0], v[1], v[2]) - corners.held[row]
        free = now + beta * real(sweeps[2]) * (now - corners.last[row])
        corners.last[row] = now
        held = t.vec3(free)
        count = corners.count[row]
        if count > 0:
            held, along = contact.hold_corner(contacts, row, count, free, clock[0])
            corners.held[row] = held - free
            corners.free[row] = -v[3] * along
        corners.v[row] = t.vec4(held[0], held[1], held[2], v[3])

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)
            for k in (sweep_color, extrapolate_cells, hold_corners)}
    return SimpleNamespace(**made)


@cache
def solve_kernels(real, module) -> SimpleNamespace:
    """Kernels of one thread: begin_solve; check_residual after some sweeps, of at most `most`. word: of the frame's status, see
    SAID. sweeps: sweeps go on, sweeps of this step, 0 after a residual that grew, else 1. total: parts, cells, the parts
    before."""
    name = types(real).name

    def begin_solve(total: wp.array(dtype=wp.int64), sweeps: wp.array(dtype=int)):
        total[0] = wp.int64(0)
        total[1] = wp.int64(0)
        total[2] = wp.int64(-1)
        sweeps[0] = 1
        sweeps[1] = 0
        sweeps[2] = 1

    def check_residual(done: int, most: int, total: wp.array(dtype=wp.int64), sweeps: wp.array(dtype=int),
                       word: wp.array(dtype=int)):
        part = float(total[0]) / (float(FINEST) * wp.max(float(total[1]), 1.0))
        sweeps[2] = 1
        if total[2] >= wp.int64(0) and total[0] > total[2] and sweeps[1] > 0:
            sweeps[2] = 0
        total[2] = total[0]
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
