"""Transfers between particles and a staggered grid: PIC (Harlow 1964), FLIP (Brackbill, Ruppel 1986), APIC (Jiang, Schroeder,
Selle, Teran, Stomakhin 2015, section 5.3: one affine vector for each component of a staggered velocity).

    to the grid       m_i = sum_p w_ip,   m_i u_i = sum_p w_ip (v_p + c_p . (x_i - x_p))            per component
    back   pic        v_p = sum_i w_ip u_i
           flip       v_p = s (v_p + sum_i w_ip (u_i - u_i before)) + (1 - s) sum_i w_ip u_i
           apic       v_p = sum_i w_ip u_i,   c_p = sum_i u_i grad w_ip

    w       product of hats 1 - |x_i - x_p| / dx: linear interpolation, whose weights sum to 1
    c       gradient of a component [1/s]; 0 but of apic
    s       part of flip; 1 keeps all noise

Of all three the momentum on the grid is that of the particles, to rounding; apic keeps the angular momentum too. Both
directions are gathers: a face reads the particles of the cells around it (`sort`), in one order. Within half a cell of a side
that is not periodic a particle counts as if it stood at the last row of a component, in both directions. Beside walls that are
thinner than the grid can tell (`thin`, kernels/particles/walls.py) a particle and a row that do not see each other count for
nothing in both directions: w is of the rows that it sees, over their sum.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs, wrap_row
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_structs

TRANSFERS = ("apic", "flip", "pic")


@cache
def transfer_stencils(dim: int, real) -> SimpleNamespace:
    """reach(g, axis, i, b) -> (first, last) cell along axis b about row i of a component (-1: of the centres); rows(g, axis, x)
    -> place of x [m] in rows, held within them; hat(d) -> weight at d rows; image(g, j) -> (cell that stands for j, whole
    periods [m] that it is away; no cell: first component -1); sees(bits, axis, m) -> whether a particle of these bits sees the
    row at its corner m; corner(away) -> m of the row that is `away` rows from it."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @wp.func
    def transfer_reach(axis: int, i: int, b: int):
        last = i + 1
        if b == axis:
            last = i
        return i - 1, last

    @wp.func
    def place_in_rows(g: S.Grid, axis: int, x: t.vec3):
        s = x / g.dx - f.offset(axis)
        for b in range(wp.static(dim)):
            if g.periodic[b] == 0:
                n = g.n[b] - 1
                if b == axis:
                    n = g.n[b]
                s[b] = wp.clamp(s[b], real(0.0), real(n))
        return s

    @wp.func
    def hat_weight(d: real):
        return wp.max(real(1.0) - wp.abs(d), real(0.0))

    @wp.func
    def periodic_image(g: S.Grid, j: wp.vec3i):
        """Shift in cells is added to the place of a particle there."""
        i = wp.vec3i(0, 0, 0)
        shift = t.vec3()
        for b in range(wp.static(dim)):
            i[b] = j[b]
            if g.periodic[b] != 0:
                i[b] = wrap_row(j[b], g.n[b], 1)
                shift[b] = real(j[b] - i[b])
            elif j[b] < 0 or j[b] >= g.n[b]:
                i[0] = -1
                return i, shift
        return i, shift

    @wp.func
    def hat_corner(away: t.vec3):
        m = int(away[0] > real(0.0)) + 2 * int(away[1] > real(0.0))
        if wp.static(dim == 3):
            m += 4 * int(away[2] > real(0.0))
        return m

    @wp.func
    def row_is_seen(bits: int, axis: int, m: int):
        return ((bits >> ((axis + 1) * wp.static(2 ** dim) + m)) & 1) != 0

    return SimpleNamespace(reach=transfer_reach, rows=place_in_rows, hat=hat_weight, image=periodic_image, corner=hat_corner,
                           sees=row_is_seen)


@cache
def particle_to_grid_kernel(dim: int, affine: bool, thin: bool, real, module):
    """Kernel over the faces of an axis: u_out [m/s], 0 where there is no particle; mass_out, in particles."""
    t, S, T, f, s = (types(real), grid_structs(real), particle_structs(real), grid_functions(dim, real),
                     transfer_stencils(dim, real))

    def particle_to_grid(g: S.Grid, axis: int, particles: T.Particles, cells: T.Cells, u_out: wp.array(dtype=real),
                         mass_out: wp.array(dtype=real)):
        face = wp.tid()
        i = f.place(face, f.faces(g, axis))
        low = wp.vec3i(0, 0, 0)
        high = wp.vec3i(0, 0, 0)
        for b in range(wp.static(dim)):
            first, last = s.reach(axis, i[b], b)
            low[b] = first
            high[b] = last
        at = t.vec3(real(i[0]), real(i[1]), real(i[2]))
        mass = real(0.0)
        sum = real(0.0)
        for a in range(low[0], high[0] + 1):
            for b in range(low[1], high[1] + 1):
                for d in range(low[2], high[2] + 1):
                    j, shift = s.image(g, wp.vec3i(a, b, d))
                    if j[0] >= 0:
                        c = flat_cell_index(j, g.n)
                        for k in range(cells.first[c], cells.first[c + 1]):
                            p = cells.order[k]
                            away = at - shift - s.rows(g, axis, particles.x[p])
                            w = s.hat(away[0]) * s.hat(away[1])
                            if wp.static(dim == 3):
                                w *= s.hat(away[2])
                            if wp.static(thin):
                                if not s.sees(particles.seen[p], axis, s.corner(away)):
                                    w = real(0.0)
                            if w > real(0.0):
                                v = particles.v[p]
                                value = v[axis]
                                if wp.static(affine):
                                    C = particles.C[p]
                                    for m in range(wp.static(dim)):
                                        value += C[axis, m] * g.dx * away[m]
                                mass += w
                                sum += w * value
        u = real(0.0)
        if mass > real(0.0):
            u = sum / mass
        u_out[face] = u
        mass_out[face] = mass

    name = f"to_faces{'_affine' * affine}{'_thin' * thin}_{f.name}"
    return wp.kernel(particle_to_grid, name=name, module=module, enable_backward=False)


@cache
def seen_sample_function(dim: int, affine: bool, thin: bool, real):
    """Function (g, u, axis, x, bits) -> (value of a component at x [m], its gradient [1/s], part of the weights that a particle
    of these bits sees). Rows that it does not see have the mean of those that it sees."""
    t, S, f, s = types(real), grid_structs(real), grid_functions(dim, real), transfer_stencils(dim, real)

    @wp.func(inline=False)
    def seen_rows_mean(g: S.Grid, u: wp.array(dtype=real), axis: int, at: t.vec3, base: wp.vec3i, bits: int):
        """(mean of the rows that are seen, their part of the weights)."""
        shape = f.faces(g, axis)
        sum = real(0.0)
        whole = real(0.0)
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            if s.sees(bits, axis, m):
                i = base + wp.vec3i(m % 2, (m // 2) % 2, m // 4)
                w = s.hat(real(i[0]) - at[0]) * s.hat(real(i[1]) - at[1])
                if wp.static(dim == 3):
                    w *= s.hat(real(i[2]) - at[2])
                sum += w * u[f.row(i[0], i[1], i[2], shape, g.periodic)]
                whole += w
        if whole > real(0.0):
            sum = sum / whole
        return sum, whole

    @wp.func
    def sample_seen_rows(g: S.Grid, u: wp.array(dtype=real), axis: int, x: t.vec3, bits: int):
        shape = f.faces(g, axis)
        at = s.rows(g, axis, x)
        base = wp.vec3i(0, 0, 0)
        for b in range(wp.static(dim)):
            base[b] = int(wp.floor(at[b]))
        value = real(0.0)
        slope = t.vec3()
        rest = real(0.0)
        whole = real(1.0)
        if wp.static(thin):
            if bits != -1:
                rest, whole = seen_rows_mean(g, u, axis, at, base, bits)
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            i = base + wp.vec3i(m % 2, (m // 2) % 2, m // 4)
            away = t.vec3(real(i[0]), real(i[1]), real(i[2])) - at
            q = u[f.row(i[0], i[1], i[2], shape, g.periodic)]
            if wp.static(thin):
                if not s.sees(bits, axis, m):
                    q = rest
            w = t.vec3(s.hat(away[0]), s.hat(away[1]), real(1.0))
            sign = t.vec3(real(2 * (m % 2) - 1), real(2 * ((m // 2) % 2) - 1), real(2 * (m // 4) - 1))
            if wp.static(dim == 3):
                w[2] = s.hat(away[2])
            value += w[0] * w[1] * w[2] * q
            if wp.static(affine):
                slope[0] = slope[0] + sign[0] * w[1] * w[2] * q / g.dx
                slope[1] = slope[1] + w[0] * sign[1] * w[2] * q / g.dx
                if wp.static(dim == 3):
                    slope[2] = slope[2] + w[0] * w[1] * sign[2] * q / g.dx
        return value, slope, whole

    return sample_seen_rows


@cache
def grid_to_particle_kernel(dim: int, transfer: str, thin: bool, real, module):
    """Kernel over rows: v (and C) of each particle from u; of flip `before`, what `particle_to_grid_kernel` had left, and the
    part s. A component that a particle sees no row of stays as it is."""
    S, T = grid_structs(real), particle_structs(real)
    affine, flip = transfer == "apic", transfer == "flip"
    read = seen_sample_function(dim, affine, thin, real)

    @wp.func
    def transferred_component(g: S.Grid, u: wp.array(dtype=real), before: wp.array(dtype=real), axis: int,
                              particles: T.Particles, p: int, s: real, out: T.Particles):
        bits = int(-1)
        if wp.static(thin):
            bits = particles.seen[p]
        value, slope, part = read(g, u, axis, particles.x[p], bits)
        if wp.static(flip):
            old, none, no = read(g, before, axis, particles.x[p], bits)
            v = particles.v[p]
            value = value + s * (v[axis] - old)
        if wp.static(thin):
            if part <= real(0.0):
                v = particles.v[p]
                value = v[axis]
        if wp.static(affine):
            C = particles.C[p]
            C[axis, 0] = slope[0]
            C[axis, 1] = slope[1]
            C[axis, 2] = slope[2]
            out.C[p] = C
        return value

    def grid_to_particle(g: S.Grid, u: S.Faces, before: S.Faces, s: real, particles: T.Particles, out: T.Particles):
        p = wp.tid()
        if particles.id[p] >= 0:
            v = particles.v[p]
            v[0] = transferred_component(g, u.x, before.x, 0, particles, p, s, out)
            v[1] = transferred_component(g, u.y, before.y, 1, particles, p, s, out)
            if wp.static(dim == 3):
                v[2] = transferred_component(g, u.z, before.z, 2, particles, p, s, out)
            out.v[p] = v

    name = f"to_particles_{transfer}{'_thin' * thin}_{dim}d_{types(real).name}"
    return wp.kernel(grid_to_particle, name=name, module=module, enable_backward=False)
