"""Motion of free points over one substep, in displacement form.

    x   position at the start [m], relative to the origin of its object     e   rounding remainder of x: the position is x + e
    v   velocity [m/s]          s   step before this one [m]                u   velocity before this one [m/s]
    d   displacement [m], the unknown; it starts at e and a substep ends with x + d
    a   anchor [m]: the velocity is v = (d - a) / g                         w   inverse mass [1/kg]; 0 is moved by its pin only

Backward Euler (order 1):  a = e,        g = h,      d = a + g (v + g f)
BDF2 (order 2):            a = e + s/3,  g = 2h/3,   d = a + g (v + (v - u)/3 + g f)
one node at c h:           a = e,        g = c h,    as backward Euler; the substep ends with x + d + (1/c - 1) (d - e) and
                           (d - a)/(c g) - (1/c - 1) v: order 1, for c = 1/2 the implicit midpoint of order 2
sdirk3 (order 3):          kernels/motion/sdirk3.py, twice backward Euler of another step

BDF2 is x' = x + s/3 + (2/3) h v', v' = v + (v - u)/3 + (2/3) h f, written in differences so that nothing cancels
(Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, III.1). f is gravity [m/s^2]; a decay rate k [1/s] of the
velocity (drag of the air) is taken implicitly: v' = v~ / (1 + g k) + g f, exact at rest, a relative error of g k in the
terminal velocity. All are stable for every h.

The remainder (Kahan 1965): x' = fl(x + d), e' = d - (x' - x). Without it 256 substeps a frame lose a factor of 45 in float32.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import OVER_CORES, writes_all
from wsim.kernels.math.real import has_adjoint, substep_number, types


@cache
def point_constants(real):
    """Struct of what each point and object keeps for the whole run: reads only."""
    t = types(real)

    @wp.struct
    class Constants:
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg], (points,)
        object: wp.array(dtype=int)          # object of each point, (points,)
        gravity: wp.array(dtype=t.vec3)      # [m/s^2], (objects,)
        decay: wp.array(dtype=t.scalar)      # [1/s], (objects,)

    return Constants


@cache
def point_states(real):
    """Struct of the state of the points, as a launch reads it; arrays that a kernel does not read stay empty."""
    t = types(real)

    @wp.struct
    class PointState:
        x: wp.array(dtype=t.vec3)            # symbols as above, (points,)
        e: wp.array(dtype=t.vec3)
        v: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        s: wp.array(dtype=t.vec3)
        u: wp.array(dtype=t.vec3)
        struck: wp.array(dtype=real)         # 1: has left an overlap, and forgets s and u; empty: none does

    return PointState


@cache
def euler_prediction_kernel(real, module):
    """Kernel: anchor and unconstrained displacement of backward Euler."""
    t, Constants = types(real), point_constants(real)

    @wp.kernel(name=f"predict_euler_{t.name}{OVER_CORES}", module=module, enable_backward=False)
    def predict_euler(c: Constants, e: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), g: real,
                      a_out: wp.array(dtype=t.vec3), d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        a = e[i]
        o = c.object[i]
        free = wp.where(c.w[i] > real(0.0), real(1.0), real(0.0))
        rate = real(1.0) / (real(1.0) + g * c.decay[o])
        a_out[i] = a
        d_out[i] = a + (free * g) * (rate * v[i] + g * c.gravity[o])

    return writes_all(predict_euler)


@cache
def bdf2_prediction_kernel(real, module):
    """Kernel: anchor and unconstrained displacement of BDF2."""
    t, Constants = types(real), point_constants(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def predict_bdf2(c: Constants, e: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), s: wp.array(dtype=t.vec3),
                     u: wp.array(dtype=t.vec3), g: real, a_out: wp.array(dtype=t.vec3), d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        third = real(1.0) / real(3.0)
        o = c.object[i]
        free = wp.where(c.w[i] > real(0.0), real(1.0), real(0.0))
        a = e[i] + third * s[i]
        vt = v[i] + third * (v[i] - u[i])
        rate = real(1.0) / (real(1.0) + g * c.decay[o])
        a_out[i] = a
        d_out[i] = a + (free * g) * (rate * vt + g * c.gravity[o])

    return writes_all(predict_bdf2)


@cache
def euler_finish_kernel(real, module):
    """Kernel: velocity, new position and its remainder."""
    t = types(real)

    @wp.kernel(name=f"finish_euler_{t.name}{OVER_CORES}", module=module, enable_backward=False)
    def finish_euler(a: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), x: wp.array(dtype=t.vec3), g: real,
                     x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = x[i]
        step = d[i]
        v_out[i] = (step - a[i]) / g
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)

    return writes_all(finish_euler)


@cache
def beyond_finish_kernel(real, module, part: float = 0.5):
    """Kernel: as finish_euler, from that part of the substep, where d is, to its end."""
    t, once, more = types(real), real(1.0 / part), real((1.0 - part) / part)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def finish_beyond(e: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), x: wp.array(dtype=t.vec3),
                      v: wp.array(dtype=t.vec3), g: real,
                      x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = x[i]
        solved = d[i] - e[i]
        step = d[i] + more * solved
        v_out[i] = once * (solved / g) - more * v[i]
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)

    return writes_all(finish_beyond)


@cache
def beyond_prolong_kernel(real, module, part: float = 0.5):
    """Kernel: d, found at that part of the substep, goes on to its end, where contacts look for it (kept in `ahead`), v is the
    velocity there before they act. A pinned point has the velocity that it went by."""
    t, once, more = types(real), real(1.0 / part), real((1.0 - part) / part)

    @wp.kernel(module=module, enable_backward=False)
    def prolong_beyond_stage(w: wp.array(dtype=real), e: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3),
                             v: wp.array(dtype=t.vec3),
                             g: real, d_out: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3),
                             ahead_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        solved = d[i] - e[i]
        step = d[i] + more * solved
        v1 = solved / g
        if w[i] > real(0.0):
            v1 = once * v1 - more * v[i]
        v_out[i] = v1
        d_out[i] = step
        ahead_out[i] = step

    return prolong_beyond_stage


@cache
def point_landing_kernel(real, module):
    """Kernel: new position and its remainder, where the velocity is known."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def land_points(d: wp.array(dtype=t.vec3), x: wp.array(dtype=t.vec3),
                    x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = x[i]
        step = d[i]
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)

    return land_points


@cache
def bdf2_finish_kernel(real, module):
    """Kernel: as finish_euler, and the history; reads x, e, v, d, a, struck. What leaves an overlap (struck = 1) goes on as if
    it had always had its new velocity; at other contacts `settle` of kernels/contact/project.py has made the normal part of
    the step one of backward Euler, since a multistep formula across an impact bounces."""
    t, PointState = types(real), point_states(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def finish_bdf2(at: PointState, h: real, g: real,
                    x_out: wp.array(dtype=t.vec3), e_out: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3),
                    s_out: wp.array(dtype=t.vec3), u_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        x0 = at.x[i]
        step = at.d[i]
        e0 = at.e[i]
        v0 = at.v[i]
        v1 = (step - at.a[i]) / g
        x1 = x0 + step
        s1 = step - e0
        if at.struck:
            if at.struck[i] != real(0.0):
                s1 = h * v1
                v0 = v1
        x_out[i] = x1
        e_out[i] = step - (x1 - x0)
        v_out[i] = v1
        s_out[i] = s1
        u_out[i] = v0

    return writes_all(finish_bdf2)


@cache
def pin_motion_kernel(real, module):
    """Kernel: a hard-pinned point goes that part of the way to where its frame is, target[k] [m], (substeps, pins)."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def move_pins(point: wp.array(dtype=int), target: wp.array2d(dtype=t.vec3), x: wp.array(dtype=t.vec3),
                  e: wp.array(dtype=t.vec3), k: int, now: wp.array(dtype=int), part: real, d_out: wp.array(dtype=t.vec3)):
        i = point[wp.tid()]
        d_out[i] = e[i] + part * ((target[substep_number(k, now), wp.tid()] - x[i]) - e[i])

    return move_pins


@cache
def pin_velocity_kernel(real, module):
    """Kernel: a hard-pinned point has the velocity [m/s] of its frame, which a curve gives."""
    t = types(real)
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def carry_pins(point: wp.array(dtype=int), speed: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        p = wp.tid()
        v_out[point[p]] = speed[p]

    return carry_pins


@cache
def soft_pins(real):
    """Struct of the soft pins: reads only. Pins of one point act in turn, each in a launch of its own."""
    t = types(real)

    @wp.struct
    class SoftPinTable:
        point: wp.array(dtype=int)           # (pins,)
        alpha: wp.array(dtype=t.scalar)      # compliance [m/N], (pins,)
        damping: wp.array(dtype=t.scalar)    # [N s/m], (pins,)
        w: wp.array(dtype=t.scalar)          # inverse mass [1/kg], (points,)
        first: wp.array(dtype=int)           # pins of the j-th pinned point: item[first[j]] .. item[first[j + 1]]; or empty
        item: wp.array(dtype=int)
        turn: wp.array(dtype=int)            # pins of a launch, no two of one point; empty: all

    return SoftPinTable


@cache
def pin_holding_kernel(real, module):
    """Kernel over the pins of a turn: C = x + d - target (three rows), a damped spring (XPBD, eq. 18, 26); reads x, d, a."""
    t, SoftPins, PointState = types(real), soft_pins(real), point_states(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def hold_pins(pins: SoftPins, target: wp.array2d(dtype=t.vec3), at: PointState, lam: wp.array(dtype=t.vec3), k: int,
                  g: real, d_out: wp.array(dtype=t.vec3), lam_out: wp.array(dtype=t.vec3)):
        p = wp.tid()
        if pins.turn:
            p = pins.turn[p]
        i = pins.point[p]
        d0 = at.d[i]
        l0 = lam[p]
        c = pins.alpha[p] / (g * g)
        gamma = c * pins.damping[p] * g
        wi = pins.w[i]
        K = (real(1.0) + gamma) * wi + c
        if K > real(0.0):
            dlam = -((at.x[i] - target[k, p]) + d0 + c * l0 + gamma * (d0 - at.a[i])) / K
            lam_out[p] = l0 + dlam
            d_out[i] = d0 + wi * dlam

    return hold_pins


@cache
def not_finite_kernel(real, module):
    """Kernel: status becomes at least 1 + i for the highest point i whose position or velocity is not finite."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def report_not_finite(x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), status: wp.array(dtype=int)):
        i = wp.tid()
        zero = (x[i] - x[i]) + (v[i] - v[i])              # no number minus itself is no number: a seventh of isfinite's time
        if zero[0] + zero[1] + zero[2] != real(0.0):
            wp.atomic_max(status, 0, i + 1)

    return report_not_finite
