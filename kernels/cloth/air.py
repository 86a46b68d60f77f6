"""Drag and lift of moving air on triangles.

    r = (v0 + v1 + v2)/3 - wind, v = (d - a)/g the predicted velocities; u as r, without what gravity adds in this substep
    n the unit normal, A the area, rho the density of the air
    drag  F = -1/2 rho cd A |r.n| r                          (projected area, against the relative motion)
    lift  F = -1/2 rho cl A (r.n) |r| (n - (n.r) r / |r|^2)  (across the relative motion, largest at 45 degrees)
    normal drag  F = -c A (u.n) n                            (linear, along the normal alone: `wsim.scene.fabric`)

(Keckeisen, Kimmerle, Thomaszewski, Wacker 2004, Modelling effects of wind fields in cloth animations, section 4, without
normalising the direction of lift, so that it vanishes smoothly.) Forces are gathered by points, a third of each triangle.
The derivative of the drag on a corner is at most K = 1/3 rho cd A |r.n| + 1/3 c A [kg/s]. The gathered
K enters by one Newton step of the implicit equation, so that strong wind on light cloth cannot overshoot:
dv = g w F / (1 + g w K). So the normal drag alone gives v' = v / (1 + g c / m) + g f: a rate of decay that errs by g c / 2 m of
itself, a terminal velocity by g c / m. What is at rest stays so, since u is 0 there: what holds it up has yet to come. Explicit
steps have gravity and elastic forces in u, and contacts have yet to come: there air carries h c / m of what lies on a collider.

Leapfrog evaluates the forces at the velocity v = 2 v' - q + c / 2. Here v' = v + h a / 2 is the velocity of the following half
step, q = v' + h a / 2 the velocity that damping uses, and c the change by air and contacts in the substep before. So r and u
are of order 2, and

    dv = kick w F / (1 + (h w K)^2)

At pins that move, the velocity is that of the half step: an error of order 1 (1e-5 of a 50 cm sheet that a pin swings).
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.marks import owns_points
from wsim.kernels.math.real import has_adjoint, types


@cache
def air_tables(real):
    """Struct of the air over each object: reads only."""
    t = types(real)

    @wp.struct
    class Air:
        object: wp.array(dtype=int)          # of each point, (points,)
        wind: wp.array(dtype=t.vec3)         # [m/s], (objects,)
        drag: wp.array(dtype=t.scalar)       # rho cd / 6 [kg/m^3], (objects,)
        lift: wp.array(dtype=t.scalar)       # rho cl / 6 [kg/m^3], (objects,)
        normal_drag: wp.array(dtype=t.scalar)    # c / 3 [kg/(m^2 s)], (objects,)
        gravity: wp.array(dtype=t.vec3)      # [m/s^2], (objects,)
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg], (points,)
        fall: real                           # 1: velocities have gravity, and nothing yet that holds against it; else 0

    return Air


@cache
def leapfrog_halves(real):
    """Struct of the state of leapfrog between its half steps, read only: see kernels/motion/explicit.py."""
    t = types(real)

    @wp.struct
    class LeapfrogHalf:
        x: wp.array(dtype=t.vec3)            # [m], (points,)
        v: wp.array(dtype=t.vec3)            # of the half step that follows, but for what others change in it [m/s], (points,)
        pair: wp.array(dtype=t.vec3)         # q in rows (2 + at) n
        change: wp.array(dtype=t.vec3)       # c [m/s], (points,)
        at: int
        known: real                          # 1: c is of the substep before, 0: of no substep of this frame
        h: real                              # substep [s]
        kick: real                           # [s]

    return LeapfrogHalf


@wp.func
def press_triangle(air: Any, o: int, area2: Any, r: Any, fallen: Any):
    """Force on each corner [N] and K [kg/s] of a triangle of twice the area times the normal area2 [m^2]."""
    size = wp.length(area2)
    zero = size - size
    half = type(size)(0.5)
    f = area2 - area2
    k = zero
    if size > zero:
        n = area2 / size
        rn = wp.dot(r, n)
        k = half * size * air.drag[o] * wp.abs(rn)
        c_n = half * size * air.normal_drag[o]
        f = -k * r - (c_n * (rn - wp.dot(fallen, n))) * n
        k = type(size)(2.0) * k + c_n
        r2 = wp.dot(r, r)
        if r2 > zero:
            f -= (half * size * air.lift[o] * rn * wp.sqrt(r2)) * (n - (rn / r2) * r)
    return f, k


@cache
def triangle_drag_kernel(real, module):
    """Kernel: force on each corner of a triangle [N] and K, its derivative by r [kg/s]."""
    t, Air = types(real), air_tables(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def drag_on_triangles(triangle: wp.array(dtype=wp.vec3i), air: Air, x: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3),
                          d: wp.array(dtype=t.vec3), g: real, force_out: wp.array(dtype=t.vec3),
                          k_out: wp.array(dtype=t.scalar)):
        c = wp.tid()
        p = triangle[c]
        o = air.object[p[0]]
        x0 = x[p[0]]
        moved = (d[p[0]] - a[p[0]]) + (d[p[1]] - a[p[1]]) + (d[p[2]] - a[p[2]])
        fallen = t.vec3()
        for j in range(3):
            fallen += wp.where(air.w[p[j]] > real(0.0), air.fall * g / real(3.0), real(0.0)) * air.gravity[air.object[p[j]]]
        f, k = press_triangle(air, o, wp.cross(x[p[1]] - x0, x[p[2]] - x0), moved / (real(3.0) * g) - air.wind[o], fallen)
        force_out[c] = f
        k_out[c] = k

    return drag_on_triangles


@cache
def leapfrog_drag_kernel(real, module):
    """Kernel: as `triangle_drag_kernel`, for leapfrog."""
    t, Air, Half = types(real), air_tables(real), leapfrog_halves(real)

    @wp.func
    def leapfrog_velocity(s: Half, i: int):
        more = t.vec3()
        if s.known > real(0.0):                        # else what is there may be no number: a frame that broke has left it
            more = real(0.5) * s.change[i]
        return real(2.0) * s.v[i] - s.pair[(2 + s.at) * s.x.shape[0] + i] + more

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def leapfrog_triangle_drag(triangle: wp.array(dtype=wp.vec3i), air: Air, s: Half, force_out: wp.array(dtype=t.vec3),
                               k_out: wp.array(dtype=t.scalar)):
        c = wp.tid()
        p = triangle[c]
        o = air.object[p[0]]
        x0 = s.x[p[0]]
        r = (leapfrog_velocity(s, p[0]) + leapfrog_velocity(s, p[1]) + leapfrog_velocity(s, p[2])) / real(3.0) - air.wind[o]
        f, k = press_triangle(air, o, wp.cross(s.x[p[1]] - x0, s.x[p[2]] - x0), r, t.vec3())
        force_out[c] = f
        k_out[c] = k

    return leapfrog_triangle_drag


@cache
def air_gather_functions(real):
    """Struct of the triangles of each point, and function: their forces and K at point i."""
    t = types(real)

    @wp.struct
    class AirCorners:
        first: wp.array(dtype=int)           # item[first[i]:first[i + 1]] of point i, (points + 1,)
        item: wp.array(dtype=int)            # triangles

    @wp.func
    def gather_air_force(corners: AirCorners, force: wp.array(dtype=t.vec3), k: wp.array(dtype=t.scalar), i: int):
        f = t.vec3()                      # by themselves: Warp's adjoint of a loop does not stand a product with its sums
        drag = real(0.0)
        for j in range(corners.first[i], corners.first[i + 1]):
            f += force[corners.item[j]]
            drag += k[corners.item[j]]
        return f, drag

    return AirCorners, gather_air_force


@cache
def air_displacement_kernel(real, module):
    """Kernel: each point gathers its triangles' forces into its predicted displacement."""
    t, (Corners, gather) = types(real), air_gather_functions(real)

    @owns_points
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def apply_air_force(corners: Corners, force: wp.array(dtype=t.vec3), k: wp.array(dtype=t.scalar),
                        w: wp.array(dtype=t.scalar), d: wp.array(dtype=t.vec3), g: real, d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        f, drag = gather(corners, force, k, i)
        d_out[i] = d[i] + (g * g * w[i] / (real(1.0) + g * w[i] * drag)) * f

    return apply_air_force


@cache
def leapfrog_air_kernel(real, module):
    """Kernel: as `air_displacement_kernel`, for leapfrog: it also adds half of dv to the velocity that damping uses."""
    t, Half, (Corners, gather) = types(real), leapfrog_halves(real), air_gather_functions(real)

    @owns_points
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def apply_leapfrog_air(corners: Corners, force: wp.array(dtype=t.vec3), k: wp.array(dtype=t.scalar),
                           w: wp.array(dtype=t.scalar),
                           d: wp.array(dtype=t.vec3), s: Half, d_out: wp.array(dtype=t.vec3), pair_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        rate = (2 + s.at) * d.shape[0] + i
        f, drag = gather(corners, force, k, i)
        z = s.h * w[i] * drag
        dv = (s.kick * w[i] / (real(1.0) + z * z)) * f
        d_out[i] = d[i] + s.h * dv
        pair_out[rate] = s.pair[rate] + real(0.5) * dv

    return apply_leapfrog_air


@cache
def wind_work_kernel(real, module):
    """Kernel over triangles: adds to given [J] what the wind w does in a substep at most, max(h F . w, 0). Drag opposes what
    moves through the air, F . (v - w) <= 0, so that no more than F . w becomes energy of the cloth."""
    t, Air = types(real), air_tables(real)

    def add_wind_work(triangle: wp.array(dtype=wp.vec3i), air: Air, force: wp.array(dtype=t.vec3), h: real,
                      given: wp.array(dtype=wp.float64)):
        c = wp.tid()
        all = real(3.0) * h * wp.dot(force[c], air.wind[air.object[triangle[c][0]]])           # of three corners
        given[c] = given[c] + wp.float64(wp.max(all, real(0.0)))

    return wp.kernel(add_wind_work, name=f"blow_work_{t.name}", module=module, enable_backward=False)
