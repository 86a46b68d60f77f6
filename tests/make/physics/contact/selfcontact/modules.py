"""What tests/physics/contact/selfcontact/test_modules.py shares with other tests: swept."""

import numpy as np

from tests.physics.contact.selfcontact.rig import SOLVERS, crumple, said
from wsim.physics.contact.selfcontact.rows import sweeps
from wsim.scene import Box, Motion
from wsim.simulation.simulation import Simulation


def swept(name: str, together: bool, device: str, monkeypatch) -> np.ndarray:
    """Places of a sheet that is thrown about and meets a box; together: by sweeps in one launch."""
    monkeypatch.setattr(sweeps, "TOGETHER", together)
    scene = crumple(0, 10, **SOLVERS[name])
    scene.collider("/box", Box((0.2, 0.05, 0.2)), motion=Motion.at_place((0.0, -0.1, 0.0)), static_friction=0.5)
    sim = Simulation(scene, device=device)
    sim.run(2)
    assert sim.plan.method("selfcontact").sweeper.fits() == together and said(sim)["near_pairs"] > 0
    assert sim.plan.method("contact").contacts.slots.count.numpy().any()
    return sim.state.x.numpy()
