"""What a length has gained, beyond the precision of its parts."""

from fractions import Fraction

import numpy as np
import pytest
import warp as wp

from tools.bench.gradients import sheet
from wsim.gradient.recording import Recording
from wsim.kernels.math.compensated import squared_length_gain
from wsim.simulation.simulation import Simulation

GPU = pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device here: run on a GPU machine")


@wp.kernel(module="unique")
def gains(x: wp.array2d(dtype=wp.vec3), d: wp.array2d(dtype=wp.vec3), rest: wp.array(dtype=float), left: wp.array(dtype=float),
          out: wp.array(dtype=float)):
    i = wp.tid()
    out[i] = squared_length_gain(x[0, i], x[1, i], d[0, i], d[1, i], rest[i], left[i])


@pytest.mark.parametrize("far", [0.0, 1.0, 1e3])
@pytest.mark.parametrize("strain", [0.0, 1e-7, 1e-4, -0.3, 2.0])
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=GPU)])
def test_it_is_that_of_its_parts_in_fractions(far, strain, device):
    """Springs of 5 cm, stretched by less than a float32 sees; moved by as much as they are long."""
    rng, n = np.random.default_rng(5), 200
    x = (rng.normal(size=(2, n, 3)) * 0.03 + far).astype(np.float32)
    d = (rng.normal(size=(2, n, 3)) * 0.03).astype(np.float32)
    r = (x[1].astype(float) - x[0]) + (d[1].astype(float) - d[0])
    length = np.linalg.norm(r, axis=1) / (1.0 + strain)
    rest = length.astype(np.float32)
    left = (length - rest).astype(np.float32)
    out = wp.zeros(n, dtype=float, device=device)
    given = [wp.array(a, dtype=wp.vec3, device=device) for a in (x, d)] + [wp.array(a, device=device) for a in (rest, left)]
    wp.launch(gains, n, given, [out], device=device)
    for k, found in enumerate(out.numpy()):
        parts = [sum(s * Fraction(float(p[q, k, a])) for p in (x, d) for q, s in ((1, 1), (0, -1))) for a in range(3)]
        square = (Fraction(float(rest[k])) + Fraction(float(left[k]))) ** 2
        exact = sum(p * p for p in parts) - square
        assert abs(Fraction(float(found)) - exact) < 1e-7 * abs(exact) + 1e-13 * square


def test_a_sheet_of_996_substeps_in_float32():
    """32 x 32 points, springs of 1 kN/m, leapfrog, 12 frames of 83 substeps: within 1e-4 of float64 by every initial position
    and every spring."""
    scene, found = sheet(32, 83), []
    for precision in ("float64", "float32"):
        recording = Recording(Simulation(scene, device="cpu", precision=precision, gradients=True), 12)
        last = recording.positions(12)
        gradient = recording.backward({12: last})
        found.append([last, gradient.positions(), gradient.material("stiffness", elements=True)])
    for exact, single in zip(*found, strict=True):
        assert np.linalg.norm(single - exact) < 1e-4 * np.linalg.norm(exact)
