"""What tests/physics/joints/test_sleep.py shares with other tests: chain, sleepy."""

from dataclasses import replace

from tests.make.physics.rigid.contact import box, world
from wsim.physics.rigid.joints.joint import spherical_joint
from wsim.simulation.simulation import Simulation

DAMPED = {"drag": 3.0, "spin_drag": 3.0}


def chain(name: str, z: float = 0.0, n: int = 3, **last) -> list:
    """Boxes 0.4 m long that hang at y = 3, and their joints."""
    links = [box(f"/{name}{k}", (0.0, 2.8 - 0.4 * k, z), (0.05, 0.2, 0.05), **DAMPED, **(last if k == n - 1 else {}))
             for k in range(n)]
    return links + [spherical_joint(f"/{name}j{k}", links[k - 1] if k else None, links[k], at=(0.0, 3.0 - 0.4 * k, z))
                    for k in range(n)]


def sleepy(*things, speed: float = 0.05, device: str = "cpu", **more) -> Simulation:
    bodies = [thing for thing in things if hasattr(thing, "colliders")]
    scene = replace(world(*bodies, **more).given, sleep_speed=speed)
    for thing in things:
        if not hasattr(thing, "colliders"):
            scene.add(thing)
    return Simulation(scene, device=device)
