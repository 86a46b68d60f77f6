"""Surfaces that rub: a square of cloth on an incline, and on another cloth, sticks and slips about the angle atan(mu)."""

from dataclasses import replace

import numpy as np
import pytest

from tests.physics.contact.selfcontact.rig import run, said
from tests.physics.contact.selfcontact.rig import solvers as each
from wsim.scene import Pin, Plane, Scene, shapes
from wsim.scene.fabric import Fabric

G, MU, WITHIN = 9.81, 0.5, 1.0                                                        # WITHIN: degrees about atan(MU)
CLOTH = Fabric(stretch=60.0, shear=20.0, bend=1e-6, thickness=4e-3, density=100.0, static_friction=MU, dynamic_friction=MU)


def square(side: float, count: int, turn: float, height: float) -> tuple:
    """A sheet about the origin, turned about y [rad], at a height [m]."""
    points, counts, indices = shapes.sheet(side, side, count, count, horizontal=True)
    points = np.array(points, np.float64)
    points -= points.mean(axis=0)
    c, s = np.cos(turn), np.sin(turn)
    return points @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T + (0.0, height, 0.0), counts, indices


def incline(angle: float, on: str, **more) -> Scene:
    """A square of cloth on a plane, or on a pinned cloth, that falls by an angle [degrees] along x; of which one corner hangs
    free, since something of a cloth has to."""
    a = np.radians(angle)
    scene = Scene(gravity=(G * np.sin(a), -G * np.cos(a), 0.0), fps=60.0, **more)
    if on == "plane":
        scene.collider("/floor", Plane("Y"), static_friction=MU, dynamic_friction=MU)
    else:
        lower = square(0.2, 8, 0.0, 0.0)
        scene.cloth("/lower", *lower, material=CLOTH, self_collision=True)
        scene.pins.append(Pin("/pin", "/lower", range(len(lower[0]) - 1)))
    scene.cloth("/upper", *square(0.08, 4, 0.3, CLOTH.thickness * (0.5 if on == "plane" else 1.0)), material=CLOTH,
                self_collision=True)
    return scene


ROWS = [pytest.param(*row.values, on, id=f"{row.id}-{on}") for row in each() for on in ("plane", "cloth")]


@pytest.mark.parametrize("solver, on", ROWS)
def test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above(solver, on):
    """Below, it goes less than an angle of a hundredth of a degree too much would let it; above, as a block does."""
    frames, critical = 20, np.degrees(np.arctan(MU))
    time = frames / 60.0

    def block(angle: float) -> float:
        a = np.radians(angle)
        return 0.5 * G * (np.sin(a) - MU * np.cos(a)) * time**2

    for more in (-WITHIN, WITHIN):
        scene = incline(critical + more, on, **solver)
        sim = run(scene)
        sim.run(frames)
        gone = sim.positions("/upper") - scene.cloths[-1].points
        if more < 0.0:
            assert np.abs(gone[:, 0]).max() < block(critical + 0.01)
        else:
            h = 1.0 / 60.0 / scene.substeps
            assert np.abs(gone[:, 0] - block(critical + more)).max() < 0.02 * block(critical + more) * (1.0 + h / time)
        assert np.abs(gone[:, 1]).max() < 0.02 * CLOTH.thickness
        told = said(sim)
        assert told["cut"] == told["held"] == 0


@pytest.mark.parametrize("solver", each("newton", "newton midpoint"))
def test_a_square_of_cloth_that_slides_fast_on_another_passes_its_edges_as_a_block(solver):
    """Ten degrees above, by 0.7 mm a substep in the end, before it hangs over: rows to edges that are passed braked it by half.
    Backward Euler goes a (t^2 + h t) / 2."""
    frames, angle = 13, np.degrees(np.arctan(MU)) + 10.0
    a, time, h = np.radians(angle), frames / 60.0, 1.0 / 600.0
    scene = incline(angle, "cloth", **solver)
    sim = run(scene)
    sim.run(frames)
    block = 0.5 * G * (np.sin(a) - MU * np.cos(a)) * time * (time + h * (solver["integrator"] == "backward_euler"))
    gone = sim.positions("/upper") - scene.cloths[-1].points
    assert np.abs(gone[:, 0] - block).max() < 0.01 * block
    assert np.abs(gone[:, 1]).max() < 1e-3 * CLOTH.thickness and np.abs(gone[:, 2]).max() < 0.01 * block


def test_friction_that_is_less_lets_it_slide():
    scene = incline(np.degrees(np.arctan(MU)) - WITHIN, "cloth", **each("xpbd")[0].values[0])
    for cloth in scene.cloths:
        cloth.material = replace(cloth.material, static_friction=0.9 * MU, dynamic_friction=0.9 * MU)
    sim = run(scene)
    sim.run(20)
    assert (sim.positions("/upper") - scene.cloths[-1].points)[:, 0].min() > 5e-3


@pytest.mark.parametrize("solver", each("xpbd", "leapfrog"))
def test_friction_that_is_set_live_is_that_of_the_material(solver):
    """Of a cloth on a cloth without any collider: to the bit as if both had it from the start, and not as they have it."""
    scenes = [incline(10.0, "cloth", **solver) for _ in range(3)]
    smooth = replace(CLOTH, static_friction=0.05, dynamic_friction=0.02)
    for cloth in scenes[1].cloths:
        cloth.material = smooth
    sims = [run(scene) for scene in scenes]
    for path in ("/lower", "/upper"):
        sims[2].set(path, "static_friction", 0.05)
        sims[2].set(path, "dynamic_friction", 0.02)
    for sim in sims:
        sim.run(10)
    rough, made, live = (sim.positions("/upper") for sim in sims)
    assert np.array_equal(live, made)
    assert (live - rough)[:, 0].min() > 0.5 * 0.5 * G * (np.sin(np.radians(10.0)) - 0.02) * (10.0 / 60.0)**2
