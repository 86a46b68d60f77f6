"""Contact points of a simulation, from all methods that have some."""

from wsim.scene import Problem, SceneError
from wsim.scene.samples import ContactPoints, join_contact_points


def contacts_of_path(sim, path: str | None, world: int | None) -> ContactPoints:
    """Contact points as `Simulation.contacts` returns them."""
    if world is not None and (isinstance(world, bool) or world not in range(sim.worlds)):
        raise SceneError(Problem("world", f"there is no world {world}; allowed are 0 to {sim.worlds - 1}, or None for all"))
    if path is not None and path not in (there := _touching_paths(sim)):
        raise SceneError(Problem(path, "is no body and no collider that has contacts; there are "
                                 f"{', '.join(sorted(there)) or 'none'}; fix: name one of them"))
    found = join_contact_points(points for m in sim.plan.methods for points in m.contact_points(sim.plan.clock))
    if world is not None:
        found = found.rows(found.world == world)
    return found if path is None else found.seen_from(path)


def _touching_paths(sim) -> set[str]:
    """Paths of what may have contacts that are told."""
    scene = sim.scene
    return {each.path for each in (*scene.colliders, *scene.bodies(), *scene.things("Body"))}
