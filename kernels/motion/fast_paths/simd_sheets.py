"""Membranes and hinges on a CPU, eight at a time: each element is taken once, leaves its forces at its corners, and points
gather them, always in the same order.

    triangles    C, s, f_k = -G_k^T s                              as kernels/cloth/element.py, membrane of constraint.py
    hinges       z, G, slope, kept     C_t = sum_s value_ts z_s    f_k = -(slope u + kept) G_k     as kernels/cloth/curvature.py

In C++ with Clang's vectors, as kernels/motion/fast_paths/simd_springs.py: points are four wide, elements go in packets of
EIGHT, a number of each in a lane. x_k - x_0 stays for a frame and is kept. The tables are those of every solver (live values
are seen), padded to whole packets. Forces of a membrane without its G: with p, q the rows of the first Piola-Kirchhoff stress,

    p = s_u r_u + (m (s_u - s_v) + 2 q U_vv s_uv) r_v     q = s_v r_v - (m (s_u - s_v) - 2 q U_uu s_uv) r_u
    f_k = -(B_ku p + B_kv q)                              m = q U_uv,  q = 1 / tr U

No sum depends on how elements are shared between threads, and no bit does. The text goes into the functions of
kernels/motion/fast_paths/sheet_march.py.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.fast_paths.simd_springs import VECTORS

ROWS = 8               # of the room, each of all places, as kernels/motion/fast_paths/simd_springs.py has them
TRIANGLE, HINGE = 3, 4                  # points
KEPT = {TRIANGLE: 6, HINGE: 9 + 9 + 3}  # reals that the room keeps of an element: x_k - x_0, G, slope, kept and z
THIN = 1.0e-3          # |F_u x F_v| over |F_u|^2 + |F_v|^2 below which rounding may have turned the normal

# Vectors of eight elements.
TOOLS = """
    typedef {integer} lanes __attribute__((vector_size(8 * sizeof({real}))));
    auto dot = [](const Columns& a, const Columns& b) {{ return a.x * b.x + a.y * b.y + a.z * b.z; }};
    auto cross = [](const Columns& a, const Columns& b) {{
        return Columns{{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}}; }};
    auto times = [](eight a, const Columns& b) {{ return Columns{{a * b.x, a * b.y, a * b.z}}; }};
    auto plus = [](const Columns& a, const Columns& b) {{ return Columns{{a.x + b.x, a.y + b.y, a.z + b.z}}; }};
    auto mix = [&](eight a, const Columns& b, eight c, const Columns& d) {{ return plus(times(a, b), times(c, d)); }};
    auto over = [&](eight a) {{ return a > 0 ? 1 / a : none; }};
    auto spread = [&](vec* to, const Columns& f) {{                                 // lanes 0 4 1 5 2 6 3 7
        const eight a = __builtin_shufflevector(f.x, f.y, 0, 8, 1, 9, 4, 12, 5, 13);
        const eight b = __builtin_shufflevector(f.x, f.y, 2, 10, 3, 11, 6, 14, 7, 15);
        const eight c = __builtin_shufflevector(f.z, none, 0, 8, 1, 9, 4, 12, 5, 13);
        const eight d = __builtin_shufflevector(f.z, none, 2, 10, 3, 11, 6, 14, 7, 15);
        at(to, 0) = __builtin_shufflevector(a, c, 0, 1, 8, 9, 4, 5, 12, 13);
        at(to, 2) = __builtin_shufflevector(a, c, 2, 3, 10, 11, 6, 7, 14, 15);
        at(to, 4) = __builtin_shufflevector(b, d, 0, 1, 8, 9, 4, 5, 12, 13);
        at(to, 6) = __builtin_shufflevector(b, d, 2, 3, 10, 11, 6, 7, 14, 15); }};
"""
ROOM = VECTORS + TOOLS + """
    const int places = s.order.shape[0], blocks = s.group.shape[0] - 1, *order = s.order.data, *group = s.group.data;
    const int triangles = s.triangles, hinges = s.hinges, sheets = s.count.shape[0];
    vec *D = (vec*)(((unsigned long long)room.data + 63) / 64 * 64), *F = D + s.row, *X = F + s.row, *Q = X + s.row,
        *V = Q + s.row, *C = V + s.row, *S = C + s.row, *G = S + s.row, *W = G + s.row, *U = W + 24 * triangles,
        *M = U + 32 * hinges + 2;                                                   // before it and behind it: zero
    eight *ET = (eight*)(M + sheets + 2 - sheets % 2), *EH = ET + 6 * triangles, *GH = EH + 9 * hinges,
          *slope = GH + 9 * hinges, *kept = slope + hinges, *Z = kept + hinges;
    auto all = [](const {real}* a, int p) {{ return *(const entries*)(a + 8 * p); }};
    auto base = [&](vec* row, const int* id, eight* r) {{
        for (int l = 0; l < 4; ++l) r[l] = pair(end(row, id[l]), end(row, id[l + 4])); }};
    auto from = [&](vec* row, const int* id, const eight* o) {{                     // of that corner, from the first one
        eight r[4];
        for (int l = 0; l < 4; ++l) r[l] = pair(end(row, id[l]), end(row, id[l + 4])) - o[l];
        return columns(r); }};
    auto four = [&](const {real}* a, int p, eight* out) {{                          // four numbers of each
        const {real}* o = a + 32 * p;
        eight r[4];
        for (int l = 0; l < 4; ++l)
            r[l] = __builtin_shufflevector(*(const vec4u*)(o + 4 * l), *(const vec4u*)(o + 4 * l + 16), 0, 1, 2, 3, 4, 5, 6, 7);
        const Columns c = columns(r);
        out[0] = c.x; out[1] = c.y; out[2] = c.z;
        const eight a3 = __builtin_shufflevector(r[0], r[1], 3, 11, 3, 11, 7, 15, 7, 15);
        const eight b3 = __builtin_shufflevector(r[2], r[3], 3, 11, 3, 11, 7, 15, 7, 15);
        out[3] = __builtin_shufflevector(a3, b3, 0, 1, 8, 9, 4, 5, 12, 13); }};
"""
# What does not change while x stays.
APART = """
    if (rank == 0) M[-2] = M[-1] = M[sheets] = zero;
    for (int p = share(triangles, rank); p < share(triangles, rank + 1); ++p) {{
        const int* id = s.corner.data + 24 * p;
        eight o[4];
        base(X, id, o);
        for (int k = 0; k < 2; ++k) {{
            const Columns e = from(X, id + 8 * k + 8, o);
            ET[6 * p + 3 * k] = e.x; ET[6 * p + 3 * k + 1] = e.y; ET[6 * p + 3 * k + 2] = e.z;
        }}
    }}
    for (int p = share(hinges, rank); p < share(hinges, rank + 1); ++p) {{
        const int* id = s.hinge.data + 32 * p;
        eight o[4];
        base(X, id, o);
        for (int k = 0; k < 3; ++k) {{
            const Columns e = from(X, id + 8 * k + 8, o);
            EH[9 * p + 3 * k] = e.x; EH[9 * p + 3 * k + 1] = e.y; EH[9 * p + 3 * k + 2] = e.z;
        }}
    }}
"""
# Normals of thin triangles, and axes of those without size: lanes of `thin`.
ACROSS = """
    auto across = [&](lanes thin, const Columns& Fu, const Columns& Fv, eight uu, eight vv, eight size, Columns& n) {{
        const lanes v = vv > uu;
        const eight a = over(__builtin_elementwise_sqrt(v ? vv : uu));
        const Columns e{{a * (v ? Fv.x : Fu.x), a * (v ? Fv.y : Fu.y), a * (v ? Fv.z : Fu.z)}};
        const lanes lost = size == 0, y = __builtin_elementwise_abs(e.y) > ({real})0.9;
        const Columns o{{y ? none : -e.z, y ? e.z : none, y ? -e.y : e.x}};
        Columns m{{lost ? o.x : n.x, lost ? o.y : n.y, lost ? o.z : n.z}};
        const eight b = dot(m, e);
        m = Columns{{m.x - b * e.x, m.y - b * e.y, m.z - b * e.z}};
        m = times(over(__builtin_elementwise_sqrt(dot(m, m))), m);
        n = Columns{{thin ? m.x : n.x, thin ? m.y : n.y, thin ? m.z : n.z}};
    }};
"""
# Forces of the triangles of packet p.
TRIANGLES = """
        const int* id = s.corner.data + 24 * p;
        eight o[4], B[4], K[4];
        four((const {real}*)s.rest.data, p, B);
        four((const {real}*)s.stiffness.data, p, K);
        base(D, id, o);
        const Columns X1 = plus(Columns{{ET[6 * p], ET[6 * p + 1], ET[6 * p + 2]}}, from(D, id + 8, o));
        const Columns X2 = plus(Columns{{ET[6 * p + 3], ET[6 * p + 4], ET[6 * p + 5]}}, from(D, id + 16, o));
        const Columns Fu = mix(B[0], X1, B[2], X2), Fv = mix(B[1], X1, B[3], X2);
        const Columns N = cross(Fu, Fv);
        const eight uu = dot(Fu, Fu), vv = dot(Fv, Fv), size = __builtin_elementwise_sqrt(dot(N, N));
        Columns n = times(over(size), N);
        const lanes thin = !(size >= ({real}){thin} * (uu + vv)) | (uu + vv == 0);
        if (__builtin_reduce_or(thin)) across(thin, Fu, Fv, uu, vv, size, n);
        const eight t = __builtin_elementwise_sqrt(uu + vv + 2 * size), q = over(t);
        Columns ru = times(q, plus(Fu, cross(Fv, n))), rv = times(q, plus(Fv, cross(n, Fu)));
        ru.x = t == 0 ? none + 1 : ru.x;
        rv.y = t == 0 ? none + 1 : rv.y;
        const eight Uuu = dot(ru, Fu), Uvv = dot(rv, Fv), Uuv = dot(ru, Fv), m = q * Uuv;
        eight Cu = Uuu - 1, Cv = Uvv - 1, Cs = 2 * Uuv;
        const eight gu = 2 * q * Uvv, gv = 2 * q * Uuu;
        {rate}
        const eight su = K[0] * Cu + K[1] * Cv, sv = K[1] * Cu + K[3] * Cv, ss = K[2] * Cs, turn = m * (su - sv);
        const Columns P = mix(su, ru, turn + gu * ss, rv), R = mix(sv, rv, gv * ss - turn, ru);
        const Columns f1 = mix(-B[0], P, -B[1], R), f2 = mix(-B[2], P, -B[3], R);
        spread(W + 24 * p, Columns{{-(f1.x + f2.x), -(f1.y + f2.y), -(f1.z + f2.z)}});
        spread(W + 24 * p + 8, f1);
        spread(W + 24 * p + 16, f2);
"""
RATE = """base(Q, id, o);
        const Columns V1 = from(Q, id + 8, o), V2 = from(Q, id + 16, o);
        const Columns Du = mix(B[0], V1, B[2], V2), Dv = mix(B[1], V1, B[3], V2);
        const eight vu = dot(rv, Du), uv = dot(ru, Dv), spin = m * (vu - uv), tau = all(s.tau.data, p);
        Cu += tau * (dot(ru, Du) + spin);
        Cv += tau * (dot(rv, Dv) - spin);
        Cs += tau * (gu * vu + gv * uv);"""
ANGLES = {wp.float32: """
    auto angle = [&](eight y, eight x) {{                                            // as `arctangent`
        const eight ax = __builtin_elementwise_abs(x), ay = __builtin_elementwise_abs(y);
        const eight most = __builtin_elementwise_max(ax, ay), least = __builtin_elementwise_min(ax, ay);
        const eight z = most > 0 ? least / most : none, u = z * z;
        eight P = -0.0163679108f + 0.00292068769f * u;
        P = 0.0432118343f + P * u;
        P = -0.0755221217f + P * u;
        P = 0.106660037f + P * u;
        P = -0.142110551f + P * u;
        P = 0.199937728f + P * u;
        P = -0.333331527f + P * u;
        eight r = z + z * u * P;
        r = ay > ax ? 1.57079632679f - r : r;
        r = x < 0 ? 3.14159265359f - r : r;
        return y < 0 ? -r : r; }};
    auto turned = [&](eight a, eight& sine, eight& cosine) {{                        // as `sine_cosine`
        eight r = __builtin_elementwise_abs(a);
        const lanes far = r > 1.57079632679f;
        r = far ? __builtin_elementwise_max(3.14159265359f - r, none) : r;
        const eight u = r * r, v = u * u;
        const eight P = (-0.166666605f + 8.33308817e-03f * u) + v * (-1.98111127e-04f + 2.60893263e-06f * u);
        const eight R = (-0.499999995f + 4.16666407e-02f * u) + v * ((-1.38884035e-03f + 2.47618862e-05f * u)
                                                                   - v * 2.60771050e-07f);
        sine = r + r * u * P;
        sine = a < 0 ? -sine : sine;
        cosine = 1 + u * R;
        cosine = far ? -cosine : cosine; }};
""", wp.float64: """
    auto angle = [&](eight y, eight x) {{
        eight r;
        for (int l = 0; l < 8; ++l) r[l] = ::atan2(y[l], x[l]);
        return r; }};
    auto turned = [&](eight a, eight& sine, eight& cosine) {{
        for (int l = 0; l < 8; ++l) {{ sine[l] = ::sin(a[l]); cosine[l] = ::cos(a[l]); }} }};
"""}
# G of the hinges of packet p, and sine and cosine of their angles, times the same
GEOMETRY = """
        const int* id = s.hinge.data + 32 * p;
        const eight *e = EH + 9 * p;
        eight o[4], *g = GH + 9 * p;
        base(D, id, o);
        const Columns E = plus(Columns{{e[0], e[1], e[2]}}, from(D, id + 8, o));
        const Columns X2 = plus(Columns{{e[3], e[4], e[5]}}, from(D, id + 16, o));
        const Columns X3 = plus(Columns{{e[6], e[7], e[8]}}, from(D, id + 24, o));
        const Columns N2 = cross(E, X2), N3 = cross(X3, E);
        const eight LL = dot(E, E), q = over(LL), H2 = q * dot(N2, N2), H3 = q * dot(N3, N3), both = H2 * H3;
        const eight L = __builtin_elementwise_sqrt(LL);
        const lanes good = both > ({real}){flat};
        const eight part = good ? -q * L / both : none;
        sines[p - p0] = good ? -L * dot(X3, N2) : none;
        cosines[p - p0] = good ? dot(N2, N3) : none;
        const Columns G2 = times(part * H3, N2), G3 = times(part * H2, N3);
        const Columns G1 = mix(-(q * dot(E, X2)), G2, -(q * dot(E, X3)), G3);
        g[0] = G1.x; g[1] = G1.y; g[2] = G1.z; g[3] = G2.x; g[4] = G2.y; g[5] = G2.z; g[6] = G3.x; g[7] = G3.y; g[8] = G3.z;
        {bend_rate}
"""
# and of their angles: chains of many operations, of which a core works at several while they are by themselves
STRAIN = """
        eight a = angle(sines[p - p0], cosines[p - p0]) - all(s.angle.data, p);
        a = a > ({real}){pi} ? a - 2 * ({real}){pi} : a < -({real}){pi} ? a + 2 * ({real}){pi} : a;
        a = sines[p - p0] == 0 && cosines[p - p0] == 0 ? none : a;
        eight sine, cosine;
        turned(a, sine, cosine);
        const eight w = sine * sine, df = cosine * (1 + ({real})0.5 * w), k = all(s.bend.data, p);
        const eight root = __builtin_elementwise_sqrt(k), f = sine + sine * w * ({real}){sixth};
        Z[p] = root * (f {fold_rate});
        slope[p] = root * df;
        kept[p] = k * all(s.own.data, p) * (a - f * df {alone_rate});
"""
BEND_RATE = """base(Q, id, o);
        rates[p - p0] = dot(G1, from(Q, id + 8, o)) + dot(G2, from(Q, id + 16, o)) + dot(G3, from(Q, id + 24, o));"""
FOLD_RATE = "+ df * all(s.relax.data, p) * rates[p - p0]"
ALONE_RATE = "+ ({real})0.25 * w * w * (3 + w) * all(s.relax.data, p) * rates[p - p0]"
# Forces of the points of places i .. i + 7.
GATHER = """
                vec f[8];
                for (int l = 0; l < 8; ++l) f[l] = zero;
                for (int k = s.first.data[i / 8]; k < s.first.data[i / 8 + 1]; ++k)
                    for (int l = 0; l < 8; ++l) f[l] += end(W, s.force.data[8 * k + l]);
                for (int l = 0; l < 8; ++l) F[i + l] = f[l];
"""
# Curvature of sheet triangle c.
CURVATURE = """
        vec curved = zero;
        for (int k = {slots} * c; k < {slots} * c + s.count.data[c]; ++k)
            curved += (({real}*)Z)[s.slot.data[k]] * ((const vec4u*)s.value.data)[k];
        M[c] = curved;
"""
# Forces of the hinges of packet p.
MOMENTS = """
        vec u0[8];
        for (int l = 0; l < 8; ++l) u0[l] = zero;
        for (int k = s.begin.data[p]; k < s.begin.data[p + 1]; ++k)
            for (int l = 0; l < 8; ++l) u0[l] += ((const vec4u*)s.moment.data)[8 * k + l] * M[s.home.data[8 * k + l]];
        eight r[4];
        for (int l = 0; l < 4; ++l) r[l] = pair(u0[l], u0[l + 4]);
        const Columns u = columns(r), *g = (const Columns*)(GH + 9 * p);
        const eight moment = -(slope[p] * (u.x + u.y + u.z) + kept[p]);
        const Columns f1 = times(moment, g[0]), f2 = times(moment, g[1]), f3 = times(moment, g[2]);
        spread(U + 32 * p, Columns{{-(f1.x + f2.x + f3.x), -(f1.y + f2.y + f3.y), -(f1.z + f2.z + f3.z)}});
        spread(U + 32 * p + 8, f1);
        spread(U + 32 * p + 16, f2);
        spread(U + 32 * p + 24, f3);
"""


@cache
def sheet_of(real):
    """Struct of membranes and hinges, padded to packets of EIGHT: reads only."""
    t = types(real)

    @wp.struct
    class PacketSheet:
        order: wp.array(dtype=int)           # point of each place in the arrays, or -1, (places,)
        group: wp.array(dtype=int)           # first EIGHT places of each block, (blocks + 1,)
        corner: wp.array(dtype=int)          # FOUR times the places of packets of triangles, (packets, 3, EIGHT)
        rest: wp.array(dtype=t.mat22)        # as kernels/cloth/element.py, by triangles
        stiffness: wp.array(dtype=t.vec4)
        tau: wp.array(dtype=real)
        hinge: wp.array(dtype=int)           # FOUR times the places of packets of hinges, (packets, 4, EIGHT)
        angle: wp.array(dtype=real)          # at rest [rad], by hinges
        bend: wp.array(dtype=real)           # [J]
        relax: wp.array(dtype=real)          # tau [s]
        own: wp.array(dtype=real)            # as kernels/cloth/curvature.py, and
        slot: wp.array(dtype=int)
        count: wp.array(dtype=int)
        value: wp.array(dtype=t.vec4)        # three numbers, and 0
        begin: wp.array(dtype=int)           # first row of each packet of hinges, (packets + 1,)
        moment: wp.array(dtype=t.vec4)       # value of a slot of each hinge, (rows, EIGHT); 0 past the last
        home: wp.array(dtype=int)            # triangle of the slot, (rows, EIGHT); past the last the one past all
        first: wp.array(dtype=int)           # first row of EIGHT places, (places / EIGHT + 1,)
        force: wp.array(dtype=int)           # FOUR times the place of a corner's force, (rows, EIGHT); past the last one of 0
        triangles: int                       # packets
        hinges: int
        row: int                             # places from row to row of the room

    return PacketSheet
