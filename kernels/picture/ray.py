"""Ray casting of triangles over a ground that shows shadows only: primary rays, one key light, sky light.

Radiance that leaves a diffuse surface of albedo a and unit normal n towards the eye (Kajiya 1986, one bounce; the
factor pi is in the lights):

    L = a ( K max(n.l, 0) V  +  (1/pi) integral over the hemisphere of S(w) (n.w) dw )

    l  direction towards the key light      K  its colour        V  the visible fraction of its disc
    S  radiance from direction w: the sky where the ray leaves, a share of the albedo of what it meets otherwise

The image is traced at twice the width and height, one sample of V and one of the integral a pixel: pixel (x, y)
takes sample (x mod 8) + 8 (y mod 8), scrambled, of a 64-point Hammersley set. Three passes of the weights 1 2 1 at
steps 1, 2, 4 (the a-trous wavelet, Dammertz et al. 2010) give each of the 64 samples the same weight where normals and
plane agree, so that noise leaves without blurring edges. `develop_image` shades, maps tones and averages 2 x 2.

Lengths are relative to the scene's size (the caller scales), colours linear, float32 only: a picture needs no more.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 1})     # half the compile time

BACKDROP, GROUND, SURFACE = wp.constant(0), wp.constant(1), wp.constant(2)
LIFT = wp.constant(2.0e-4)        # start of a secondary ray over its surface; smaller: freckles, larger: light leaks
FAR = wp.constant(1.0e4)          # longest ray
BACK_SHADE = wp.constant(0.72)    # albedo of the back side over that of the front
BOUNCE = wp.constant(0.30)        # light that a surface met by a sky ray is assumed to receive
TILE_SHADE = wp.constant(0.12)    # of light that the darker squares of a floor keep back
OFF_PLANE = wp.constant(0.02)     # neighbours this far from the tangent plane, a unit of view distance, share no light


@wp.struct
class RayScene:
    mesh: wp.uint64                          # all triangles of the scene
    normal_of: wp.array(dtype=wp.vec3i)      # normal of each corner, (triangles,)
    color_of: wp.array(dtype=wp.vec3i)       # colour of each corner, (triangles,)
    normals: wp.array(dtype=wp.vec3)
    colors: wp.array(dtype=wp.vec3)          # linear albedo


@wp.struct
class CameraView:
    eye: wp.vec3
    right: wp.vec3       # times the tangent of half the horizontal angle
    above: wp.vec3       # times the tangent of half the vertical angle
    forward: wp.vec3
    up: wp.vec3          # of the world
    ground: float        # height of the ground along up
    floor: int           # 1: there is a ground
    tile: float          # edge of the squares that show it; 0: shadows alone do
    light: wp.vec3       # unit, towards the key light
    spread: float        # tangent of the light's angular radius
    key: wp.vec3         # colour of the key light
    zenith: wp.vec3      # sky radiance above
    horizon: wp.vec3     # and at the horizon
    backdrop_high: wp.vec3
    backdrop_low: wp.vec3


@wp.struct
class PixelSamples:
    what: wp.array2d(dtype=wp.int32)         # BACKDROP, GROUND or SURFACE
    place: wp.array2d(dtype=wp.vec3)         # hit point
    normal: wp.array2d(dtype=wp.vec3)        # unit, towards the eye
    albedo: wp.array2d(dtype=wp.vec3)


@wp.func
def sky_radiance(view: CameraView, w: wp.vec3):
    """Radiance of the sky (or of the bright floor) in direction w."""
    s = wp.dot(w, view.up)
    return wp.lerp(view.horizon, view.zenith, wp.sqrt(wp.max(s, 0.0))) * wp.where(s < 0.0, 0.55, 1.0)


@wp.func
def frame_about_normal(n: wp.vec3):
    """Rotation matrix whose third column is the unit vector n (Duff et al. 2017)."""
    s = wp.where(n[2] < 0.0, -1.0, 1.0)
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return wp.matrix_from_cols(wp.vec3(1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]),
                               wp.vec3(b, s + n[1] * n[1] * a, -n[1]), n)


@wp.func
def hammersley_point(i: int):
    """Point i of 64 in the unit square: (i / 64, i with its six bits reversed / 64), in the middle of its cell."""
    j = ((i & 1) << 5) | ((i & 2) << 3) | ((i & 4) << 1) | ((i & 8) >> 1) | ((i & 16) >> 3) | ((i & 32) >> 5)
    return wp.vec2((float(i) + 0.5) / 64.0, (float(j) + 0.5) / 64.0)


@wp.func
def corner_mean(of: wp.array(dtype=wp.vec3i), values: wp.array(dtype=wp.vec3), face: int, u: float, v: float):
    """Value of the corners of a triangle at barycentric coordinates u, v of its first two corners."""
    c = of[face]
    return u * values[c[0]] + v * values[c[1]] + (1.0 - u - v) * values[c[2]]


@wp.func
def pixel_ray(view: CameraView, y: int, x: int, height: int, width: int):
    """Unit direction through the middle of a pixel; row 0 is the top."""
    a = 2.0 * (float(x) + 0.5) / float(width) - 1.0
    b = 1.0 - 2.0 * (float(y) + 0.5) / float(height)
    return wp.normalize(view.forward + a * view.right + b * view.above)


@wp.func
def sample_incoming_light(surfaces: RayScene, view: CameraView, p: wp.vec3, n: wp.vec3, i: int):
    """One sample of the light at p: (V, sky integral as a colour)."""
    u = hammersley_point(i)
    r = wp.sqrt(u[0])
    phi = 6.2831853 * u[1]
    disc = wp.vec3(r * wp.cos(phi), r * wp.sin(phi), 0.0)
    visible = wp.float32(0.0)
    toward = wp.normalize(view.light + view.spread * (frame_about_normal(view.light) * disc))
    if wp.dot(toward, n) > 0.0 and not wp.mesh_query_ray_anyhit(surfaces.mesh, p, toward, FAR):
        visible = 1.0
    w = frame_about_normal(n) * wp.vec3(disc[0], disc[1], wp.sqrt(wp.max(0.0, 1.0 - u[0])))
    hit = wp.mesh_query_ray(surfaces.mesh, p, w, FAR)
    S = sky_radiance(view, w)
    if hit.result:
        S = BOUNCE * surfaces.colors[surfaces.color_of[hit.face][0]]
    return wp.vec4(visible, S[0], S[1], S[2])


@wp.kernel
def trace_primary_rays(surfaces: RayScene, view: CameraView, samples: PixelSamples, light: wp.array2d(dtype=wp.vec4)):
    """What each pixel sees, and one sample of the light there."""
    y, x = wp.tid()
    d = pixel_ray(view, y, x, light.shape[0], light.shape[1])
    i = ((x & 7) + 8 * (y & 7)) * 37 & 63          # 37 is odd: a permutation that takes neighbours apart
    hit = wp.mesh_query_ray(surfaces.mesh, view.eye, d, FAR)
    what = int(BACKDROP)
    n = view.up
    p = wp.vec3(0.0)
    if hit.result:
        what = SURFACE
        face = wp.normalize(hit.normal)
        side = wp.where(wp.dot(face, d) > 0.0, -1.0, 1.0)
        n = side * wp.normalize(corner_mean(surfaces.normal_of, surfaces.normals, hit.face, hit.u, hit.v))
        graze = wp.dot(n, d)                       # a smooth normal must not look away from the eye
        if graze > -0.02:
            n = wp.normalize(n - (graze + 0.02) * d)
        p = view.eye + hit.t * d + LIFT * side * face
        samples.albedo[y, x] = wp.where(side < 0.0, BACK_SHADE, 1.0) * corner_mean(
            surfaces.color_of, surfaces.colors, hit.face, hit.u, hit.v)
    elif view.floor == 1 and wp.dot(d, view.up) < -1.0e-4:
        t = (view.ground - wp.dot(view.eye, view.up)) / wp.dot(d, view.up)
        if t > 0.0 and t < 200.0:
            what = GROUND
            p = view.eye + t * d + LIFT * view.up
    samples.what[y, x] = what
    samples.place[y, x] = p
    samples.normal[y, x] = n
    if what != BACKDROP:
        light[y, x] = sample_incoming_light(surfaces, view, p, n, i)


@wp.kernel
def smooth_light(samples: PixelSamples, view: CameraView, step: int, light: wp.array2d(dtype=wp.vec4),
                 light_out: wp.array2d(dtype=wp.vec4)):
    """Weights 1 2 1 in both directions at `step` pixels, among neighbours on the same surface."""
    y, x = wp.tid()
    what = samples.what[y, x]
    if what == BACKDROP:
        return
    p = samples.place[y, x]
    n = samples.normal[y, x]
    reach = 1.0 / (OFF_PLANE * wp.length(p - view.eye))
    total = 4.0 * light[y, x]
    weight = wp.float32(4.0)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            v = y + dy * step
            u = x + dx * step
            inside = v >= 0 and u >= 0 and v < light.shape[0] and u < light.shape[1]
            if inside and dy * dy + dx * dx > 0 and samples.what[v, u] == what:
                a = wp.max(wp.dot(n, samples.normal[v, u]), 0.0)
                a = a * a
                a = a * a
                a = a * a
                a = a * wp.max(0.0, 1.0 - reach * wp.abs(wp.dot(n, samples.place[v, u] - p)))
                a = a * float((2 - wp.abs(dx)) * (2 - wp.abs(dy)))
                total += a * light[v, u]
                weight += a
    light_out[y, x] = total / weight


@wp.func
def diffuse_radiance(view: CameraView, n: wp.vec3, E: wp.vec4):
    """Light that a white surface of normal n sends out."""
    return view.key * (E[0] * wp.max(wp.dot(n, view.light), 0.0)) + wp.vec3(E[1], E[2], E[3])


@wp.func
def tone_curve(c: float):
    """Linear up to 0.7, then a shoulder that reaches 1 at infinity."""
    if c <= 0.7:
        return c
    return 1.0 - 0.09 / (c - 0.4)


@wp.func
def encode_srgb(c: float):
    """Linear to sRGB byte (IEC 61966-2-1)."""
    c = wp.clamp(c, 0.0, 1.0)
    s = wp.where(c <= 0.0031308, 12.92 * c, 1.055 * wp.pow(c, 1.0 / 2.4) - 0.055)
    return wp.uint8(255.0 * s + 0.5)


@wp.func
def tile_shade(view: CameraView, p: wp.vec3, d: wp.vec3, height: int):
    """Share of light of a floor in squares, every second of which is darker, at a place p seen along d. Squares fade out where
    a pixel covers half of one."""
    if view.tile <= 0.0:
        return 1.0
    q = (p - wp.dot(p, view.up) * view.up) / view.tile
    squares = int(wp.floor(q[0] + 0.5)) + int(wp.floor(q[1] + 0.5)) + int(wp.floor(q[2] + 0.5))
    wide = wp.length(p - view.eye) * 2.0 * wp.length(view.above) / float(height) / wp.max(-wp.dot(d, view.up), 1.0e-3)
    return 1.0 - TILE_SHADE * float(squares & 1) * wp.clamp(1.0 - 2.0 * wide / view.tile, 0.0, 1.0)


@wp.func
def pixel_radiance(samples: PixelSamples, view: CameraView, light: wp.array2d(dtype=wp.vec4), y: int, x: int):
    """Linear colour of one traced pixel."""
    d = pixel_ray(view, y, x, light.shape[0], light.shape[1])
    rise = 1.0 - (float(y) + 0.5) / float(light.shape[0])
    c = wp.lerp(view.backdrop_low, view.backdrop_high, rise * rise * (3.0 - 2.0 * rise))
    what = samples.what[y, x]
    n = samples.normal[y, x]
    if what == GROUND:                              # the backdrop, darkened by what the light has lost there
        lit = diffuse_radiance(view, n, light[y, x])
        S = 0.8 * view.zenith + 0.2 * view.horizon                # cosine mean of `sky_radiance` over a free hemisphere
        free = diffuse_radiance(view, n, wp.vec4(1.0, S[0], S[1], S[2]))
        c = tile_shade(view, samples.place[y, x], d, light.shape[0]) * wp.cw_mul(c, wp.min(wp.cw_div(lit, free), wp.vec3(1.0)))
    if what == SURFACE:
        c = wp.cw_mul(samples.albedo[y, x], diffuse_radiance(view, n, light[y, x]))
        rim = 1.0 - wp.max(-wp.dot(n, d), 0.0)      # a little sheen at grazing angles
        c += (0.06 * rim * rim * rim) * wp.vec3(light[y, x][1], light[y, x][2], light[y, x][3])
    return c


@wp.func
def tone_map_color(c: wp.vec3):
    return wp.vec3(tone_curve(c[0]), tone_curve(c[1]), tone_curve(c[2]))


@wp.kernel
def develop_image(samples: PixelSamples, view: CameraView, light: wp.array2d(dtype=wp.vec4), image: wp.array3d(dtype=wp.uint8)):
    """Image of half the size: mean of 2 x 2 traced pixels, sRGB."""
    y, x = wp.tid()
    c = wp.vec3(0.0)
    for k in range(4):
        c += 0.25 * tone_map_color(pixel_radiance(samples, view, light, 2 * y + k // 2, 2 * x + k % 2))
    for k in range(3):
        image[y, x, k] = encode_srgb(c[k])
