"""Motions between keys on the device, in float64: formulas and their order are those of `Motion.at` (wsim/scene/curve).

    M = T R S     T and S linear, R turned at constant speed about a fixed axis (slerp), held outside of the keys

Polar parts of the keys, axes and angles come from the host: what is left are a sine, a cosine and products, so that both
evaluations agree to some roundings of the place and of a unit matrix.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.rotation import rotation_about_axis

real, mat33, vec3 = wp.float64, wp.mat33d, wp.vec3d


@wp.struct
class MotionKeys:
    first: wp.array(dtype=int)                # keys of motion m: first[m] .. first[m + 1], (motions + 1,)
    time: wp.array(dtype=real)                # [s], increasing, (keys,)
    place: wp.array(dtype=vec3)               # T [m], (keys,)
    whole: wp.array(dtype=mat33)              # R S, as it was authored, (keys,)
    turned: wp.array(dtype=mat33)             # R, (keys,)
    stretch: wp.array(dtype=mat33)            # S, (keys,)
    axis: wp.array(dtype=vec3)                # of the turn to the next key, a unit vector, (keys,)
    angle: wp.array(dtype=real)               # of that turn [rad], in 0 .. pi, (keys,)


@wp.func
def key_segment(keys: MotionKeys, m: int, t: real):
    """Key before t, key behind it (the same one outside of the keys) and the fraction of the way between them."""
    low = keys.first[m]
    high = keys.first[m + 1]
    while low < high:                         # the first key later than t
        middle = (low + high) // 2
        if keys.time[middle] <= t:
            low = middle + 1
        else:
            high = middle
    a = low - 1
    b = low
    s = real(0.0)
    if low == keys.first[m]:
        a = low
    elif low == keys.first[m + 1]:
        b = a
    else:
        s = (t - keys.time[a]) / (keys.time[b] - keys.time[a])
    return a, b, s


@wp.func
def interpolate_keyed_motion(keys: MotionKeys, m: int, t: real):
    """R S and T [m] of motion m at time t [s]."""
    a, b, s = key_segment(keys, m, t)
    A = mat33()
    p = keys.place[a]
    if a == b:
        A = keys.whole[a]
    else:
        Sa = keys.stretch[a]
        A = keys.turned[a] * rotation_about_axis(keys.axis[a], s * keys.angle[a]) * (Sa + s * (keys.stretch[b] - Sa))
        p = p + s * (keys.place[b] - p)
    return A, p


@cache
def motion_sample_kernel(module):
    """Kernel over (motions, moments): motions at times start + moment [s]. start: when the frame begins, (1,)."""

    def sample_keyed_motions(keys: MotionKeys, start: wp.array(dtype=real), moment: wp.array(dtype=real),
                             A_out: wp.array2d(dtype=mat33), p_out: wp.array2d(dtype=vec3)):
        m, k = wp.tid()
        A, p = interpolate_keyed_motion(keys, m, start[0] + moment[k])
        A_out[m, k] = A
        p_out[m, k] = p

    return wp.kernel(sample_keyed_motions, name="sample_motion", module=module, enable_backward=False)
