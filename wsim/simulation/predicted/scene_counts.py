"""Counts of what other methods than those of points do in a frame, from which `wsim.simulation.cost` says how long it takes."""

from wsim.scene import Scene


def count_others(scene: Scene, chained: bool) -> tuple[dict[str, float], dict[str, float]]:
    """Counts of the work of rigid bodies in a substep and of fluids in a frame; chained: of joints the longest chain alone."""
    return count_rigid(scene, chained), count_fluids(scene)


def count_rigid(scene: Scene, chained: bool) -> dict[str, float]:
    """Points of contact and joints of a substep of rigid bodies: those that touch at the start, two of each body at least.
    chained: joints of the longest chain alone count."""
    bodies, joints = scene.things("Body"), scene.things("Joint")
    if not bodies:
        return {}
    from wsim.simulation.predicted.touching import touching_pairs
    _, found = touching_pairs(scene, bodies)
    return {"rigid": 1, "contact": max(int(found.count.sum()), 2 * len(bodies)),
            "joint": longest_chain(joints) if chained else len(joints)}


def longest_chain(joints: list) -> int:
    """Joints of the largest group of bodies that joints hold together."""
    group: dict[str, list] = {}
    for joint in joints:
        ends = [path for path in (joint.body0, joint.body1) if path]
        members = list({id(found): found for path in ends for found in [group.get(path, [path])]}.values())
        merged = [path for member in members for path in member]
        group.update(dict.fromkeys(merged, merged))
    return max((sum((joint.body0 or joint.body1) in members for joint in joints) for members in group.values()), default=0)


def count_fluids(scene: Scene) -> dict[str, float]:
    """Domains, their cells, cells times obstacles and sources, and particles of liquids, of a frame."""
    if not (scene.things("Fluid") or scene.things("Liquid")):
        return {}
    found = dict.fromkeys(("grid", "cell", "walled", "emitted", "tank", "drop"), 0.0)
    for fluid in (*scene.things("Fluid"), *scene.things("Liquid")):
        found["grid"] += 1
        found["cell"] += fluid.elements
        found["walled"] += fluid.elements * len(scene.colliders)
    for fluid in scene.things("Fluid"):
        found["emitted"] += fluid.elements * sum(s.fluid in ("", fluid.path) for s in scene.things("Source"))
    for liquid in scene.things("Liquid"):
        from wsim.physics.fluid.liquid.seeds import estimated_particles
        found["tank"] += 1
        found["drop"] += estimated_particles(liquid, scene)
        found["emitted"] += liquid.elements * sum(s.liquid in ("", liquid.path) and s.role != "start"
                                                  for s in scene.things("LiquidSource"))
    return found
