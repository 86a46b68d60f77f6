"""What is refused, and what is warned of, each with its path and what to do."""

import numpy as np
import pytest

from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Motion, Scene
from wsim.scene.check.scene import check_scene
from wsim.scene.solids import Box, Sphere
from wsim.simulation.simulation import Simulation

ROOM = {"low": (0, 0, 0), "high": (1, 1, 1), "cell": 0.1}


def said(*things, wind=(0.0, 0.0, 0.0)) -> list[str]:
    scene = Scene(wind=wind)
    for thing in things:
        scene.add(thing)
    return [str(p) for p in check_scene(scene)]


@pytest.mark.parametrize(("more", "words"), [
    ({"high": (1, 0, 1)}, "its box is empty: 1 x 0 x 1 m"),
    ({"cell": 0.0}, "cell is 0"), ({"cell": 0.4}, "it has 2x2x2 cells"), ({"density": -1.0}, "density is -1"),
    ({"cell": 1e-4}, "it has 1e+12 cells"), ({"viscosity": np.nan}, "viscosity is nan"),
    ({"sides": ("open", "periodic") + ("open",) * 4}, "side -x is open and side +x is periodic"),
    ({"sides": ("periodic",) * 6, "high": (1.1, 1, 1)}, "periodic along x, with 11 cells"),
    ({"sides": ("open",) * 5}, "sides are"), ({"advection": "euler"}, "advection is 'euler'"),
    ({"smoke": np.zeros((3, 3, 3))}, "smoke at the start has shape (3, 3, 3)"), ({"most_steps": 0}, "most_steps is 0"),
    ({"velocity": np.full((10, 10, 10, 3), np.inf)}, "velocity holds NaN or infinity"),
    ({"conserve": True}, "it conserves smoke, and air passes side -x, which is open"),
    ({"conserve": True, "sides": ("closed",) * 6, "side_velocities": np.eye(6, 3)}, "air passes side -x, which is closed"),
    ({"conserve": True, "sides": ("closed",) * 6, "scalar_advection": "linear"}, "smoke that is carried by linear"),
    ({"margin": np.nan}, "margin is nan"), ({"margin": 0.5, "sides": ("closed",) * 6}, "no side is open"),
])
def test_a_fluid_that_cannot_be_run_is_refused(more, words):
    assert any(p.startswith("error: /f: ") and words in p for p in said(Fluid("/f", **(ROOM | more))))


@pytest.mark.parametrize(("more", "words"), [
    ({}, "nothing moves its air"), ({"high": (1.03, 1, 1)}, "its box is 10.3 x 10 x 10 cells"),
    ({"tolerance": 1e-9}, "tolerance is 1e-09"),
    ({"sides": ("closed",) * 6, "side_velocities": np.eye(6, 3)}, "air comes in through closed sides"),
    ({"side_velocities": np.eye(6, 3)}, "side -x is open and has a velocity"),
    ({"margin": 0.5, "velocity": np.ones((10, 10, 10, 3))}, "its air has a velocity at the start"),
])
def test_a_fluid_that_is_seldom_meant_is_warned_of(more, words):
    found = said(Fluid("/f", **(ROOM | more)))
    assert any(p.startswith("warning: /f: ") and words in p for p in found)
    assert not any(p.startswith("error: /f") for p in found)


@pytest.mark.parametrize(("more", "kind", "words"), [
    ({"motion": Motion.at_place((5, 5, 5))}, "warning", "it is outside of its fluids"),
    ({"fluid": "/g"}, "error", "it is a source of '/g'"), ({"smoke": 0.0}, "warning", "it gives nothing"),
    ({"shape": Sphere(-1.0)}, "error", "radius is -1"), ({"velocity": (np.nan, 0, 0)}, "error", "velocity holds NaN"),
])
def test_a_source_that_gives_nothing_is_told(more, kind, words):
    source = Source("/s", **({"shape": Sphere(0.1), "smoke": 1.0, "motion": Motion.at_place((0.5, 0.5, 0.5))} | more))
    assert any(p.startswith(f"{kind}: /s: ") and words in p for p in said(Fluid("/f", **ROOM), source))


@pytest.mark.parametrize(("place", "filled"), [((0.5, 0.5, 0.5), True), ((0.5, 0.5, 5.0), False)])
def test_an_obstacle_that_fills_the_box_is_warned_of_and_nothing_moves(place, filled):
    scene = Scene(frames=2, fps=20.0, gravity=(0.0, -9.81, 0.0))
    scene.add(Fluid("/f", (0, 0, 0), (1, 1, 0.125), 0.125))
    scene.add(Source("/s", Sphere(0.2), smoke=1.0, temperature=100.0, motion=Motion.at_place((0.5, 0.5, 0.0))))
    scene.collider("/block", Box((2.0, 2.0, 2.0)), at=place)
    assert any("warning: /f: /block fills all of it" in str(p) for p in check_scene(scene)) == filled
    sim = Simulation(scene, device="cpu")
    sim.run()
    assert (sim.indicators()["fluid_speed"] == 0.0) == filled and np.isfinite(sim.indicators()["fluid_smoke"])


def test_what_is_sound_is_not_complained_of():
    assert said(Fluid("/f", **ROOM), Source("/s", Sphere(0.1), smoke=1.0, motion=Motion.at_place((0.5, 0.5, 0.5)))) == []
