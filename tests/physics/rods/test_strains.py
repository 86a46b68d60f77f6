"""Strains of rods: gradients against differences, and the device against the host."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels.rods import element
from wsim.physics.rods import shape

BEND = element.bend()
strains = BEND.strains


@wp.kernel(module="test_rod_strains", enable_backward=False)
def evaluate(X: wp.array(dtype=wp.vec3d), T: wp.array(dtype=wp.vec3d), M: wp.array(dtype=wp.vec3d),
             turn: wp.array(dtype=wp.float64), s: wp.array(dtype=wp.vec3d), g: wp.array(dtype=wp.mat33d),
             o: wp.array(dtype=wp.vec3d)):
    e0 = X[1] - X[0]
    e1 = X[2] - X[1]
    t0 = wp.normalize(e0)
    t1 = wp.normalize(e1)
    m0 = element.turned(t0, element.upright(t0, element.transport(T[0], t0, M[0])), turn[0])
    m1 = element.turned(t1, element.upright(t1, element.transport(T[1], t1, M[1])), turn[1])
    f = strains(t0, t1, wp.length(e0), wp.length(e1), m0, m1, wp.float64(0.0))
    s[0] = f.s
    g[0] = f.a
    g[1] = f.b
    o[0] = f.u
    o[1] = f.w


class Place:
    """Three points with directors that go along when points move, as in a substep."""

    def __init__(self, seed: int):
        rng = np.random.default_rng(seed)
        self.X = np.cumsum(np.array([1.0, 0.0, 0.0]) + 0.7 * rng.normal(size=(3, 3)), axis=0)
        self.T = shape.unit(np.diff(self.X, axis=0))
        m = np.cross(self.T, rng.normal(size=(2, 3)))
        self.M = shape.unit(m)

    def at(self, X: np.ndarray, turn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        s, g, o = wp.zeros(1, dtype=wp.vec3d, device="cpu"), wp.zeros(2, dtype=wp.mat33d, device="cpu"), wp.zeros(
            2, dtype=wp.vec3d, device="cpu")
        given = [wp.array(v, dtype=wp.vec3d, device="cpu") for v in (X, self.T, self.M)]
        wp.launch(evaluate, 1, [*given, wp.array(turn, dtype=wp.float64, device="cpu")], [s, g, o], device="cpu")
        return s.numpy()[0], g.numpy(), o.numpy()


@pytest.mark.parametrize("seed", range(4))
def test_gradients_of_curvature_and_twist_are_those_of_differences(seed):
    place, h = Place(seed), 1e-6
    _, g, o = place.at(place.X, (0.0, 0.0))
    wanted = np.stack([-g[0], g[0] - g[1], g[1]], axis=1)                       # of each strain, by point
    for i, c in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, c] = h
        found = (place.at(place.X + d, (0.0, 0.0))[0] - place.at(place.X - d, (0.0, 0.0))[0]) / (2.0 * h)
        assert found == pytest.approx(wanted[:, i, c], abs=1e-8)
    for j in range(2):
        d = np.eye(2)[j] * h
        assert (place.at(place.X, d)[0] - place.at(place.X, -d)[0]) / (2.0 * h) == pytest.approx(o[j], abs=1e-8)


def test_the_host_has_the_strains_of_the_device():
    place = Place(7)
    host = shape.strains(place.X[None], place.M[None])[0, 1]
    assert host == pytest.approx(place.at(place.X, (0.0, 0.0))[0], abs=1e-14)


def test_rigid_motions_do_not_strain():
    rng = np.random.default_rng(3)
    x, q = np.cumsum(rng.normal(size=(1, 9, 3)), axis=1), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    q *= np.linalg.det(q)
    m = shape.frames(x)
    assert shape.strains(x @ q.T + 5.0, m @ q.T) == pytest.approx(shape.strains(x, m), abs=1e-12)
    assert np.abs(shape.strains(x, m)[..., 2]).max() < 1e-12                    # frames without twist have none
