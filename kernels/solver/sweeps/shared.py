"""Colours of constraints by XPBD, all of a sweep in one launch, by a cluster of blocks whose shared memory holds the
displacements of a world (CUDA, sm_90 and up). Formulas, symbols and order are those of kernels/solver/xpbd.py.

Blocks that share displacements through global memory wait for it three times a colour: until what they wrote is there, then for
points, then for displacements. Here point p of a world is in block p // ROOM, whose memory the others read and write. What a
constraint reads besides does not change in a sweep, and is read while the blocks wait for each other.

A thread takes one constraint of a colour: there are as many threads as the largest colour has constraints.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, membrane_response, membrane_shear, membrane_slender
from wsim.kernels.cloth.terms import plane_stress, variant
from wsim.kernels.math import block
from wsim.kernels.math.matrix import solve_block
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.solver.xpbd import CALM, TINY, weights_of

ROOM = 1024            # points of a block: 16 KB of float32, 32 KB of float64
PLACE = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    __shared__ __align__(32) {real} own[4 * {room}];
    return (int)__cvta_generic_to_shared(own);
#else
    return 0;
#endif
"""
AT = """
    unsigned at;
    asm("mapa.shared::cluster.u32 %0, %1, %2;" : "=r"(at) : "r"((unsigned)base + {bytes}u * (p % {room})), "r"(p / {room}));
"""
GET = """
    wp::vec_t<3, {real}> v;
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
""" + AT + """
    {load}
#endif
    return v;
"""
PUT = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
""" + AT + """
    {store}
#endif
"""
WORDS = {
    "float": ("""asm volatile("{.reg .f32 u; ld.shared::cluster.v4.f32 {%0, %1, %2, u}, [%3];}"
        : "=f"(v[0]), "=f"(v[1]), "=f"(v[2]) : "r"(at) : "memory");""",
              """asm volatile("st.shared::cluster.v4.f32 [%0], {%1, %2, %3, %3};"
        :: "r"(at), "f"(v[0]), "f"(v[1]), "f"(v[2]) : "memory");"""),
    "double": ("""for (int k = 0; k < 3; ++k)
        asm volatile("ld.shared::cluster.f64 %0, [%1];" : "=d"(v[k]) : "r"(at + 8 * k) : "memory");""",
               """for (int k = 0; k < 3; ++k)
        asm volatile("st.shared::cluster.f64 [%0], %1;" :: "r"(at + 8 * k), "d"(v[k]) : "memory");"""),
}


@cache
def memory(real):
    """Functions: place () -> where the memory of a block begins; get (base, p) and put (base, p, v), of point p of a world."""
    vec3, name = types(real).vec3, "float" if real is wp.float32 else "double"
    given = {"real": name, "room": ROOM, "bytes": 16 if name == "float" else 32}
    load, store = WORDS[name]

    @wp.func_native(PLACE.format(**given))
    def place() -> int: ...

    @wp.func_native(GET.replace("{load}", "LOAD").format(**given).replace("LOAD", load))
    def get(base: int, p: int) -> vec3: ...

    @wp.func_native(PUT.replace("{store}", "STORE").format(**given).replace("STORE", store))
    def put(base: int, p: int, v: vec3): ...

    return place, get, put


@cache
def sweep(constraint: Constraint, *, real, module, cluster: int, **kind):
    """(Batch, kernel) as `wsim.kernels.solver.xpbd.sweep`, whose `kind` is without `exact`; d is changed in place.

    The kernel's arguments: batch, at, colours, each, rate, omega, lam, lam_out; each: points of a world.
    """
    o = variant(constraint, real, **kind)
    PointState, (place, get, put), (Row, read, step) = states(real), memory(real), (_block if o.rows == 3 else _row)(o)

    @wp.func
    def own(i: int, rank: int, first: int, each: int, base: int, at: PointState, out: bool):
        """Displacements of the points of a block, into its memory or from it."""
        for p in range(rank * ROOM + i, wp.min((rank + 1) * ROOM, each), wp.block_dim()):
            if out:
                at.d[first + p] = get(base, p)
            else:
                put(base, p, at.d[first + p])

    def sweep(batch: o.Batch, at: PointState, colours: wp.array(dtype=wp.vec2i), each: int, rate: real, omega: real,
              lam: wp.array(dtype=o.value), lam_out: wp.array(dtype=o.value)):
        threads = cluster * wp.block_dim()
        world = wp.tid() // threads
        i = wp.tid() - world * threads
        rank = i // wp.block_dim()
        base = place()
        own(i - rank * wp.block_dim(), rank, world * each, each, base, at, False)
        row = Row()
        colour = colours[0]
        c = colour[0] + world * colour[1] + i
        goes = i < colour[1]
        if goes:
            row = read(c, batch, at, rate, lam)
        block.meet_cluster()
        for k in range(colours.shape[0]):
            if goes:
                row = step(row, world * each, base, omega)
            block.arrive_cluster()
            if wp.static(o.lam):
                if goes:
                    lam_out[c] = row.lam
            if k + 1 < colours.shape[0]:
                colour = colours[k + 1]
                c = colour[0] + world * colour[1] + i
                goes = i < colour[1]
                if goes:
                    row = read(c, batch, at, rate, lam)
            block.wait_cluster()
        own(i - rank * wp.block_dim(), rank, world * each, each, base, at, True)

    return o.Batch, wp.kernel(sweep, name=f"sweep_shared_{o.name}", module=module, enable_backward=False, grid_stride=False,
                               launch_bounds=block.SHARE, cluster_dim=cluster)


def _reading(o):
    """(Row, read): struct of what a constraint reads besides displacements, and function (c, batch, at, rate, lam) -> it."""
    real, n, place, value, weights = o.t.scalar, o.points - 1, o.place, o.value, weights_of(o.points, o.t.scalar)
    rows, masses = wp.types.matrix((n, 3), real), wp.types.vector(o.points, real)
    shape, entry = (o.t.mat22, o.t.vec4) if o.rows == 3 else (real, real)

    @wp.struct
    class Row:
        p: o.ids
        rest: shape
        alpha: entry                              # a
        gamma: real
        lam: value
        w: masses
        x: rows                                   # places of the other points from the first [m]
        a: rows                                   # of anchors

    @wp.func
    def read(c: int, batch: o.Batch, at: states(real), rate: real, lam: wp.array(dtype=value)):
        r = Row()
        p = batch.point[c]
        r.p = p
        r.rest = batch.rest[c]
        if wp.static(not o.unilateral):
            r.alpha = (rate * rate) * batch.alpha[place(c)]
        if wp.static(o.damped):
            r.gamma = rate * batch.tau[place(c)]
        if wp.static(o.lam):
            r.lam = lam[c]
        r.w = weights(batch.w, p)
        for k in range(n):
            r.x[k] = at.x[p[k + 1]] - at.x[p[0]]
            if wp.static(o.damped):
                r.a[k] = at.a[p[k + 1]] - at.a[p[0]]
        return r

    return Row, read


def _row(o):
    """(Row, read, step) of constraints with one row. step (row, first, base, omega) -> row, its multiplier behind the step."""
    real, vec3, n, formula, (_, get, put) = o.t.scalar, o.t.vec3, o.points - 1, o.formula, memory(o.t.scalar)
    Row, read = _reading(o)
    rows, all = wp.types.matrix((n, 3), real), wp.types.matrix((n + 1, 3), real)

    @wp.func
    def step(row: Row, first: int, base: int, omega: real):
        N = all()
        N[0] = get(base, row.p[0] - first)
        X = rows()
        for k in range(n):
            N[k + 1] = get(base, row.p[k + 1] - first)
            X[k] = row.x[k] + (N[k + 1] - N[0])
        C, G = formula(X, row.rest)
        if wp.static(o.unilateral):
            C = wp.max(C, real(0.0))
        r = -C
        if wp.static(o.lam):
            r -= row.alpha * row.lam
        if wp.static(o.damped):
            for k in range(n):
                r -= row.gamma * wp.dot(G[k], (N[k + 1] - N[0]) - row.a[k])
        G0 = vec3()
        below = real(0.0)
        for k in range(n):
            G0 -= G[k]
            below += row.w[k + 1] * wp.dot(G[k], G[k])
        if wp.static(not o.anchored):
            below += row.w[0] * wp.dot(G0, G0)
        below = (real(1.0) + row.gamma) * below + row.alpha
        if below > real(0.0):                          # else all pinned or no direction: nothing to move
            dlam = (omega * r) / below
            if wp.static(not o.anchored):
                put(base, row.p[0] - first, N[0] + (row.w[0] * dlam) * G0)
            for k in range(n):
                put(base, row.p[k + 1] - first, N[k + 1] + (row.w[k + 1] * dlam) * G[k])
            row.lam = row.lam + dlam
        return row

    return Row, read, step


def _block(o):
    """(Row, read, step) of constraints with three rows on three points."""
    real, formula, (_, get, put), (Row, read), tiny = o.t.scalar, o.formula, memory(o.t.scalar), _reading(o), TINY[o.t.scalar]

    @wp.func
    def step(row: Row, first: int, base: int, omega: real):
        i, j, k = row.p[0] - first, row.p[1] - first, row.p[2] - first
        d0 = get(base, i)
        d1 = get(base, j)
        d2 = get(base, k)
        C, G1, G2 = formula(wp.matrix_from_rows(row.x[0] + (d1 - d0), row.x[1] + (d2 - d0)), row.rest)
        r = -C
        if wp.static(o.lam):
            r -= plane_stress(row.alpha) * row.lam
        if wp.static(o.damped):
            r -= row.gamma * (G1 * ((d1 - d0) - row.a[0]) + G2 * ((d2 - d0) - row.a[1]))
        G0 = -(G1 + G2)
        S = membrane_response(C, row.rest, row.w[0], row.w[1], row.w[2])
        dlam = omega * solve_block((real(1.0) + row.gamma) * S + plane_stress(row.alpha), r, real(tiny))
        if wp.dot(r, r) > real(CALM * CALM):
            slender = membrane_slender(row.rest)
            most = real(2.0) * slender[1]
            way = wp.abs(membrane_shear(row.rest, S * dlam)) * (slender[0] - most)         # as kernels/solver/xpbd.py
            if way > most:
                dlam *= most / way
        put(base, i, d0 + row.w[0] * (wp.transpose(G0) * dlam))
        put(base, j, d1 + row.w[1] * (wp.transpose(G1) * dlam))
        put(base, k, d2 + row.w[2] * (wp.transpose(G2) * dlam))
        row.lam = row.lam + dlam
        return row

    return Row, read, step
