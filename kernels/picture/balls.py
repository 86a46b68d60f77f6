"""Ray casting of balls beside the triangles of ray.py: particles, round at any distance, each by its own radius and colour.

A ray q + t d meets a ball of centre c and radius r first at

    t = -b - sqrt(r^2 - |e|^2),    b = (q - c) . d,    e = (q - c) - b d

e is the way from the ray's nearest point to the centre: written so, the root keeps its digits far from the ball (Haines et al.
2019, Ray Tracing Gems, chapter 7). Balls stand in a tree of boxes; a ray passes what lies behind the nearest hit so far. A ball
that the eye or a secondary ray begins in is not met. Lengths as in ray.py, float32 only.
"""

import warp as wp

from wsim.kernels.picture import ray

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

SAMPLES = wp.constant(4)          # of the light at a ball: neighbours share less of it than on a surface


@wp.struct
class BallScene:
    tree: wp.uint64                          # of the boxes about all balls
    centers: wp.array(dtype=wp.vec3)
    radii: wp.array(dtype=wp.float32)
    colors: wp.array(dtype=wp.vec3)          # linear albedo


@wp.func
def ball_distance(q: wp.vec3, d: wp.vec3, r: float):
    """Way along the unit vector d to a ball of radius r about the origin, from q outside of it; below 0: it is not met."""
    b = wp.dot(q, d)
    e = q - b * d
    root = r * r - wp.dot(e, e)
    if root < 0.0 or b > 0.0:
        return -1.0
    return -b - wp.sqrt(root)


@wp.func
def nearest_ball(balls: BallScene, start: wp.vec3, d: wp.vec3, most: float):
    """Way to the nearest ball within `most`, and its number; -1: there is none."""
    query = wp.bvh_query_ray(balls.tree, start, d)
    best = wp.float32(most)
    found = int(-1)
    k = int(0)
    while wp.bvh_query_next(query, k, best):
        t = ball_distance(start - balls.centers[k], d, balls.radii[k])
        if t > 0.0 and t < best:
            best = t
            found = k
    return best, found


@wp.func
def meets_ball(balls: BallScene, start: wp.vec3, d: wp.vec3):
    """Whether a ray meets any ball."""
    query = wp.bvh_query_ray(balls.tree, start, d)
    k = int(0)
    while wp.bvh_query_next(query, k):
        if ball_distance(start - balls.centers[k], d, balls.radii[k]) > 0.0:
            return True
    return False


@wp.func
def sample_light_with_balls(surfaces: ray.RayScene, balls: BallScene, view: ray.CameraView, p: wp.vec3, n: wp.vec3, i: int):
    """One sample of the light at p, as `ray.sample_incoming_light`."""
    u = ray.hammersley_point(i)
    r = wp.sqrt(u[0])
    phi = 6.2831853 * u[1]
    disc = wp.vec3(r * wp.cos(phi), r * wp.sin(phi), 0.0)
    visible = wp.float32(0.0)
    toward = wp.normalize(view.light + view.spread * (ray.frame_about_normal(view.light) * disc))
    if wp.dot(toward, n) > 0.0 and not wp.mesh_query_ray_anyhit(surfaces.mesh, p, toward, ray.FAR):
        if not meets_ball(balls, p, toward):
            visible = 1.0
    w = ray.frame_about_normal(n) * wp.vec3(disc[0], disc[1], wp.sqrt(wp.max(0.0, 1.0 - u[0])))
    S = ray.sky_radiance(view, w)
    most = wp.float32(ray.FAR)
    hit = wp.mesh_query_ray(surfaces.mesh, p, w, ray.FAR)
    if hit.result:
        S = ray.BOUNCE * surfaces.colors[surfaces.color_of[hit.face][0]]
        most = hit.t
    t, k = nearest_ball(balls, p, w, most)
    if k >= 0:
        S = ray.BOUNCE * balls.colors[k]
    return wp.vec4(visible, S[0], S[1], S[2])


@wp.kernel
def trace_rays_with_balls(surfaces: ray.RayScene, balls: BallScene, view: ray.CameraView, samples: ray.PixelSamples,
                          light: wp.array2d(dtype=wp.vec4)):
    """Behind `ray.trace_primary_rays`: balls before what each pixel sees, and the light there with their shadows."""
    y, x = wp.tid()
    d = ray.pixel_ray(view, y, x, light.shape[0], light.shape[1])
    i = ((x & 7) + 8 * (y & 7)) * 37 & 63
    what = samples.what[y, x]
    most = wp.float32(ray.FAR)
    if what != ray.BACKDROP:
        most = wp.dot(samples.place[y, x] - view.eye, d)
    t, k = nearest_ball(balls, view.eye, d, most)
    if k < 0:
        if what != ray.BACKDROP:
            light[y, x] = sample_light_with_balls(surfaces, balls, view, samples.place[y, x], samples.normal[y, x], i)
        return
    p = view.eye + t * d
    n = wp.normalize(p - balls.centers[k])
    p = p + ray.LIFT * n
    samples.what[y, x] = ray.SURFACE
    samples.place[y, x] = p
    samples.normal[y, x] = n
    samples.albedo[y, x] = balls.colors[k]
    total = wp.vec4()
    count = int(SAMPLES)
    for m in range(count):
        total += sample_light_with_balls(surfaces, balls, view, p, n, (i + 16 * m) & 63)
    light[y, x] = total / float(SAMPLES)
