"""Smoke in pictures: light that is lost and scattered on the way through grids of density, before and beside the surfaces of
kernels/picture/ray.py.

Along a ray from the eye, radiance L and transmittance T (Kajiya, Von Herzen 1984, ray tracing volume densities; Beer-Lambert):

    T(t) = exp(- integral_0^t k rho ds)        L = integral T k rho a (P K V + S (1 + V) / 2) dt  +  T(end) L_surface

    rho  density        k  extinction of density 1 [1/length]        a  albedo        K  colour of the key light
    V    part of the key light that is left at a place: exp(- integral k rho) towards it, 0 behind a surface
    S    the sky's mean        P  part of the key light that is scattered to the eye, of all directions and orders

A ray is cut into equal pieces, of a block of voxels at most towards the light, of half of one from the eye; a piece has the
density at its middle, and the exact integral of that. Blocks are voxels, or larger in grids finer than a picture shows. V is
worked out once an image, at each block near smoke. Surfaces and ground have the shadow of smoke. Grids are trilinear between
the centres of voxels, 0 outside. Lengths as in ray.py, float32 only.
"""

import warp as wp

from wsim.kernels.picture import ray

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

SCATTERED = wp.constant(0.65)     # P; single scattering alone would be 1/4 and leaves thick smoke too dark
OPAQUE = wp.constant(2.0e-3)      # transmittance from which on nothing behind is seen


@wp.struct
class SmokeMedium:
    density: wp.array3d(dtype=float)     # of each voxel
    lit: wp.array3d(dtype=float)         # V at each block
    block: int                           # voxels along an edge of a block
    turn: wp.mat33                       # world to index: turn p + shift
    shift: wp.vec3
    back: wp.mat33                       # index to world: back q + corner
    corner: wp.vec3
    albedo: wp.vec3
    extinction: float                    # k


@wp.func
def trilinear_density(field: wp.array3d(dtype=float), q: wp.vec3):
    """Trilinear value at an index, 0 outside."""
    x = int(wp.floor(q[0]))
    y = int(wp.floor(q[1]))
    z = int(wp.floor(q[2]))
    f = q - wp.vec3(float(x), float(y), float(z))
    total = wp.float32(0.0)
    for k in range(8):
        i = x + (k & 1)
        j = y + ((k >> 1) & 1)
        n = z + (k >> 2)
        if (i >= 0 and j >= 0 and n >= 0 and i < field.shape[0] and j < field.shape[1] and n < field.shape[2]):
            w = wp.where((k & 1) == 1, f[0], 1.0 - f[0])
            w = w * wp.where(((k >> 1) & 1) == 1, f[1], 1.0 - f[1])
            w = w * wp.where((k >> 2) == 1, f[2], 1.0 - f[2])
            total += w * field[i, j, n]
    return total


@wp.func
def lit_at(medium: SmokeMedium, q: wp.vec3):
    """V at an index of the density, beyond the middles of the outer blocks that of those."""
    p = (q + wp.vec3(0.5, 0.5, 0.5)) / float(medium.block) - wp.vec3(0.5, 0.5, 0.5)
    for a in range(3):
        p[a] = wp.clamp(p[a], 0.0, float(medium.lit.shape[a]) - 1.0)
    return trilinear_density(medium.lit, p)


@wp.func
def ray_box_interval(medium: SmokeMedium, q: wp.vec3, d: wp.vec3, end: float):
    """Where a ray q + t d, 0 < t < end, is within the box of what is not 0: (first t, last t); last < first: nowhere."""
    low = wp.float32(0.0)
    high = end
    for a in range(3):
        n = float(medium.density.shape[a])
        if wp.abs(d[a]) < 1.0e-9:
            if q[a] <= -1.0 or q[a] >= n:
                high = -1.0
        else:
            s = (-1.0 - q[a]) / d[a]
            t = (n - q[a]) / d[a]
            low = wp.max(low, wp.min(s, t))
            high = wp.min(high, wp.max(s, t))
    return wp.vec2(low, high)


@wp.func
def ray_piece_count(medium: SmokeMedium, reach: wp.vec2, d: wp.vec3):
    """Number of equal pieces of a block at most."""
    return int(wp.ceil((reach[1] - reach[0]) * wp.length(d) / float(medium.block)))


@wp.func
def transmittance_toward(medium: SmokeMedium, p: wp.vec3, toward: wp.vec3):
    """exp(- integral k rho) from a place on in a direction."""
    q = medium.turn * p + medium.shift
    d = medium.turn * toward
    reach = ray_box_interval(medium, q, d, ray.FAR)
    if reach[1] <= reach[0]:
        return 1.0
    n = ray_piece_count(medium, reach, d)
    step = (reach[1] - reach[0]) / float(n)
    total = wp.float32(0.0)
    for k in range(n):
        total += trilinear_density(medium.density, q + (reach[0] + (float(k) + 0.5) * step) * d)
    return wp.exp(-medium.extinction * step * total)


@wp.kernel
def light_smoke(medium: SmokeMedium, surfaces: ray.RayScene, view: ray.CameraView, lit: wp.array3d(dtype=float)):
    """V of each block that has smoke in it or beside it."""
    i, j, k = wp.tid()
    b = medium.block
    near = wp.float32(0.0)
    for x in range(wp.max(b * (i - 1), 0), wp.min(b * (i + 2), medium.density.shape[0])):
        for y in range(wp.max(b * (j - 1), 0), wp.min(b * (j + 2), medium.density.shape[1])):
            for z in range(wp.max(b * (k - 1), 0), wp.min(b * (k + 2), medium.density.shape[2])):
                near = wp.max(near, medium.density[x, y, z])
    V = wp.float32(1.0)
    if near > 0.0:
        middle = float(b) * wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5) - wp.vec3(0.5, 0.5, 0.5)
        p = medium.back * middle + medium.corner
        V = transmittance_toward(medium, p, view.light)
        if wp.mesh_query_ray_anyhit(surfaces.mesh, p, view.light, ray.FAR):
            V = 0.0
    lit[i, j, k] = V


@wp.kernel
def shade_surfaces(medium: SmokeMedium, view: ray.CameraView, samples: ray.PixelSamples, light: wp.array2d(dtype=wp.vec4),
                   light_out: wp.array2d(dtype=wp.vec4)):
    """The key light that smoke leaves at what each pixel sees."""
    y, x = wp.tid()
    E = light[y, x]
    if samples.what[y, x] != ray.BACKDROP and E[0] > 0.0:
        E = wp.vec4(E[0] * transmittance_toward(medium, samples.place[y, x], view.light), E[1], E[2], E[3])
    light_out[y, x] = E


@wp.kernel
def march_smoke(medium: SmokeMedium, view: ray.CameraView, samples: ray.PixelSamples, behind: wp.array2d(dtype=wp.vec4),
                seen: wp.array2d(dtype=wp.vec4)):
    """(L, T) of each pixel, of this medium and what is behind it."""
    y, x = wp.tid()
    d = ray.pixel_ray(view, y, x, seen.shape[0], seen.shape[1])
    end = float(ray.FAR)
    if samples.what[y, x] != ray.BACKDROP:
        end = wp.length(samples.place[y, x] - view.eye)
    q = medium.turn * view.eye + medium.shift
    dq = medium.turn * d
    reach = ray_box_interval(medium, q, dq, end)
    L = wp.vec3(0.0)
    T = wp.float32(1.0)
    if reach[1] > reach[0]:
        n = 2 * ray_piece_count(medium, reach, dq)
        step = (reach[1] - reach[0]) / float(n)
        S = 0.8 * view.zenith + 0.2 * view.horizon
        k = int(0)
        while k < n and T > OPAQUE:
            at = q + (reach[0] + (float(k) + 0.5) * step) * dq
            rho = trilinear_density(medium.density, at)
            if rho > 0.0:
                V = lit_at(medium, at)
                left = wp.exp(-medium.extinction * rho * step)
                L += (T * (1.0 - left)) * wp.cw_mul(medium.albedo, (SCATTERED * V) * view.key + (0.5 + 0.5 * V) * S)
                T = T * left
            k += 1
    B = behind[y, x]
    seen[y, x] = wp.vec4(L[0] + T * B[0], L[1] + T * B[1], L[2] + T * B[2], T * B[3])


@wp.kernel
def develop_smoke(samples: ray.PixelSamples, view: ray.CameraView, light: wp.array2d(dtype=wp.vec4),
                  smoke: wp.array2d(dtype=wp.vec4), image: wp.array3d(dtype=wp.uint8)):
    """As `ray.develop_image`, seen through smoke."""
    y, x = wp.tid()
    c = wp.vec3(0.0)
    for k in range(4):
        v = 2 * y + k // 2
        u = 2 * x + k % 2
        s = smoke[v, u]
        c += 0.25 * ray.tone_map_color(s[3] * ray.pixel_radiance(samples, view, light, v, u) + wp.vec3(s[0], s[1], s[2]))
    for k in range(3):
        image[y, x, k] = ray.encode_srgb(c[k])
