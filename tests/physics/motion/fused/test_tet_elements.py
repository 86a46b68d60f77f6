"""Tets as blocks that stay take them (CUDA code, here compiled for the CPU): the forces of kernels/soft/fem.py, by rounding."""

from functools import cache

import numpy as np
import pytest
import warp as wp

from wsim.kernels.motion.fused import sheet_elements, tet_elements
from wsim.kernels.soft import fem
from wsim.kernels.soft.material import TABLE

ROUNDING = 2e-5        # of the largest force of a tet: where it is pressed to a third terms cancel
SHIM = """
#define fmaf(a, b, c) ((a) * (b) + (c))
#define fabsf(a) wp::abs(a)
#define sqrtf(a) wp::sqrt(a)
#define fmaxf(a, b) wp::max(a, b)
#define fminf(a, b) wp::min(a, b)
    struct float4 { float x, y, z, w; };
    struct uint2 { unsigned x, y; };
    auto make_float4 = [](float x, float y, float z, float w) { float4 r; r.x = x; r.y = y; r.z = z; r.w = w; return r; };
    auto make_uint2 = [](unsigned x, unsigned y) { uint2 r; r.x = x; r.y = y; return r; };
    auto word = [](float a) { int i; __builtin_memcpy(&i, &a, 4); return i; };
    auto real = [](int i) { float a; __builtin_memcpy(&a, &i, 4); return a; };
    constexpr int TETS = 1, flat = 0, bent = 0;
    constexpr bool DAMPED = true;
    float room[12];
    float4 one[1];
    float* const F = room;
    float4* const R = one;
    float4 X[4], d[4], q[4], T[6];
    for (int k = 0; k < 4; ++k) {
        d[k] = make_float4(place_of.data[k][0], place_of.data[k][1], place_of.data[k][2], 0.f);
        q[k] = make_float4(rate_of.data[k][0], rate_of.data[k][1], rate_of.data[k][2], 0.f);
        X[k] = make_float4(0.f, 0.f, 0.f, 0.f);
    }
    const float own[3] = {mu, lam, tau};
    const int words[3] = {0, 1 << 16, 2 | 3 << 16};
    for (int k = 0; k < 3; ++k) {
        T[k] = make_float4(edge.data[k][0], edge.data[k][1], edge.data[k][2], own[k]);
        T[3 + k] = make_float4(slope.data[k][0], slope.data[k][1], slope.data[k][2], real(words[k]));
    }
    R[0] = make_float4(warm[0], warm[1], warm[2], warm[3]);
"""


@cache
def march(material: str):
    """Kernel over tets: forces at their corners, and rotations."""
    text = SHIM + sheet_elements.ARITHMETIC + tet_elements.tet_pass_code((material,)) + """
    tet(0, d, q);
    wp::mat_t<4, 3, float> f;
    for (int k = 0; k < 4; ++k) for (int j = 0; j < 3; ++j) f.data[k][j] = F[4 * j + k];
    return f;
"""
    for name, meant in {"RECIPROCAL": "1.f / ", "RSQRT": "1.f / sqrtf", "FLOAT_AS_INT": "word"}.items():
        text = text.replace(name, meant)
    four = wp.types.matrix((4, 3), wp.float32)

    @wp.func_native(text)
    def forces(place_of: four, rate_of: four, edge: wp.mat33, slope: wp.mat33, mu: float, lam: float, tau: float,
               warm: wp.quat) -> four: ...

    @wp.kernel(module="unique", enable_backward=False)
    def march(place_of: wp.array(dtype=four), rate_of: wp.array(dtype=four), tets: fem.elements(wp.float32),
              warm: wp.array(dtype=wp.quat), f_out: wp.array(dtype=four)):
        c = wp.tid()
        f_out[c] = forces(place_of[c], rate_of[c], tets.edge[c], tets.gradient[c], tets.volume[c] * tets.mu[c],
                          tets.volume[c] * tets.lam[c], tets.tau[c], warm[c])

    return march


def state(kind: str, n: int = 400):
    """Deformation gradients of n tets, (n, 3, 3), and quaternions that are near their rotations, or not."""
    g = np.random.default_rng(len(kind))
    F = np.eye(3) + {"small": 1e-3, "large": 0.3, "any": 2.0, "flat": 0.0, "shrunk": 0.0}[kind] * g.normal(size=(n, 3, 3))
    if kind == "flat":
        F[:, 2] = 0.0
    if kind == "shrunk":
        F[:] = 0.3 * g.normal(size=(n, 3, 3))
    turn = g.normal(size=(n, 4)) * [[0.3, 0.3, 0.3, 0.0]] + [[0.0, 0.0, 0.0, 1.0]]
    return F, turn / np.linalg.norm(turn, axis=1)[:, None]


@pytest.mark.parametrize("kind", ["small", "large", "any", "flat", "shrunk"])
@pytest.mark.parametrize("material", sorted(TABLE))
def test_forces_are_those_of_launch_by_launch(material, kind):
    F, warm = state(kind)
    n, g = len(F), np.random.default_rng(0)
    rest = np.array([[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.2, 0.1, 0.8]]) + 0.1 * g.normal(size=(n, 4, 3))
    edges = rest[:, 1:] - rest[:, :1]
    slopes = np.linalg.inv(edges).swapaxes(1, 2)
    x = np.einsum("nij,nkj->nki", F, rest)
    rate = 10.0 * g.normal(size=(n, 4, 3))
    real, vec3 = np.float32, wp.vec3
    tets = fem.elements(wp.float32)()
    tets.point = wp.array(np.arange(4 * n, dtype=np.int32).reshape(n, 4), dtype=wp.vec4i, device="cpu")
    for name, value, dtype in (("edge", edges, wp.mat33), ("gradient", slopes, wp.mat33), ("volume", g.uniform(1, 2, n), float),
                               ("mu", g.uniform(1, 2, n), float), ("lam", g.uniform(1, 9, n), float),
                               ("tau", g.uniform(0.0, 0.02, n), float)):
        setattr(tets, name, wp.array(value.astype(real), dtype=dtype, device="cpu"))

    def uploaded(values, dtype=vec3):
        return wp.array(np.ascontiguousarray(values, real), dtype=dtype, device="cpu")
    start, moved = x[:, :1] * 0.0 + rest, x - rest
    want, turned, q = wp.zeros(4 * n, dtype=vec3, device="cpu"), uploaded(warm, wp.quat), uploaded(warm, wp.quat)
    wp.launch(fem.forces(material, True, real=wp.float32, module="tets_launched"), n,
              [tets, uploaded(start.reshape(-1, 3)), uploaded(moved.reshape(-1, 3)), uploaded(rate.reshape(-1, 3)), q],
              [want, turned], device="cpu")
    four = wp.types.matrix((4, 3), wp.float32)
    found, edge = wp.zeros(n, dtype=four, device="cpu"), tets.edge
    tets.edge = uploaded(start[:, 1:].astype(real) - start[:, :1].astype(real) - edge.numpy(), wp.mat33)
    wp.launch(march(material), n, [uploaded(moved, four), uploaded(rate, four), tets, q], [found], device="cpu")
    f, w = found.numpy(), want.numpy().reshape(n, 4, 3)
    apart = np.abs(f - w).max(axis=(1, 2)) / np.abs(w).max(axis=(1, 2))
    assert apart.max() < ROUNDING and np.median(apart) < 1e-6 and np.abs(w).max() > 1.0
