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
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import differentiable, types


@cache
def air(real):
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
def press(real, module):
    """Kernel: force on each corner of a triangle [N] and K, its derivative by r [kg/s]."""
    t, Air = types(real), air(real)

    @wp.kernel(module=module, enable_backward=differentiable(module))
    def press(triangle: wp.array(dtype=wp.vec3i), air: Air, x: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3),
              d: wp.array(dtype=t.vec3), g: real, force_out: wp.array(dtype=t.vec3), k_out: wp.array(dtype=t.scalar)):
        c = wp.tid()
        p = triangle[c]
        o = air.object[p[0]]
        x0 = x[p[0]]
        area2 = wp.cross(x[p[1]] - x0, x[p[2]] - x0)          # 2 A n
        moved = (d[p[0]] - a[p[0]]) + (d[p[1]] - a[p[1]]) + (d[p[2]] - a[p[2]])
        r = moved / (real(3.0) * g) - air.wind[o]
        size = wp.length(area2)
        f = t.vec3()
        k = real(0.0)
        if size > real(0.0):
            n = area2 / size
            rn = wp.dot(r, n)
            k = real(0.5) * size * air.drag[o] * wp.abs(rn)
            c_n = real(0.5) * size * air.normal_drag[o]
            fallen = t.vec3()
            for j in range(3):
                fallen += wp.where(air.w[p[j]] > real(0.0), air.fall * g / real(3.0), real(0.0)) * air.gravity[air.object[p[j]]]
            f = -k * r - (c_n * (rn - wp.dot(fallen, n))) * n
            k = real(2.0) * k + c_n
            r2 = wp.dot(r, r)
            if r2 > real(0.0):
                f -= (real(0.5) * size * air.lift[o] * rn * wp.sqrt(r2)) * (n - (rn / r2) * r)
        force_out[c] = f
        k_out[c] = k

    return press


@cache
def blow(real, module):
    """Kernel: each point gathers its triangles' forces into its predicted displacement."""
    t = types(real)

    @wp.func
    def gather(first: wp.array(dtype=int), item: wp.array(dtype=int), force: wp.array(dtype=t.vec3),
               k: wp.array(dtype=t.scalar), i: int):
        f = t.vec3()                      # by themselves: Warp's adjoint of a loop does not stand a product with its sums
        drag = real(0.0)
        for j in range(first[i], first[i + 1]):
            f += force[item[j]]
            drag += k[item[j]]
        return f, drag

    @wp.kernel(module=module, enable_backward=differentiable(module))
    def blow(first: wp.array(dtype=int), item: wp.array(dtype=int), force: wp.array(dtype=t.vec3),
             k: wp.array(dtype=t.scalar), w: wp.array(dtype=t.scalar), d: wp.array(dtype=t.vec3), g: real,
             d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        f, drag = gather(first, item, force, k, i)
        d_out[i] = d[i] + (g * g * w[i] / (real(1.0) + g * w[i] * drag)) * f

    return blow


@cache
def blow_work(real, module):
    """Kernel over triangles: adds to given [J] what the wind w does in a substep at most, max(h F . w, 0). Drag opposes what
    moves through the air, F . (v - w) <= 0, so that no more than F . w becomes energy of the cloth."""
    t, Air = types(real), air(real)

    def blow_work(triangle: wp.array(dtype=wp.vec3i), air: Air, force: wp.array(dtype=t.vec3), h: real,
                  given: wp.array(dtype=wp.float64)):
        c = wp.tid()
        all = real(3.0) * h * wp.dot(force[c], air.wind[air.object[triangle[c][0]]])           # of three corners
        given[c] = given[c] + wp.float64(wp.max(all, real(0.0)))

    return wp.kernel(blow_work, name=f"blow_work_{t.name}", module=module, enable_backward=False)
