"""Friction of a ball that turns, with rolling resistance: one contact, solved at once.

    n   unit normal towards the ball       lam  normal push       T  friction across n       q  torque of rolling over r
    phi = R theta  how far the ball has turned in a substep, times its radius [m]      r  radius of rolling, see below
    s   slide of the surfaces at their contact [m]             psi  turn of one about the other, times r [m]

In the unknowns of a contact, of which s0 and psi0 are without:

    s = s0 + A T + n x (B q),    psi = psi0 - B n x T + C q        A, B, C  [1/kg], or [1] where pushes are in metres
    |T| <= mu_s lam where s = 0, else T = -mu_d lam s / |s|        |q| <= mu_r lam where psi = 0, else q = -mu_r lam psi / |psi|

A ball of inertia 2/5 m R^2 and inverse mass w has a = 5/2 w: a push T at its contact turns it by phi = -a n x T. At a wall
A = w + a, B = C = a, r = R. Two balls, with x = r / R and 1/r = 1/R_i + 1/R_j:

    A = w_i + w_j + a_i + a_j,      B = a_i x_i - a_j x_j,      C = a_i x_i^2 + a_j x_j^2

The law of rolling is that of Ai, Chen, Rotter, Ooi 2011, eq. 2 (model A, mu_r lam r), with a friction's rest: a ball that has
stopped stays, and does not rock about its place as a torque by the sign of its spin alone would. It resists turns about the
normal as it does rolling. T is taken out first: a ball that sticks has

    q = -((A psi0 + B n x s0) / (A C - B^2))_t - psi0_n / C,      T = -(s0 + B n x q) / A

and where q or T is bounded the other follows from it. So balls at rest need one iteration, not a limit of many. A rigid body
knows what T and q make of it before they act (bodies.py).
Friction at the contact's place by velocities: Mueller, Macklin, Chentanez, Jeschke, Kim 2020, section 3.6; here within the
iterations, so that what rests does not creep.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

SPHERE = 2.5           # m R^2 over the inertia of a ball


@cache
def roll_type(real):
    """Struct of balls that turn, by point of the state where nothing else is said."""
    t = types(real)

    @wp.struct
    class RollTable:
        own: wp.array(dtype=t.vec3)        # a over w, 0 of what does not turn now; mu_r, -1: never; radius [m]
        spin: wp.array(dtype=t.vec3)       # angular velocity [rad/s]
        phi: wp.array(dtype=t.vec3)        # in this substep [m]
        q: wp.array(dtype=t.vec3)          # of contacts with colliders, by their slots [m]
        wall: wp.array(dtype=t.vec3)       # turn of the collider in the substep times the ball's radius, by slot [m]
        swing: wp.array(dtype=t.vec3)      # and how much more a rigid body turns by what its star foresees, by slot [m]

    return RollTable


@cache
def rolling_law_func(real):
    """Function (n, pressed, s0, psi0, (A, B, C), (mu_s, mu_d, mu_r)) -> T and q, as the rows of a matrix."""
    t = types(real)

    @wp.func
    def cut_length(q: t.vec3, most: real):
        size = wp.length(q)
        share = real(1.0)
        if size > most:
            share = most / size
        return share * q

    @wp.func
    def solve_rolling_contact(n: t.vec3, pressed: real, s0: t.vec3, psi0: t.vec3, K: t.vec3, mu: t.vec3):
        T = t.vec3()
        q = t.vec3()
        if pressed > real(0.0):
            A = K[0]
            B = K[1]
            C = K[2]
            if C > real(0.0):
                about = wp.dot(n, psi0)
                rolled = A * (psi0 - about * n) + B * wp.cross(n, s0)
                q = cut_length((-about / C) * n - rolled / (A * C - B * B), mu[2] * pressed)
            T = -(s0 + B * wp.cross(n, q)) / A
            size = wp.length(T)
            if size > mu[0] * pressed:
                T *= wp.min(mu[1] * pressed / size, real(1.0))
                if C > real(0.0):
                    q = cut_length((B * wp.cross(n, T) - psi0) / C, mu[2] * pressed)
        return wp.matrix_from_rows(T, q)

    return solve_rolling_contact


@cache
def roll_begin_kernel(real, module):
    """Kernel over points: how far a ball turns in a substep of h [s] by what it has."""
    Roll = roll_type(real)

    def begin_rolling(roll: Roll, h: real):
        i = wp.tid()
        if roll.own[i][2] > real(0.0):
            roll.phi[i] = (h * roll.own[i][2]) * roll.spin[i]

    return wp.kernel(begin_rolling, name=f"roll_begin_{types(real).name}", module=module, enable_backward=False)


@cache
def roll_end_kernel(real, module):
    """Kernel over points: angular velocities behind a substep of h [s]."""
    Roll = roll_type(real)

    def end_rolling(roll: Roll, h: real):
        i = wp.tid()
        if roll.own[i][2] > real(0.0):
            roll.spin[i] = roll.phi[i] / (h * roll.own[i][2])

    return wp.kernel(end_rolling, name=f"roll_end_{types(real).name}", module=module, enable_backward=False)


@cache
def spin_energy_kernel(real, module):
    """Kernel over (worlds x threads): rows of the ledger (kernels/math/ledger.py) of the energy 1/5 m R^2 omega^2 of spins [J].
    w: inverse masses [1/kg]."""
    Roll = roll_type(real)

    def sum_spin_energy(roll: Roll, w: wp.array(dtype=real), worlds: int, rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        each = w.shape[0] // worlds
        K = wp.float64(0.0)
        for i in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
            R = wp.float64(roll.own[i][2])
            if R > wp.float64(0.0) and w[i] > real(0.0):
                omega = wp.vec3d(roll.spin[i])
                K += wp.float64(0.2) * R * R / wp.float64(w[i]) * wp.dot(omega, omega)
        rows[wp.tid()] = wp.vec4d(K, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))

    return wp.kernel(sum_spin_energy, name=f"roll_energy_{types(real).name}", module=module, enable_backward=False)
