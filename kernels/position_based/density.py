"""Fluids by constraints on density (Macklin, Mueller 2013), as multipliers that last over iterations and substeps.

    x = y + u  where a particle is, y where the substep began [m]      d  distance of particles at rest [m]     V = d^3
    r, e       distance of a pair [m], unit vector from j to i         H  reach of the kernel, 2 d              s  distance to
    a wall W(r) = 15 / (pi H^3) (1 - r/H)^3          G_ij = V / S W'(r) e     lam  multiplier, a pressure is lam / (g^2 V)
    [Pa]

    C_i = (sum_j V W_ij + sum_walls B(s)) / S - 1 <= 0                 S: the same sum where d is the lattice's, 1.236
    D_i = w |sum_j G_ij + G_wall|^2 + w sum_j |G_ij|^2                 all particles have one inverse mass w, but those held: 0
    lam_i' = max(lam_i + b_n dlam_i + a_n (C_i - E_i) / D_i, 0)        n: of the iteration         E  C where a substep begins
    d_i -= w_i (sum_j (dlam_i + dlam_j) G_ij + dlam_i G_wall)          dlam = lam' - lam

This kernel has nearly the same sum on each lattice (cubic, face-centred, body-centred: 1.2359, 1.2336, 1.2357), so that a
fluid keeps its volume however it comes to lie; and it pushes hardest where particles are close. Pressure is never negative, so
that no artificial one (eq. 13 there) has to part them. Pairs take opposite pushes: momentum is kept to rounding.

A wall stands for layers of particles at s + d/2 and s + 3d/2 behind it, each spread over its plane:

    B(s) = sum_k 1.5 d/H (1 - q)^4 (1 + 4 q),   q = (s + (k + 1/2) d) / H,        B' = sum_k -30 d/H^2 q (1 - q)^3

In a corner layers would count twice: walls together have the part 1 - product of (1 - B / S).
All particles are corrected at once, with the weights a_n, b_n of Chebyshev polynomials of the fourth kind (Lottes 2022) for
eigenvalues of J W J^T / D up to MOST_EIGENVALUE. They converge over substeps, since lam lasts. Pairs nearer than NEAREST d
part; in one place, as their order says.

Iterations keep densities as they are where a substep begins. The last one adds CORRECTED E_i / D_i, which moves particles but
does not last. If lam lasted with it, it would integrate an error twice behind the velocity: let iterations take the part a of
a mode; then z^3 = (1 - a) (z^3 - (z - 1)^3) for its change z in a substep, and |z| > 1 where a < 1/2. So each fluid deeper than
its iterations reach would boil. With E_i the modes have |z|^2 = 1 - a, about, and errors of volume decay, for all a and depths.
A fluid that is thinner than at rest, by up to half of MOST_THIN, keeps E_i < 0 where lam lasts: both signs decay alike.

Pressure that lasts pushes in the places where a substep begins. It is a stiff spring as pairs turn, and bursts where it moves
neighbours by a large part of d. So what lasts has a bound, MOST_KEPT: there iterations take all of the error (E_i = 0). D_i and
the change of lam in an iteration have bounds too.
Self-terms and the kernel's slope dilute both: with K = -sum_j r.G_ij / 3 = 0.76 the error of the volume is C / K, and the
pressure K lam / (g^2 V), its virial.
"""

# ruff: noqa: UP018       int(0) makes a variable of what would be a constant
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.packets.sums import row_sums
from wsim.kernels.position_based.pair_sums import LATTICE, REACHED

LEAST_SLOPE = 0.05     # d^2 D_i / w at least: 0.066 of two particles at rest, 0.25 of a lattice
MOST_KEPT = 0.3        # w lam / d^2 that lasts at most: such a pressure moves a neighbour at rest by 0.05 d in a substep
MOST_CHANGE = 1.0      # the same of its change in an iteration
MOST_EIGENVALUE = 3.0  # of J W J^T / D: 2.45 of the cubic lattice
CORRECTED = 0.25       # of E / D, a substep: at 0.5 two iterations boil, as |z| = 1.12 says
PARTED = 0.01          # of what pairs nearer than NEAREST d lack, an iteration
WALLS = 3              # of a particle at most, the nearest ones: a corner has three


def iteration_weights(i: int) -> tuple[float, float]:
    """(a_n, b_n) of iteration i = n - 1."""
    return (8 * i + 4) / (2 * i + 3) / MOST_EIGENVALUE, max(2 * i - 1, 0) / (2 * i + 3)


@cache
def fluid_structs(real) -> SimpleNamespace:
    """Structs: FluidTable (constants and scratch by place)."""
    t = types(real)

    @wp.struct
    class FluidTable:
        d: t.scalar                        # distance at rest [m]
        w: wp.array(dtype=t.scalar)        # inverse mass of points of the state
        y: wp.array(dtype=t.vec4)          # by k [m]; fourth: see flow.py
        at: wp.array(dtype=t.vec4)         # y + u, by k [m]; fourth: change of lam in the iteration before
        lam: wp.array(dtype=t.scalar)      # by k [J s^2]
        wall: wp.array(dtype=t.vec4)       # normal, and s of y; entry e of place k at e * count + k; s >= H: none
        rate: wp.array(dtype=t.vec3)       # velocity of each of these walls [m/s]
        push: wp.array(dtype=t.vec3)       # G_wall, by k [1/m]
        pressure: wp.array(dtype=t.scalar) # by p [Pa], what lasts
        tight: wp.array(dtype=t.scalar)    # C, by k
        start: wp.array(dtype=t.scalar)    # E, by k
        lasting: wp.array(dtype=t.scalar)  # what of lam lasts, by k [J s^2]

    return SimpleNamespace(FluidTable=FluidTable)


@wp.func
def wall_weight(s: Any, H: Any):
    """(B(s) / S, its slope [1/m]) for d = H / 2."""
    one = type(s)(1.0)
    B = type(s)(0.0)
    slope = type(s)(0.0)
    for k in range(2):
        q = wp.max(s / H + type(s)(0.25) + type(s)(0.5) * type(s)(k), type(s)(0.0))
        a = wp.max(one - q, type(s)(0.0))
        B += type(s)(0.75 / LATTICE) * a * a * a * a * (one + type(s)(4.0) * q)
        slope -= type(s)(15.0 / LATTICE) * q * a * a * a / H
    return B, slope


@wp.func
def place_of(p: Any):
    """The first three of four."""
    return wp.vector(p[0], p[1], p[2])


@cache
def fluid_gather_kernel(real, module):
    """Kernel over places: y, y + u and the pressures that last, in the order of cells; h [s]."""
    t, N, S = types(real), neighbour_structs(real), fluid_structs(real)

    def gather_fluid(rows: N.ParticleTable, c: N.CellTable, f: S.FluidTable, x: wp.array(dtype=t.vec3),
                     d: wp.array(dtype=t.vec3), h: real):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        y = x[i] + rows.shift[p]
        lam = f.pressure[p] * h * h * f.d * f.d * f.d
        if f.w[i] > real(0.0):
            lam = wp.min(lam, real(MOST_KEPT) * f.d * f.d / f.w[i])
        f.y[k] = t.vec4(y[0], y[1], y[2], real(0.0))
        f.at[k] = t.vec4(y[0] + d[i][0], y[1] + d[i][1], y[2] + d[i][2], lam)
        f.lam[k] = lam

    return kernel_over_cores(gather_fluid, f"fluid_gather_{t.name}", module)


@cache
def fluid_wall_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over places: the walls within reach of a particle at the end of a substep, at the time [s] of the frame."""
    t, S = types(real), fluid_structs(real)
    Colliders, ask = collider_type(real), collider_queries(kinds, real)

    def find_fluid_walls(f: S.FluidTable, colliders: Colliders, time: real):
        k = wp.tid()
        H = real(REACHED) * f.d
        y = place_of(f.y[k])
        far = H + wp.length(place_of(f.at[k]) - y)
        m = int(0)
        for c in range(colliders.kind.shape[0]):
            s, n, place = ask.closest(colliders, c, y, time)
            if s < far:
                at = int(m)
                if m == wp.static(WALLS):                # the farthest gives way
                    at = 0
                    for e in range(1, wp.static(WALLS)):
                        if f.wall[e * f.y.shape[0] + k][3] > f.wall[at * f.y.shape[0] + k][3]:
                            at = int(e)
                    if f.wall[at * f.y.shape[0] + k][3] <= s:
                        at = wp.static(WALLS)
                else:
                    m += 1
                if at < wp.static(WALLS):
                    f.wall[at * f.y.shape[0] + k] = t.vec4(n[0], n[1], n[2], s)
                    f.rate[at * f.y.shape[0] + k] = ask.rate(colliders, c, place, time)
        for e in range(m, wp.static(WALLS)):
            f.wall[e * f.y.shape[0] + k] = t.vec4(real(0.0), real(0.0), real(0.0), real(1.0e30))

    return kernel_over_cores(find_fluid_walls, f"fluid_walls_{'_'.join(kinds)}_{t.name}", module)


@cache
def fluid_motion_kernel(real, module):
    """Kernel over places: y + u in the order of cells, before an iteration; before the first one where walls leave it, which
    contacts have not moved yet."""
    t, N, S = types(real), neighbour_structs(real), fluid_structs(real)

    def gather_fluid_motion(rows: N.ParticleTable, c: N.CellTable, f: S.FluidTable, first: int, d: wp.array(dtype=t.vec3)):
        k = wp.tid()
        u = d[rows.point[c.order[k]]]
        y = f.y[k]
        if first != 0:
            for e in range(wp.static(WALLS)):
                row = f.wall[e * f.y.shape[0] + k]
                n = t.vec3(row[0], row[1], row[2])
                u = u + wp.max(wp.min(row[3], real(0.5) * f.d) - row[3] - wp.dot(n, u), real(0.0)) * n
        f.at[k] = t.vec4(y[0] + u[0], y[1] + u[1], y[2] + u[2], f.at[k][3])

    return kernel_over_cores(gather_fluid_motion, f"fluid_motion_{t.name}", module)


@cache
def wall_density_func(real):
    """Function (f, k, u) -> (part of the density that walls stand for, its slope G_wall), at y + u of place k."""
    t, S = types(real), fluid_structs(real)

    @wp.func
    def density_of_walls(f: S.FluidTable, k: int, u: t.vec3):
        H = real(REACHED) * f.d
        free = real(1.0)
        wall = t.vec3()
        for e in range(wp.static(WALLS)):
            row = f.wall[e * f.y.shape[0] + k]
            n = t.vec3(row[0], row[1], row[2])
            gap = row[3] + wp.dot(n, u)
            if gap < H:
                B, slope = wall_weight(gap, H)
                wall = (real(1.0) - B) * wall + (free * slope) * n
                free = free * (real(1.0) - B)
        return real(1.0) - free, wall

    return density_of_walls


@cache
def fluid_pressure_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: one iteration of the multipliers, with a_n, b_n and what it corrects of E."""
    t, N, S, walls = types(real), neighbour_structs(real), fluid_structs(real), wall_density_func(real)
    sums = row_sums(lanes, real)

    def solve_fluid_pressure(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable, speed: real,
                             momentum: real, corrected: real):
        first = wp.static(lanes) * wp.tid()
        found = sums.density(f.at, lists, first, f.d)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                B, wall = walls(f, k, place_of(f.at[k]) - place_of(f.y[k]))
                C = found[m, 0] + B - real(1.0)
                G = t.vec3(found[m, 1], found[m, 2], found[m, 3]) + wall
                w = f.w[rows.point[c.order[k]]]
                D = w * wp.max(wp.dot(G, G) + found[m, 4], real(LEAST_SLOPE) / (f.d * f.d))
                lam = f.lam[k]
                new = real(0.0)
                if w > real(0.0):
                    most = real(MOST_CHANGE) * f.d * f.d / w
                    E = f.start[k]
                    lasting = lam + wp.clamp(momentum * f.at[k][3] + speed * (C - E) / D, -most, most)
                    new = wp.max(lasting + wp.clamp(corrected * E / D, -most, most), real(0.0))
                    f.lasting[k] = wp.max(lasting, real(0.0))
                f.lam[k] = new
                f.at[k][3] = new - lam
                f.push[k] = wall
                f.tight[k] = wp.where(w > real(0.0), C, real(0.0))

    return kernel_over_cores(solve_fluid_pressure, f"fluid_pressure_{lanes}_{t.name}", module)


@cache
def fluid_push_kernel(lanes: int, real, module):
    """Kernel over `lanes` places each: what changes of multipliers move."""
    t, N, S, sums = types(real), neighbour_structs(real), fluid_structs(real), row_sums(lanes, real)

    def push_fluid(rows: N.ParticleTable, c: N.CellTable, lists: N.PairLists, f: S.FluidTable, d_out: wp.array(dtype=t.vec3)):
        first = wp.static(lanes) * wp.tid()
        found = sums.push(f.at, lists, first, f.d)
        for m in range(wp.static(lanes)):
            k = first + m
            if k < lists.size:
                i = rows.point[c.order[k]]
                if f.w[i] > real(0.0):
                    move = t.vec3(found[m, 0], found[m, 1], found[m, 2]) + f.at[k][3] * f.push[k]
                    apart = t.vec3(found[m, 3], found[m, 4], found[m, 5])
                    d_out[i] = d_out[i] - f.w[i] * move + real(PARTED) * apart

    return kernel_over_cores(push_fluid, f"fluid_push_{lanes}_{t.name}", module)


@cache
def fluid_wall_push_kernel(real, module):
    """Kernel over places: G_wall where a substep begins."""
    S, walls = fluid_structs(real), wall_density_func(real)

    def start_wall_push(f: S.FluidTable):
        k = wp.tid()
        B, wall = walls(f, k, place_of(f.at[k]) - place_of(f.y[k]))
        f.push[k] = wall

    return kernel_over_cores(start_wall_push, f"fluid_wall_push_{types(real).name}", module)
