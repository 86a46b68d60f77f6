"""Seconds that a frame takes by each solver, known before any is run: what it does, counted, times what each costs.

    counts     how often a frame of a plan does what COSTS has the seconds of, by name
    COSTS      by kind of device, as the rows of methods state them (`wsim.scene.values.cost.MethodCost`), fitted to what
               tools/bench/choice/misses.py measured (tools/results/data/choice_*.json), which prints the fitted constants;
               nothing is timed at build

    step, spring, element       a substep of leapfrog (one more for each kind of element), a spring in it, an element by weight
    blown                       a substep of it in which air acts
    packed, beside, aired       sheets in packets (CPU): an element by weight; a point, where others act within a substep, and
                                where one of them is air
    block, tet                  a substep of soft bodies, a tet in it; ten-node tets count TEN, those of a CPU that packets do
                                not take ALONE
    rest, sweep, projection     a substep of XPBD, a sweep over a kind of constraint, a constraint in it by its weight
    newton, solved              a Newton step of soft bodies, a tet in it; of a GPU `cluster_solves_bodies` besides
    assembled                   a constraint, by its weight, in a Newton step of sheets
    gradient, conjugate         such a step, and a point in it, times the root of omega h, as the iterations of its solve go;
    iterated                    instead of both where a cluster of blocks iterates
    pressed                     what contacts add to such a step, and to a system
    touch, near                 a launch for contacts (a search a substep, a projection an iteration), a point beside a collider
    mesh, wide                  a search of a mesh in a substep; a point beside one, by the seconds of a substep: it looks as
                                far as it goes
    surfaces, surfaced          what self-contact adds to a substep, and a point in it, where something is near (else nothing)
    met, damped, body           what a frame is said to take besides (`count_frame_of_choice`), which no choice depends on: a
    point that may
                                touch a convex shape, in a substep; a damped tet in a Newton step, times sqrt(1 + damping
                                time / step), as the iterations of its solve go; a rigid body, or what else
                                other methods move, in a substep
    rigid, contact, joint       a substep of rigid bodies, a point of contact in it, a joint; on a GPU, which takes chains one
                                after the other, a joint of the longest chain
    rods, rod, ropes, rope      a substep of strands that are solved for one by one, a point of them in it; of such as may touch
                                each other, or rigid bodies, likewise
    grid, cell                  an object that says of how many `elements` it is made, a frame; an element of it
    walled, emitted             an element beside each collider's obstacles, and beside each source
    sheeted                     an element of a domain in which cloth or a soft body is a wall: what a sheet covers of it
    tank, drop                  a liquid, a frame; a particle that it has at the start
    transfer, particle          an explicit step of material points; a particle in it, on a CPU by the weight of its law
    pushed                      what bodies and surfaces that they push add to such a step
    meshed, enclosed            and what each mesh that collides does: a step, and a particle in it
    long, solved_particle       an implicit one; a particle in it
    sheet, shared, sent         a substep of sheets and tets that blocks share, the work of a block, what a grid of them takes
                                to send places, or velocities (H200, tools/bench/choice/blocks.py: blocks_h200.json)
    struck, tried, faced        what convex colliders add to it, each of them, and a mesh (H200: a sheet of 33 x 33 on 16, 100
                                and 225 balls; a shirt on its dummy)
    limited                     and strain limits of eight colours (H200: that sheet), of a grid twice that
    cluster, clustered          a substep of a net that a cluster of blocks takes in one launch a frame, a point in it
"""

from math import inf, sqrt

import numpy as np

from wsim.model.model import Model
from wsim.physics.cloth.kind import SPRINGS, kind_row
from wsim.scene import Surface
from wsim.scene.methods import (
    METHODS,
    MethodRow,
    each_method_object,
    feels_air,
    has_self_collision,
    has_tets,
    loads_on_deformables,
    solid_materials,
)

# GPU: an H100, frames of ten scenes by leapfrog, XPBD and Newton's method (tools/bench/nets/garments.py: in one launch where
# that is the default), which are said to take 0.6 to 1.3 of what they do. What only large scenes tell is an H200's: nets that a
# cluster takes 0.42 us a substep at 1k points, 1.06 at 8k; XPBD 14 colours of 2 us, 2.1e-11 s a spring
# (choice_h200.json); tets 112 us a substep of 976k, a Newton step of these 4.3 to 8 ms
# (soft_h200.json); contacts 19 to 25 us to find and 7 to project a million points that touch nothing (contact_h200.json), 57 to
# find 6.4k points of a shirt by 96 substeps of 1/24 s, 493 to find 102k by 56 (tools/kernels.py garment:shirt_102k:fps30).
# Choices among the runs that choice_h200.json has measured: 2 of 35 take over 1.3 times the fastest that errs by less than
# wanted, 1.54 times at most (tools/bench/choice/costs.py replays it), beside 2 of soft bodies, whose iterations are not in it
# Newton steps of sheets on a CPU, 12 to 40 points a side (choice_newton_cpu.json): 0.6 to 1.2, below omega h of 200
# Cells of a fluid: fluids_h200.json. CPU: one core of an EPYC (choice_epyc_2_cores.json); met, damped, body, cell fitted to
# the examples (tools/bench/choice/said.py, said_cpu.json); packed, beside, aired: sheets of 16 to 72 cells a side, one thread,
# least CPU seconds of 6 to 12 frames, said to take 0.9 to 1.3 of what they do (12k points, which leave the cache: 0.6)
# surfaces, surfaced: two falling layers 2 mm apart of 9, 17 and 25 points a side, 24 to 80 substeps (one core, others busy: 2.1
# to 3.3, 6.6 and 17 to 24 ms a substep, by leapfrog as by XPBD); of a GPU what the twist of 50k points takes, 19 to 30 ms by 24
# rigid to drop: CPU, medians of bricks, dominoes, a pyramid, an arch, cards, a humanoid, a plume, 1, 20 and 100 sources, a dam,
# a tank: said to take 0.6 to 1.4 of their frames (one core); H200: scenes_h200.json, a pile of 1000 bodies, a tank of a million
# particles (tools/results/fluids.md); no scene there has many sources
# sheeted: the waved flag, one core and H200 (20 thousand cells; what a large grid takes there is not measured). pushed to
# enclosed: the sand castle and the hourglass, likewise
# transfer to solved_particle: CPU, jelly and sand of 64 to 32768 particles, 2.8e-7 and 5e-7 s a particle; H200, 97k and 1M of
# jelly (tools/results/material_points.md); implicit sand of 512 and 4096 (CPU), of 221k and 1.8M (H200, by 100 sweeps)
# rods to rope: CPU, hairs of 32 points on a ball, a shaken head, a knot, a net under three bodies: said to take 0.5 to 1.4 of
# their frames in the mean; H200: 100 and 10000 hairs (3 to 15 ms by 4), 4 ropes under a box and 64 under 16 (60 and 91 ms by 4)
# matched to spun: CPU, 100 cubes of 125 points by 8 x 4 and 8 x 16, and one of 125; H200, tools/results/position_based.md
COSTS = {kind: {"body": body} | {name: each for row in METHODS if row.cost for name, each in getattr(row.cost, kind).items()}
         for kind, body in (("cuda", 1e-8), ("cpu", 1e-6))}
TEN = 8.0, 12.0        # work of a quadratic tet over that of a linear one: its forces, its part of a Newton step (CPU)
ALONE = 2.2            # a tet that is taken by itself, over one of a packet (CPU, one core: 110 and 50 ns with its points)
SHARED_TET = 10.0      # work of a tet that blocks share, in that of sheets
# a point beside a mesh over one beside a convex shape. H200: 0.4 to 1.5 ns a point. CPU: the shirt on its dummy, 0.16 us by
# leapfrog of 1122 substeps, 0.21 by XPBD of 213
MESH = {"cuda": 20.0, "cpu": 10.0}
ELEMENT = 2.4          # work of elements in a sweep of a GPU over that of springs (H200, shirts of 26k and 102k points)
SLOW = 430.0           # substeps a second, below which a search beside a mesh grows no further (H200: a shirt of 102k points)
CLUSTERED = 8192       # points of a net, up to which a cluster takes it
ITERATED = 2048        # points of a sheet, up to which a cluster of CLUSTER blocks has its rows in registers
CLUSTER, GRID = 16, 128
RATE = 8.0             # root of omega h of soft bodies where it is not known


def seconds_of_counts(model: Model, counted: dict[str, float]) -> float:
    """Time that so much takes on the model's device [s]."""
    kind = "cuda" if model.device.is_cuda else "cpu"
    own = {name: each for row in _rows_with_things(model.scene) if row.cost for name, each in getattr(row.cost, kind).items()}
    costs = own | COSTS[kind]                              # rows may be added later
    return sum(times * costs[name] for name, times in counted.items())


def _rows_with_things(scene) -> list[MethodRow]:
    """Rows of the things of a scene that are no bodies of points."""
    return list(dict.fromkeys(row for row, _ in each_method_object(scene)))


def count_explicit_frame(model: Model, n: int) -> dict[str, float]:
    """Counts of a frame of n substeps of leapfrog."""
    springs, work, kinds = _count_soft_constraints(model)
    tets, simple = (_weighted_number_of_tets(model, 0),
                    not (model.scene.colliders or has_tets(model.scene) or work > springs or has_self_collision(model.scene)))
    damped = any(r.tau for r in model.constraints)
    blown = feels_air(model.scene)
    if model.device.is_cuda and model.device.arch >= 90 and simple and not damped and model.points <= CLUSTERED:
        return {"cluster": n, "clustered": n * model.points}
    if blocks_take_whole_frames(model, kinds):
        from wsim.physics.motion.fused.domain_decomposition import few_block_points
        limited = any(r.kind == "limit" for r in model.constraints)
        blocks = CLUSTER if model.points <= few_block_points(limited) * CLUSTER else GRID
        sends = n * (blocks == GRID)
        return {"sheet": n, "sent": sends * (1 + (damped or blown)), "shared": n * (work + SHARED_TET * tets) / blocks,
                "limited": (n + sends) * limited, **_count_colliders_of_blocks(model, n)}
    if all_elements_are_packed(model, kinds):
        scene = model.scene
        aired = n * model.points * feels_air(scene)
        within = aired or scene.colliders or _any_hard_constraint(model) or any(p.stiffness < inf for p in scene.pins)
        return {"step": n, "packed": n * work, "beside": n * model.points * bool(within), "aired": aired,
                **_count_contact_work(model, n, 1)}
    others = sum(kind_row(kind).gather != SPRINGS for kind in kinds)
    return {"step": n * (1 + others), "spring": n * springs, "element": n * (work - springs), "blown": n * blown,
            "block": n * bool(tets), "tet": n * tets, **_count_contact_work(model, n, 1)}


def blocks_take_whole_frames(model: Model, kinds: set[str]) -> bool:
    """True if blocks of a GPU share sheets and soft bodies and take whole frames: see
    `wsim.physics.motion.fused.domain_decomposition`."""
    if not model.device.is_cuda:
        return False
    from wsim.physics.motion.fused.domain_decomposition import KINDS, SHARED, blocks_take_acts
    scene = model.scene
    apart = any(body.quadratic or body.pressure for body in scene.bodies()) or any(
        m.yield_strain < inf for m in solid_materials(scene))
    return (model.device.arch >= 90 and bool(kinds or has_tets(scene)) and kinds <= KINDS and blocks_take_acts(model)
            and not (apart or has_self_collision(scene)) and model.points <= SHARED and model.dtype is np.float32
            and model.worlds == 1 and not model.gradients)


def _count_colliders_of_blocks(model: Model, n: int) -> dict[str, float]:
    """Costs that colliders add to substeps of sheets that blocks share."""
    meshes = sum(isinstance(c.shape, Surface) for c in model.scene.colliders)
    convex = len(model.scene.colliders) - meshes
    return {"struck": n * bool(convex), "tried": n * convex, "faced": n * meshes}


def all_elements_are_packed(model: Model, kinds: set[str]) -> bool:
    """True if explicit steps take all elements in packets."""
    apart = model.device.is_cuda or model.gradients or has_tets(model.scene) or loads_on_deformables(model.scene)
    return bool(kinds) and not apart and all(kind_row(kind).packets for kind in kinds)


def count_sweeps_frame(model: Model, n: int, iterations: int) -> dict[str, float]:
    """Counts of a frame of n substeps of coloured XPBD."""
    springs, work, kinds = _count_soft_constraints(model)
    work = springs + (work - springs) * (ELEMENT if model.device.is_cuda else 1.0)
    return {"rest": n, "sweep": n * iterations * len(kinds), "projection": n * iterations * work,
            **_count_contact_work(model, n, iterations)}


def count_newton_of_soft_bodies(model: Model, n: int, iterations: int, omega: float = 0.0) -> dict[str, float]:
    """Counts of a frame of n systems of soft bodies, and of sheets that share their points, of so many Newton steps each.
    omega: the highest frequency [rad/s], 0: not known."""
    times, (_, work, _) = n * iterations, _count_soft_constraints(model)
    rate = sqrt(max(1.0, omega / model.scene.fps / n)) if omega and cluster_solves_bodies(model) else RATE
    return {"newton": times, "solved": times * _weighted_number_of_tets(model, 1), "assembled": times * work,
            **_count_contact_work(model, n, iterations), **({"iterated": times * rate} if model.device.is_cuda else {})}


def count_newton_of_sheets(model: Model, n: int, iterations: int, omega: float) -> dict[str, float]:
    """Counts of a frame of n systems of sheets and nets, of so many Newton steps each. omega: the highest frequency [rad/s]."""
    _, work, _ = _count_soft_constraints(model)
    times, rate = n * iterations, sqrt(max(1.0, omega / model.scene.fps / n))
    if cluster_solves_bodies(model):
        iterations_of = {"iterated": times * rate}
    else:
        iterations_of = {"conjugate": times * rate * model.points, "gradient": times * rate}
    return {"assembled": times * work, **iterations_of,
            "pressed": (n + times) * bool(model.scene.colliders), **_count_contact_work(model, n, iterations)}


def cluster_solves_bodies(model: Model) -> bool:
    """True where a cluster of blocks solves for each body: `wsim.physics.motion.fused.conjugate`."""
    sizes = np.diff(model.starts)
    return (model.device.is_cuda and model.device.arch >= 90 and sizes.max(initial=0) <= ITERATED
            and CLUSTER * len(sizes) <= model.device.sm_count and not any(r.row.gather == SPRINGS for r in model.constraints))


def highest_frequency(model: Model) -> float:
    """The highest frequency of a scene without soft bodies [rad/s]."""
    if has_tets(model.scene):
        return 0.0
    from wsim.physics.motion.frequency import frequency_bound
    return frequency_bound(model)[0]


def count_frame_of_choice(model: Model, choice) -> dict[str, float]:
    """Counts of a frame of a `wsim.simulation.choice.SchemeChoice`, as if all that may touch did."""
    counts = {row.name: row.cost.counts for row in METHODS if row.cost}
    steps = choice.iterations if choice.solver == "implicit" and has_tets(model.scene) else 0
    found = counts.get(choice.solver, count_sweeps_choice)(model, choice)
    clusters = counts["shape_matching"](model, choice) if any(b.is_cluster for b in model.scene.bodies()) else {}
    return found | clusters | _count_other_objects(model, choice.substeps, choice.substeps * steps)


def count_explicit_choice(model: Model, choice) -> dict[str, float]:
    """Counts of a frame by the explicit solver."""
    return count_explicit_frame(model, choice.substeps)


def count_newton_choice(model: Model, choice) -> dict[str, float]:
    """Counts of a frame by the implicit solver."""
    if has_tets(model.scene):
        return count_newton_of_soft_bodies(model, choice.substeps, choice.iterations, choice.omega)
    return count_newton_of_sheets(model, choice.substeps, choice.iterations, choice.omega or highest_frequency(model))


def count_sweeps_choice(model: Model, choice) -> dict[str, float]:
    """Counts of a frame by XPBD."""
    return count_sweeps_frame(model, choice.substeps, choice.iterations)


def _count_other_objects(model: Model, n: int, steps: int) -> dict[str, float]:
    """What a frame of n substeps, and so many Newton steps, is said to take besides: contacts, damping, and what other methods
    say of their things; what says nothing counts as a body a thing, and so do rigid bodies besides."""
    scene = model.scene
    convex = sum(not isinstance(c.shape, Surface) for c in scene.colliders)
    rate = n * scene.fps                                             # steps a second
    damped = sum(len(b.tets) * sqrt(1.0 + rate * most) for b in model.bodies
                 if b.source.is_solid and (most := b.source.damping_time))
    bodies = len(scene.things("Body")) + sum(row.cost is None for row, _ in each_method_object(scene))
    found: dict[str, float] = {"met": n * model.points * convex, "damped": steps * damped, "body": n * bodies * model.worlds}
    for row in _rows_with_things(scene):
        for name, times in (row.cost.counts(scene, n, model.device.is_cuda) if row.cost else {}).items():
            found[name] = found.get(name, 0.0) + times * model.worlds
    return found


def _count_soft_constraints(model: Model) -> tuple[float, float, set[str]]:
    """Springs, work of all soft constraints in springs, kinds; of all worlds."""
    soft = [r for r in model.constraints if not r.hard]
    springs, work = (sum(r.row.weight * len(r.ids) for r in found)
                     for found in ([r for r in soft if r.row.gather == SPRINGS], soft))
    return springs, work, {r.kind for r in soft}


def _any_hard_constraint(model: Model) -> bool:
    return any(r.hard for r in model.constraints)


def _weighted_number_of_tets(model: Model, what: int) -> float:
    """Tets, a quadratic one as TEN[what], of the explicit steps of a CPU one that is taken by itself as ALONE."""
    found = 0.0
    for body in (b for b in model.bodies if len(b.tets)):
        alone = what == 0 and not model.device.is_cuda and not _tets_are_packed(body)
        found += len(body.tets) * (1.0 if body.tets.shape[1] == 4 else TEN[what]) * (ALONE if alone else 1.0)
    return found


def _tets_are_packed(body) -> bool:
    from wsim.physics.soft.fem import PACKETS
    return body.tets.shape[1] == 4 and all(m.model in PACKETS for m in body.source.materials)


def _count_contact_work(model: Model, n: int, iterations: int) -> dict[str, float]:
    """What colliders and self-contact add, met or not. A mesh that moves is fitted anew every substep."""
    met, meshes = 0.0, 0
    own: dict[str, float] = {"surfaces": n, "surfaced": n * model.points} if has_self_collision(model.scene) else {}
    for c in model.scene.colliders:
        mesh = isinstance(c.shape, Surface)
        meshes += mesh
        met += model.points * (MESH["cuda" if model.device.is_cuda else "cpu"] if mesh else 1.0)
        met += len(c.shape.indices) if isinstance(c.shape, Surface) and (c.shape.poses is not None or c.motion.moves) else 0.0
    return {"touch": n * (1 + iterations), "near": n * met, "mesh": n * meshes,
            "wide": meshes * model.points * n / (n * model.scene.fps + SLOW)} | own if model.scene.colliders else own
