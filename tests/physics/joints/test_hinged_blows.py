"""Elastic blows at bodies that hinges hold keep their energy: joints take part in the blow, and do not only mend it afterwards.

A hinged ball, mass m, radius r, at a distance l of its hinge, would leave a wall at (l^2 - 0.4 r^2) / (l^2 + 0.4 r^2) of its
speed if it were thrown as a free one first: 0.94 of it here, 0.82 of the energy behind three blows.
"""

from math import cos, degrees, sin

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tools.bench.rigid.answers.stage import NONE, Stage, turned
from wsim.physics.rigid.joints.joint import joint_between, locked_limits_except
from wsim.scene import Box, Sphere
from wsim.scene.fabric import Fabric

G, L = 9.81, 1.0


def hang(stage: Stage, name: str, r: float, x: float, y: float, angle: float) -> None:
    """A ball of 1 kg on a rod of length L without mass, hinged at (x, y, 0) about y."""
    at, turn = (x - L * sin(angle), y, -L * cos(angle)), turned((0.0, 1.0, 0.0), degrees(angle))
    body = stage.body(f"/{name}", Sphere(r), at, turn, rest=1.0, rub=0.0, mass=1.0)
    stage.scene.add(joint_between(f"/{name}_hinge", None, body, (x, y, 0.0), (0.0, 1.0, 0.0),
                                  limits=locked_limits_except("rotX")))


@pytest.mark.parametrize("rate", [(24.0, 10), (60.0, 8)])
def test_a_hinged_ball_at_a_wall_and_a_cradle_keep_their_energy(rate):
    stage, r = Stage(*rate), 0.2
    stage.collider("/wall", Box((0.5, 1.0, 1.0)), (0.5 + r, 0.0, -L), rest=1.0, rub=0.0)
    hang(stage, "ball", r, 0.0, 0.0, 0.3)
    for k in range(3):
        hang(stage, f"cradle{k}", 0.1, 0.2001 * k, 5.0, 0.5 * (k == 0))
    track = stage.run(3.0)
    rows = [track.row[name] for name in ("/ball", "/cradle0", "/cradle1", "/cradle2")]
    moments = 0.4 * np.array([r, 0.1, 0.1, 0.1])**2
    x, v, w = track.x[:, rows], track.v[:, rows], track.w[:, rows]
    energy = 0.5 * (v**2).sum(-1) + 0.5 * moments * (w**2).sum(-1) + G * (x[..., 2] + L)
    for one in (energy[:, 0], energy[:, 1:].sum(1)):
        assert np.abs(one / one[0] - 1.0).max() < 1e-3
    most = energy[0, 1:].sum() / G                                    # a frame may miss the top: 1/2 (1/48 s w)^2 of it
    assert abs((x[track.until(1.9), 3, 2] + L).max() / most - 1.0) < 0.5 * (np.sqrt(G / L) / 48.0)**2 + 5e-3
    assert np.ptp(v[:, 0, 0]) > 1.0 and (np.diff(np.sign(v[:, 0, 0])) < 0).sum() >= 2


@pytest.mark.parametrize("solver", first_and_slow(["xpbd", "explicit", "implicit"]))
def test_joints_take_part_in_blows_beside_a_cloth_too(solver):
    """A far cloth cuts the substeps of bodies in parts (kernels/rigid/touch/step.py). It was lost at the wall."""
    stage, r = Stage(24.0, 10, gravity=0.0, solver=solver), 0.2
    stage.collider("/wall", Box((0.5, 1.0, 1.0)), (0.75 + r, 0.0, -L), rest=1.0, rub=0.0)
    stage.scene.cloth("/sheet", np.array([(30.0, 0.0, 0.0), (31.0, 0.0, 0.0), (30.0, 1.0, 0.0)]), np.array([3]), np.arange(3),
                      material=Fabric(density=200.0, thickness=1e-3, stretch=1e3, shear=300.0))
    body = stage.body("/ball", Sphere(r), (0.0, 0.0, -L), NONE, (1.0, 0.0, 0.0), (0.0, -1.0 / L, 0.0), rest=1.0, rub=0.0,
                      mass=1.0)
    stage.scene.add(joint_between("/hinge", None, body, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), limits=locked_limits_except("rotX")))
    track = stage.run(1.0)
    energy = (track.v[:, 0]**2).sum(-1) + 0.4 * r * r * (track.w[:, 0]**2).sum(-1)
    assert track.v[-1, 0, 0] < -0.5 and np.abs(energy / energy[0] - 1.0).max() < 2e-3
