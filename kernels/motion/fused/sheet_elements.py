"""Hinges and triangles of sheets in float32, as CUDA code of kernels/motion/fused/sheet.py: the formulas of
kernels/cloth/constraint.py, element.py and curvature.py, whose docstrings derive them.

`hinge` and `triangle` leave the forces at the corners of an element in F, twelve numbers: x, y and z of its four corners (a
triangle has three: the fourth is that of the air on each of them). Those of a hinge still wait for its moment. 1 / a and
a^-1/2 are within two units in the last place.
"""

import math

from wsim.kernels.cloth.constraint import FLAT

ARITHMETIC = """
    struct V3 { float x, y, z; };
    auto v3 = [](float x, float y, float z) { V3 r; r.x = x; r.y = y; r.z = z; return r; };
    auto add = [=](V3 a, V3 b) { return v3(a.x + b.x, a.y + b.y, a.z + b.z); };
    auto times = [=](float s, V3 a) { return v3(s * a.x, s * a.y, s * a.z); };
    auto more = [=](float s, V3 a, V3 b) { return v3(fmaf(s, a.x, b.x), fmaf(s, a.y, b.y), fmaf(s, a.z, b.z)); };
    auto dot = [](V3 a, V3 b) { return fmaf(a.x, b.x, fmaf(a.y, b.y, a.z * b.z)); };
    auto cross = [=](V3 a, V3 b) {
        return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    };
    auto over = [=](float a) { const float r = RECIPROCAL(a); return fmaf(r, fmaf(-a, r, 1.f), r); };
    auto root_over = [=](float a) { const float r = RSQRT(a); return fmaf(0.5f * r, fmaf(-a * r, r, 1.f), r); };
    auto inverse = [=](float a) { return a > 1e-37f ? over(a) : 0.f; };
    auto corners = [](uint2 word, int* p) {
        p[0] = word.x & 0xffff; p[1] = word.x >> 16; p[2] = word.y & 0xffff; p[3] = word.y >> 16;
    };
    auto less = [=](float4 a, float4 b) { return v3(a.x - b.x, a.y - b.y, a.z - b.z); };
    auto apart = [=](const float4* d, int i, int j) {               // of points j and i, without loss far from the origin
        return add(less(X[j], X[i]), less(d[j], d[i]));
    };
    auto place = [=](int element, V3 f0, V3 f1, V3 f2, V3 f3) {
        float4* const f = (float4*)(F + 12 * element);
        f[0] = make_float4(f0.x, f1.x, f2.x, f3.x);
        f[1] = make_float4(f0.y, f1.y, f2.y, f3.y);
        f[2] = make_float4(f0.z, f1.z, f2.z, f3.z);
    };
"""
HINGE = """
    auto hinge = [=](int c, const float4* d, const float4* q) {
        int p[4];
        corners(hinge_corner[c], p);
        const float4 own = P[c];                                    // rest angle, k^1/2, tau, k q
        const V3 E = apart(d, p[0], p[1]), X2 = apart(d, p[0], p[2]), X3 = apart(d, p[0], p[3]);
        const V3 N2 = cross(E, X2), N3 = cross(X3, E), none = v3(0.f, 0.f, 0.f);
        const float LL = dot(E, E), n2 = dot(N2, N2), n3 = dot(N3, N3);
        const float r = LL > 1e-37f ? root_over(LL) : 0.f, qq = r * r, L = LL * r;
        float D = 0.f;
        V3 G1 = none, G2 = none, G3 = none;
        if ((qq * n2) * (qq * n3) > FLAT) {
            const float y = -L * dot(X3, N2), x = dot(N2, N3), ax = fabsf(x), ay = fabsf(y), most = fmaxf(ax, ay);
            const float a = most > 1e-37f ? fminf(ax, ay) * over(most) : 0.f, u = a * a;
            float s = fmaf(0.00292068769f, u, -0.0163679108f);
            s = fmaf(s, u, 0.0432118343f);
            s = fmaf(s, u, -0.0755221217f);
            s = fmaf(s, u, 0.106660037f);
            s = fmaf(s, u, -0.142110551f);
            s = fmaf(s, u, 0.199937728f);
            s = fmaf(s, u, -0.333331527f);
            s = fmaf(a * u, s, a);
            if (ay > ax) s = 0.5f * PI - s;
            if (x < 0.f) s = PI - s;
            D = (y < 0.f ? -s : s) - own.x;
            if (D > PI) D -= 2.f * PI;
            if (D < -PI) D += 2.f * PI;
            G2 = times(-L * over(n2), N2);
            G3 = times(-L * over(n3), N3);
            G1 = more(-qq * dot(E, X2), G2, times(-qq * dot(E, X3), G3));
        }
        float t = fabsf(D), sign = 1.f;                             // sine, cosine: see `sine_cosine`
        if (t > 0.5f * PI) { t = fmaxf(PI - t, 0.f); sign = -1.f; }
        const float u = t * t;
        float sine = fmaf(2.60893263e-06f, u, -1.98111127e-04f), cosine = fmaf(-2.60771050e-07f, u, 2.47618862e-05f);
        sine = fmaf(fmaf(sine, u, 8.33308817e-03f), u, -0.166666605f);
        cosine = fmaf(fmaf(fmaf(cosine, u, -1.38884035e-03f), u, 4.16666407e-02f), u, -0.499999995f);
        sine = fmaf(t * u, sine, t);
        if (D < 0.f) sine = -sine;
        cosine = sign * fmaf(u, cosine, 1.f);
        const float w = sine * sine, steep = cosine * fmaf(0.5f, w, 1.f);
        float f = fmaf(sine * w, SIXTH, sine), left = fmaf(-f, steep, D);
        if (DAMPED) {
            const float b = own.z * (dot(G1, less(q[p[1]], q[p[0]])) + dot(G2, less(q[p[2]], q[p[0]]))
                                     + dot(G3, less(q[p[3]], q[p[0]])));
            f = fmaf(steep, b, f);
            left = fmaf(0.25f * w * w * (3.f + w), b, left);
        }
        z[c] = own.y * f;
        if (c < bent) {
            slope[c] = own.y * steep;
            kept[c] = own.w * left;
            place(flat + c, times(-1.f, add(G1, add(G2, G3))), G1, G2, G3);
        }
    };
"""
TRIANGLE = """
    auto triangle = [=](int c, const float4* d, const float4* q) {
        int p[4];
        corners(corner[c], p);
        const float4 b = B[c], S4 = K[c];
        const V3 X1 = apart(d, p[0], p[1]), X2 = apart(d, p[0], p[2]);
        const V3 Fu = more(b.x, X1, times(b.z, X2)), Fv = more(b.y, X1, times(b.w, X2)), N = cross(Fu, Fv);
        const float uu = dot(Fu, Fu), vv = dot(Fv, Fv), ss = dot(N, N);
        const float rs = ss > 1e-37f ? root_over(ss) : 0.f, s = ss * rs;
        V3 n = times(rs, N);
        if (s < 1e-3f * (uu + vv)) {                                // rounding may have turned N
            V3 e = vv > uu ? times(vv > 1e-37f ? root_over(vv) : 0.f, Fv) : times(uu > 1e-37f ? root_over(uu) : 0.f, Fu);
            if (s == 0.f) n = fabsf(e.y) > 0.9f ? cross(e, v3(1.f, 0.f, 0.f)) : cross(e, v3(0.f, 1.f, 0.f));
            n = more(-dot(n, e), e, n);
            const float nn = dot(n, n);
            n = times(nn > 1e-37f ? root_over(nn) : 0.f, n);
        }
        const float tt = uu + vv + 2.f * s, qq = tt > 1e-37f ? root_over(tt) : 0.f;
        V3 ru = times(qq, add(Fu, cross(Fv, n))), rv = times(qq, add(Fv, cross(n, Fu)));
        if (!(tt > 1e-37f)) { ru.x = 1.f; rv.y = 1.f; }
        const float Uuu = dot(ru, Fu), Uvv = dot(rv, Fv), Uuv = dot(ru, Fv), m = qq * Uuv;
        float C0 = Uuu - 1.f, C1 = Uvv - 1.f, C2 = 2.f * Uuv;
        const V3 Au = more(m, rv, ru), Bu = times(-m, ru), Av = times(-m, rv), Bv = more(m, ru, rv);
        const V3 As = times(2.f * qq * Uvv, rv), Bs = times(2.f * qq * Uuu, ru);
        if (DAMPED) {
            const V3 V1 = less(q[p[1]], q[p[0]]), V2 = less(q[p[2]], q[p[0]]);
            const V3 Vu = times(tau[c], more(b.x, V1, times(b.z, V2))), Vv = times(tau[c], more(b.y, V1, times(b.w, V2)));
            C0 += dot(Au, Vu) + dot(Bu, Vv);
            C1 += dot(Av, Vu) + dot(Bv, Vv);
            C2 += dot(As, Vu) + dot(Bs, Vv);
        }
        const float s0 = S4.x * C0 + S4.y * C1, s1 = S4.y * C0 + S4.w * C1, s2 = S4.z * C2;
        const V3 PA = more(-s0, Au, more(-s1, Av, times(-s2, As))), PB = more(-s0, Bu, more(-s1, Bv, times(-s2, Bs)));
        const V3 f1 = more(b.x, PA, times(b.y, PB)), f2 = more(b.z, PA, times(b.w, PB));
        V3 air = v3(0.f, 0.f, 0.f);                                 // of each corner: kernels/cloth/air.py
        if (AIR) {
            const V3 sum = add(less(q[p[1]], q[p[0]]), less(q[p[2]], q[p[0]])), A2 = cross(X1, X2);
            const V3 r = v3(fmaf(sum.x, 1.f / 3.f, q[p[0]].x - breeze[c].x), fmaf(sum.y, 1.f / 3.f, q[p[0]].y - breeze[c].y),
                            fmaf(sum.z, 1.f / 3.f, q[p[0]].z - breeze[c].z));
            const float aa = dot(A2, A2), ra = aa > 1e-37f ? root_over(aa) : 0.f, size = aa * ra, rr = dot(r, r);
            const V3 normal = times(ra, A2);
            const float rn = dot(r, normal), k = 0.5f * size * breeze[c].w * fabsf(rn), up = 0.5f * size * lift[c] * rn;
            const float along = 0.5f * size * across[c];
            air = more(-along * rn, normal, times(-k, r));
            if (rr > 1e-37f) {
                const float rs_ = root_over(rr);
                air = more(-up * rr * rs_, more(-rn * rs_ * rs_, r, normal), air);
            }
            drag[c] = fmaf(2.f, k, along);
        }
        place(c, times(-1.f, add(f1, f2)), f1, f2, air);
    };
"""
NUMBERS = f"constexpr float PI = {math.pi}f, FLAT = {FLAT}f, SIXTH = {1 / 6}f;"
