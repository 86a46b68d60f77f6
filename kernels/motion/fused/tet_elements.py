"""Linear tetrahedra in float32, as CUDA code of kernels/motion/fused/sheet.py: the formulas of kernels/soft/fem.py, the
stresses of kernels/soft/material.py and neo_hookean.py, and the rotation of kernels/math/rotation.py, whose docstrings derive
them.

`tet` leaves the forces at the four corners of a tet in F, as hinges and triangles do theirs. In shared memory a tet has

    T    (x_k - x_0) - r_k where the frame begins and g_k [1/m], k = 1, 2, 3; with them V mu, V lam [J], tau [s], the number of
         its material, and the places of its corners in two words
    R    the quaternion of its rotation a substep ago; where a frame begins no rotation

Matrices are three columns. 1 / a and a^-1/2 are within two units in the last place, and products are taken in another order
than launch by launch has them: the forces of both differ by rounding.
"""

from wsim.kernels.math.eigen import SWEEPS
from wsim.kernels.math.rotation import ITERATIONS
from wsim.kernels.soft.principal import LARGEST

FILL = """
    for (int i = t; i < tets; i += THREADS) {
        const int word[2] = {at(15, 2 * i), at(15, 2 * i + 1)}, first = 3 * at(0, word[0] & 0xffff);
        auto fill = [=](int kind, int k, const auto& of) {
            const float *const r = (const float*)of.edge.data + 9 * k, *const s = (const float*)of.gradient.data + 9 * k;
            const float V = of.volume.data[k], own[3] = {V * of.mu.data[k], V * of.lam.data[k], of.tau.data[k]};
            const int more_[3] = {kind, word[0], word[1]};
            for (int j = 0; j < 3; ++j) {
                const int last = 3 * at(0, (unsigned)word[(j + 1) / 2] >> (j == 1 ? 0 : 16) & 0xffff);
                T[j * TETS + i] = make_float4(x3[last] - x3[first] - r[3 * j], x3[last + 1] - x3[first + 1] - r[3 * j + 1],
                                              x3[last + 2] - x3[first + 2] - r[3 * j + 2], own[j]);
                T[(3 + j) * TETS + i] = make_float4(s[3 * j], s[3 * j + 1], s[3 * j + 2], INT_AS_FLOAT(more_[j]));
            }
        };
        int g = at(14, i);
        FILL_EACH
        R[i] = make_float4(0.f, 0.f, 0.f, 1.f);
        scale[flat + bent + i] = 1.f;
    }
"""
MATRIX = """
    struct M3 { V3 x, y, z; };                                      // columns
    auto m3 = [](V3 x, V3 y, V3 z) { M3 A; A.x = x; A.y = y; A.z = z; return A; };
    auto onto = [=](M3 A, V3 v) { return more(v.x, A.x, more(v.y, A.y, times(v.z, A.z))); };        // A v
    auto under = [=](M3 A, V3 v) { return v3(dot(A.x, v), dot(A.y, v), dot(A.z, v)); };             // A^T v
    auto minus = [](V3 a, V3 b) { V3 r; r.x = a.x - b.x; r.y = a.y - b.y; r.z = a.z - b.z; return r; };
    auto most_of = [](V3 a) { return fmaxf(fabsf(a.x), fmaxf(fabsf(a.y), fabsf(a.z))); };
    auto clamped = [=](V3 a) {
        const float m = LARGEST;
        return v3(fmaxf(fminf(a.x, m), -m), fmaxf(fminf(a.y, m), -m), fmaxf(fminf(a.z, m), -m));
    };
    auto hooke = [=](M3 A, float mu, float lam) {                   // 2 mu e + lam tr e, e = sym A
        const float xy = mu * (A.x.y + A.y.x), xz = mu * (A.x.z + A.z.x), yz = mu * (A.y.z + A.z.y);
        const float m = mu + mu, p = lam * (A.x.x + A.y.y + A.z.z);
        return m3(v3(fmaf(m, A.x.x, p), xy, xz), v3(xy, fmaf(m, A.y.y, p), yz), v3(xz, yz, fmaf(m, A.z.z, p)));
    };
    auto turned_by = [=](float4 q) {                                // R - 1
        const float x = 2.f * q.x, y = 2.f * q.y, z = 2.f * q.z, xx = x * q.x, yy = y * q.y, zz = z * q.z;
        const float xy = x * q.y, xz = x * q.z, yz = y * q.z, wx = x * q.w, wy = y * q.w, wz = z * q.w;
        return m3(v3(-yy - zz, xy + wz, xz - wy), v3(xy - wz, -xx - zz, yz + wx), v3(xz + wy, yz - wx, -xx - yy));
    };
    auto unit = [=](float4 q) {
        const float s = root_over(fmaf(q.x, q.x, fmaf(q.y, q.y, fmaf(q.z, q.z, q.w * q.w))));
        return make_float4(s * q.x, s * q.y, s * q.z, s * q.w);
    };
"""
ROTATION = """
    auto rotation_anew = [=](M3 F, float4 q) {                      // Horn's matrix by Jacobi turns; rarely run
        const float a[3] = {F.y.z - F.z.y, F.z.x - F.x.z, F.x.y - F.y.x}, xy = F.y.x + F.x.y, xz = F.z.x + F.x.z,
                    yz = F.z.y + F.y.z, first[4] = {q.x, q.y, q.z, q.w};
        float K[4][4] = {{F.x.x - F.y.y - F.z.z, xy, xz, a[0]}, {xy, F.y.y - F.x.x - F.z.z, yz, a[1]},
                         {xz, yz, F.z.z - F.x.x - F.y.y, a[2]}, {a[0], a[1], a[2], F.x.x + F.y.y + F.z.z}};
        float V[4][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
        #pragma unroll 1
        for (int sweep = 0, left = 1; sweep < SWEEPS && left; ++sweep) {
            left = 0;
            #pragma unroll 1
            for (int pair = 0; pair < 6; ++pair) {
                const int i = pair < 3 ? 0 : pair < 5 ? 1 : 2, j = pair < 3 ? pair + 1 : pair < 5 ? pair - 1 : 3;
                if (!(fabsf(K[i][j]) > 0.25f * ROUNDING * fmaxf(fabsf(K[i][i]), fabsf(K[j][j])))) continue;
                const float theta = (K[j][j] - K[i][i]) / (2.f * K[i][j]);
                float u = 1.f / (fabsf(theta) + sqrtf(fmaf(theta, theta, 1.f)));
                if (theta < 0.f) u = -u;
                const float c = 1.f / sqrtf(fmaf(u, u, 1.f)), s = u * c;
                #pragma unroll 1
                for (int k = 0; k < 4; ++k) {
                    const float f = K[k][i], g = K[k][j], v = V[k][i], w = V[k][j];
                    K[k][i] = c * f - s * g;  K[k][j] = s * f + c * g;
                    V[k][i] = c * v - s * w;  V[k][j] = s * v + c * w;
                }
                #pragma unroll 1
                for (int k = 0; k < 4; ++k) {
                    const float f = K[i][k], g = K[j][k];
                    K[i][k] = c * f - s * g;  K[j][k] = s * f + c * g;
                }
                ++left;
            }
        }
        const float most = fmaxf(fmaxf(K[0][0], K[1][1]), fmaxf(K[2][2], K[3][3]));
        float near[4] = {0, 0, 0, 0}, best[4] = {0, 0, 0, 1}, size = 0.f;
        #pragma unroll 1
        for (int k = 0; k < 4; ++k) {
            float along = 0.f;
            for (int j = 0; j < 4; ++j) along = fmaf(first[j], V[j][k], along);
            for (int j = 0; j < 4 && K[k][k] == most; ++j) best[j] = V[j][k];
            for (int j = 0; j < 4 && K[k][k] >= most - 16.f * ROUNDING * most; ++j) near[j] = fmaf(along, V[j][k], near[j]);
        }
        for (int j = 0; j < 4; ++j) size = fmaf(near[j], near[j], size);
        const float* const r = size > 1e-6f ? near : best;
        return unit(make_float4(r[0], r[1], r[2], r[3]));
    };
    auto rotation = [=](M3 H, float4 warm) {                        // of F = 1 + H, from that of a nearby F
        float4 q = warm;
        #pragma unroll 1
        for (int k = 0; k < ITERATIONS; ++k) {
            const M3 D = turned_by(q);
            V3 x = minus(H.x, D.x), y = minus(H.y, D.y), z = minus(H.z, D.z);
            x = add(x, under(D, x));
            y = add(y, under(D, y));
            z = add(z, under(D, z));
            const V3 b = v3(y.z - z.y, z.x - x.z, x.y - y.x);
            const float tr = x.x + y.y + z.z + 3.f, least = 1e-3f * tr, g0 = tr - x.x - 1.f;
            if (!(tr > 0.f && g0 > least)) break;
            const float g10 = -0.5f * (y.x + x.y), g20 = -0.5f * (z.x + x.z), o0 = over(g0), l10 = g10 * o0, l20 = g20 * o0;
            const float g1 = tr - y.y - 1.f - l10 * g10, g21 = fmaf(-l20, g10, -0.5f * (z.y + y.z));
            if (!(g1 > least)) break;
            const float o1 = over(g1), l21 = g21 * o1, g2 = tr - z.z - 1.f - l20 * g20 - l21 * g21;
            if (!(g2 > least)) break;
            const float y1 = fmaf(-l10, b.x, b.y), w2 = (b.z - l20 * b.x - l21 * y1) * over(g2), w1 = fmaf(y1, o1, -l21 * w2);
            const float w0 = b.x * o0 - l10 * w1 - l20 * w2, u0 = 0.5f * w0, u1 = 0.5f * w1, u2 = 0.5f * w2;
            q = unit(make_float4(q.x + q.w * u0 + q.y * u2 - q.z * u1, q.y + q.w * u1 + q.z * u0 - q.x * u2,
                                 q.z + q.w * u2 + q.x * u1 - q.y * u0, q.w - q.x * u0 - q.y * u1 - q.z * u2));
            const float ww = fmaf(w0, w0, fmaf(w1, w1, w2 * w2)), ends = 0.5f * ROUNDING * over(tr) * fminf(g0, fminf(g1, g2));
            if (ww * ww * ww <= ends * ends) return q;              // the next step: below |w|^3 / least pivot
        }
        const float size = fmaxf(most_of(H.x), fmaxf(most_of(H.y), most_of(H.z))), s = size > 1.f ? 1.f / size : 1.f;
        const M3 F = m3(v3(fmaf(s, H.x.x, s), s * H.x.y, s * H.x.z), v3(s * H.y.x, fmaf(s, H.y.y, s), s * H.y.z),
                        v3(s * H.z.x, s * H.z.y, fmaf(s, H.z.z, s)));
        return dot(F.x, F.x) + dot(F.y, F.y) + dot(F.z, F.z) > 0.f ? rotation_anew(F, warm) : warm;
    };
"""
STRESS = {"corotational": ROTATION + """
    auto corotational = [=](M3 G, float mu, float lam, float4* r) {
        const float4 q = rotation(G, *r);
        const M3 D = turned_by(q);
        *r = q;
        V3 x = minus(G.x, D.x), y = minus(G.y, D.y), z = minus(G.z, D.z);
        x = add(x, under(D, x));
        y = add(y, under(D, y));
        z = add(z, under(D, z));
        const M3 S = hooke(m3(x, y, z), mu, lam);
        return m3(add(S.x, onto(D, S.x)), add(S.y, onto(D, S.y)), add(S.z, onto(D, S.z)));
    };
""", "linear": """
    auto linear = [=](M3 G, float mu, float lam, float4*) { return hooke(G, mu, lam); };
""", "neo_hookean": """
    auto neo_hookean = [=](M3 G, float mu, float lam, float4*) {
        const M3 C = m3(cross(G.y, G.z), cross(G.z, G.x), cross(G.x, G.y));
        const float tr = G.x.x + G.y.y + G.z.z, hh = 0.5f * (dot(G.x, G.x) + dot(G.y, G.y) + dot(G.z, G.z));
        const float x = 0.5f * (tr + hh), j = tr + (C.x.x + C.y.y + C.z.z + dot(G.x, C.x));
        const float p = (lam + 5.f / 6.f * mu) * fmaxf(fminf(j, LARGEST), -LARGEST), shear = mu * x / (3.f + 3.f * x);
        auto side = [=](float g, float u) { return fmaf(mu, g + u, fmaf(shear, g, -p * u)); };      // u of G^T - cof G
        auto middle = [=](float g, float u) { return fmaf(mu, g + u - tr, fmaf(shear, 1.f + g, p * (1.f + tr - u))); };
        return m3(v3(middle(G.x.x, G.x.x - C.x.x), side(G.x.y, G.y.x - C.x.y), side(G.x.z, G.z.x - C.x.z)),
                  v3(side(G.y.x, G.x.y - C.y.x), middle(G.y.y, G.y.y - C.y.y), side(G.y.z, G.z.y - C.y.z)),
                  v3(side(G.z.x, G.x.z - C.z.x), side(G.z.y, G.y.z - C.z.y), middle(G.z.z, G.z.z - C.z.z)));
    };
""", "st_venant_kirchhoff": """
    auto st_venant_kirchhoff = [=](M3 G, float mu, float lam, float4*) {
        const M3 E = m3(more(0.5f, under(G, G.x), G.x), more(0.5f, under(G, G.y), G.y), more(0.5f, under(G, G.z), G.z));
        const M3 S = hooke(E, mu, lam);
        return m3(add(S.x, onto(G, S.x)), add(S.y, onto(G, S.y)), add(S.z, onto(G, S.z)));
    };
"""}
TET = """
    auto tet = [=](int c, const float4* d, const float4* q) {
        const float4 e1 = T[c], e2 = T[TETS + c], e3 = T[2 * TETS + c], g1 = T[3 * TETS + c], g2 = T[4 * TETS + c],
                     g3 = T[5 * TETS + c];
        int p[4];
        corners(make_uint2(FLOAT_AS_INT(g2.w), FLOAT_AS_INT(g3.w)), p);
        auto change = [=](V3 u1, V3 u2, V3 u3) {                    // sum of u_k g_k^T
            return m3(more(g1.x, u1, more(g2.x, u2, times(g3.x, u3))), more(g1.y, u1, more(g2.y, u2, times(g3.y, u3))),
                      more(g1.z, u1, more(g2.z, u2, times(g3.z, u3))));
        };
        const float4 d0 = d[p[0]], none = make_float4(0.f, 0.f, 0.f, 0.f);
        const M3 H = change(add(less(e1, none), less(d[p[1]], d0)), add(less(e2, none), less(d[p[2]], d0)),
                            add(less(e3, none), less(d[p[3]], d0)));
        const float size = fmaxf(most_of(H.x), fmaxf(most_of(H.y), most_of(H.z)));
        const M3 G = size <= LARGEST ? H : m3(clamped(H.x), clamped(H.y), clamped(H.z));
        M3 P = G;
        STRESS_EACH
        if (DAMPED) {
            const float4 q0 = q[p[0]];
            const M3 F = m3(v3(1.f + G.x.x, G.x.y, G.x.z), v3(G.y.x, 1.f + G.y.y, G.y.z), v3(G.z.x, G.z.y, 1.f + G.z.z));
            const M3 dF = change(less(q[p[1]], q0), less(q[p[2]], q0), less(q[p[3]], q0));
            const M3 S = hooke(m3(under(F, dF.x), under(F, dF.y), under(F, dF.z)), e3.w * e1.w, e3.w * e2.w);
            P = m3(add(P.x, onto(F, S.x)), add(P.y, onto(F, S.y)), add(P.z, onto(F, S.z)));
        }
        const V3 f1 = times(-1.f, onto(P, v3(g1.x, g1.y, g1.z))), f2 = times(-1.f, onto(P, v3(g2.x, g2.y, g2.z)));
        const V3 f3 = times(-1.f, onto(P, v3(g3.x, g3.y, g3.z)));
        place(flat + bent + c, times(-1.f, add(add(f1, f2), f3)), f1, f2, f3);
    };
"""
NUMBERS = (f"constexpr float LARGEST = {LARGEST:.1f}f, ROUNDING = 1.1920929e-07f;\n"
           f"    constexpr int SWEEPS = {SWEEPS}, ITERATIONS = {ITERATIONS};")


WORDS = 6 * 4 + 4 + 12 + 1       # [4 bytes] of a tet: T, R, its forces and their scale


def tet_fill_code(materials: tuple[str, ...]) -> str:
    """What brings tets into a block's memory. materials: in the order in which tets are numbered."""
    each = "".join(f"if (g >= 0 && g < h.{m}.mu.shape[0]) fill({k}, g, h.{m});\n        g -= h.{m}.mu.shape[0];\n        "
                   for k, m in enumerate(materials))
    return FILL.replace("FILL_EACH", each) if materials else ""


def tet_pass_code(materials: tuple[str, ...]) -> str:
    """`tet`, and all that it calls."""
    each = " else ".join(f"if (FLOAT_AS_INT(g1.w) == {k}) P = {m}(G, e1.w, e2.w, R + c);" for k, m in enumerate(materials))
    tet = TET.replace("STRESS_EACH", each)
    return f"    {NUMBERS}\n{MATRIX}{''.join(STRESS[m] for m in materials)}{tet}" if materials else ""


def tet_call_code(materials: tuple[str, ...], text: str) -> str:
    """A pass over elements with tets among them, or without."""
    return text.replace("ELSE_TET", "else if (i >= solid) tet(i - solid, d, rate);" if materials else "")
