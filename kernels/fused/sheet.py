"""A whole frame of explicit steps of sheets in one launch, by a cluster of blocks (CUDA, sm_90 and up; float32).

A block has a domain of points and computes all that acts on them: the triangles and hinges at its points, the curvatures that
these hinges need, the angles of all hinges that those curvatures need. For that it needs places of the points of other domains,
three rings of them: blocks send each other these, once a substep. All else stands in shared memory:

    angles of hinges, forces of triangles | curvatures | moments | points gather forces, move, are sent | neighbours are awaited

at a bar the threads of a block wait for each other. Elements at the edge of a domain are computed by two blocks or more, alike.
A point's forces are gathered by LANES threads in a fixed order, so the bits are the same every time; they differ from launch by
launch by rounding. Points move as in kernels/motion/cluster.py; air is taken at the velocity that damping sees, not at that of
the end of the substep. Tables: `wsim.physics.fused.domains`.
"""

import re
from functools import cache

import warp as wp

from wsim.kernels.cloth import curvature
from wsim.kernels.cloth.spring import net
from wsim.kernels.fused.blocks import BEFORE, WORDS
from wsim.kernels.fused.sheet_elements import ARITHMETIC, HINGE, NUMBERS, TRIANGLE
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import steps

LISTS = ("point", "hinge", "hinge_corner", "triangle", "corner", "slot", "moment_begin", "moment", "force_begin", "force",
         "push_begin", "push", "value", "near")
SLOTS = curvature.SLOTS
ROOM = """
    float4* const X = (float4*)sheet_room;                          // positions where the frame begins
    float4* const D = X + S;                                        // displacements since, twice
    float4* const Q = D + 2 * S;                                    // velocities that damping sees, twice
    float4* const breeze = Q + (RATES ? 2 * S : 0);                 // wind over triangles, and their drag
    float4* const value = breeze + (AIR ? FLATS : 0);               // and hinge, of each slot of a triangle
    float4* const C = value + SLOTS * CURVED;                       // curvatures
    float4* const B = C + CURVED;                                   // rest and stiffness of triangles
    float4* const K = B + FLATS;
    float4* const P = K + FLATS;                                    // of hinges
    float* const F = (float*)(P + HINGES);
    float* const scale = F + 12 * (FLATS + BENT);                   // of the forces of an element: of hinges, the moment
    float* const z = scale + FLATS + BENT;
    float* const slope = z + HINGES;
    float* const kept = slope + BENT;
    float* const tau = kept + BENT;
    float* const lift = tau + FLATS;
    float* const drag = lift + (AIR ? FLATS : 0);                   // [kg/s]
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
              owned = head[17] - 1;
    const float *const x3 = (const float*)x.data;
    float *const y3 = (float*)x_out.data, *const e3 = (float*)e.data, *const v3_ = (float*)v.data, *const r3 = (float*)r.data;
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
    const int g0 = mine ? at(0, p) : 0, object = mine ? c.object.data[g0] : 0, column = mine ? c.pin.data[g0] : -1;
    const float w = mine ? c.w.data[g0] : 0.f, decay = mine ? c.decay.data[object] : 0.f;
    float room2 = BOUNDED && mine ? h.room.data[g0] : 1e30f;        // square of the clearance [m^2], -2 once it was not enough
    room2 = room2 > 0.f ? room2 * room2 : -1.f;
    float gravity[3] = {0}, d0[3] = {0}, s[3] = {0}, v0[3] = {0}, goal[3] = {0}, q[3] = {0}, r0[3], x0[3];
    for (int k = 0; k < 3 && mine; ++k) {
        gravity[k] = ((const float*)c.gravity.data)[3 * object + k];
        d0[k] = e3[3 * g0 + k];
        v0[k] = q[k] = w > 0.f ? v3_[3 * g0 + k] : 0.f;
        r0[k] = r3[3 * g0 + k];
        x0[k] = x3[3 * g0 + k];
    }
    const bool moves = mine && column >= 0 && !(w > 0.f) && step.drift > 0.f;
    const float* goals = (const float*)c.target.data + 3 * (step.row * c.target.shape[1] + column);
    for (int k = 0; k < 3 && moves; ++k) goal[k] = goals[k];
    float kick = step.kick;  int from = 0;
    const int points = x.shape[0], guest = GRID && owned + t < there ? at(0, owned + t) : -1;
    float4* const mail = (float4*)h.mail.data;                      // displacements of all points, twice; velocities
    if (!GRID) { CLUSTER_BEGINS } else { BLOCK_MEETS }
    const int forces = mine ? force_begin[p] + lane : 0, forces_end = mine ? force_begin[p + 1] : 0;
    const int pushes = mine && !GRID ? push_begin[p] + lane : 0, pushes_end = mine && !GRID ? push_begin[p + 1] : 0;
"""
SUBSTEPS = """
    for (int sub = 0; ; ++sub) {
        const bool last = sub == step.count;
        if (last && step.close == 0.f) break;
        const float4 *const d = D + S * from, *const rate = Q + S * from;
        const int first = (angles + 31) / 32 * 32;                  // of the triangles: warps take one kind
        for (int i = t; i < first + flat; i += THREADS) {
            if (i < angles) hinge(i, d, rate);
            else if (i >= first) triangle(i - first, d, rate);
        }
        BLOCK_MEETS
        for (int i = t; i < curved; i += THREADS) {
            V3 sum = v3(0.f, 0.f, 0.f);
            const float4* const a = value + SLOTS * i;
            #pragma unroll
            for (int k = 0; k < SLOTS; ++k) sum = more(z[FLOAT_AS_INT(a[k].w)], v3(a[k].x, a[k].y, a[k].z), sum);
            C[i] = make_float4(sum.x, sum.y, sum.z, 0.f);
        }
        BLOCK_MEETS
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
        BLOCK_MEETS
        float f[3] = {0, 0, 0}, blow[3] = {0, 0, 0}, damp = 0.f;
        #pragma unroll 4
        for (int k = forces; k < forces_end; k += LANES) {
            const int word = force[k], element = word >> 2;
            const float part = scale[element], *const a = F + 12 * element + (word & 3);
            for (int j = 0; j < 3; ++j) f[j] = fmaf(part, a[4 * j], f[j]);
            if (AIR && element < flat) {
                damp += drag[element];
                for (int j = 0; j < 3; ++j) blow[j] += F[12 * element + 4 * j + 3];
            }
        }
        SUM_LANES
        if (AIR) {                                                  // one Newton step of drag, which cannot overshoot then
            const float part = 1.f / (1.f + 2.f * (last ? step.close : kick) * w * damp);
            for (int k = 0; k < 3; ++k) f[k] = fmaf(part, blow[k], f[k]);
        }
        if (last) {
            for (int k = 0; k < 3 && w > 0.f; ++k) {
                const float y = step.close * (w * f[k] + gravity[k] - decay * q[k]) + r0[k], v1 = v0[k] + y;
                r0[k] = y - (v1 - v0[k]);
                v0[k] = v1;
            }
            break;
        }
        if (w > 0.f) {
            for (int k = 0; k < 3; ++k) {
                const float a = w * f[k] + gravity[k] - decay * q[k], y = kick * a + r0[k], v1 = v0[k] + y;
                r0[k] = y - (v1 - v0[k]);
                v0[k] = v1;
                const float move = step.drift * v1 + s[k], d1 = d0[k] + move;
                s[k] = move - (d1 - d0[k]);
                d0[k] = d1;
                q[k] = v1 + step.ahead * a;
            }
            if (BOUNDED && !(d0[0] * d0[0] + d0[1] * d0[1] + d0[2] * d0[2] <= room2)) room2 = -2.f;
        } else if (moves && (sub < 2 || step.stride)) {
            for (int k = 0; k < 3; ++k) {
                const float d1 = goal[k] - x0[k];
                v0[k] = q[k] = (d1 - d0[k]) / step.h;
                d0[k] = d1;
            }
        }
        from = 1 - from;
        const float4 d1 = make_float4(d0[0], d0[1], d0[2], 0.f), q1 = make_float4(q[0], q[1], q[2], 0.f);
        if (mine && lane == 0) {
            (GRID ? mail[points * from + g0] : D[S * from + p]) = D[S * from + p] = d1;
            if (RATES) (GRID ? mail[points * (2 + from) + g0] : Q[S * from + p]) = Q[S * from + p] = q1;
        }
        for (int k = pushes; k < pushes_end; k += LANES) {
            const int block = push[k] >> 16, slot = push[k] & 0xffff;
            send(block, D + S * from + slot, d1, sub);
            if (RATES) send(block, Q + S * from + slot, q1, sub);
        }
        kick = step.later;
        if (moves && step.stride && sub + 1 < step.count) {
            goals += 3 * c.target.shape[1];
            for (int k = 0; k < 3; ++k) goal[k] = goals[k];
        }
        if (!GRID) {
            CLUSTER_WAITS
        } else {                                                    // blocks wait for those that they share points with
            BLOCK_MEETS
            if (t == 0) say(h.turn.data + rank, sub + 1);
            if (t < head[2 * 13 + 1]) hear(h.turn.data + at(13, t), sub + 1);
            BLOCK_MEETS
            if (guest >= 0) {
                D[S * from + owned + t] = fresh(mail + points * from + guest);
                if (RATES) Q[S * from + owned + t] = fresh(mail + points * (2 + from) + guest);
            }
            BLOCK_MEETS
        }
    }
    if (!GRID) { CLUSTER_ENDS }                                     // nobody leaves while others may still send to it
    if (BOUNDED && room2 < -1.5f) atomicMax(h.met.data, 1);
    if (mine && lane == 0)
        for (int k = 0; k < 3; ++k) {
            const float x1 = x0[k] + d0[k];
            y3[3 * g0 + k] = x1;
            e3[3 * g0 + k] = (d0[k] - (x1 - x0[k])) + s[k];
            v3_[3 * g0 + k] = v0[k];
            r3[3 * g0 + k] = r0[k];
        }
"""
@cache
def sheets(real):
    """Struct of the patches, and of the elements that they are made of: reads only, but for met."""
    t = types(real)

    @wp.struct
    class Sheets:
        head: wp.array(dtype=int)            # first place in `list` and size of each of LISTS, (blocks * LISTS * 2,)
        list: wp.array(dtype=int)
        rest: wp.array(dtype=t.mat22)        # of triangles, as kernels/cloth/element.py has them
        stiffness: wp.array(dtype=t.vec4)
        tau: wp.array(dtype=t.scalar)
        angle: wp.array(dtype=t.scalar)      # of hinges
        bend: wp.array(dtype=t.scalar)
        relax: wp.array(dtype=t.scalar)
        own: wp.array(dtype=t.scalar)        # of curvatures
        value: wp.array(dtype=t.vec3)
        wind: wp.array(dtype=t.vec3)         # and drag and lift of the air over each object: kernels/cloth/air.py
        drag: wp.array(dtype=t.scalar)
        lift: wp.array(dtype=t.scalar)
        room: wp.array(dtype=t.scalar)       # clearance [m], (points,); of frames that are watched
        met: wp.array(dtype=int)             # becomes 1 where a point goes further
        mail: wp.array(dtype=t.vec4)         # what blocks of a grid send, (4 points,)
        turn: wp.array(dtype=int)            # substeps that each has sent; 0 where a frame begins

    return Sheets


def sizes(plan, damped: bool, bounded: bool) -> str:
    """Constants of the code."""
    numbers = {"S": plan.points, "OWN": plan.own, "FLATS": plan.triangles, "BENT": plan.bent, "HINGES": plan.hinges,
               "CURVED": plan.curved, "MOMENTS": plan.moments, "FORCES": plan.forces, "THREADS": plan.threads,
               "LANES": plan.lanes, "SLOTS": SLOTS, "LISTS": len(LISTS)}
    flags = {"DAMPED": damped, "AIR": plan.air, "RATES": damped or plan.air, "BOUNDED": bounded, "GRID": plan.grid}
    return (f"constexpr int {', '.join(f'{k} = {v}' for k, v in numbers.items())};\n"
            f"    constexpr bool {', '.join(f'{k} = {int(v)}' for k, v in flags.items())};\n    {NUMBERS}\n")


def code(plan, damped: bool, bounded: bool) -> str:
    """The body of the kernel."""
    text = "".join((sizes(plan, damped, bounded), ROOM, FILL, ARITHMETIC, HINGE, TRIANGLE, OWN, SUBSTEPS))
    for word, meant in WORDS.items():
        text = re.sub(rf"\b{word}\b", lambda _, meant=meant: meant, text)
    return text


@cache
def frame(real, module, plan, damped: bool, bounded: bool = False):
    """Kernel, launched over plan.size blocks of plan.threads (`wsim.physics.fused.domains.Plan`): as kernels/motion/cluster.py
    has it, of sheets alone. bounded: frames are watched."""
    vec3, Net, Sheets, Step = types(real).vec3, net(real), sheets(real), steps(real)

    @wp.func_native(BEFORE + code(plan, damped, bounded) + "#endif\n")
    def march(c: Net, h: Sheets, x: wp.array(dtype=vec3), step: Step, x_out: wp.array(dtype=vec3), e: wp.array(dtype=vec3),
              v: wp.array(dtype=vec3), r: wp.array(dtype=vec3)): ...

    def frame(c: Net, h: Sheets, x: wp.array(dtype=vec3), step: Step, x_out: wp.array(dtype=vec3),
              e_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), r_out: wp.array(dtype=vec3)):
        room = wp.tile_empty(shape=wp.static(plan.words), dtype=float, storage="shared")      # `sheet_room`   # noqa: F841
        march(c, h, x, step, x_out, e_out, v_out, r_out)

    return wp.kernel(frame, name="frame_sheets" + "_bounded" * bounded, module=module, enable_backward=False,
                     grid_stride=False, launch_bounds=plan.threads, cluster_dim=1 if plan.grid else plan.size)
