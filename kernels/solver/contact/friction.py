"""Coulomb friction in a Newton step (kernels/solver/contact/active_set.py): a drag towards no slip, and what a line search
looks at.

    lam [m]   push along the normal n, kernels/contact/project.py         s = (I - n n^T) (d - a - g u)   how far a point has
              slid [m]
    own = m / g^2, c = mu_d own lam [N]                           f   force on it across n, D its block of the Jacobian [N/m]

Friction is a potential of the slip, with lam of this Newton step: Tresca's law, and Coulomb's where Newton's method ends (a
bound that lags, as in Li et al. 2020, section 5.4; without their smoothing). For every r > 0

    c |s| <= c (|s|^2 / r + r) / 2

with equality at |s| = r: a drag c / r towards no slip, which never drives a point beyond it. r is |s|, or how far the point
alone would slide if that is more. With G the force on the point if it had not slid,

    G = f + D s,    r = max(|s|, (|G| - c) / |D|)
    sticks: |G| <= mu_s own lam: s becomes 0, T = -f / own           slides: T = -mu_d lam G / |G|

so a point that slides may come to rest, and one that rests is let go as fast as its force says.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.solver.line_search import D as DOUBLE
from wsim.kernels.solver.line_search import LineSearchTrial


@cache
def friction_formulas(real) -> SimpleNamespace:
    """Functions of one contact."""
    t = types(real)
    vec3, mat33 = t.vec3, t.mat33

    @wp.func
    def tangential_slip(n: vec3, d: vec3, w: vec3):
        """How far d has slid from where the surface carried it, w = a + g u."""
        way = d - w
        return way - wp.dot(way, n) * n

    @wp.func
    def friction_drag(n: vec3, s: vec3, f: vec3, H: mat33, own: real, lam: real, mu: t.vec2):
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
            drag = c * inverse_or_zero(wp.max(slid, (size - c) / stiff))
        return T, drag, sticks

    return SimpleNamespace(slip=tangential_slip, friction=friction_drag)


@cache
def friction_energy_kernel(real, module):
    """Kernel over bodies times lanes, after `descent.inertia`: adds the change of sum c |s|. first (bodies + 1,): a body's
    points."""
    t, Slots = types(real), project.slot_type(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def slip_distance(n: DOUBLE.vec3, way: DOUBLE.vec3):
        return wp.length(way - wp.dot(way, n) * n)

    @wp.kernel(module=module, enable_backward=False)
    def add_friction_energy_change(trial: LineSearchTrial, s: Slots, own: wp.array(dtype=real), push: vec3, g: real, d: vec3,
                                   a: vec3, y: vec3):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for i in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = DOUBLE.vec3(s.n[j])
                P = DOUBLE.vec3(push[j])
                c = wp.float64(own[i]) * slip_distance(n, P)
                if c > wp.float64(0.0):
                    way = DOUBLE.vec3(d[i]) - DOUBLE.vec3(a[i]) - wp.float64(g) * DOUBLE.vec3(s.u[j])
                    before = slip_distance(n, way)
                    part = wp.float64(1.0)
                    for k in range(trial.end):
                        if k >= trial.begin:
                            trial.change[row, k] = trial.change[row, k] + c * (slip_distance(n, way + part
                                                                                             * DOUBLE.vec3(y[i])) - before)
                        part *= wp.float64(0.5)

    return add_friction_energy_change


@cache
def contact_reprojection_kernel(real, module):
    """Kernel over points, where others have moved them: d outside of every collider, and slip taken back as friction does that
    (kernels/contact/project.py), by no more than there is of either, whatever the pushes were."""
    t, Slots, slip = types(real), project.slot_type(real), friction_formulas(real).slip
    (Rows, Points), vec3 = project.contact_tables(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def press_contacts(c: Rows, points: Points, s: Slots, g: real, a: vec3, d_out: vec3, push_out: vec3):
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
                mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                way = slip(n, d, a[i] + g * s.u[j])
                onward = T - way
                size = wp.length(onward)
                stop = onward
                if size > mu[0] * pressed:
                    stop = (wp.min(mu[1] * pressed, size) / size) * onward
                back = stop - T
                d += wp.min(real(1.0), wp.length(way) * inverse_or_zero(wp.length(back))) * back
                T = stop
                touched = wp.static(project.TOUCHED)
            else:
                T = t.vec3()
            push_out[j] = pressed * n + T
        d_out[i] = d
        s.mark[i] = (s.mark[i] & wp.static(project.SUNK)) | touched

    return press_contacts
