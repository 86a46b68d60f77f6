"""Motion of particles in the velocity of a grid: third-order Runge-Kutta (Ralston 1962), then what stops them.

    k1 = u(x),  k2 = u(x + h k1 / 2),  k3 = u(x + 3 h k2 / 4),  x += h (2 k1 + 3 k2 + 4 k3) / 9  + d(x)

    d        displacement that keeps the volume [m] (kernels/particles/surface.py), as the velocity on faces
    sides    closed: they stay SKIN cells within; open: who passes is none any more; periodic: comes in at the other side
    solid    signed distance of the obstacles at the grid's nodes [m]: who is within is put onto the surface, along the gradient

Gravity acts on faces that have mass: u += h g.

A particle that does not see all rows about it, beside a thin wall (walls.py), goes by Euler's step, in what it sees.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_structs
from wsim.kernels.particles.transfers import seen_sample_function

SKIN = 1e-3


@cache
def obstacle_exit_function(dim: int, real):
    """Function (g, shape, solid, s) -> a place s [cells], out of the obstacles."""
    t, S = types(real), grid_structs(real)

    @wp.func
    def push_out_of_obstacles(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), s: t.vec3):
        base = wp.vec3i(0, 0, 0)
        f = t.vec3()
        for b in range(wp.static(dim)):
            base[b] = wp.clamp(int(wp.floor(s[b])), 0, g.n[b] - 1)
            f[b] = s[b] - real(base[b])
        phi = real(0.0)
        n = t.vec3()
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            i = base + wp.vec3i(m % 2, (m // 2) % 2, m // 4)
            q = solid[flat_cell_index(i, shape)]
            w = t.vec3(real(1.0), real(1.0), real(1.0))
            d = t.vec3()
            for b in range(wp.static(dim)):
                if i[b] > base[b]:
                    w[b] = f[b]
                    d[b] = real(1.0)
                else:
                    w[b] = real(1.0) - f[b]
                    d[b] = real(-1.0)
            phi += w[0] * w[1] * w[2] * q
            n += q * t.vec3(d[0] * w[1] * w[2], w[0] * d[1] * w[2], w[0] * w[1] * d[2])
        found = s
        size = wp.length(n)
        if phi < real(0.0) and size > real(0.0):
            found = s - (phi / g.dx) * n / size
        return found

    return push_out_of_obstacles


@cache
def fastest_particle_kernel(real, module):
    """Kernel over threads: the greatest part of a velocity, and `more` [m/s] on top, into most_out."""
    T = particle_structs(real)

    def find_fastest_particle(particles: T.Particles, threads: int, more: wp.array(dtype=real), most_out: wp.array(dtype=real)):
        most = real(0.0)
        for p in range(wp.tid(), particles.id.shape[0], threads):
            if particles.id[p] >= 0:
                v = particles.v[p]
                most = wp.max(most, wp.max(wp.abs(v[0]), wp.max(wp.abs(v[1]), wp.abs(v[2]))))
        most = most + more[0]
        if most > most_out[0]:
            wp.atomic_max(most_out, 0, most)

    return wp.kernel(find_fastest_particle, name=f"particles_fastest_{types(real).name}", module=module, enable_backward=False)


@cache
def particle_motion_kernel(dim: int, obstacles: bool, thin: bool, real, module):
    """Kernel over rows: x a step on; a particle that leaves gets an id below 0."""
    t, S, T, f = types(real), grid_structs(real), particle_structs(real), grid_functions(dim, real)
    outside, read = obstacle_exit_function(dim, real), seen_sample_function(dim, False, thin, real)

    @wp.func
    def seen_velocity(g: S.Grid, u: S.Faces, x: t.vec3, bits: int, other: t.vec3):
        """At a place [m], of what a particle sees there; `other` of what it sees nothing of."""
        v = other
        a, none, part = read(g, u.x, 0, x, bits)
        if part > real(0.0):
            v[0] = a
        b, no, part_y = read(g, u.y, 1, x, bits)
        if part_y > real(0.0):
            v[1] = b
        if wp.static(dim == 3):
            d, nil, part_z = read(g, u.z, 2, x, bits)
            if part_z > real(0.0):
                v[2] = d
        return v

    @wp.func
    def keep_in_domain(g: S.Grid, at: t.vec3):
        s = at
        stays = int(1)
        for b in range(wp.static(dim)):
            n = real(g.n[b])
            if g.periodic[b] != 0:
                s[b] = s[b] - n * wp.floor(s[b] / n)
            else:
                if s[b] < real(SKIN):
                    if (g.outside[b] & 1) != 0:
                        if s[b] < real(0.0):
                            stays = int(0)
                    else:
                        s[b] = real(SKIN)
                if s[b] > n - real(SKIN):
                    if (g.outside[b] & 2) != 0:
                        if s[b] > n:
                            stays = int(0)
                    else:
                        s[b] = n - real(SKIN)
        return s, stays

    def move_particles(g: S.Grid, u: S.Faces, d: S.Faces, clock: wp.array(dtype=real), shape: wp.vec3i,
                       solid: wp.array(dtype=real), particles: T.Particles, out: T.Particles):
        p = wp.tid()
        if particles.id[p] >= 0:
            s = particles.x[p] / g.dx
            h = clock[0] / g.dx
            bits = int(-1)
            if wp.static(thin):
                bits = particles.seen[p]
            a = f.velocity(g, u, s)
            b = f.velocity(g, u, s + real(0.5) * h * a)
            c = f.velocity(g, u, s + real(0.75) * h * b)
            to = s + h * (real(2.0) * a + real(3.0) * b + real(4.0) * c) / real(9.0) + f.velocity(g, d, s) / g.dx
            if wp.static(thin):
                if bits != -1:
                    x = particles.x[p]
                    to = s + h * seen_velocity(g, u, x, bits, particles.v[p]) + seen_velocity(g, d, x, bits, t.vec3()) / g.dx
            to, stays = keep_in_domain(g, to)
            if wp.static(obstacles):
                to, still = keep_in_domain(g, outside(g, shape, solid, to))
                stays = stays * still
            out.x[p] = g.dx * to
            if stays == 0:
                out.id[p] = -1

    name = f"particles_move{'_obstacles' * obstacles}{'_thin' * thin}_{f.name}"
    return wp.kernel(move_particles, name=name, module=module, enable_backward=False)


@cache
def liquid_gravity_kernel(real, module):
    """Kernel over the faces of an axis."""

    def apply_liquid_gravity(axis: int, gravity: wp.array(dtype=real), clock: wp.array(dtype=real), mass: wp.array(dtype=real),
                             u_out: wp.array(dtype=real)):
        c = wp.tid()
        if mass[c] > real(0.0):
            u_out[c] = u_out[c] + clock[0] * gravity[axis]

    return wp.kernel(apply_liquid_gravity, name=f"particles_pull_{types(real).name}", module=module, enable_backward=False)
