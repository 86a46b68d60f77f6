"""XPBD's sweeps of membranes and hinges on a CPU, eight constraints of a colour at a time, and the angles that hinges want.

The formulas, symbols and order of colours are those of kernels/solver/xpbd.py (`_block`, `_row`), kernels/cloth/constraint.py
and kernels/cloth/curvature.py, in C++ with Clang's vectors as kernels/motion/fast_paths/simd_sheets.py. Constraints of a colour
share no point that moves, so eight of them are read, solved and written together. What is left of a colour repeats its last
constraint in the lanes behind it, which are not written. A lane computes the same whatever stands beside it: bits do not depend
on worlds.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import DIHEDRAL, FLAT, MEMBRANE, Constraint
from wsim.kernels.cloth.curvature import SLOTS, sheet_curvatures
from wsim.kernels.cloth.terms import batch_of, constraint_variant
from wsim.kernels.motion.fast_paths.simd_sheets import ACROSS, ANGLES, THIN, TOOLS
from wsim.kernels.motion.fast_paths.simd_springs import VECTORS
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.xpbd import CALM, TINY

PI = "3.14159265358979323846"
# Reading of points, and of numbers of constraints c[0] .. c[7]; `full`: they stand behind each other.
READ = VECTORS + TOOLS + """
    const {real} *x = (const {real}*)points.x.data, *anchor = (const {real}*)points.a.data, *weight = batch.w.data;
    {real} *d = ({real}*)points.d.data;
    const int count = points.x.shape[0], *corner = (const int*)batch.point.data;
    int c[8], id[8 * {n}];
    bool full = false;
    auto some = [&](const {real}* p, int i, int n) {{ return i + 1 < n ? (vec)*(const vec4u*)(p + 3 * i) : load(p, i); }};
    auto rows = [&](const {real}* p, const int* at, eight* r) {{
        for (int l = 0; l < 4; ++l) r[l] = pair(some(p, at[l], count), some(p, at[l + 4], count)); }};
    auto begin = [&](int k, int end) {{
        full = end - k >= 8;
        for (int l = 0; l < 8; ++l) {{
            c[l] = k + l < end ? k + l : end - 1;
            for (int j = 0; j < {n}; ++j) id[8 * j + l] = corner[{n} * c[l] + j];
        }} }};
    auto each = [&](const {real}* a) {{
        if (full) return (eight)*(const entries*)(a + c[0]);
        eight r;
        for (int l = 0; l < 8; ++l) r[l] = a[c[l]];
        return r; }};
    auto masses = [&](const int* at) {{
        eight r;
        for (int l = 0; l < 8; ++l) r[l] = weight[at[l]];
        return r; }};
    auto four = [&](const {real}* a, bool same, eight* out) {{
        eight r[4];
        for (int l = 0; l < 4; ++l)
            r[l] = pair(*(const vec4u*)(a + (same ? 0 : 4 * c[l])), *(const vec4u*)(a + (same ? 0 : 4 * c[l + 4])));
        const Columns o = columns(r);
        out[0] = o.x; out[1] = o.y; out[2] = o.z;
        const eight a3 = __builtin_shufflevector(r[0], r[1], 3, 11, 3, 11, 7, 15, 7, 15);
        const eight b3 = __builtin_shufflevector(r[2], r[3], 3, 11, 3, 11, 7, 15, 7, 15);
        out[3] = __builtin_shufflevector(a3, b3, 0, 1, 8, 9, 4, 5, 12, 13); }};
    auto put = [&]({real}* p, const int* at, int n, const Columns& f) {{
        vec out[8];
        spread(out, f);
        for (int l = 0; l < n; ++l) store(p, at[l], out[l < 4 ? 2 * l : 2 * l - 7]); }};
"""
# Places X of the other points from the first, in this substep, and their displacements from it less those of the anchor, V.
PLACES = """
        eight x0[4], d0[4], a0[4];
        Columns X[{n}], V[{n}], N[{n}];
        rows(x, id, x0);
        rows(d, id, d0);
        if ({damped}) rows(anchor, id, a0);
        N[0] = columns(d0);
        for (int j = 1; j < {n}; ++j) {{
            eight xj[4], dj[4], aj[4];
            rows(x, id + 8 * j, xj);
            rows(d, id + 8 * j, dj);
            N[j] = columns(dj);
            if ({damped}) rows(anchor, id + 8 * j, aj);
            for (int l = 0; l < 4; ++l) {{
                const eight way = dj[l] - d0[l];
                xj[l] = (xj[l] - x0[l]) + way;
                if ({damped}) aj[l] = way - (aj[l] - a0[l]);
            }}
            X[j] = columns(xj);
            if ({damped}) V[j] = columns(aj);
        }}
"""
COLOURS = """
    for (int colour = 0; colour < colours.shape[0]; ++colour) {{
        const int first = colours.data[colour].c[0] + world * colours.data[colour].c[1];
        const int last = first + colours.data[colour].c[1];
        for (int k = first; k < last; k += 8) {{
            begin(k, last);
            const int good = full ? 8 : last - k;
            {one}
        }}
    }}
#endif
"""
BLOCK = PLACES + """
        eight B[4], A[4];
        four((const {real}*)batch.rest.data, false, B);
        four((const {real}*)batch.alpha.data, {uniform}, A);
        for (int j = 0; j < 4; ++j) A[j] *= rate * rate;
        const Columns Fu = mix(B[0], X[1], B[2], X[2]), Fv = mix(B[1], X[1], B[3], X[2]), n1 = cross(Fu, Fv);
        const eight uu = dot(Fu, Fu), vv = dot(Fv, Fv), size = __builtin_elementwise_sqrt(dot(n1, n1));
        Columns n = times(over(size), n1);
        const lanes thin = !(size >= ({real}){thin} * (uu + vv)) | (uu + vv == 0);
        if (__builtin_reduce_or(thin)) across(thin, Fu, Fv, uu, vv, size, n);
        const eight t = __builtin_elementwise_sqrt(uu + vv + 2 * size), q = over(t);
        Columns ru = times(q, plus(Fu, cross(Fv, n))), rv = times(q, plus(Fv, cross(n, Fu)));
        ru.x = t == 0 ? none + 1 : ru.x;
        rv.y = t == 0 ? none + 1 : rv.y;
        const eight Uuu = dot(ru, Fu), Uvv = dot(rv, Fv), Uuv = dot(ru, Fv), m = q * Uuv;
        const eight Cu = Uuu - 1, Cv = Uvv - 1, Cs = 2 * Uuv, gu = 2 * q * Uvv, gv = 2 * q * Uuu;
        eight r0 = -Cu, r1 = -Cv, r2 = -Cs, l0 = none, l1 = none, l2 = none, gamma = none;
        if ({lam}) {{
            for (int l = 0; l < 8; ++l) {{
                const {real}* o = (const {real}*)lam.data + 3 * c[l];
                l0[l] = o[0]; l1[l] = o[1]; l2[l] = o[2];
            }}
            r0 -= A[0] * l0 + A[1] * l1;
            r1 -= A[1] * l0 + A[3] * l1;
            r2 -= A[2] * l2;
        }}
        if ({damped}) {{
            gamma = rate * ({uniform} ? none + batch.tau.data[0] : each(batch.tau.data));
            const Columns Du = mix(B[0], V[1], B[2], V[2]), Dv = mix(B[1], V[1], B[3], V[2]);
            const eight vu = dot(rv, Du), uv = dot(ru, Dv), spin = m * (vu - uv);
            r0 -= gamma * (dot(ru, Du) + spin);
            r1 -= gamma * (dot(rv, Dv) - spin);
            r2 -= gamma * (gu * vu + gv * uv);
        }}
        const eight w0 = masses(id), w1 = masses(id + 8), w2 = masses(id + 16), p = over(Cu + Cv + 2), mm = p * Cs / 2;
        const eight b = 2 * p * (Cv + 1), g = 2 * p * (Cu + 1), u0 = B[0] + B[2], v0 = B[1] + B[3];
        const eight Muu = w0 * u0 * u0 + w1 * B[0] * B[0] + w2 * B[2] * B[2];
        const eight Muv = w0 * u0 * v0 + w1 * B[0] * B[1] + w2 * B[2] * B[3];
        const eight Mvv = w0 * v0 * v0 + w1 * B[1] * B[1] + w2 * B[3] * B[3];
        const eight turn = mm * mm * (Muu + Mvv) - 2 * mm * Muv, S00 = Muu + turn, S11 = Mvv + turn, S01 = -turn;
        const eight S02 = Muu * mm * b + Muv * g - Mvv * mm * g, S12 = -Muu * mm * b + Muv * b + Mvv * mm * g;
        const eight S22 = Muu * b * b + Mvv * g * g, more = 1 + gamma;
        const eight T00 = more * S00 + A[0], T01 = more * S01 + A[1], T02 = more * S02;
        const eight T11 = more * S11 + A[3], T12 = more * S12, T22 = more * S22 + A[2];
        auto pivot = [&](eight s, eight before) {{ return s > ({real}){tiny} * before ? 1 / s : none; }};
        const eight q0 = pivot(T00, T00), l10 = T01 * q0, l20 = T02 * q0, q1 = pivot(T11 - l10 * T01, T11);
        const eight s21 = T12 - l20 * T01, l21 = s21 * q1, q2 = pivot(T22 - l20 * T02 - l21 * s21, T22);
        const eight z1 = r1 - l10 * r0, z2 = r2 - l20 * r0 - l21 * z1;
        eight y2 = z2 * q2, y1 = z1 * q1 - l21 * y2, y0 = r0 * q0 - l10 * y1 - l20 * y2;
        y0 *= omega; y1 *= omega; y2 *= omega;
        const lanes long_ = r0 * r0 + r1 * r1 + r2 * r2 > ({real}){calm} * ({real}){calm};
        if (__builtin_reduce_or(long_)) {{
            {shorten}
        }}
        const eight both = mm_of(y0, y1);
        const Columns P = mix(y0, ru, both + gu * y2, rv), R = mix(y1, rv, gv * y2 - both, ru);
        const Columns f1 = mix(B[0], P, B[1], R), f2 = mix(B[2], P, B[3], R);
        put(d, id, good, plus(N[0], times(w0, Columns{{-(f1.x + f2.x), -(f1.y + f2.y), -(f1.z + f2.z)}})));
        put(d, id + 8, good, plus(N[1], times(w1, f1)));
        put(d, id + 16, good, plus(N[2], times(w2, f2)));
        if ({lam}) for (int l = 0; l < good; ++l) {{
            {real}* o = ({real}*)lam_out.data + 3 * c[l];
            o[0] = l0[l] + y0[l]; o[1] = l1[l] + y1[l]; o[2] = l2[l] + y2[l];
        }}
"""
# `membrane_slender` and `membrane_shear`
SHORTEN = """
            const eight a0 = B[0] * B[0] + B[1] * B[1], a1 = B[2] * B[2] + B[3] * B[3], a2 = B[0] * B[2] + B[1] * B[3];
            const eight wide = __builtin_elementwise_max(__builtin_elementwise_max(a0, a1), a0 + a1 + (a2 + a2));
            const eight most = 2 * __builtin_elementwise_abs(B[0] * B[3] - B[1] * B[2]);
            eight e = a1 > a0 ? B[2] : B[0], f = a1 > a0 ? B[3] : B[1];
            const lanes third = u0 * u0 + v0 * v0 > e * e + f * f;
            e = third ? u0 : e;
            f = third ? v0 : f;
            const eight c0 = S00 * y0 + S01 * y1 + S02 * y2, c1 = S01 * y0 + S11 * y1 + S12 * y2;
            const eight c2 = S02 * y0 + S12 * y1 + S22 * y2;
            const eight shear = (2 * e * f * (c1 - c0) + (e * e - f * f) * c2) * over(e * e + f * f);
            const eight step = __builtin_elementwise_abs(shear) * (wide - most);
            const eight part = (long_ & (step > most)) ? most / step : none + 1;
            y0 *= part; y1 *= part; y2 *= part;
"""
# C and G of hinges, from rest angles `rest`
HINGE = PLACES + """
        const Columns E = X[1], X2 = X[2], X3 = X[3], N2 = cross(E, X2), N3 = cross(X3, E);
        const eight LL = dot(E, E), q = over(LL), H2 = q * dot(N2, N2), H3 = q * dot(N3, N3), both = H2 * H3;
        const eight L = __builtin_elementwise_sqrt(LL);
        const lanes high = both > ({real}){flat};
        const eight part = high ? -q * L / both : none;
        eight C = angle(high ? -L * dot(X3, N2) : none, high ? dot(N2, N3) : none) - each({rest});
        C = C > ({real}){pi} ? C - 2 * ({real}){pi} : C < -({real}){pi} ? C + 2 * ({real}){pi} : C;
        C = high ? C : none;
        const Columns G2 = times(part * H3, N2), G3 = times(part * H2, N3);
        const Columns G1 = mix(-(q * dot(E, X2)), G2, -(q * dot(E, X3)), G3);
        eight moved = none;
        if ({damped}) moved = dot(G1, V[1]) + dot(G2, V[2]) + dot(G3, V[3]);
"""
ROW = HINGE + """
        const eight alpha = rate * rate * each(batch.alpha.data);
        eight r = -C, gamma = none, before = none;
        if ({lam}) {{ before = each(lam.data); r -= alpha * before; }}
        if ({damped}) {{ gamma = rate * each(batch.tau.data); r -= gamma * moved; }}
        const Columns G0{{-(G1.x + G2.x + G3.x), -(G1.y + G2.y + G3.y), -(G1.z + G2.z + G3.z)}};
        const eight w0 = masses(id), w1 = masses(id + 8), w2 = masses(id + 16), w3 = masses(id + 24);
        const eight below = (1 + gamma) * (w1 * dot(G1, G1) + w2 * dot(G2, G2) + w3 * dot(G3, G3) + w0 * dot(G0, G0)) + alpha;
        const eight dlam = below > 0 ? omega * r / below : none;
        put(d, id, good, plus(N[0], times(w0 * dlam, G0)));
        put(d, id + 8, good, plus(N[1], times(w1 * dlam, G1)));
        put(d, id + 16, good, plus(N[2], times(w2 * dlam, G2)));
        put(d, id + 24, good, plus(N[3], times(w3 * dlam, G3)));
        if ({lam}) for (int l = 0; l < good; ++l) lam_out.data[c[l]] = before[l] + dlam[l];
"""
# Angles, curvatures and moments: what `angles`, `sums` and `targets` of kernels/cloth/curvature.py do.
AIM = """
    const int hinges = batch.point.shape[0], sheets = cur.count.shape[0], slots = cur.value.shape[0];
    for (int k = 0; k < hinges; k += 8) {{
        begin(k, hinges);
        const int good = full ? 8 : hinges - k;
        {hinge}
        eight sine, cosine;
        turned(C, sine, cosine);
        const eight w = sine * sine, df = cosine * (1 + ({real})0.5 * w);
        eight f = sine + sine * w * ({real})0.16666666666666666, lone = C - f * df;
        if ({damped}) {{
            const eight b = rate * each(batch.tau.data) * moved;
            C += b;
            f += df * b;
            lone += ({real})0.25 * w * w * (3 + w) * b;
        }}
        const eight root = __builtin_elementwise_sqrt(each(batch.alpha.data)), z = over(root) * f, slope = root * df;
        const eight kept = C - each(cur.own.data) * lone;
        for (int l = 0; l < good; ++l) {{
            cur.z.data[k + l] = z[l]; cur.slope.data[k + l] = slope[l]; cur.kept.data[k + l] = kept[l];
        }}
    }}
    const {real}* value = (const {real}*)cur.value.data;
    {real}* curved = ({real}*)cur.C.data;
    for (int t = 0; t < sheets; ++t) {{
        vec sum = zero;
        for (int s = {slots} * t; s < {slots} * t + cur.count.data[t]; ++s)
            sum += cur.z.data[cur.slot.data[s]] * some(value, s, slots);
        store(curved, t, sum);
    }}
    for (int e = 0; e < hinges; ++e) {{
        vec u = zero;
        for (int k = cur.begin.data[e]; k < cur.end.data[e]; ++k) {{
            const int s = cur.item.data[k];
            u += some(value, s, slots) * some(curved, s / {slots}, sheets);
        }}
        target.data[e] = rest.data[e] + (cur.kept.data[e] - cur.slope.data[e] * (u[0] + u[1] + u[2]));
    }}
#endif
"""


def sweep_source(real, body: str, n: int, **flags) -> str:
    """The C++ of a body between what reads, and what turns angles."""
    name, integer = ("float", "int") if real is wp.float32 else ("double", "long long")
    given = {"real": name, "integer": integer, "n": n, "thin": THIN, "flat": FLAT, "pi": PI, "calm": CALM, "tiny": TINY[real],
             "slots": SLOTS, **{key: "true" if value is True else "false" if value is False else value
                                for key, value in flags.items()}}
    return READ.format(**given) + (ANGLES[real].format(**given) if n == 4 else ACROSS.format(**given)) + body.format(**given)


@cache
def simd_sweep_kernel(constraint: Constraint, *, real=wp.float32, module="unique", multipliers: bool = False,
                      damped: bool = False, uniform: bool = False, exact: bool = False):
    """(Batch, kernel) as `wsim.kernels.solver.xpbd.xpbd_sweep_kernel`, of a CPU: membranes and hinges, without `exact`."""
    o = constraint_variant(constraint, real, multipliers, damped, uniform, exact=exact)
    vec3, value, PointState, Batch = o.t.vec3, o.value, point_states(real), o.Batch
    flags = {"lam": multipliers, "damped": damped, "uniform": uniform, "rest": "batch.rest.data"}
    one = ROW if constraint is DIHEDRAL else BLOCK.replace("{shorten}", SHORTEN).replace("mm_of(y0, y1)", "m * (y0 - y1)")
    code = sweep_source(real, COLOURS.replace("{one}", one), constraint.points, **flags)

    @wp.func_native(code)
    def native_simd_sweep(world: int, batch: Batch, points: PointState, colours: wp.array(dtype=wp.vec2i), rate: real,
                          omega: real, lam: wp.array(dtype=value), lam_out: wp.array(dtype=value)): ...

    def simd_sweep(batch: Batch, at: PointState, colours: wp.array(dtype=wp.vec2i), rate: real, omega: real,
                   lam: wp.array(dtype=value), d_out: wp.array(dtype=vec3), lam_out: wp.array(dtype=value)):
        native_simd_sweep(wp.tid(), batch, at, colours, rate, omega, lam, lam_out)  # d_out is at.d: in place

    return Batch, wp.kernel(simd_sweep, name=f"sweep_{o.name}", module=module, enable_backward=False)


@cache
def rest_angle_kernel(real, module, damped: bool):
    """Kernel of one thread: z, slope, kept and C of hinges and triangles, and the angles at rest that hinges want, as `angles`,
    `sums` and `targets` of kernels/cloth/curvature.py. rest: angles at rest; rate: 1 / h."""
    Batch, Curvatures, PointState = batch_of(DIHEDRAL, real), sheet_curvatures(real), point_states(real)
    code = sweep_source(real, AIM.replace("{hinge}", HINGE), 4, damped=damped, rest="rest.data")

    @wp.func_native(code)
    def native_rest_angles(batch: Batch, rest: wp.array(dtype=real), points: PointState, rate: real, cur: Curvatures,
                           target: wp.array(dtype=real)): ...

    def aim_rest_angles(batch: Batch, rest: wp.array(dtype=real), at: PointState, rate: real, cur: Curvatures,
                        target_out: wp.array(dtype=real)):
        native_rest_angles(batch, rest, at, rate, cur, target_out)

    return wp.kernel(aim_rest_angles, name="target" + "_damped" * damped, module=module, enable_backward=False)


FORMS = (MEMBRANE, DIHEDRAL)                     # constraints that have packets
