"""Bending: curvatures of triangles from the angles of hinges, and back to a moment for each hinge. See
wsim/physics/cloth/bending.py.

    z_e = k_e^1/2 (f_e + tau_e f'_e b_e)     C_t = sum_s value_ts z_s     u_e = sum_ts value_ts.C_t     b = G.v

f is a function of D = theta - theta_0 in [-pi, pi] with the period 2 pi: see `folded_angle`. k [J] is the stiffness of a hinge
alone, 1 / alpha, and q = sum_t |value_t|^2 <= 1 the part of it that does not depend on other hinges. Energy, and moment of a
hinge:

    E = 1/2 sum |C_t|^2 + 1/2 sum k q (D^2 - f^2)        m = k^1/2 f' u + k q (D - f f' + tau (1 - f'^2) b)

The force is -m G. Its part with tau is damping in proportion to the stiffness f' K f' + k q (1 - f'^2), K = k^1/2 value value^T
k^1/2: neither is ever negative, nor above k. Triangles and hinges gather: no atomics.
"""

import math
from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import DIHEDRAL, dihedral_constraint, inverse_or_zero
from wsim.kernels.cloth.element import force_elements
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types

SLOTS = 9              # hinges of a triangle, at most: as `wsim.physics.cloth.bending.SLOTS`


@cache
def sheet_curvatures(real):
    """Struct of the triangles of all sheets. Slot s belongs to triangle s // SLOTS."""
    t = types(real)

    @wp.struct
    class Curvatures:
        slot: wp.array(dtype=int)            # hinge of each slot, (SLOTS t,): those in use come first
        count: wp.array(dtype=int)           # slots of a triangle in use
        value: wp.array(dtype=t.vec3)
        own: wp.array(dtype=t.scalar)        # q: sum of |value|^2 over the slots of a hinge, (hinges,)
        begin: wp.array(dtype=int)           # slots of a hinge: item[begin] .. item[end]
        end: wp.array(dtype=int)
        item: wp.array(dtype=int)
        z: wp.array(dtype=t.scalar)          # [J^1/2], (hinges,)
        C: wp.array(dtype=t.vec3)            # [J^1/2], (t,)
        slope: wp.array(dtype=t.scalar)      # what u of a hinge counts by, (hinges,): its kernel says the unit
        kept: wp.array(dtype=t.scalar)       # what a hinge has without the others, (hinges,)
        G: wp.array(dtype=t.vec3)            # of the last three points [1/m], (3 hinges,); explicit steps
        y: wp.array(dtype=t.scalar)          # as z and C, of adjoints
        Y: wp.array(dtype=t.vec3)

    return Curvatures


@wp.func
def sine_cosine(D: wp.float64):
    """Sine and cosine of an angle [rad]."""
    return wp.sin(D), wp.cos(D)


@wp.func
def sine_cosine(D: wp.float32):  # noqa: F811 - an overload
    """Sine and cosine of an angle [rad] in [-pi, pi], to 1 unit of 1.

    r in [0, pi/2] is the angle from 0 or from pi, sin r = r + r u P(u), cos r = 1 + u Q(u), u = r^2; P and Q minimise the
    largest error, 4.8e-9 and 2.4e-10. Half the time of the library's functions on a CPU, and the same on every device.
    """
    r = wp.abs(D)
    sign = wp.float32(1.0)
    if r > wp.static(math.pi / 2.0):
        r = wp.max(wp.static(math.pi) - r, 0.0)
        sign = wp.float32(-1.0)
    u = r * r
    v = u * u
    P = (-0.166666605 + 8.33308817e-03 * u) + v * (-1.98111127e-04 + 2.60893263e-06 * u)
    Q = (-0.499999995 + 4.16666407e-02 * u) + v * ((-1.38884035e-03 + 2.47618862e-05 * u) - v * 2.60771050e-07)
    s = r + r * u * P
    if D < 0.0:
        s = -s
    return s, sign * (1.0 + u * Q)


@wp.func
def folded_angle(D: Any):
    """f = s + s^3 / 6, f' = c (1 + s^2 / 2) and 1 - f'^2 of an angle [rad], s its sine and c its cosine; f'' = -3/2 s^3.

    Two terms of arcsin s: f = D - 3/40 D^5 of small angles. It is smooth through pi, where it is 0, so that what hinges share
    does not change sign there, and |f| <= |D|, |f'| <= 1: the energy is never negative, nor above 1/2 k D^2.
    """
    one = type(D)(1.0)
    half = type(D)(0.5)
    s, c = sine_cosine(D)
    w = s * s
    return s + s * w * type(D)(wp.static(1.0 / 6.0)), c * (one + half * w), half * half * w * w * (type(D)(3.0) + w)


@wp.func
def hinge_moment(cur: Any, C: Any, e: int):
    """u of hinge e."""
    u = cur.z.dtype(0.0)
    for k in range(cur.begin[e], cur.end[e]):
        s = cur.item[k]
        u += wp.dot(cur.value[s], C[s // wp.static(SLOTS)])
    return u


@cache
def curvature_sum_kernel(real, module, both: bool = False):
    """Kernel over triangles: C of z; both: and Y of y."""
    t, Curvatures = types(real), sheet_curvatures(real)

    def sum_curvatures(cur: Curvatures):
        c = wp.tid()
        C = t.vec3()
        Y = t.vec3()
        for s in range(SLOTS * c, SLOTS * c + cur.count[c]):
            e = cur.slot[s]
            C += cur.z[e] * cur.value[s]
            if wp.static(both):
                Y += cur.y[e] * cur.value[s]
        cur.C[c] = C
        if wp.static(both):
            cur.Y[c] = Y

    return wp.kernel(sum_curvatures, name="curvature" + "_both" * both, module=module, enable_backward=False)


@cache
def hinge_strain_kernel(real, module, damped: bool):
    """Kernel over hinges of an explicit step: z, G, and slope and kept by which m = slope u + kept."""
    t, Elements, Curvatures = types(real), force_elements(DIHEDRAL, real), sheet_curvatures(real)

    def strain_hinges(batch: Elements, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), source: int, cur: Curvatures):
        c = wp.tid()
        m = x.shape[0]
        p = batch.point[c]
        i = p[0]
        x0 = x[i]
        d0 = d[source * m + i]
        X = t.mat33()
        for k in range(3):
            j = p[k + 1]
            X[k] = (x[j] - x0) + (d[source * m + j] - d0)
        C, G = dihedral_constraint(X, batch.rest[c])
        f, slope, rest = folded_angle(C)
        kept = C - f * slope
        if wp.static(damped):
            v0 = d[(2 + source) * m + i]
            b = real(0.0)
            for k in range(3):
                b += batch.tau[c] * wp.dot(G[k], d[(2 + source) * m + p[k + 1]] - v0)
            f += slope * b
            kept += rest * b
        stiffness = batch.stiffness[c]
        root = wp.sqrt(stiffness)
        cur.z[c] = root * f
        cur.slope[c] = root * slope
        cur.kept[c] = stiffness * cur.own[c] * kept
        for k in range(3):
            cur.G[3 * c + k] = G[k]

    return wp.kernel(strain_hinges, name="hinge" + "_damped" * damped, module=module, enable_backward=False)


@cache
def hinge_force_kernel(real, module):
    """Kernel over hinges: force on each of their points, f[first + 4 c + k] [N]."""
    t, Elements, Curvatures = types(real), force_elements(DIHEDRAL, real), sheet_curvatures(real)

    def hinge_corner_forces(batch: Elements, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), source: int, first: int,
                            cur: Curvatures, f_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        s = -(cur.slope[c] * hinge_moment(cur, cur.C, c) + cur.kept[c])
        F0 = t.vec3()
        for k in range(3):
            f = s * cur.G[3 * c + k]
            F0 -= f
            f_out[first + 4 * c + k + 1] = f
        f_out[first + 4 * c] = F0

    return writes_all(wp.kernel(hinge_corner_forces, name=f"corners_dihedral_{t.name}", module=module, enable_backward=False))


@cache
def hinge_of(real, damped: bool):
    """Function of hinge c of a table of XPBD or Newton's method: its places X and displacements V less those of the anchor
    (both to its first point), C and G."""
    t, Batch = types(real), batch_of(DIHEDRAL, real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def read_hinge(batch: Batch, rest: wp.array(dtype=real), x: vec3, d: vec3, a: vec3, c: int):
        p = batch.point[c]
        i = p[0]
        X = t.mat33()
        V = t.mat33()
        for k in range(3):
            moved = d[p[k + 1]] - d[i]
            X[k] = (x[p[k + 1]] - x[i]) + moved
            if wp.static(damped):
                V[k] = moved - (a[p[k + 1]] - a[i])
        C, G = dihedral_constraint(X, rest[c])
        return X, V, C, G

    return read_hinge


@cache
def hinge_angle_kernel(real, module, damped: bool):
    """Kernel over hinges of such a table: z, and slope and kept by which D + tau b - m / k = kept - slope u. rest: angles at
    rest; rate: 1 / h."""
    t, Batch, Curvatures, hinge = types(real), batch_of(DIHEDRAL, real), sheet_curvatures(real), hinge_of(real, damped)
    vec3 = wp.array(dtype=t.vec3)

    def compute_hinge_angles(batch: Batch, rest: wp.array(dtype=real), x: vec3, d: vec3, a: vec3, rate: real, cur: Curvatures):
        c = wp.tid()
        _X, V, C, G = hinge(batch, rest, x, d, a, c)
        f, slope, rest_of = folded_angle(C)
        lone = C - f * slope
        if wp.static(damped):
            b = rate * batch.tau[c] * wp.ddot(G, V)
            C += b
            f += slope * b
            lone += rest_of * b
        root = wp.sqrt(batch.alpha[c])
        cur.z[c] = inverse_or_zero(root) * f
        cur.slope[c] = root * slope
        cur.kept[c] = C - cur.own[c] * lone

    return wp.kernel(compute_hinge_angles, name="angle" + "_damped" * damped, module=module, enable_backward=False)


@cache
def target_angle_kernel(real, module):
    """Kernel over hinges: the angles that hinges alone, of stiffness k, would have to be at rest at for the moments that the
    sheet has: theta_0 + D - m / k, which XPBD projects to. Since 1/2 sum k D^2 is at least E, sweeps that repeat it go
    downhill where hinges are not folded sharply, and so do substeps of one sweep."""
    Batch, Curvatures = batch_of(DIHEDRAL, real), sheet_curvatures(real)

    def hinge_target_angles(batch: Batch, rest: wp.array(dtype=real), cur: Curvatures, target_out: wp.array(dtype=real)):
        c = wp.tid()
        target_out[c] = rest[c] + (cur.kept[c] - cur.slope[c] * hinge_moment(cur, cur.C, c))

    return wp.kernel(hinge_target_angles, name="target", module=module, enable_backward=False)


@cache
def stored_bending_kernel(real, module):
    """Kernel over hinges of such a table: z without damping, and at kept 1/2 k q (D^2 - f^2) [J]."""
    t, Batch, Curvatures, hinge = types(real), batch_of(DIHEDRAL, real), sheet_curvatures(real), hinge_of(real, False)
    vec3 = wp.array(dtype=t.vec3)

    def stored_bending(batch: Batch, rest: wp.array(dtype=real), x: vec3, d: vec3, cur: Curvatures):
        c = wp.tid()
        _X, _V, C, _G = hinge(batch, rest, x, d, d, c)
        angle = wp.float64(C)
        k = inverse_or_zero(wp.float64(batch.alpha[c]))
        f, _slope, _rest = folded_angle(angle)
        cur.z[c] = real(wp.sqrt(k) * f)
        cur.kept[c] = real(wp.float64(0.5) * k * wp.float64(cur.own[c]) * (angle - f) * (angle + f))

    return wp.kernel(stored_bending, name="hinge_energy", module=module, enable_backward=False)


@cache
def bending_energy_kernel(real, module):
    """Kernel over a fixed number of threads, as many for each world: (0, 0, E [J]) of each thread's share of the triangles and
    hinges, in float64."""
    Curvatures = sheet_curvatures(real)

    def sum_bending_energy(cur: Curvatures, triangles: int, hinges: int, worlds: int, out: wp.array(dtype=wp.vec3d)):
        lanes = out.shape[0] // worlds
        world = wp.tid() // lanes
        lane = wp.tid() % lanes
        sum = wp.float64(0.0)
        for c in range(world * (triangles // worlds) + lane, (world + 1) * (triangles // worlds), lanes):
            C = wp.vec3d(cur.C[c])
            sum += wp.float64(0.5) * wp.dot(C, C)
        for e in range(world * (hinges // worlds) + lane, (world + 1) * (hinges // worlds), lanes):
            sum += wp.float64(cur.kept[e])
        out[wp.tid()] = wp.vec3d(wp.float64(0.0), wp.float64(0.0), sum)

    return wp.kernel(sum_bending_energy, name="bending_energy", module=module, enable_backward=False)
