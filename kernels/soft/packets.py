"""Forces of linear tetrahedra on a CPU, EIGHT at a time: the formulas of kernels/soft/fem.py in C++ with Clang's vectors, which
any CPU computes, since Warp's matrices and indices cost several times the arithmetic of one tet.

A lane is one tet, whose numbers no other lane sees. The rotation of a corotational tet is Newton's (kernels/math/rotation.py),
all lanes together, each as it is once it has converged; lanes that do not converge are left to the function of one tet, and are
the bits of what is returned. A packet has no adjoint; gradients take the tets one by one.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.fem import elements, tet_force_function
from wsim.kernels.soft.principal import LARGEST

EIGHT = 8              # tets of a packet
ROUNDING = {wp.float32: "1.1920929e-07f", wp.float64: "2.220446049250313e-16"}
NAMES = {wp.float32: ("float", "int"), wp.float64: ("double", "long long")}

CODE = """
#if !defined(__CUDA_ARCH__)
    typedef {real} T;
    typedef T many __attribute__((vector_size(8 * sizeof(T))));
    typedef {whole} flags __attribute__((vector_size(8 * sizeof(T))));
    const many none = {{}};
    const flags no = {{}};
    const int first = some[0], size = some[1];
    int c[8], p[4][8];
    for (int l = 0; l < 8; ++l) {{
        c[l] = first + l < size ? first + l : size - 1;
        for (int k = 0; k < 4; ++k) p[k][l] = ((const int*)tets.point.data)[4 * c[l] + k];
    }}
    auto pick = [](const T* a, const int* i, int w, int k) {{          // number k of rows i, each of w
        return many{{a[w * i[0] + k], a[w * i[1] + k], a[w * i[2] + k], a[w * i[3] + k],
                     a[w * i[4] + k], a[w * i[5] + k], a[w * i[6] + k], a[w * i[7] + k]}};
    }};
    auto most = [](many a, many b) {{ return a > b ? a : b; }};
    auto least = [](many a, many b) {{ return a < b ? a : b; }};
    auto root = [](many a) {{ return __builtin_elementwise_sqrt(a); }};
    auto all = [](flags f) {{ {whole} found = -1; for (int l = 0; l < 8; ++l) found &= f[l]; return found != 0; }};
    many G[3][3], H[3][3], u[3];
    const T *place = (const T*)x.data, *moved = (const T*)d.data;
    {{
        many r[3][3];
        for (int a = 0; a < 3; ++a) {{
            const many x0 = pick(place, p[0], 3, a), d0 = pick(moved, p[0], 3, a);
            for (int k = 0; k < 3; ++k)
                r[k][a] = ((pick(place, p[k + 1], 3, a) - x0) - pick((const T*)tets.edge.data, c, 9, 3 * k + a))
                        + (pick(moved, p[k + 1], 3, a) - d0);
        }}
        for (int k = 0; k < 3; ++k)
            for (int b = 0; b < 3; ++b) G[k][b] = pick((const T*)tets.gradient.data, c, 9, 3 * k + b);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) H[a][b] = r[0][a] * G[0][b] + r[1][a] * G[1][b] + r[2][a] * G[2][b];
    }}
    const many mu = pick((const T*)tets.mu.data, c, 1, 0), lam = pick((const T*)tets.lam.data, c, 1, 0);
    many P[3][3];
    flags done = ~no;
    {rotation}
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) H[a][b] = most(least(H[a][b], none + T({largest})), none - T({largest}));
    {stress}
    {damping}
    const many volume = pick((const T*)tets.volume.data, c, 1, 0);
    many f[4][3];
    for (int a = 0; a < 3; ++a) {{
        for (int k = 0; k < 3; ++k)
            f[k + 1][a] = -volume * (P[a][0] * G[k][0] + P[a][1] * G[k][1] + P[a][2] * G[k][2]);
        f[0][a] = -(f[1][a] + f[2][a] + f[3][a]);
    }}
    int left = 0;
    for (int l = 0; l < 8 && first + l < size; ++l) {{
        if (!done[l]) {{ left |= 1 << l; continue; }}
        T* to = (T*)f_out.data + 3 * (tets.force + 4 * c[l]);
        for (int k = 0; k < 4; ++k)
            for (int a = 0; a < 3; ++a) to[3 * k + a] = f[k][a][l];
        {keep}
    }}
    return left;
#else
    return 0;
#endif
"""
TURNED = """            D[0][0] = -2 * (q[1] * q[1] + q[2] * q[2]); D[0][1] = 2 * (q[0] * q[1] - q[2] * q[3]);
            D[0][2] = 2 * (q[0] * q[2] + q[1] * q[3]); D[1][0] = 2 * (q[0] * q[1] + q[2] * q[3]);
            D[1][1] = -2 * (q[0] * q[0] + q[2] * q[2]); D[1][2] = 2 * (q[1] * q[2] - q[0] * q[3]);
            D[2][0] = 2 * (q[0] * q[2] - q[1] * q[3]); D[2][1] = 2 * (q[1] * q[2] + q[0] * q[3]);
            D[2][2] = -2 * (q[0] * q[0] + q[1] * q[1]);"""
# q and D = R - 1; X = R^T (scale (H - D)) of the last step
ROTATION = """
    many q[4], D[3][3];
    auto turn = [&]() {{
{turned}
    }};
    auto back = [&](many s, many (&X)[3][3]) {{                       // R^T s (H - D)
        many Y[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) Y[a][b] = s * (H[a][b] - D[a][b]);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) X[a][b] = Y[a][b] + (D[0][a] * Y[0][b] + D[1][a] * Y[1][b] + D[2][a] * Y[2][b]);
    }};
    for (int k = 0; k < 4; ++k) q[k] = pick((const T*)q_in.data, c, 4, k);
    {{
        const many square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], over = 1 / root(square);
        for (int k = 0; k < 4; ++k) q[k] = square > 0 ? q[k] * over : none + T(k == 3);
        many size = none;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) size = most(size, most(H[a][b], -H[a][b]));
        const many scale = size > 1 ? 1 / size : none + T(1);
        flags lost = no;
        done = no;
        for (int step = 0; step < 6; ++step) {{                       // ITERATIONS
            many X[3][3];
            turn();
            back(scale, X);
            const many b0 = X[2][1] - X[1][2], b1 = X[0][2] - X[2][0], b2 = X[1][0] - X[0][1];
            const many t = X[0][0] + X[1][1] + X[2][2] + 3 * scale, few = T(1e-3) * t;
            const many g0 = t - X[0][0] - scale, g10 = T(-0.5) * (X[0][1] + X[1][0]), g20 = T(-0.5) * (X[0][2] + X[2][0]);
            const many l10 = g10 / g0, l20 = g20 / g0;
            const many g1 = t - X[1][1] - scale - l10 * g10, g21 = T(-0.5) * (X[1][2] + X[2][1]) - l20 * g10, l21 = g21 / g1;
            const many g2 = t - X[2][2] - scale - l20 * g20 - l21 * g21;
            const many y1 = b1 - l10 * b0, w2 = (b2 - l20 * b0 - l21 * y1) / g2, w1 = y1 / g1 - l21 * w2;
            const many w0 = b0 / g0 - l10 * w1 - l20 * w2;
            const flags good = (t > 0) & (g0 > few) & (g1 > few) & (g2 > few), goes = good & ~done & ~lost;
            const many h0 = T(0.5) * w0, h1 = T(0.5) * w1, h2 = T(0.5) * w2;
            many n[4] = {{q[0] + q[3] * h0 + q[1] * h2 - q[2] * h1, q[1] + q[3] * h1 + q[2] * h0 - q[0] * h2,
                          q[2] + q[3] * h2 + q[0] * h1 - q[1] * h0, q[3] - q[0] * h0 - q[1] * h1 - q[2] * h2}};
            const many unit = 1 / root(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] + n[3] * n[3]);
            for (int k = 0; k < 4; ++k) q[k] = goes ? n[k] * unit : q[k];
            const many ww = w0 * w0 + w1 * w1 + w2 * w2;
            lost |= ~good & ~done;
            done |= goes & (ww * root(ww) <= {rounding} * (least(least(g0, g1), g2) / (t + t)));
            if (all(done | lost)) break;
        }}
        turn();
    }}
"""
HOOKE = """{{
        many Y[3][3], S[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) Y[a][b] = H[a][b] - D[a][b];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) S[a][b] = Y[a][b] + (D[0][a] * Y[0][b] + D[1][a] * Y[1][b] + D[2][a] * Y[2][b]);
        const many swell = lam * (S[0][0] + S[1][1] + S[2][2]);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b <= a; ++b) Y[a][b] = Y[b][a] = mu * (S[a][b] + S[b][a]) + (a == b ? swell : none);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) P[a][b] = Y[a][b] + (D[a][0] * Y[0][b] + D[a][1] * Y[1][b] + D[a][2] * Y[2][b]);
    }}"""
NEO_HOOKEAN = """{{
        many C[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {{
                const int i = (a + 1) % 3, j = (a + 2) % 3, k = (b + 1) % 3, l = (b + 2) % 3;
                C[a][b] = H[i][k] * H[j][l] - H[i][l] * H[j][k];
            }}
        const many t = H[0][0] + H[1][1] + H[2][2];
        const many change = C[0][0] + C[1][1] + C[2][2] + (H[0][0] * C[0][0] + H[0][1] * C[0][1] + H[0][2] * C[0][2]);
        many square = none;
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) square += H[a][b] * H[a][b];
        const many s = T(0.5) * (t + T(0.5) * square), j = t + change;
        const many push = (lam + T(5.0 / 6.0) * mu) * most(least(j, none + T({largest})), none - T({largest}));
        const many shear = mu * (s / (3 * (1 + s)));
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {{
                const many one = none + T(a == b);
                P[a][b] = mu * (H[a][b] + H[b][a] - t * one - C[a][b]) + shear * (one + H[a][b])
                        + push * (C[a][b] + (one + t * one - H[b][a]));
            }}
    }}"""
DAMPING = """{{
        const T* speed = (const T*)v.data;
        const many tau = pick((const T*)tets.tau.data, c, 1, 0);
        many r[3][3], E[3][3], F[3][3];
        for (int a = 0; a < 3; ++a) {{
            const many v0 = pick(speed, p[0], 3, a);
            for (int k = 0; k < 3; ++k) r[k][a] = pick(speed, p[k + 1], 3, a) - v0;
        }}
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {{
                E[a][b] = r[0][a] * G[0][b] + r[1][a] * G[1][b] + r[2][a] * G[2][b];
                F[a][b] = H[a][b] + T(a == b);
            }}
        many S[3][3];
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) S[a][b] = F[0][a] * E[0][b] + F[1][a] * E[1][b] + F[2][a] * E[2][b];
        const many swell = lam * (S[0][0] + S[1][1] + S[2][2]);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b <= a; ++b) E[a][b] = E[b][a] = mu * (S[a][b] + S[b][a]) + (a == b ? swell : none);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) P[a][b] += tau * (F[a][0] * E[0][b] + F[a][1] * E[1][b] + F[a][2] * E[2][b]);
    }}"""
KEEP = "for (int k = 0; k < 4; ++k) ((T*)q_out.data)[4 * c[l] + k] = q[k][l];"
STRESSES = {"corotational": (ROTATION, HOOKE, KEEP), "neo_hookean": ("", NEO_HOOKEAN, "")}


@cache
def tet_packet_function(material: str, damped: bool, real):
    """Function: forces, and rotations, of the tets first .. first + 7 of size, `some`; returns the bits of those left."""
    t, Tets = types(real), elements(real)
    name, whole = NAMES[real]
    rotation, stress, keep = STRESSES[material]
    words = {"real": name, "whole": whole, "largest": repr(LARGEST), "rounding": ROUNDING[real], "turned": TURNED}
    code = CODE.format(rotation=rotation.format(**words), stress=stress.format(**words), keep=keep,
                       damping=DAMPING.format(**words) if damped else "", **words)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    @wp.func_native(code)
    def native_tet_packet(tets: Tets, x: vec3, d: vec3, v: vec3, q_in: quat, some: wp.vec2i, f_out: vec3,
                          q_out: quat) -> int: ...

    @wp.func(inline=False)                               # compiled once, for all kernels of the module
    def packet_of(tets: Tets, x: vec3, d: vec3, v: vec3, q_in: quat, some: wp.vec2i, f_out: vec3, q_out: quat):
        return native_tet_packet(tets, x, d, v, q_in, some, f_out, q_out)

    return packet_of


@cache
def forces(material: str, damped: bool, *, real, module):
    """Kernel over packets: as `wsim.kernels.soft.fem.forces`. size: tets."""
    t, Tets, eight, one = (types(real), elements(real), tet_packet_function(material, damped, real),
                           tet_force_function(material, damped, real))
    vec3, quat, many, turns = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), EIGHT, bool(STRESSES[material][0])

    @wp.func(inline=False)
    def left_over(tets: Tets, c: int, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        one(tets, c, x, d, v, q, f_out, q_out)

    def packet_tet_forces(tets: Tets, size: int, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        first = wp.static(many) * wp.tid()
        left = eight(tets, x, d, v, q, wp.vec2i(first, size), f_out, q_out)
        if wp.static(turns):
            k = int(0)  # noqa: UP018
            while left != 0:
                if left & 1 != 0:
                    left_over(tets, first + k, x, d, v, q, f_out, q_out)
                left = left >> 1
                k += 1

    name = f"fem_packets_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(packet_tet_forces, name=name, module=module, enable_backward=False)
