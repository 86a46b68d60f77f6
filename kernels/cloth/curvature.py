"""Bending: curvatures of triangles from the angles of hinges, and back to a moment for each hinge. See
wsim/physics/cloth/bending.py.

    z_e = k_e^1/2 (theta_e - theta_0e + tau_e G_e.v)     C_t = sum_s value_ts z_s     u_e = sum_ts value_ts.C_t

k [J] is the stiffness of a hinge alone, 1 / alpha. The energy is 1/2 sum |C_t|^2, the moment of a hinge k^1/2 u, and a force
-k^1/2 u G: what it has of tau is damping in proportion to stiffness. Triangles and hinges gather: no atomics.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import dihedral, inverse
from wsim.kernels.cloth.element import elements
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types

SLOTS = 9              # hinges of a triangle, at most: as `wsim.physics.cloth.bending.SLOTS`


@cache
def curvatures(real):
    """Struct of the triangles of all sheets. Slot s belongs to triangle s // SLOTS."""
    t = types(real)

    @wp.struct
    class Curvatures:
        slot: wp.array(dtype=int)            # hinge of each slot, (SLOTS t,): those in use come first
        count: wp.array(dtype=int)           # slots of a triangle in use
        value: wp.array(dtype=t.vec3)
        begin: wp.array(dtype=int)           # slots of a hinge: item[begin] .. item[end]
        end: wp.array(dtype=int)
        item: wp.array(dtype=int)
        z: wp.array(dtype=t.scalar)          # [J^1/2], (hinges,)
        C: wp.array(dtype=t.vec3)            # [J^1/2], (t,)
        G: wp.array(dtype=t.vec3)            # of the last three points [1/m], (3 hinges,); explicit steps
        y: wp.array(dtype=t.scalar)          # as z and C, of adjoints
        Y: wp.array(dtype=t.vec3)

    return Curvatures


@wp.func
def moment(cur: Any, C: Any, e: int):
    """u of hinge e."""
    u = cur.z.dtype(0.0)
    for k in range(cur.begin[e], cur.end[e]):
        s = cur.item[k]
        u += wp.dot(cur.value[s], C[s // wp.static(SLOTS)])
    return u


@cache
def sums(real, module, both: bool = False):
    """Kernel over triangles: C of z; both: and Y of y."""
    t, Curvatures = types(real), curvatures(real)

    def sums(cur: Curvatures):
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

    return wp.kernel(sums, name="curvature" + "_both" * both, module=module, enable_backward=False)


@cache
def strained(real, module, damped: bool):
    """Kernel over hinges of an explicit step: z and G."""
    t, Elements, Curvatures = types(real), elements("dihedral", real), curvatures(real)

    def strained(batch: Elements, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), source: int, cur: Curvatures):
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
        C, G = dihedral(X, batch.rest[c])
        if wp.static(damped):
            v0 = d[(2 + source) * m + i]
            for k in range(3):
                C += batch.tau[c] * wp.dot(G[k], d[(2 + source) * m + p[k + 1]] - v0)
        cur.z[c] = wp.sqrt(batch.stiffness[c]) * C
        for k in range(3):
            cur.G[3 * c + k] = G[k]

    return wp.kernel(strained, name="hinge" + "_damped" * damped, module=module, enable_backward=False)


@cache
def corners(real, module):
    """Kernel over hinges: force on each of their points, f[first + 4 c + k] [N]."""
    t, Elements, Curvatures = types(real), elements("dihedral", real), curvatures(real)

    def corners(batch: Elements, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), source: int, first: int,
                cur: Curvatures, f_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        s = -wp.sqrt(batch.stiffness[c]) * moment(cur, cur.C, c)
        F0 = t.vec3()
        for k in range(3):
            f = s * cur.G[3 * c + k]
            F0 -= f
            f_out[first + 4 * c + k + 1] = f
        f_out[first + 4 * c] = F0

    return wp.kernel(corners, name=f"corners_dihedral_{t.name}", module=module, enable_backward=False)


@cache
def hinge_of(real, damped: bool):
    """Function of hinge c of a table of XPBD or Newton's method: its places X and displacements V less those of the anchor
    (both to its first point), C and G."""
    t, Batch = types(real), batch_of("dihedral", real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def hinge(batch: Batch, rest: wp.array(dtype=real), x: vec3, d: vec3, a: vec3, c: int):
        p = batch.point[c]
        i = p[0]
        X = t.mat33()
        V = t.mat33()
        for k in range(3):
            moved = d[p[k + 1]] - d[i]
            X[k] = (x[p[k + 1]] - x[i]) + moved
            if wp.static(damped):
                V[k] = moved - (a[p[k + 1]] - a[i])
        C, G = dihedral(X, rest[c])
        return X, V, C, G

    return hinge


@cache
def angles(real, module, damped: bool):
    """Kernel over hinges of such a table: z. rest: angles at rest; rate: 1 / h."""
    t, Batch, Curvatures, hinge = types(real), batch_of("dihedral", real), curvatures(real), hinge_of(real, damped)
    vec3 = wp.array(dtype=t.vec3)

    def angles(batch: Batch, rest: wp.array(dtype=real), x: vec3, d: vec3, a: vec3, rate: real, cur: Curvatures):
        c = wp.tid()
        _X, V, C, G = hinge(batch, rest, x, d, a, c)
        if wp.static(damped):
            C += rate * batch.tau[c] * wp.ddot(G, V)
        cur.z[c] = wp.sqrt(inverse(batch.alpha[c])) * C

    return wp.kernel(angles, name="angle" + "_damped" * damped, module=module, enable_backward=False)


@cache
def targets(real, module):
    """Kernel over hinges: the angles that hinges alone, of stiffness k, would have to be at rest at for the moments that the
    sheet has: theta_0 + C - k^-1/2 u, which XPBD projects to. Since sum k C^2 is at least |C_t|^2, sweeps that repeat it
    go downhill, and so do substeps of one sweep."""
    Batch, Curvatures = batch_of("dihedral", real), curvatures(real)

    def targets(batch: Batch, rest: wp.array(dtype=real), cur: Curvatures, target_out: wp.array(dtype=real)):
        c = wp.tid()
        target_out[c] = rest[c] + wp.sqrt(batch.alpha[c]) * (cur.z[c] - moment(cur, cur.C, c))

    return wp.kernel(targets, name="target", module=module, enable_backward=False)


@cache
def energy(real, module):
    """Kernel over a fixed number of threads: 1/2 |C_t|^2 [J] of each thread's share of `count` triangles, in float64."""
    Curvatures = curvatures(real)

    def energy(cur: Curvatures, count: int, out: wp.array(dtype=wp.float64)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), count, out.shape[0]):
            C = wp.vec3d(cur.C[c])
            sum += wp.float64(0.5) * wp.dot(C, C)
        out[wp.tid()] = sum

    return wp.kernel(energy, name="bending_energy", module=module, enable_backward=False)
