"""The warning of soft bodies that lose volume which the corotational law does not resist."""

import numpy as np
import pytest

from wsim import Bulk, Scene, Simulation
from wsim.kernels.soft.material import lame_parameters
from wsim.physics.soft import stored
from wsim.physics.soft.volume import LOST
from wsim.scene import shapes
from wsim.scene.curve import Motion

YOUNG = 1e5


def cube(nu: float, model: str = "corotational", quadratic: bool = False, by: float = 0.0, frames: int = 6) -> Scene:
    """A cube of 1 m whose top is pressed down by a part of its height."""
    scene = Scene(fps=24.0, frames=frames, gravity=(0.0, 0.0, 0.0), solver="implicit", integrator="backward_euler", substeps=4)
    points, tets = shapes.block((1.0, 1.0, 1.0), (3, 3, 3))
    soft = scene.soft("/cube", points, tets, material=Bulk(YOUNG, nu, 1000.0, model), quadratic=quadratic)
    way = np.tile(np.eye(4), (2, 1, 1))
    way[1, 2, 3] = -by
    scene.pin("/low", soft, np.flatnonzero(points[:, 2] < points[:, 2].min() + 1e-6))
    scene.pin("/high", soft, np.flatnonzero(points[:, 2] > points[:, 2].max() - 1e-6),
              motion=Motion(np.array([0.0, 0.75 * frames / 24.0]), way))
    return scene


def pressure(law: str, s: np.ndarray, mu: float, lam: float) -> float:
    """Mean Cauchy stress [Pa] at stretches s: a third of dPsi / d ln(size), over J; by central differences."""
    def psi(e: float) -> float:
        H = np.diag(s * (1.0 + e) - 1.0)[None]
        return float(stored.ENERGY[law](H, s[None] * (1.0 + e) - 1.0, np.array([mu]), np.array([lam]))[0])
    return (psi(1e-5) - psi(-1e-5)) / (2e-5 * 3.0 * np.prod(s))


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_lost_volume_is_that_of_a_uniform_stretch_by_both_laws(nu, quadratic):
    """1 - s1 s2 s3; and by neo_hookean that of the size at which the same shape has the same pressure, found by bisection on
    derivatives of the energies. To half a unit of the words."""
    sim = Simulation(cube(nu, quadratic=quadratic), device="cpu")
    sim.load()
    s = np.array([1.1, 1.15, 0.7])
    sim.state.x.assign((sim.state.x.numpy() * s).astype(np.float32))
    method = sim.plan.method("volume")
    method.look(sim.plan.clock)
    sim.plan.status.fetch()
    found = sim.plan.status.said(LOST)
    mu, lam = lame_parameters(YOUNG, nu)
    p, low, high = pressure("corotational", s, mu, lam), 0.5, 1.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if pressure("neo_hookean", s * middle, mu, lam) > p else (middle, high)
    assert found[0] == pytest.approx(1e4 * (1.0 - np.prod(s)), abs=1.0)
    assert found[1] == pytest.approx(1e4 * max(0.0, 1.0 - np.prod(s * low)), abs=1.0)


def test_a_pressed_cube_that_loses_volume_is_told_with_the_law_that_keeps_it():
    sim = Simulation(cube(0.49, by=0.3), device="cpu")
    sim.run(6)
    said = [str(w) for w in sim.warnings if "volume" in str(w)]
    assert len(said) == 1 and "/cube lost 1" in said[0] and 'wsim:elasticModel = "neo_hookean"' in said[0]


@pytest.mark.parametrize(("nu", "model", "by"), [(0.49, "neo_hookean", 0.3), (0.3, "corotational", 0.3),
                                                 (0.49, "corotational", 0.05)])
def test_what_another_law_would_not_keep_is_not_told(nu, model, by):
    """neo_hookean itself; a material that gives way to pressure, and loses as much by any law; a small change of shape."""
    sim = Simulation(cube(nu, model, by=by), device="cpu")
    sim.run(6)
    assert not [w for w in sim.warnings if "volume" in str(w)]
