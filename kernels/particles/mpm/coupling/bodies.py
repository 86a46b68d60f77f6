"""Rigid bodies among material points through a frame. They go with the particles step by step; what particles have given them
in all then acts on them through the frame that their own method does, with contacts and joints.

    take     centre, turn and momenta of the state where a frame begins
    begin    a step: weight and forces; shapes go into the table
    solve    velocity u = u0 + W (s - S u), s - S u the impulse of the nodes that press (contact.py), W the inverse masses: a
             light body under heavy sand goes with it, and takes no more than it can
    kick     impulses of nodes;   end: those of particles, and the place after the step
    give     mean force J / dt, and the torque that the body's own way through the frame needs for the same angular momentum:
             (sum (y - c0) x J  -  (v0 dt / 2 + F dt^2 / 6 m) x J) / dt

Others, such as a floor or a joint, hold a body against part of a push: W lacks that direction, by the part of it that they took
in the last frame (`hold`). Vectors are the world's, places count from the corner of the grid.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.coupling.tables import FINE, GIVEN, SUMS, push_tables
from wsim.kernels.rigid import motion

LEAST = wp.constant(0.02)          # part of a push that others hold: less is rounding
mat66d = wp.types.matrix((6, 6), wp.float64)
vec6d = wp.types.vector(6, wp.float64)


@wp.func
def solve_six(M: mat66d, b: vec6d):
    """x of M x = b, by elimination with pivots of columns."""
    A = M
    x = b
    for k in range(6):
        best = int(k)
        for i in range(k + 1, 6):
            if wp.abs(A[i, k]) > wp.abs(A[best, k]):
                best = i
        for j in range(6):
            swap = A[k, j]
            A[k, j] = A[best, j]
            A[best, j] = swap
        side = x[k]
        x[k] = x[best]
        x[best] = side
        for i in range(k + 1, 6):
            f = A[i, k] / A[k, k]
            for j in range(k, 6):
                A[i, j] = A[i, j] - f * A[k, j]
            x[i] = x[i] - f * x[k]
    for m in range(6):
        k = 5 - m
        sum = x[k]
        for j in range(k + 1, 6):
            sum -= A[k, j] * x[j]
        x[k] = sum / A[k, k]
    return x


@cache
def body_functions(real) -> SimpleNamespace:
    """respond(constants, bodies, b, J, T) -> (dp, dL) that the body takes while others hold it; set_rates; read_sum."""
    t, tables, (Bodies, _) = types(real), push_tables(real), motion.body_structs(real)

    @wp.func
    def spin_response(c: Bodies, s: tables.PushedBodies, b: int, T: t.vec3):
        """Change of the spin [rad/s] by an angular impulse."""
        i = s.row[b]
        out = motion.angular_velocity_of(s.turn[b], T, c.inverse[i])
        part = wp.length_sq(s.turned[b])
        if part > real(0.0):
            across = motion.angular_velocity_of(s.turn[b], s.turned[b], c.inverse[i])
            out -= (part * wp.dot(across, T) / wp.dot(across, s.turned[b])) * across
        return out

    @wp.func
    def linear_response(c: Bodies, s: tables.PushedBodies, b: int, J: t.vec3):
        """Change of the velocity [m/s] by an impulse."""
        return c.w[s.row[b]] * (J - wp.dot(s.held[b], J) * s.held[b])

    @wp.func
    def kick_body(c: Bodies, s: tables.PushedBodies, b: int, J: t.vec3, T: t.vec3):
        """p and L after a push that others hold in part."""
        i = s.row[b]
        p = s.p[b] + linear_response(c, s, b, J) / c.w[i]
        q = s.turn[b]
        spin = wp.quat_rotate_inv(q, spin_response(c, s, b, T))
        L = s.L[b] + wp.quat_rotate(q, wp.cw_div(spin, c.inverse[i]))
        return p, L

    @wp.func
    def read_sum(w: tables.Walls, b: int, n: int):
        """Sum over shares of a number of a body, which begins anew."""
        sum = wp.int64(0)
        for k in range(w.pushed.sums.shape[0]):
            sum += w.pushed.sums[k, SUMS * b + n]
            w.pushed.sums[k, SUMS * b + n] = wp.int64(0)
        return wp.float64(sum) * FINE

    @wp.func
    def read_impulse(w: tables.Walls, b: int, h: real):
        """(J, T) of a body since it was read last."""
        unit = wp.float64(w.pushed.mass) * wp.float64(w.pushed.dx) / wp.float64(h)
        far = unit * wp.float64(w.pushed.reach[b])
        n = int(GIVEN)
        J = wp.vec3d(read_sum(w, b, n), read_sum(w, b, n + 1), read_sum(w, b, n + 2))
        T = wp.vec3d(read_sum(w, b, n + 3), read_sum(w, b, n + 4), read_sum(w, b, n + 5))
        return unit * J, far * T

    @wp.func
    def single(v: wp.vec3d):
        return t.vec3(real(v[0]), real(v[1]), real(v[2]))

    return SimpleNamespace(spin_response=spin_response, linear_response=linear_response, kick_body=kick_body, read_sum=read_sum,
                           read_impulse=read_impulse, single=single)


@cache
def body_kernels(real, module) -> SimpleNamespace:
    """Kernels over bodies, see the file's docstring; place_shapes over rows of the table."""
    t, tables, f, (Bodies, Moving) = types(real), push_tables(real), body_functions(real), motion.body_structs(real)

    @wp.func
    def turned(q: t.quat, way: t.vec3):
        angle = wp.length(way)
        found = q
        if angle > real(0.0):
            found = wp.normalize(wp.quat_from_axis_angle(way / angle, angle) * q)
        return found

    def take_bodies(c: Bodies, now: Moving, s: tables.PushedBodies, w: tables.Walls):
        b = wp.tid()
        i = s.row[b]
        s.turn[b] = wp.normalize(now.q[i])
        w.pushed.center[b] = s.base[b] + (now.x[i] + now.e[i])
        s.start[b] = w.pushed.center[b]
        s.p[b] = now.p[i]
        s.L[b] = now.L[i]
        s.before_p[b] = now.p[i]
        s.before_L[b] = now.L[i]
        s.given_p[b] = wp.vec3d()
        s.given_L[b] = wp.vec3d()

    def begin_bodies(c: Bodies, s: tables.PushedBodies, w: tables.Walls, clock: wp.array(dtype=real)):
        b = wp.tid()
        i = s.row[b]
        p, L = f.kick_body(c, s, b, clock[0] * c.push[i], clock[0] * c.torque[i])
        s.p[b] = p
        s.L[b] = L
        s.v[b] = c.w[i] * p
        s.spin[b] = motion.angular_velocity_of(s.turn[b], L, c.inverse[i])

    def place_shapes(s: tables.PushedBodies, w: tables.Walls, clock: wp.array(dtype=real)):
        k = wp.tid()
        b = w.table.owner[k]
        if b >= 0:
            spin = s.spin[b]
            arm = wp.quat_rotate(s.turn[b], s.place[k])
            v = s.v[b] + wp.cross(spin, arm)
            time = clock[1]                                    # now; the table counts from where the frame begins
            q = turned(s.turn[b] * s.axes[k], -time * spin)
            w.table.pose[0, k] = t.transform(w.pushed.center[b] + arm - time * v, q)
            w.table.speed[k] = v
            w.table.spin[k] = spin

    def solve_bodies(c: Bodies, s: tables.PushedBodies, w: tables.Walls, clock: wp.array(dtype=real)):
        b = wp.tid()
        i = s.row[b]
        R = w.pushed.reach[b]
        mass = wp.float64(w.pushed.mass)
        pace = mass * wp.float64(w.pushed.dx) / wp.float64(clock[0])
        free = c.w[i] * s.p[b]
        round = R * motion.angular_velocity_of(s.turn[b], s.L[b], c.inverse[i])
        A = mat66d()
        x = vec6d()
        for j in range(6):                                     # columns of 1 + W S, and of W s
            J = t.vec3(real(mass * f.read_sum(w, b, j)), real(mass * f.read_sum(w, b, 6 + j)),
                       real(mass * f.read_sum(w, b, 12 + j)))
            T = t.vec3(real(mass * f.read_sum(w, b, 18 + j)), real(mass * f.read_sum(w, b, 24 + j)),
                       real(mass * f.read_sum(w, b, 30 + j)))
            dv = f.linear_response(c, s, b, J)
            ds = R * f.spin_response(c, s, b, R * T)
            for a in range(3):
                A[a, j] = wp.float64(dv[a])
                A[3 + a, j] = wp.float64(ds[a])
            A[j, j] = A[j, j] + wp.float64(1.0)
        J = t.vec3(real(pace * f.read_sum(w, b, 36)), real(pace * f.read_sum(w, b, 37)), real(pace * f.read_sum(w, b, 38)))
        T = t.vec3(real(pace * f.read_sum(w, b, 39)), real(pace * f.read_sum(w, b, 40)), real(pace * f.read_sum(w, b, 41)))
        dv = f.linear_response(c, s, b, J)
        ds = R * f.spin_response(c, s, b, R * T)
        for a in range(3):
            x[a] = wp.float64(free[a] + dv[a])
            x[3 + a] = wp.float64(round[a] + ds[a])
        x = solve_six(A, x)
        s.v[b] = t.vec3(real(x[0]), real(x[1]), real(x[2]))
        s.spin[b] = t.vec3(real(x[3]), real(x[4]), real(x[5])) / R

    def kick_bodies(c: Bodies, s: tables.PushedBodies, w: tables.Walls, clock: wp.array(dtype=real)):
        b = wp.tid()
        i = s.row[b]
        J, T = f.read_impulse(w, b, clock[0])
        way = w.pushed.center[b] - s.start[b]
        s.given_p[b] = s.given_p[b] + J
        s.given_L[b] = s.given_L[b] + T + wp.cross(wp.vec3d(wp.float64(way[0]), wp.float64(way[1]), wp.float64(way[2])), J)
        p, L = f.kick_body(c, s, b, f.single(J), f.single(T))
        s.p[b] = p
        s.L[b] = L
        s.v[b] = c.w[i] * p
        s.spin[b] = motion.angular_velocity_of(s.turn[b], L, c.inverse[i])

    def end_bodies(c: Bodies, s: tables.PushedBodies, w: tables.Walls, clock: wp.array(dtype=real)):
        b = wp.tid()
        J, T = f.read_impulse(w, b, clock[0])
        way = w.pushed.center[b] - s.start[b]
        s.given_p[b] = s.given_p[b] + J
        s.given_L[b] = s.given_L[b] + T + wp.cross(wp.vec3d(wp.float64(way[0]), wp.float64(way[1]), wp.float64(way[2])), J)
        step = clock[0] * s.v[b]
        p, L = f.kick_body(c, s, b, f.single(J), f.single(T) - wp.cross(step, f.single(J)))
        s.p[b] = p
        s.L[b] = L
        w.pushed.center[b] = w.pushed.center[b] + step
        s.turn[b] = turned(s.turn[b], clock[0] * s.spin[b])

    def give_bodies(c: Bodies, s: tables.PushedBodies, w: tables.Walls, push_out: wp.array(dtype=t.vec3),
                    torque_out: wp.array(dtype=t.vec3)):
        b = wp.tid()
        i = s.row[b]
        dt = w.pushed.dt
        J = f.single(s.given_p[b])
        way = (c.w[i] * dt) * (real(0.5) * s.before_p[b] + (dt / real(6.0)) * c.push[i])
        push_out[i] = push_out[i] + J / dt
        torque_out[i] = torque_out[i] + (f.single(s.given_L[b]) - wp.cross(way, J)) / dt

    @wp.func
    def held_direction(whole: t.vec3, done: t.vec3, given: t.vec3):
        """Of a push in a frame, of which particles gave a part, and what came of it: the direction, times the root of the part
        that others held."""
        size = wp.length(whole)
        found = t.vec3()
        if size > real(LEAST) * wp.length(given):
            n = whole / size
            part = wp.clamp(wp.dot(whole - done, n) / size, real(0.0), real(1.0))
            if part > real(LEAST):
                found = wp.sqrt(part) * n
        return found

    def hold_bodies(c: Bodies, now: Moving, s: tables.PushedBodies, w: tables.Walls):
        """A frame has ended. c: with what particles gave."""
        b = wp.tid()
        i = s.row[b]
        dt = w.pushed.dt
        s.held[b] = held_direction(dt * c.push[i], now.p[i] - s.before_p[b], f.single(s.given_p[b]))
        s.turned[b] = held_direction(dt * c.torque[i], now.L[i] - s.before_L[b], f.single(s.given_L[b]))
        w.pushed.center[b] = s.base[b] + (now.x[i] + now.e[i])
        s.turn[b] = wp.normalize(now.q[i])
        s.v[b] = t.vec3()
        s.spin[b] = t.vec3()

    def correct_bodies(s: tables.PushedBodies, w: tables.Walls, now: Moving, out: Moving):
        """Angular momentum of particles that were set aside where the frame ends."""
        b = wp.tid()
        J, T = f.read_impulse(w, b, w.pushed.dt)
        out.L[s.row[b]] = now.L[s.row[b]] + f.single(T)

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{t.name}", module=module, enable_backward=False)
            for k in (take_bodies, begin_bodies, place_shapes, solve_bodies, kick_bodies, end_bodies, give_bodies, hold_bodies,
                      correct_bodies)}
    return SimpleNamespace(**made)
