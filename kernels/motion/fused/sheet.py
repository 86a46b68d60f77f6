"""Forces of sheets and solids that a cluster of blocks shares for a whole frame in one launch (CUDA, sm_90 and up; float32).

A block has a domain of points and computes all that acts on them: the triangles, hinges and tets at its points, the
curvatures that these hinges need, the angles of all hinges that those curvatures need. For that it needs places of points of
other domains, three rings of them (for tets one): blocks send each other these, once a substep. All else is in shared memory:

    angles of hinges, forces of triangles, tets | curvatures | moments | points gather forces, move, are sent | neighbours

at a bar the threads of a block wait for each other, at the last for neighbours. Elements at the edge of a domain are computed
by two blocks or more, alike. A point's forces are gathered by LANES threads in a fixed order, so the bits are the same every
time; they differ from launch by launch by rounding. Kernels: march.py, motion: own.py. Air is taken at the velocity that
damping sees. Tables: `wsim.physics.motion.fused.domain_decomposition`.
"""

import re
from functools import cache

import warp as wp

from wsim.kernels.cloth import curvature
from wsim.kernels.cloth.spring import spring_nets
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps
from wsim.kernels.motion.fused import tet_elements
from wsim.kernels.motion.fused.blocks import BEFORE, WORDS
from wsim.kernels.motion.fused.domain_decomposition import LISTS, sheet_patch_table
from wsim.kernels.motion.fused.own import thread_points
from wsim.kernels.motion.fused.sheet_elements import ARITHMETIC, HINGE, NUMBERS, TRIANGLE

SLOTS = curvature.SLOTS
ROOM = """
    float4* const X = (float4*)sheet_room + 1;                      // positions where the frame begins; before: `gates`
    float4* const D = X + S;                                        // displacements since, twice
    float4* const Q = D + 2 * S;                                    // velocities that damping sees, twice
    float4* const breeze = Q + (RATES ? 2 * S : 0);                 // wind over triangles, and their drag
    float4* const value = breeze + (AIR ? FLATS : 0);               // and hinge, of each slot of a triangle
    float4* const C = value + SLOTS * CURVED;                       // curvatures
    float4* const B = C + CURVED;                                   // rest and stiffness of triangles
    float4* const K = B + FLATS;
    float4* const P = K + FLATS;                                    // of hinges
    float4* const T = P + HINGES;                                   // of tets
    float4* const R = T + 6 * TETS;
    float* const F = (float*)(R + TETS);
    float* const scale = F + 12 * (FLATS + BENT + TETS);            // of the forces of an element: of hinges, the moment
    float* const z = scale + FLATS + BENT + TETS;
    float* const slope = z + HINGES;
    float* const kept = slope + BENT;
    float* const tau = kept + BENT;
    float* const lift = tau + FLATS;
    float* const across = lift + (AIR ? FLATS : 0);                 // normal drag
    float* const drag = across + (AIR ? FLATS : 0);                 // derivative of the drag [kg/s]
    uint2* const corner = (uint2*)(drag + (AIR ? FLATS : 0));
    uint2* const hinge_corner = corner + FLATS;
    int* const moment_begin = (int*)(hinge_corner + HINGES);
    int* const moment = moment_begin + BENT + 4;
    int* const force_begin = moment + MOMENTS;
    int* const force = force_begin + OWN + 4;
    int* const push_begin = force + FORCES;
    int* const push = push_begin + OWN + 4;
"""
FILL = """
    const int t = THREAD, rank = RANK;
    const int *const head = h.head.data + 2 * LISTS * rank, *const list = h.list.data;
    auto at = [=](int k, int i) { return list[head[2 * k] + i]; };
    const int there = head[1], angles = head[3], flat = head[7], curved = head[11] / SLOTS, bent = head[13] - 1,
              owned = head[17] - 1, tets = head[29];
    const float *const x3 = (const float*)x.data;
    const float *const e3 = (const float*)e.data, *const v3_ = (const float*)v.data, *const r3 = (const float*)r.data;
    for (int i = t; i < there; i += THREADS) {
        const int g = at(0, i);
        X[i] = make_float4(x3[3 * g], x3[3 * g + 1], x3[3 * g + 2], 0.f);
        D[i] = make_float4(e3[3 * g], e3[3 * g + 1], e3[3 * g + 2], 0.f);
        if (RATES) Q[i] = make_float4(v3_[3 * g], v3_[3 * g + 1], v3_[3 * g + 2], 0.f);
    }
    for (int c = t; c < angles; c += THREADS) {
        const int g = at(1, c);
        const float k = h.bend.data[g];
        P[c] = make_float4(h.angle.data[g], sqrtf(k), DAMPED ? h.relax.data[g] : 0.f, k * h.own.data[g]);
        hinge_corner[c] = make_uint2(at(2, 2 * c), at(2, 2 * c + 1));
    }
    for (int i = t; i < flat; i += THREADS) {
        const int g = at(3, i);
        const float *const b = (const float*)h.rest.data + 4 * g, *const k = (const float*)h.stiffness.data + 4 * g;
        B[i] = make_float4(b[0], b[1], b[2], b[3]);
        K[i] = make_float4(k[0], k[1], k[2], k[3]);
        if (DAMPED) tau[i] = h.tau.data[g];
        corner[i] = make_uint2(at(4, 2 * i), at(4, 2 * i + 1));
        scale[i] = 1.f;
        if (AIR) {
            const int o = c.object.data[at(0, at(4, 2 * i) & 0xffff)];
            const float* const wind = (const float*)h.wind.data + 3 * o;
            breeze[i] = make_float4(wind[0], wind[1], wind[2], h.drag.data[o]);
            lift[i] = h.lift.data[o];
            across[i] = h.normal_drag.data[o];
        }
    }
    for (int s = t; s < SLOTS * curved; s += THREADS) {
        const float* const a = (const float*)h.value.data + 3 * at(12, s);
        value[s] = at(5, s) < 0 ? make_float4(0.f, 0.f, 0.f, INT_AS_FLOAT(0))
                                : make_float4(a[0], a[1], a[2], INT_AS_FLOAT(at(5, s)));
    }
    auto copy = [=](int k, int* into) { for (int i = t; i < head[2 * k + 1]; i += THREADS) into[i] = at(k, i); };
    copy(6, moment_begin); copy(7, moment); copy(8, force_begin); copy(9, force); copy(10, push_begin); copy(11, push);
"""
OWN = """
    const int p = t / LANES, lane = t % LANES;
    const bool mine = p < owned;
    const int g0 = mine ? at(0, p) : 0, object = mine ? c.object.data[g0] : 0;
    own.point = mine ? g0 : -1;
    own.lane = lane;
    own.column = mine ? c.pin.data[g0] : -1;
    own.w = mine ? c.w.data[g0] : 0.f;
    own.decay = mine ? c.decay.data[object] : 0.f;
    own.room = BOUNDED && mine ? h.room.data[g0] : 1e30f;
    own.room = own.room > 0.f ? own.room * own.room : -1.f;
    for (int k = 0; k < 3 && mine; ++k) {
        own.gravity[k] = ((const float*)c.gravity.data)[3 * object + k];
        own.d[k] = e3[3 * g0 + k];
        own.v[k] = own.q[k] = own.w > 0.f ? v3_[3 * g0 + k] : 0.f;
        own.r[k] = r3[3 * g0 + k];
        own.x[k] = x3[3 * g0 + k];
    }
    own.moves = mine && own.column >= 0 && !(own.w > 0.f) && step.drift > 0.f;
    const float* goals = (const float*)c.target.data + 3 * (step.row * c.target.shape[1] + own.column);
    for (int k = 0; k < 3 && own.moves; ++k) own.goal[k] = goals[k];
    own.there = there;  own.angles = angles;  own.flat = flat;  own.curved = curved;  own.bent = bent;  own.owned = owned;
    own.tets = tets;
    own.guest = GRID && owned + t < there ? at(0, owned + t) : -1;
    if (!GRID) { CLUSTER_BEGINS } else { BLOCK_MEETS }
    own.force = mine ? force_begin[p] + lane : 0;
    own.forces_end = mine ? force_begin[p + 1] : 0;
    own.push = mine && !GRID ? push_begin[p] + lane : 0;
    own.pushes_end = mine && !GRID ? push_begin[p + 1] : 0;
"""
COUNTS = """
    const int t = THREAD, from = sub & 1, angles = own.angles, flat = own.flat, curved = own.curved, bent = own.bent,
              tets = own.tets;
"""
FORCES = """
    const float4 *const d = D + S * from, *const rate = Q + S * from;
    const int first = (angles + 31) / 32 * 32;                  // of the triangles: warps take one kind
    const int solid = first + (flat + 31) / 32 * 32;
    for (int i = t; i < (tets ? solid + tets : first + flat); i += THREADS) {
        if (i < angles) hinge(i, d, rate);
        else if (i >= first && i - first < flat) triangle(i - first, d, rate);
        ELSE_TET
    }
    BLOCK_MEETS
    for (int i = t; i < curved; i += THREADS) {
        V3 sum = v3(0.f, 0.f, 0.f);
        const float4* const a = value + SLOTS * i;
        #pragma unroll
        for (int k = 0; k < SLOTS; ++k) sum = more(z[FLOAT_AS_INT(a[k].w)], v3(a[k].x, a[k].y, a[k].z), sum);
        C[i] = make_float4(sum.x, sum.y, sum.z, 0.f);
    }
    if (bent) BLOCK_MEETS
    for (int i = t; i < bent; i += THREADS) {
        float u = 0.f;
        const int end = moment_begin[i + 1];
        #pragma unroll 4
        for (int k = moment_begin[i]; k < end; ++k) {
            const float4 a = value[moment[k]], b = C[moment[k] / SLOTS];
            u += fmaf(a.x, b.x, fmaf(a.y, b.y, a.z * b.z));
        }
        scale[flat + i] = -fmaf(slope[i], u, kept[i]);
    }
    if (bent) BLOCK_MEETS
    float f[3] = {0, 0, 0}, blow[3] = {0, 0, 0}, damp = 0.f;
    #pragma unroll 4
    for (int k = own.force; k < own.forces_end; k += LANES) {
        const int word = force[k], element = word >> 2;
        const float part = scale[element], *const a = F + 12 * element + (word & 3);
        for (int j = 0; j < 3; ++j) f[j] = fmaf(part, a[4 * j], f[j]);
        if (AIR && element < flat) {
            damp += drag[element];
            for (int j = 0; j < 3; ++j) blow[j] += F[12 * element + 4 * j + 3];
        }
    }
    SUM_LANES
    if (AIR) {                                                  // as kernels/cloth/air.py: drag cannot overshoot
        const float much = kick * own.w * damp, part = 1.f / (1.f + much * much);
        for (int k = 0; k < 3; ++k) f[k] = fmaf(part, blow[k], f[k]);
    }
    for (int k = 0; k < 3; ++k) own.a[k] = own.w * f[k] + own.gravity[k] - own.decay * own.q[k];
"""
SEND = """
    const int t = THREAD, from = 1 - (sub & 1), points = c.object.shape[0];
    const int there = own.there, owned = own.owned;
    float4* const mail = (float4*)h.mail.data;                      // displacements of all points, twice; velocities
    if (ACTS && LANES > 1)                                         // the first lane of a point knows what it met
        for (int k = 0; k < 3; ++k) {
            own.d[k] = __shfl_sync(0xffffffffu, own.d[k], 0, LANES);
            own.q[k] = __shfl_sync(0xffffffffu, own.q[k], 0, LANES);
        }
    const float4 d1 = make_float4(own.d[0], own.d[1], own.d[2], 0.f), q1 = make_float4(own.q[0], own.q[1], own.q[2], 0.f);
    if (own.point >= 0 && own.lane == 0) {
        const int p = t / LANES;
        D[S * from + p] = d1;
        if (RATES) Q[S * from + p] = q1;
        if (GRID) post(mail + points * from + own.point, d1, sub + 1);
        if (GRID && RATES) post(mail + points * (2 + from) + own.point, q1, sub + 1);
    }
    for (int k = own.push; k < own.pushes_end; k += LANES) {
        const int block = push[k] >> 16, slot = push[k] & 0xffff;
        send(block, D + S * from + slot, d1, gates + 8 * (sub & 1));
        if (RATES) send(block, Q + S * from + slot, q1, gates + 8 * (sub & 1));
    }
    if (own.moves && step.stride && sub + 1 < step.count) {
        const float* goals = (const float*)c.target.data + 3 * ((step.row + sub + 1) * c.target.shape[1] + own.column);
        for (int k = 0; k < 3; ++k) own.goal[k] = goals[k];
    }
    if (!GRID) {
        CLUSTER_WAITS
    } else {                                                        // blocks wait for those that they share points with
        if (own.guest >= 0) {
            D[S * from + owned + t] = fetch(mail + points * from + own.guest, sub + 1);
            if (RATES) Q[S * from + owned + t] = fetch(mail + points * (2 + from) + own.guest, sub + 1);
        }
        BLOCK_MEETS
    }
"""


def sheet_code_constants(plan, damped: bool, bounded: bool, acts: bool) -> str:
    """Constants of the code."""
    numbers = {"S": plan.points, "OWN": plan.own, "FLATS": plan.triangles, "BENT": plan.bent, "HINGES": plan.hinges,
               "CURVED": plan.curved, "MOMENTS": plan.moments, "FORCES": plan.forces, "PUSHES": plan.pushes,
               "THREADS": plan.threads, "LANES": plan.lanes, "TETS": plan.tets, "SLOTS": SLOTS, "LISTS": len(LISTS)}
    flags = {"DAMPED": damped, "AIR": plan.air, "RATES": damped or plan.air, "BOUNDED": bounded, "GRID": plan.grid,
             "ACTS": acts}
    return (f"constexpr int {', '.join(f'{k} = {v}' for k, v in numbers.items())};\n"
            f"    constexpr bool {', '.join(f'{k} = {int(v)}' for k, v in flags.items())};\n    {NUMBERS}\n")


@cache
def sheet_pass_functions(real, plan, damped: bool, bounded: bool = False, acts: bool = False):
    """(enter, forces, send, leave): functions of a block's threads, which all call them. enter: fills the block's memory, and
    what a thread keeps (`thread_points`); forces: accelerations [m/s^2] of substep `sub`, kick [s] its own; send: displacements
    to neighbours, and waits for theirs; leave: waits for all. bounded: frames are watched; acts: of the threads of a point, the
    first alone knows where it went."""
    vec3, Net, Sheets, Step, Own = (types(real).vec3, spring_nets(real), sheet_patch_table(real, plan.materials),
                                    explicit_steps(real), thread_points(real))
    solid, start = plan.materials, sheet_code_constants(plan, damped, bounded, acts) + ROOM

    @wp.func_native(cuda_function_text(start + FILL + tet_elements.tet_fill_code(solid) + OWN))
    def enter_sheet_block(c: Net, h: Sheets, step: Step, x: wp.array(dtype=vec3), e: wp.array(dtype=vec3),
                          v: wp.array(dtype=vec3), r: wp.array(dtype=vec3), own: wp.ref[Own]): ...

    elements = ARITHMETIC + HINGE + TRIANGLE + tet_elements.tet_pass_code(solid)

    @wp.func_native(cuda_function_text(start + COUNTS + elements + tet_elements.tet_call_code(solid, FORCES)))
    def sheet_block_forces(own: wp.ref[Own], kick: real, sub: int): ...

    @wp.func_native(cuda_function_text(start + SEND))
    def send_displacements(c: Net, h: Sheets, step: Step, own: wp.ref[Own], sub: int): ...

    @wp.func_native(cuda_function_text("CLUSTER_ENDS" * (not plan.grid)))
    def leave_sheet_block(): ...

    return enter_sheet_block, sheet_block_forces, send_displacements, leave_sheet_block


def cuda_function_text(text: str) -> str:
    """CUDA code of a function, empty for older devices."""
    for word, meant in WORDS.items():
        text = re.sub(rf"\b{word}\b", lambda _, meant=meant: meant, text)
    return f"{BEFORE}{text}\n#endif\n"
