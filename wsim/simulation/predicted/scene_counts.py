"""Counts of what methods besides those of points do in a frame of one world, as their rows in `wsim.scene.methods` name them;
`wsim.simulation.cost` says how long it takes. All take a scene, substeps a frame and whether a GPU takes them."""

from math import ceil

import numpy as np

from wsim.scene import Scene, Surface
from wsim.scene.solids import shape_row

COLOURS = 8            # of clusters that overlap, by cubes
# seconds of a particle on a CPU by its law, over those of a row's cost: what a law needs of principal stretches (tools/results)
LAW_WEIGHT = {"neo_hookean": 0.6, "corotational": 1.0, "snow": 1.1, "sand": 1.25}


def count_clusters(model, choice) -> dict[str, float]:
    """Projections of colours and of members, and substeps of members, of shape matching by a choice; of all worlds."""
    found = {"matched": 0.0, "member": 0.0, "spun": 0.0}
    for body in (body for body in model.scene.bodies() if body.is_cluster):
        sizes = [len(group) for group in body.groups]
        colours = 1 if sum(sizes) <= len(body.points) else min(len(sizes), COLOURS)
        found["matched"] = max(found["matched"], choice.substeps * choice.iterations * colours)
        found["member"] += choice.substeps * choice.iterations * sum(sizes) * model.worlds
        found["spun"] += choice.substeps * sum(sizes) * model.worlds
    return found


def count_rigid(scene: Scene, n: int, chained: bool) -> dict[str, float]:
    """Points of contact and joints of the substeps of rigid bodies: those that touch at the start, two of each body at least.
    On a GPU joints of the longest chain alone count: it takes chains one after the other."""
    bodies, joints = scene.things("Body"), scene.things("Joint")
    if not bodies:
        return {}
    from wsim.simulation.predicted.touching import touching_pairs
    _, found = touching_pairs(scene, bodies)
    return {"rigid": n, "contact": n * max(int(found.count.sum()), 2 * len(bodies)),
            "joint": n * (longest_chain(joints) if chained else len(joints))}


def longest_chain(joints: list) -> int:
    """Joints of the largest group of bodies that joints hold together."""
    group: dict[str, list] = {}
    for joint in joints:
        ends = [path for path in (joint.body0, joint.body1) if path]
        members = list({id(found): found for path in ends for found in [group.get(path, [path])]}.values())
        merged = [path for member in members for path in member]
        group.update(dict.fromkeys(merged, merged))
    return max((sum((joint.body0 or joint.body1) in members for joint in joints) for members in group.values()), default=0)


def count_smoke(scene: Scene, n: int, cuda: bool) -> dict[str, float]:
    """Domains, their cells, and cells times obstacles and sources, and of domains with sheets in them, of a frame."""
    from wsim.physics.fluid.objects import meets_bodies
    found = _count_cells(scene, scene.things("Fluid"), [fluid for fluid in scene.things("Fluid") if meets_bodies(fluid)])
    found["emitted"] = sum(fluid.elements * sum(s.fluid in ("", fluid.path) for s in scene.things("Source"))
                           for fluid in scene.things("Fluid"))
    return found


def count_liquids(scene: Scene, n: int, cuda: bool) -> dict[str, float]:
    """Domains, cells and sources as of smoke, and tanks and particles."""
    from wsim.physics.fluid.liquid.seeds import estimated_particles
    found = _count_cells(scene, scene.things("Liquid"), scene.things("Liquid")) | {"tank": len(scene.things("Liquid"))}
    found["drop"] = sum(estimated_particles(liquid, scene) for liquid in scene.things("Liquid"))
    found["emitted"] = sum(liquid.elements * sum(s.liquid in ("", liquid.path) and s.role != "start"
                                                 for s in scene.things("LiquidSource")) for liquid in scene.things("Liquid"))
    return found


def _count_cells(scene: Scene, domains: list, open_to_sheets: list) -> dict[str, float]:
    """open_to_sheets: those of the domains in which cloth and soft bodies are walls."""
    cells = sum(domain.elements for domain in domains)
    sheets = any(body.has_surface for body in scene.bodies())
    return {"grid": len(domains), "cell": cells, "walled": cells * len(scene.colliders),
            "sheeted": sum(domain.elements for domain in open_to_sheets) * sheets}


def count_strands(scene: Scene, n: int, cuda: bool) -> dict[str, float]:
    """Substeps of strands and of their points: alone, or among bodies and each other."""
    rods = scene.things("Rods")
    each, one = ("ropes", "rope") if scene.things("Body") or any(r.self_collision for r in rods) else ("rods", "rod")
    return {each: n, one: n * sum(len(r.points) for r in rods)} if rods else {}


def count_material_points(scene: Scene, n: int, cuda: bool) -> dict[str, float]:
    """Steps of material points and of their particles, explicit or implicit: as many as the materials need, at rest or as
    stiff as an impact makes them, and as they are fast. More where something else crushes or flings them."""
    things = scene.things("MaterialPoints")
    if not things:
        return {}
    from wsim.physics.mpm.implicit.choice import chosen_integrator, explicit_steps, materials_of
    from wsim.physics.mpm.memory import estimated_particles
    particles, cell = sum(estimated_particles(thing, scene) for thing in things), things[0].cell
    pushes = bool(scene.things("Body") or scene.bodies())
    if chosen_integrator(things, scene.fps, pushes) == "implicit":
        speed = max(float(np.linalg.norm(np.atleast_2d(thing.velocity), axis=1).max(initial=0.0)) for thing in things)
        crossed = 2.0 if things[0].material.law == "sand" else 1.0            # cells in a step, at most
        steps = max(1, ceil(speed / (crossed * cell * scene.fps)))
        return {"long": steps, "solved_particle": steps * particles}
    speeds = [impact_speed(thing, scene) for thing in things]
    steps = ceil(max(explicit_steps(material, cell, scene.fps, speed)[0] for thing, speed in zip(things, speeds, strict=True)
                     for material in materials_of([thing])))
    weights = [1.0 if cuda else LAW_WEIGHT.get(material.law, 1.0) for material in materials_of(things)]
    meshes = steps * sum(isinstance(c.shape, Surface) for c in scene.colliders)
    return {"transfer": steps, "particle": steps * particles * float(np.mean(weights)), "pushed": steps * pushes,
            "meshed": meshes, "enclosed": meshes * particles}


def impact_speed(thing, scene: Scene) -> float:
    """Speed [m/s] with which a body of material points comes down: that of its start, and of its fall to the highest collider
    that begins below it, v^2 = v_0^2 + 2 g H; without one, that of its start."""
    speed = float(np.linalg.norm(np.atleast_2d(thing.velocity), axis=1).max(initial=0.0))
    g = np.asarray(scene.gravity, np.float64)
    if not np.any(g):
        return speed
    up, bottom = -g / np.linalg.norm(g), float("inf")
    for x in (thing.points, None if thing.shape is None else outline_points(thing.shape)):
        if x is not None and len(x):
            bottom = min(bottom, float((thing.motion.points(x, 0.0) @ up).min()))
    tops = [float((c.motion.points(outline_points(c.shape), 0.0) @ up).max()) for c in scene.colliders]
    fall = min((bottom - top for top in tops if top < bottom), default=0.0)
    return float(np.sqrt(speed**2 + 2.0 * np.linalg.norm(g) * max(0.0, fall)))


def outline_points(shape) -> np.ndarray:
    """Points of a shape, in its own frame [m], (n, 3)."""
    if isinstance(shape, Surface):
        return shape.points.astype(np.float64)
    row = shape_row(shape)
    return row.outline(row.given(shape), 16)[0]
