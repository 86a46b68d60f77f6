"""What tests/physics/rigid/solver/test_sleep.py shares with other tests: asleep."""

from wsim.simulation.simulation import Simulation


def asleep(sim: Simulation) -> dict[str, bool]:
    method = sim.plan.method("rigid")
    values = method.part.arrays["asleep"].numpy()
    return {body.path: bool(values[k]) for k, (body, _) in enumerate(method.bodies)}
