"""What tests/physics/contact/test_project_adjoint.py shares with other tests: SHAPES, SOLVERS, Slid, TOP, dropped."""

from dataclasses import replace

import numpy as np

from tests.make.gradient.gradients import Run, sheet
from wsim.scene import Box, Capsule, Cone, Cylinder, Plane, Sphere
from wsim.scene.check.sharp import has_edge_contacts
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

SHAPES = {"plane": Plane(), "sphere": Sphere(0.12), "box": Box((0.05, 0.06, 0.05)), "capsule": Capsule(0.06, 0.05),
          "cylinder": Cylinder(0.08, 0.05), "cone": Cone(0.1, 0.06)}
TOP = {"plane": 0.0, "sphere": 0.12, "box": 0.05, "capsule": 0.11, "cylinder": 0.05, "cone": 0.06}
SOLVERS = {"xpbd": {"solver": "xpbd", "integrator": "backward_euler", "substeps": 6, "iterations": 3},
           "leapfrog": {"integrator": "leapfrog", "substeps": 50}}


def dropped(shape="plane", friction=(0.5, 0.4), spin=0.0, gap=0.006, **more):
    """A free sheet that falls on a collider and slides; its corner is lowest. spin [rad/s] of the collider."""
    scene = sheet("springs", damping=2e-4, **more)
    scene.pins, scene.gravity, cloth = [], (1.0, 0.5, -9.8), scene.cloths[0]
    cloth.material = replace(cloth.material, static_friction=friction[0], dynamic_friction=friction[1])
    times = np.arange(5) / 60
    places = np.stack([np.eye(4)] * 5)
    places[:, 2, 3] = -TOP[shape] - gap + 0.1 * times
    places[:, 0, 0] = places[:, 1, 1] = np.cos(spin * times)
    places[:, 1, 0], places[:, 0, 1] = np.sin(spin * times), -np.sin(spin * times)
    scene.collider("/floor", SHAPES[shape], motion=Motion(times, places), static_friction=friction[0],
                   dynamic_friction=friction[1], thickness=0.0)
    return scene


class Slid(Run):
    """With the steps that contacts allow."""

    def plain(self) -> Simulation:
        """Not recorded; without gradients too, unless edges of the cloth meet the collider then."""
        return Simulation(self.scene, device="cpu", precision="float64", gradients=has_edge_contacts(self.scene))

    def by(self, name, step, within=3e-7):
        start = getattr(self.recording, name)(0, self.path)
        way = np.random.default_rng(6).normal(size=start.shape)
        found = (getattr(self.gradient, name)(self.path) * way).sum()
        self.check(found, lambda s: (self.path, name, start + s * way), step, within)
