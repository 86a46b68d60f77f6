"""Which scenes share arrays as worlds in a sweep, and how many: by what they hold, and why others do not.

A world of a sweep must end with the bits of its run alone. So methods are named here in which one world would change a step,
or an iteration, of another.
"""

from wsim.scene import Scene
from wsim.scene.methods import has_self_collision, method_file

APART = "material points of all worlds share the length of their steps"
TOUCHING = "ropes that touch themselves or rigid bodies are solved together with those of all worlds"
SURFACES = "surfaces that collide with themselves are searched and swept together with those of all worlds"
EXACT = "contact_tolerance ends sweeps by the contacts of all worlds"
SLEEP = "bodies that may sleep are woken by a list of all worlds"
BLOWS = "blows on bodies with joints are swept together with those of all worlds"
BODY = 16              # rigid body in points of cloth, by what they take on a CPU
GRID = ("Fluid", "Liquid")


def reason_runs_go_apart(scene: Scene) -> str:
    """Why worlds of a scene share no arrays in a sweep; "" where they do."""
    if scene.things("MaterialPoints"):
        return APART
    if has_self_collision(scene):
        return SURFACES
    if not scene.things("Body"):
        return ""
    solids = method_file("Body", "solids")
    own = [c for body in scene.things("Body") for c in body.colliders]
    reasons = ((TOUCHING, bool(solids.bodies_met_by_strands(scene))), (EXACT, scene.contact_tolerance > 0.0),
               (SLEEP, solids.bodies_may_sleep(scene)),
               (BLOWS, bool(scene.things("Joint")) and any(c.restitution > 0.0 for c in [*scene.colliders, *own])))
    return next((why for why, some in reasons if some), "")


def size_of_world(scene: Scene) -> int:
    """Points of a world, and what takes as long as so many on a CPU."""
    found = sum(len(b.points) for b in scene.bodies()) + BODY * len(scene.things("Body"))
    found += sum(len(rods.points) for rods in scene.things("Rods"))
    return found + sum(fluid.cells for name in GRID for fluid in scene.things(name))
