"""A particle's step: strain and stress, place, and the rate at which steps must follow each other.

    F' = (1 + L) F with L = h C, so that B' = B + L + L^T + L L^T + L B + B L^T + L B L^T
    tau = tau of the law at B' + 2 eta dev sym C

Nothing resists the strain of a grain or drop that flies alone: it has no shape, and its gradient shortens no step. Nothing
resists the further strain of what is pressed so flat that its law forgets it (laws.py, PRESSED): APIC would keep the rate for
ever, and steps would stay short. There C keeps only its spin (C - C^T) / 2, the rigid transfer of Jiang et al. 2015, section
5.2, which keeps momentum and angular momentum.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.laws import determinant_strain
from wsim.kernels.particles.mpm.material.law_table import choose_law
from wsim.kernels.particles.mpm.tables import point_tables

COURANT = wp.constant(0.5)         # cells that a wave may cross in a step
WAY = wp.constant(0.5)             # cells that a particle may cross in a step
TURN = wp.constant(0.3)            # largest |h grad v|: F' stays far from singular
LOOSE = wp.constant(0.1)           # opening of grains and drops that bear no stress, from which they have no shape
PACKED = wp.constant(-0.97)        # J^2 - 1 from which matter is rigid: laws.py forgets further strain near here
VISCOUS = wp.constant(0.125)       # largest h eta / (density dx^2)


@cache
def motion_functions(laws: tuple[str, ...], real) -> SimpleNamespace:
    """step_rate(a, density, viscosity, C, v, dx) -> steps [1/s] that a particle needs; deform_particle and shift_particle."""
    t, T = types(real), point_tables(real)
    respond, energy = choose_law(laws, real)

    @wp.func
    def step_rate(a: real, density: real, viscosity: real, C: t.mat33, v: t.vec3, dx: real):
        wave = wp.sqrt(a / density) / (real(COURANT) * dx)
        way = wp.length(v) / (real(WAY) * dx)
        turn = wp.sqrt(wp.ddot(C, C)) / real(TURN)
        viscous = viscosity / (density * dx * dx * real(VISCOUS))
        return wp.max(wp.max(wave, way), wp.max(turn, viscous))

    @wp.func
    def read_strain(points: T.PointRows, p: int):
        b = points.b[p]
        s = points.s[p]
        return t.mat33(b[0], s[2], s[1], s[2], b[1], s[0], s[1], s[0], b[2])

    @wp.func
    def bears_nothing(points: T.PointRows, p: int):
        """True for a grain or drop that has come off."""
        stress = wp.length_sq(points.T[p]) + wp.length_sq(points.S[p])
        return points.q[p] > real(LOOSE) and stress == real(0.0)

    @wp.func
    def deform_particle(points: T.PointRows, materials: T.MaterialRows, p: int, h: real, C: t.mat33, v: t.vec3, dx: real):
        """Strain, stress and velocity gradient after a step; returns the steps [1/s] that the particle needs."""
        row = points.row[p]
        m = materials.numbers[row]
        half = real(0.5)
        rate = C
        L = h * C
        if bears_nothing(points, p):                           # it opens and closes by steps that are small enough
            rate = t.mat33()
            L = half * (L + wp.transpose(L))
            L = (real(TURN) / wp.max(wp.sqrt(wp.ddot(L, L)), real(TURN))) * L
        B = read_strain(points, p)
        X = L + L * B
        B = B + X + wp.transpose(X) + (L + L * B) * wp.transpose(L)
        B_out, q, tau, a = respond(materials.law[row], B, points.q[p], m)
        eta = m[7]
        if eta > real(0.0):
            tau += eta * (C + wp.transpose(C) - (real(2.0 / 3.0) * wp.trace(C)) * wp.identity(n=3, dtype=real))
        points.b[p] = t.vec3(B_out[0, 0], B_out[1, 1], B_out[2, 2])
        points.s[p] = t.vec3(B_out[1, 2], B_out[2, 0], B_out[0, 1])
        points.T[p] = t.vec3(tau[0, 0], tau[1, 1], tau[2, 2])
        points.S[p] = t.vec3(tau[1, 2], tau[2, 0], tau[0, 1])
        points.q[p] = q
        points.a[p] = a
        kept = C
        if not wp.min(determinant_strain(B_out), q) > real(PACKED):
            kept = half * (C - wp.transpose(C))
        points.C[p] = kept
        return step_rate(a, materials.density[row], eta, rate, v, dx)

    @wp.func
    def shift_particle(points: T.PointRows, p: int, i: int, j: int, k: int, o: t.vec3, way: t.vec3):
        """The place after a way [cells]: the rounding remainder is kept, and the nearest node found."""
        step = way + points.e[p]
        to = o + step
        points.e[p] = step - (to - o)
        x = wp.floor(to[0] + real(0.5))
        y = wp.floor(to[1] + real(0.5))
        z = wp.floor(to[2] + real(0.5))
        points.i[p] = i + int(x)
        points.j[p] = j + int(y)
        points.k[p] = k + int(z)
        points.o[p] = t.vec3(to[0] - x, to[1] - y, to[2] - z)

    return SimpleNamespace(step_rate=step_rate, deform_particle=deform_particle, shift_particle=shift_particle,
                           read_strain=read_strain, bears_nothing=bears_nothing, respond=respond, energy=energy)
