"""What tests/gpu/solver/test_sheet_contacts.py shares with other tests: run."""

import wsim
from wsim.scene import Scene


def run(scene: Scene, frames: int = 4):
    sim = wsim.Simulation(scene, device="cuda:0")
    for _ in range(frames):
        sim.step()
    contacts = sim.plan.ports.contacts
    pushes = contacts.impulses(sim.plan.clock.effective_step)
    return sim, sim.state.x.numpy(), sim.state.v.numpy(), pushes, contacts.mark.numpy()
