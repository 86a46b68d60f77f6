"""What a length has gained over its rest, in float32 but for one rounding at the end:

    |r|^2 - l^2,   r = (x_j - x_i) + (d_j - d_i),   l = rest + left

A float32 length is off by 3e-8 of itself, and so is |r|: of the strain 1e-4 of a stiff spring that is 1e-3, and of gradients as
much. Here l has two parts, and differences, sums and squares keep what they round off (Dekker 1971; Ogita, Rump, Oishi 2005,
algorithm 5.3); on a CPU it is float64. From it L - l = (|r|^2 - l^2) / (L + l). No adjoint: who calls it has its own.
"""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    float sum = 0.0f, rest_of = 0.0f;
    for (int k = 0; k < 4; ++k) {
        float r = rest, low = left, sign = -1.0f;
        if (k < 3) {
            sign = 1.0f;
            float e = xj.c[k] - xi.c[k], b = e - xj.c[k];
            low = (xj.c[k] - (e - b)) - (xi.c[k] + b);
            float d = dj.c[k] - di.c[k];
            b = d - dj.c[k];
            low += (dj.c[k] - (d - b)) - (di.c[k] + b);
            r = e + d;
            b = r - e;
            low += (e - (r - b)) + (d - b);
        }
        float p = r * r, more = fmaf(r, r, -p) + 2.0f * r * low, next = sum + sign * p, b = next - sum;
        rest_of += (sum - (next - b)) + (sign * p - b) + sign * more;
        sum = next;
    }
    return sum + rest_of;
#else
    double sum = 0.0, l = (double)rest + (double)left;
    for (int k = 0; k < 3; ++k) {
        double r = ((double)xj.c[k] - (double)xi.c[k]) + ((double)dj.c[k] - (double)di.c[k]);
        sum += r * r;
    }
    return (float)(sum - l * l);
#endif
""")
def squared_length_gain(xi: wp.vec3f, xj: wp.vec3f, di: wp.vec3f, dj: wp.vec3f, rest: wp.float32,
                        left: wp.float32) -> wp.float32:
    """|r|^2 - l^2 [m^2]."""
    ...
