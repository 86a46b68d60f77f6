"""How fast motions of any kind go, on the device, in float64: track.py derived by time. The host's formulas:
wsim/scene/curve/motion.py, turns.py and stack.py.

    dM/dt = sum_i A_1 .. dA_i/dt .. A_n        of T R S by keys: dT/dt, [omega] R S + R dS/dt, omega in world axes

omega is the rate of the pace times that of slerp or squad; outside of the keys that of going on, or 0. At a key all rates are
those of the piece behind it.
"""

from functools import cache

import warp as wp

from wsim.kernels.animation.channel import ChannelTable, channel_functions, locate_in_channel
from wsim.kernels.animation.outside import LINEAR
from wsim.kernels.animation.rotation_spline import squad_angular_rate
from wsim.kernels.animation.track import (
    ELEMENTS,
    KEYED,
    SCALE,
    SHIFT,
    TURN,
    RotationKeys,
    StackParts,
    rotation_vector_quaternion,
)
from wsim.kernels.math.rotation import multiply_rotations, rotate_vector, rotation_about_axis, rotation_to_matrix

real, mat33, vec3 = wp.float64, wp.mat33d, wp.vec3d


@wp.func
def cross_matrix_product(omega: vec3, A: mat33):
    """[omega] A."""
    zero = real(0.0)
    return mat33(zero, -omega[2], omega[1], omega[2], zero, -omega[0], -omega[1], omega[0], zero) * A


@cache
def keyed_rate(rate, own: str):
    """Function: R S and T of a motion by keys at time t, and their rates. rate: of channels."""
    def keyed_transform_and_rate(c: ChannelTable, turns: RotationKeys, j: int, channel: int, t: real):
        k, _s, n, _way, side, beyond = locate_in_channel(c, channel, t)
        first = c.first[channel]
        i = turns.first[j] + k - first
        x, dx = rate(c, channel, t)
        y, dy = rate(c, channel + 1, t)
        z, dz = rate(c, channel + 2, t)
        e, speed = rate(c, channel + 3, t)
        e -= real(k - first)
        q = turns.q[i]
        S = turns.S[i]
        dS = mat33()
        omega = vec3()
        if c.first[channel + 1] - 1 > first and k < c.first[channel + 1] - 1:
            way = turns.S[i + 1] - S
            S = S + e * way
            if turns.smooth[j] == 1:
                q, own_rate = squad_angular_rate(q, turns.a[i], turns.b[i], turns.q[i + 1], e)
                omega = rotate_vector(q, own_rate)
            else:
                omega = rotate_vector(q, turns.w[i])
                q = multiply_rotations(q, rotation_vector_quaternion(e * turns.w[i]))
            omega = speed * omega
            dS = speed * way
        if side >= 0:
            omega = vec3()
            dS = mat33()
            if c.mode[channel][side] == LINEAR:
                omega = turns.end[j, side]
                q = multiply_rotations(rotation_vector_quaternion(beyond * omega), q)
        if n != real(0.0):
            D = rotation_vector_quaternion(n * turns.whole[j])
            q = multiply_rotations(D, q)
            omega = rotate_vector(D, omega)
        R = rotation_to_matrix(q)
        return R * S, vec3(x, y, z), cross_matrix_product(omega, R * S) + R * dS, vec3(dx, dy, dz)

    return wp.func(keyed_transform_and_rate, name=f"keyed_rate_{own}")


@cache
def elements_rate(rate, own: str):
    """Function: linear part and place by channels of the elements of a matrix at time t, and their rates."""
    def matrix_elements_and_rate(c: ChannelTable, channel: int, t: real):
        B = mat33()
        o = vec3()
        dB = mat33()
        do = vec3()
        for r in range(3):
            for k in range(3):
                value, speed = rate(c, channel + 4 * r + k, t)
                B[r, k] = value
                dB[r, k] = speed
            value, speed = rate(c, channel + 4 * r + 3, t)
            o[r] = value
            do[r] = speed
        return B, o, dB, do

    return wp.func(matrix_elements_and_rate, name=f"elements_rate_{own}")


@cache
def track_rate_kernel(codes: tuple[int, ...], names: tuple[str, ...], whats: tuple[int, ...], module):
    """Kernel over motions: rates of the linear part [1/s] and of the place [m/s] at times start + moment[0] [s]."""
    own = f"{'_'.join(map(str, (*whats, 'of', *codes)))}"
    rate = channel_functions(codes, names).rate
    by_keys, by_elements = keyed_rate(rate, own), elements_rate(rate, own)
    with_keys, with_elements = KEYED in whats, ELEMENTS in whats

    def rate_track(parts: StackParts, c: ChannelTable, turns: RotationKeys, start: wp.array(dtype=real),
                   moment: wp.array(dtype=real), A_out: wp.array(dtype=mat33), p_out: wp.array(dtype=vec3)):
        m = wp.tid()
        t = start[0] + moment[0]
        A = wp.identity(n=3, dtype=real)
        dA = mat33()
        dp = vec3()
        for j in range(parts.first[m], parts.first[m + 1]):
            what = parts.what[j]
            axis = parts.axis[j]
            B = parts.linear[j]
            o = parts.offset[j]
            dB = mat33()
            do = vec3()
            if what == SHIFT:
                value, speed = rate(c, parts.channel[j], t)
                o[axis] = value
                do[axis] = speed
            elif what == TURN:
                value, speed = rate(c, parts.channel[j], t)
                n = vec3()
                n[axis] = real(1.0)
                B = rotation_about_axis(n, value)
                dB = cross_matrix_product(speed * n, B)
            elif what == SCALE:
                value, speed = rate(c, parts.channel[j], t)
                B[axis, axis] = value
                dB[axis, axis] = speed
            if wp.static(with_keys):
                if what == KEYED:
                    B, o, dB, do = by_keys(c, turns, parts.keyed[j], parts.channel[j], t)
            if wp.static(with_elements):
                if what == ELEMENTS:
                    B, o, dB, do = by_elements(c, parts.channel[j], t)
            dp = dp + dA * o + A * do
            dA = dA * B + A * dB
            A = A * B
        A_out[m] = dA
        p_out[m] = dp

    return wp.kernel(rate_track, name="rate_track", module=module, enable_backward=False)
