"""What holds points during a Newton step (kernels/newton.py): contacts as filters, friction as drag, soft pins as springs.

A contact that pushes takes its direction out of the system: P = S (A_ii)^-1 S, S = I - n n^T (Baraff, Witkin 1998, section 5.1;
an active set as in Bertsekas 1982). f is the force without contacts. A contact stays as long as f presses, f.n < 0, and is
let go where f pulls; its push P = lam n + T [m] (kernels/contact.py; impulse m P / g) is the reaction,

    lam = -f.n / own,  own = m / g^2            s = (I - n n^T) (d - a - g u)   how far the point has slid [m]

Friction is a potential of its slip, with lam of this Newton step: Tresca's law, and Coulomb's where Newton's method ends (a
bound that lags, as in Li et al. 2020, section 5.4; without their smoothing). For every r > 0

    c |s| <= c (|s|^2 / r + r) / 2              c = mu_d own lam

with equality at |s| = r: a drag c / r towards no slip, which never drives a point beyond it. r is |s|, or how far the point
alone would slide if that is more. D = A_ii, and G the force on the point if it had not slid,

    G = f_t + D s,    r = max(|s|, (|G| - c) / |D|)
    stuck:  |G| <= mu_s own lam: s = 0, S = 0, T = -f_t / own            slides: T = -mu_d lam G / |G|

so a point that slides may come to rest, and one that rests is let go as fast as its force says. What a line search looks at
(kernels/descent.py) is Phi + sum c |s|, along a way that ends outside of every collider: `clip` cuts off what would not. Where
tethers or strain limits move points after a Newton step, `press` takes back no more of it than was moved.

A soft pin k |x + d - target|^2 / 2 + c |d - a|^2 / (2 g) and the inertia are one parabola of stiffness own' = own + k + c / g
about b' = (own b + k (target - x) + (c / g) a) / own'.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels import contact, newton, pcg
from wsim.kernels.constraint import inverse
from wsim.kernels.descent import D as DOUBLE
from wsim.kernels.descent import Trial
from wsim.kernels.newton import inverse_of
from wsim.kernels.points import soft_pins
from wsim.kernels.real import types

NEAR = 0.01            # part of the search's skin: a gap under it touches, as kernels/search.py has it
PASSES = 3             # over the planes of a point in several contacts, which are not at right angles


@cache
def formulas(real) -> SimpleNamespace:
    """Functions of one contact."""
    t = types(real)
    vec3, mat33 = t.vec3, t.mat33

    @wp.func
    def slip(n: vec3, d: vec3, w: vec3):
        """How far d has slid from where the surface carried it, w = a + g u."""
        way = d - w
        return way - wp.dot(way, n) * n

    @wp.func
    def friction(n: vec3, s: vec3, f: vec3, H: mat33, own: real, lam: real, mu: t.vec2):
        """(T, drag [N/m], whether it sticks). f: the force across n."""
        pulled = H * s
        pulled -= wp.dot(pulled, n) * n
        G = f + pulled
        size = wp.length(G)
        T = -(real(1.0) / own) * f
        drag = real(0.0)
        sticks = size <= mu[0] * own * lam
        if not sticks:
            c = mu[1] * own * lam
            T = -(c / (own * size)) * G
            slid = wp.length(s)
            stiff = wp.dot(G, H * G) / (size * size)
            drag = c * inverse(wp.max(slid, (size - c) / stiff))
        return T, drag, sticks

    return SimpleNamespace(slip=slip, friction=friction)


@cache
def structs(real) -> SimpleNamespace:
    """Where: a substep as it stands. Held: what a Newton step solves, see `hold`."""
    t = types(real)

    @wp.struct
    class Where:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        g: t.scalar

    @wp.struct
    class Held:
        f: wp.array(dtype=t.vec3)            # forces that contacts leave [N], (points,)
        own: wp.array(dtype=t.scalar)        # with drag [N/m]
        start: wp.array(dtype=t.vec3)        # way to the planes that bear, and back to where one sticks [m]
        push: wp.array(dtype=t.vec3)         # of the slots; n.P > 0: it bears

    return SimpleNamespace(Where=Where, Held=Held)


@cache
def hold(real, module):
    """Kernel over points, after `assemble`: forces f without contacts to what a step solves, P filtered. fresh: 1 where forces
    at d tell what bears, 0 where the step before has told."""
    t, A, Slots, one, own_ = types(real), newton.structs(real).Matrix, contact.slots(real), formulas(real), structs(real)
    (Rows, Points), slip, friction = contact.tables(real), one.slip, one.friction

    @wp.kernel(module=module, enable_backward=False)
    def hold(c: Rows, points: Points, s: Slots, at: own_.Where, fresh: int, f: wp.array(dtype=t.vec3), A_out: A,
             held_out: own_.Held):
        i = wp.tid()
        own = A_out.own[i]
        left = f[i]
        drag = real(0.0)
        start = t.vec3()
        if s.count[i] > 0 and own > real(0.0):
            d = at.d[i]
            P = A_out.P[i]
            H = wp.inverse(P)
            S = wp.identity(n=3, dtype=real)
            pulled = t.vec3()
            sticks = bool(False)
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                gap = s.b[j] + wp.dot(n, d)
                pressed = -wp.dot(left, n) / own
                lam = wp.dot(held_out.push[j], n)
                if fresh != 0:
                    lam = wp.where(gap <= real(NEAR) * c.skin, pressed, real(0.0))
                push = t.vec3()
                if lam > real(0.0) and not sticks:
                    left += (pressed * own) * n
                    Sn = S * n
                    S -= inverse(wp.dot(n, Sn)) * wp.outer(Sn, Sn)
                    start -= (gap + wp.dot(n, start)) * n
                    mu = real(0.5) * (points.friction[i] + c.friction[s.row[j]])
                    way = slip(n, d, at.a[i] + at.g * s.u[j])
                    T, more, sticks = friction(n, way, left - wp.dot(left, n) * n, H, own, lam, mu)
                    push = lam * n + T
                    drag += more
                    pulled += more * way
                    if sticks:
                        left = t.vec3()
                        S = t.mat33()
                        start -= way
                held_out.push[j] = push
            if drag > real(0.0):
                P = inverse_of(H + drag * wp.identity(n=3, dtype=real), own)
            left = S * (left - pulled)
            A_out.P[i] = S * P * S
        held_out.f[i] = left
        held_out.own[i] = own + drag
        held_out.start[i] = start

    return hold


@cache
def remain(real, module, springs: bool, elements: bool):
    """Kernel over points: f + more - less - A z."""
    t, s = types(real), newton.structs(real)
    product, vec3 = pcg.parts(real, springs, elements).product, wp.array(dtype=t.vec3)

    def remain(rows: s.Rows, A: s.Matrix, z: vec3, f: vec3, more: vec3, less: vec3, r_out: vec3):
        i = wp.tid()
        r_out[i] = f[i] + (more[i] - less[i]) - product(i, rows, A, z)

    name = "_".join(["remain", *["springs"] * springs, *["elements"] * elements, t.name])
    return wp.kernel(remain, name=name, module=module, enable_backward=False)


@cache
def clip(real, module):
    """Kernel over points: the part of y after which d + y is in no collider, on the planes of what bears and without slip where
    it sticks. solved: 1 after a Newton step, which says what bears in the next: r are the forces it has left there."""
    t, Slots, own_, slip = types(real), contact.slots(real), structs(real), formulas(real).slip
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def outside(s: Slots, push: vec3, i: int, solved: int, start: t.vec3):
        moved = start
        count = s.count[i]
        for turn in range(wp.where(count > 1, wp.static(PASSES), 1)):  # noqa: B007
            for slot in range(count):
                j = slot * s.points + i
                n = s.n[j]
                gap = s.b[j] + wp.dot(n, moved)
                if gap < real(0.0) or (solved != 0 and wp.dot(push[j], n) > real(0.0)):
                    moved -= gap * n
        return moved

    @wp.func
    def bearing(P: t.vec3, n: t.vec3, gap: real, R: t.vec3, own: real, sticks: bool):
        """The push of a contact that bore, or of one that is hit."""
        lam = wp.dot(P, n)
        push = t.vec3()
        if lam > real(0.0):
            pressed = -wp.dot(R, n) / own
            if pressed > real(0.0):
                push = P + (pressed - lam) * n
                if sticks:
                    push = -R / own
        elif gap < real(0.0):
            push = -gap * n
        return push

    @wp.kernel(module=module, enable_backward=False)
    def clip(s: Slots, at: own_.Where, solved: int, A: newton.structs(real).Matrix, held: own_.Held, r: vec3, y: vec3,
             y_out: vec3):
        i = wp.tid()
        if s.count[i] == 0:
            return
        d = at.d[i]
        way = y[i]
        if solved != 0:
            way += held.start[i]
        moved = outside(s, held.push, i, solved, d + way)
        if solved != 0:
            R = r[i] + (held.own[i] - A.own[i]) * way
            sticks = wp.trace(A.P[i]) == real(0.0)
            touched = int(0)
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                push = bearing(held.push[j], n, s.b[j] + wp.dot(n, d + way), R, A.own[i], sticks)
                if wp.dot(push, n) > real(0.0):
                    touched = wp.static(contact.TOUCHED)
                    R += A.own[i] * push
                held.push[j] = push
            s.mark[i] = (s.mark[i] & wp.static(contact.SUNK)) | touched
        y_out[i] = moved - d

    return clip


@cache
def rub(real, module):
    """Kernel over bodies times lanes, after `descent.inertia`: adds the change of sum c |s|. first (bodies + 1,): a body's
    points."""
    t, Slots = types(real), contact.slots(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def slid(n: DOUBLE.vec3, way: DOUBLE.vec3):
        return wp.length(way - wp.dot(way, n) * n)

    @wp.kernel(module=module, enable_backward=False)
    def rub(trial: Trial, s: Slots, own: wp.array(dtype=real), push: vec3, g: real, d: vec3, a: vec3, y: vec3):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for i in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = DOUBLE.vec3(s.n[j])
                P = DOUBLE.vec3(push[j])
                c = wp.float64(own[i]) * slid(n, P)
                if c > wp.float64(0.0):
                    way = DOUBLE.vec3(d[i]) - DOUBLE.vec3(a[i]) - wp.float64(g) * DOUBLE.vec3(s.u[j])
                    before = slid(n, way)
                    part = wp.float64(1.0)
                    for k in range(trial.end):
                        if k >= trial.begin:
                            trial.change[row, k] = trial.change[row, k] + c * (slid(n, way + part * DOUBLE.vec3(y[i])) - before)
                        part *= wp.float64(0.5)

    return rub


@cache
def press(real, module):
    """Kernel over points: d on the outside of every collider, and slip taken back as far as friction does that (kernels/contact.py),
    by no more than there is of either, whatever the pushes were."""
    t, Slots, slip = types(real), contact.slots(real), formulas(real).slip
    (Rows, Points), vec3 = contact.tables(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def press(c: Rows, points: Points, s: Slots, g: real, a: vec3, d_out: vec3, push_out: vec3):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        d = d_out[i]
        touched = int(0)
        for slot in range(count):
            j = slot * s.points + i
            n = s.n[j]
            lam = wp.dot(push_out[j], n)
            T = push_out[j] - lam * n
            pressed = wp.max(lam - (s.b[j] + wp.dot(n, d)), real(0.0))
            d += (pressed - lam) * n
            if pressed > real(0.0):
                mu = real(0.5) * (points.friction[i] + c.friction[s.row[j]])
                way = slip(n, d, a[i] + g * s.u[j])
                onward = T - way
                size = wp.length(onward)
                stop = onward
                if size > mu[0] * pressed:
                    stop = (wp.min(mu[1] * pressed, size) / size) * onward
                back = stop - T
                d += wp.min(real(1.0), wp.length(way) * inverse(wp.length(back))) * back
                T = stop
                touched = wp.static(contact.TOUCHED)
            else:
                T = t.vec3()
            push_out[j] = pressed * n + T
        d_out[i] = d
        s.mark[i] = (s.mark[i] & wp.static(contact.SUNK)) | touched

    return press


@cache
def pinned(real, module):
    """Kernel over softly pinned points: own and b with their pins, first[j] .. first[j + 1] of point[j]; at substep k."""
    t, A, SoftPins = types(real), newton.structs(real).Matrix, soft_pins(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def pinned(pins: SoftPins, first: wp.array(dtype=int), item: wp.array(dtype=int), target: wp.array2d(dtype=t.vec3),
               x: vec3, a: vec3, k: int, rate: real, A_out: A, b_out: vec3):
        j = wp.tid()
        i = pins.point[item[first[j]]]
        if pins.w[i] > real(0.0):
            own = A_out.own[i]
            whole = own
            force = t.vec3()
            b = b_out[i]
            for m in range(first[j], first[j + 1]):
                pin = item[m]
                stiffness = inverse(pins.alpha[pin])
                drag = rate * pins.damping[pin]
                whole += stiffness + drag
                force += stiffness * ((target[k, pin] - x[i]) - b) + drag * (a[i] - b)
            A_out.own[i] = whole
            b_out[i] = b + force / whole

    return pinned
