"""Motions of any kind on the device, in float64: stacks of parts whose curves are channels (channel.py), motions by keys with
squad or slerp among them. The host's formulas: wsim/scene/curve/motion.py and stack.py.

    M(t) = A_1(t) ... A_n(t)     A: a constant, a shift, turn or scale along one axis, elements of a matrix, or T R S by keys

Of T R S four channels give the place and k + e, key and fraction e of the way to the next; R is slerp(q_k, q_k+1, e) or squad
with inner quaternions a_k, b_k; S is linear in e. Outside R goes on at the end's angular velocity, or has the turn of a whole
period more each time.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.animation.channel import ChannelTable, channel_functions, locate_in_channel
from wsim.kernels.animation.outside import LINEAR
from wsim.kernels.animation.rotation_spline import squad_rotation
from wsim.kernels.math.rotation import multiply_rotations, rotation_about_axis, rotation_exponential, rotation_to_matrix

real, mat33, vec3, quat = wp.float64, wp.mat33d, wp.vec3d, wp.quatd
CONSTANT, SHIFT, TURN, SCALE, ELEMENTS, KEYED = range(6)


@wp.struct
class StackParts:
    first: wp.array(dtype=int)                # parts of motion m: first[m] .. first[m + 1], (motions + 1,)
    what: wp.array(dtype=int)                 # (parts,)
    axis: wp.array(dtype=int)
    channel: wp.array(dtype=int)              # the first of its channels
    keyed: wp.array(dtype=int)                # number among motions by keys
    linear: wp.array(dtype=mat33)             # of a constant
    offset: wp.array(dtype=vec3)              # [m]


@wp.struct
class RotationKeys:
    first: wp.array(dtype=int)                # of the keys of motion by keys j, (keyed + 1,)
    smooth: wp.array(dtype=int)               # 1: squad, (keyed,)
    q: wp.array(dtype=quat)                   # (keys,)
    a: wp.array(dtype=quat)                   # inner quaternions of the piece behind each key
    b: wp.array(dtype=quat)
    w: wp.array(dtype=vec3)                   # of a slerp there, about own axes [rad]
    S: wp.array(dtype=mat33)                  # stretch
    end: wp.array2d(dtype=vec3)               # angular velocity at the first and the last key [rad/s], (keyed, 2)
    whole: wp.array(dtype=vec3)               # turn of a period [rad]


@wp.func
def rotation_vector_quaternion(u: vec3):
    """The quaternion of a rotation vector [rad]."""
    e = rotation_exponential(u)
    return quat(e[0], e[1], e[2], e[3])


@cache
def keyed_transform_func(value, own: str):
    """Function: R S and T of a motion by keys at time t. value: of channels."""
    def keyed_transform_at(c: ChannelTable, turns: RotationKeys, j: int, channel: int, t: real):
        k, _s, n, _way, side, beyond = locate_in_channel(c, channel, t)
        first = c.first[channel]
        i = turns.first[j] + k - first
        p = vec3(value(c, channel, t), value(c, channel + 1, t), value(c, channel + 2, t))
        last = c.first[channel + 1] - 1 - first
        e = value(c, channel + 3, t) - real(k - first)
        q = turns.q[i]
        S = turns.S[i]
        if last > 0:
            S = S + e * (turns.S[i + 1] - S)
            if turns.smooth[j] == 1:
                q = squad_rotation(q, turns.a[i], turns.b[i], turns.q[i + 1], e)
            else:
                q = multiply_rotations(q, rotation_vector_quaternion(e * turns.w[i]))
        if side >= 0:
            mode = c.mode[channel][side]
            if mode == LINEAR:
                q = multiply_rotations(rotation_vector_quaternion(beyond * turns.end[j, side]), q)
        if n != real(0.0):
            q = multiply_rotations(rotation_vector_quaternion(n * turns.whole[j]), q)
        return rotation_to_matrix(q) * S, p

    return wp.func(keyed_transform_at, name=f"keyed_transform_{own}")


@cache
def motion_stack_functions(codes: tuple[int, ...], names: tuple[str, ...], whats: tuple[int, ...]) -> SimpleNamespace:
    """`motion_stack_at` (parts, channels, turns, m, t) -> (linear part, place [m]) of stacks with these codes and kinds of
    parts."""
    own = f"{'_'.join(map(str, (*whats, 'of', *codes)))}"
    value = channel_functions(codes, names).value
    by_keys = keyed_transform_func(value, own)
    with_keys, with_elements = KEYED in whats, ELEMENTS in whats

    def motion_stack_at(parts: StackParts, c: ChannelTable, turns: RotationKeys, m: int, t: real):
        A = wp.identity(n=3, dtype=real)
        p = vec3()
        for j in range(parts.first[m], parts.first[m + 1]):
            what = parts.what[j]
            axis = parts.axis[j]
            B = parts.linear[j]
            o = parts.offset[j]
            if what == SHIFT:
                o[axis] = value(c, parts.channel[j], t)
            elif what == TURN:
                n = vec3()
                n[axis] = real(1.0)
                B = rotation_about_axis(n, value(c, parts.channel[j], t))
            elif what == SCALE:
                B[axis, axis] = value(c, parts.channel[j], t)
            if wp.static(with_keys):
                if what == KEYED:
                    B, o = by_keys(c, turns, parts.keyed[j], parts.channel[j], t)
            if wp.static(with_elements):
                if what == ELEMENTS:
                    for r in range(3):
                        for k in range(3):
                            B[r, k] = value(c, parts.channel[j] + 4 * r + k, t)
                        o[r] = value(c, parts.channel[j] + 4 * r + 3, t)
            p = p + A * o
            A = A * B
        return A, p

    return SimpleNamespace(at=wp.func(motion_stack_at, name=f"stack_at_{own}"))


@cache
def track_sample_kernel(codes: tuple[int, ...], names: tuple[str, ...], whats: tuple[int, ...], module):
    """Kernel over (motions, moments): motions at times start + moment [s]. start: when the frame begins, (1,)."""
    at = motion_stack_functions(codes, names, whats).at

    def sample_motion_tracks(parts: StackParts, c: ChannelTable, turns: RotationKeys, start: wp.array(dtype=real),
                             moment: wp.array(dtype=real), A_out: wp.array2d(dtype=mat33), p_out: wp.array2d(dtype=vec3)):
        m, k = wp.tid()
        A, p = at(parts, c, turns, m, start[0] + moment[k])
        A_out[m, k] = A
        p_out[m, k] = p

    return wp.kernel(sample_motion_tracks, name="sample_track", module=module, enable_backward=False)
