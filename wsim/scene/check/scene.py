"""Everything that is wrong with a scene, found before anything is simulated. NumPy only.

    check(scene) -> list of Problem, errors first, each with the prim path, what was found, what is allowed, the mend

An error cannot be simulated; a warning can, but is seldom meant. Here: settings, paths, and how objects hang
together; `wsim.scene.check.objects`, and the `check` of each method, have what can be wrong with one object by itself.
"""

import re
from collections import Counter
from collections.abc import Iterator
from math import inf
from numbers import Real
from typing import Any

import numpy as np

from wsim.geometry import topology
from wsim.scene import Deformable, Pin, Problem, Scene
from wsim.scene.check.counts import MOST
from wsim.scene.check.objects import (
    check_collider,
    check_number,
    check_point_array,
    check_rigid_motion,
    check_table_values,
    find_point_object,
    object_warning,
    thing_error,
)
from wsim.scene.curve import Curve
from wsim.scene.integrator import SOLVERS, TABLE
from wsim.scene.methods import (
    each_body_of_points,
    each_method_object,
    has_collisions,
    has_method_objects,
    has_self_collision,
    method_colliders,
    scene_skins,
)

SOFT_SOLVERS = tuple(name for name in ("auto", "implicit", "explicit") if name in SOLVERS)
WEAK = 0.2         # [m/s^2] an eighth of the Moon's; 9.81 in a file of centimetres is 0.0981
PRIM_PATH = re.compile(r"(/(?!\d)\w+)+")
STRONG = 50.0       # [m/s^2] five times Earth's gravity; files that take their unit for centimetres hold 981


@np.errstate(over="ignore", invalid="ignore")     # what is no number is reported
def check_scene(scene: Scene) -> list[Problem]:
    """Problems of a scene, errors first. Never raises for a bad scene, and does not change it."""
    found = [*_check_scene_settings(scene), *_check_prim_paths(scene)]
    for row, thing in each_body_of_points(scene):
        found += row.role("check").check(thing, scene)
    for collider in scene.colliders:
        found += check_collider(collider)
    for pin in scene.pins:
        found += _check_pin(pin, scene)
    found += _without_skeleton(scene)
    for tie in scene.ties:
        from wsim.scene.check import ties
        found += ties.check_tie(tie, scene)
    for load in scene.loads:
        from wsim.scene.check import loads
        found += loads.check_load(load, scene)
    for value in scene.varying:
        from wsim.scene.check import varying
        found += varying.check_varying_value(value, scene)
    for row, thing in each_method_object(scene):
        role = row.role("check")
        found += [*check_table_values(thing), *(role.check(thing, scene) if role else ())]
    if not any(p.fatal for p in found):           # triangles and pieces can be asked only of sound objects
        found += [*_check_support(scene), *_check_sweep_damping(scene), *_check_animated_starts(scene)]
        for body in scene.bodies():
            found += _check_held_points(body, [p for p in scene.pins if p.body == body.path and p.stiffness == inf])
        for row in dict.fromkeys(row for row, _ in each_method_object(scene)):
            role = row.role("initial")
            found += role.check(scene) if role else ()
        if scene.colliders or (scene.bodies() and method_colliders(scene)):
            from wsim.scene.check import contact
            found += contact.check_contacts(scene)
    return sorted(found, key=lambda p: not p.fatal)


def _check_scene_settings(scene: Scene) -> Iterator[Problem]:
    for name, unit in (("gravity", "m/s^2"), ("wind", "m/s")):
        value: Any = getattr(scene, name)
        if np.shape(value) != (3,) and not isinstance(value, Curve):
            yield thing_error("/", f"{name} is {value}", f"three numbers [{unit}]", f"give {name}=(x, y, z)")
            return
    yield from check_number("/", "fps", scene.fps, 0.0, True, "author timeCodesPerSecond, 24 say")
    yield from check_number("/", "start", scene.start, -inf, mend="author startTimeCode")
    yield from check_number("/", "frames", scene.frames, 0, mend="give --frames, or author endTimeCode after startTimeCode")
    yield from check_number("/", "substeps", scene.substeps, 1, mend="give --substeps, 10 say")
    yield from check_number("/", "iterations", scene.iterations, 1, mend="give --iterations, 4 say")
    for name in ("frames", "substeps", "iterations"):
        if isinstance(getattr(scene, name), Real) and (getattr(scene, name) > MOST or getattr(scene, name) % 1):
            yield thing_error("/", f"{name} is {getattr(scene, name):g}", f"a whole number up to {MOST}",
                              f"give another --{name}")
    yield from check_table_values(scene)
    if scene.contact_width > 0.0:
        for path in [c.path for c in scene.colliders if c.restitution > 0.0][:1]:
            yield thing_error(path, f"it has a restitution, and contact_width is {scene.contact_width:g} m: a smoothed "
                              "contact gives back all energy", "one of the two",
                              "leave out the restitution, or wsim:contactWidth")
    yield from _check_solver_choice(scene)
    if scene.up not in ("Y", "Z"):
        yield thing_error("/", f"up axis is '{scene.up}'", "Y or Z", "author upAxis on the stage")
    other = {"Y": "Z", "Z": "Y"}.get(scene.up, "")
    g = dict(zip("XYZ", scene.gravity, strict=False))
    if other and len(g) == 3 and g[other] < 0.0 and g["X"] == g[scene.up] == 0.0:
        yield object_warning("/", f"gravity acts along -{other}, and {scene.up} is up",
                             f"up = '{other}', or gravity along -{scene.up}", f"author upAxis = {other} on the stage "
                             f"(Scene(up='{other}')), or leave gravity out: it is 9.81 m/s^2 against up")
    size = float(np.linalg.norm(scene.gravity))
    if size > STRONG or 0.0 < size < WEAK:
        yield object_warning("/", f"gravity is {size:.3g} m/s^2", "9.81 or so",
                             "author metersPerUnit (0.01 for centimetres), or physics:gravityMagnitude in stage units")


def _check_solver_choice(scene: Scene) -> Iterator[Problem]:
    """Solver and integrator: known, and made for each other."""
    for name, found, allowed in (("solver", scene.solver, SOLVERS), ("integrator", scene.integrator, ("auto", *TABLE)),
                                 ("coordinates", scene.coordinates, ("auto", "maximal", "reduced")),
                                 ("contact_model", scene.contact_model, ("rigid", "mujoco"))):
        if found not in allowed:
            yield thing_error("/", f"{name} is '{found}'", ", ".join(allowed), "choose one of them")
            return
    solids = [body.path for body in scene.bodies() if body.is_solid]
    if solids and scene.solver == "xpbd":
        yield thing_error("/", f"solver xpbd has no tetrahedra, of which {solids[0]} is made",
                           ", ".join(SOFT_SOLVERS), "choose one of them")
    held = [body.path for body in scene.bodies() if body.is_cluster]
    if held and (scene.solver == "explicit" or scene.integrator in TABLE and TABLE[scene.integrator].explicit):
        yield thing_error("/", f"explicit steps have no shape matching, which holds {held[0]} together",
                           "solver auto, xpbd or implicit", "choose one of them")
        return
    named = TABLE.get(scene.integrator)
    if has_self_collision(scene) and named and named.solves > 1:
        path = next(body.path for body in scene.bodies() if body.self_collision)
        yield thing_error(path, f"it has wsim:selfCollision, and integrator {named.name} solves twice a step: what touches is "
                                 f"proven "
                           "where a step of one solution ends", "backward_euler, bdf2, implicit_midpoint or an explicit one",
                           "choose one of them, or leave wsim:selfCollision out")
    elif (scene.colliders or method_colliders(scene)) and named and named.rebounds:
        said, others = f"integrator {scene.integrator} rebounds from", "backward_euler, bdf2 or an explicit one"
        if scene.bodies() and method_colliders(scene):   # bodies that touch points: `wsim.simulation.choice` takes BDF2
            yield object_warning("/", f"{said} rigid bodies that points touch: bdf2 takes its place", others,
                                 "name one of them")
        elif named.solves > 1:
            yield thing_error("/", f"{said} colliders", f"implicit_midpoint, {others}", "choose one of them")
        elif scene.contact_width > 0.0:
            yield thing_error("/", f"contact_width is {scene.contact_width:g} m, and integrator {scene.integrator} has hard "
                                    "contacts alone, which act where its steps end", others,
                               "choose one of them, or leave wsim:contactWidth out")
    if scene.solver == "xpbd" and scene.contact_width > 0.0 and scene.colliders:
        yield object_warning("/", f"contact_width is {scene.contact_width:g} m, and steps of solver xpbd damp: of a bounce "
                                  "they give back 0.78 of the speed with 4 substeps, say, and 0.97 with 40",
                             "solver explicit, which gives back all",
                             "choose it, or more substeps, or leave wsim:contactWidth out")
    if "auto" in (scene.solver, scene.integrator):
        return
    fits = [name for name, m in TABLE.items() if m.explicit == (scene.solver == "explicit")]
    if scene.integrator not in fits:
        yield thing_error("/", f"integrator {scene.integrator} is none of solver {scene.solver}", ", ".join(("auto", *fits)),
                           "name one of them, or leave one of the two on auto")


def _check_sweep_damping(scene: Scene) -> Iterator[Problem]:
    """Sweeps move by 1 / (1 + damping / h) of what they would: past a substep or so they no longer converge in time."""
    if scene.fps <= 0.0 or scene.substeps < 1:
        return
    h = 1.0 / scene.fps / scene.substeps
    for body in (body for body in scene.bodies() if not body.is_solid):         # a soft body is solved for otherwise
        damping = body.damping_time
        if damping > 4.0 * h:
            yield object_warning(body.path,
                                 f"damping is {damping:g} s, {damping / h:.0f} substeps of {h:g} s: it slows the solver's "
                                 "sweeps as many times", f"{4.0 * h:.2g} s or less", "give fewer substeps or less damping; "
                                 "backward Euler damps by itself")


def _check_prim_paths(scene: Scene) -> Iterator[Problem]:
    if not scene.bodies() and not has_method_objects(scene):
        yield thing_error("/", "nothing here can move: no cloth, springs, soft body, clusters, particles, rods, rigid body, "
                          "smoke, liquid or material points",
                           "at least one", "add one, as by scene.cloth(...); in USD, `wsim new cloth MESH -o SCENE` shows how")
    named: list = [*scene.bodies(), *scene_skins(scene), *scene.colliders, *scene.pins, *scene.ties, *scene.loads,
                   *(thing for _, thing in each_method_object(scene))]
    wrong = next((thing.path for thing in named if not isinstance(thing.path, str)), None)
    if wrong is not None:
        yield thing_error("/", f"a path is {wrong!r:.60}", "an absolute path such as /World/cloth", "give a string")
        return
    for path, n in Counter(thing.path for thing in named if not getattr(thing, "shares_path", False)).items():
        if n > 1:
            yield thing_error(path, f"{n} objects have this path", "one", "give each its own")
        if not PRIM_PATH.fullmatch(path):
            yield thing_error(path, "this is no prim path", "an absolute path such as /World/cloth",
                              "begin it with /, and name it by letters, digits and _")


def _check_pin(pin: Pin, scene: Scene) -> Iterator[Problem]:
    path = pin.path
    yield from check_table_values(pin)
    yield from check_point_array(path, "places", pin.places, (len(pin.points),))
    yield from check_rigid_motion(path, pin.motion, "take the scale out of the xform that the pin hangs on")
    if len(pin.points) == 0:
        yield thing_error(path, "it holds no points", "at least one", "name points, or remove the pin")
    body = yield from find_point_object(path, "pin", "holds", pin.body, scene)
    if body is None:
        return
    bad = (pin.points < 0) | (pin.points >= len(body.points))
    if bad.any():
        yield thing_error(path, f"it holds point {pin.points[np.argmax(bad)]} of {pin.body}", f"0 to {len(body.points) - 1}",
                           "count from 0, in the order of the mesh's points")


def _without_skeleton(scene: Scene) -> Iterator[Problem]:
    """What follows a skeleton that is not in the scene."""
    skins: list = [(c.path, getattr(c.shape, "poses", None)) for c in scene.colliders]
    skins += [(p.path, p.follows.skin) for p in scene.all_pins() if p.follows is not None]
    there = [id(bones) for bones in scene.things("Skeleton")]
    for path, skin in skins:
        if hasattr(skin, "skeleton") and id(skin.skeleton) not in there:
            yield thing_error(path, f"it follows {skin.skeleton.path}, which is not in the scene", "a skeleton of the scene",
                               "add it: scene.add(bones)")


def _check_held_points(body: Deformable, pins: list[Pin]) -> list[Problem]:
    """Points that these pins hold hard far from where they start, or more than once at more than one place."""
    if not pins:
        return []
    from wsim.scene.check.pins import check_conflicting_pins, check_distant_pin_targets
    points = np.concatenate([p.points for p in pins])
    twice = len(np.unique(points)) < len(points)
    return [*check_distant_pin_targets(body, pins), *(check_conflicting_pins(body, pins) if twice else ())]


def _check_animated_starts(scene: Scene) -> Iterator[Problem]:
    """What keys should move, and nothing holds."""
    if any(thing.motion.moves for thing in [*scene.bodies(), *scene.things("Rods"), *scene.things("MaterialPoints")]):
        from wsim.scene.check.pins import check_animated_starts
        yield from check_animated_starts(scene)


def _connected_piece_labels(body: Deformable) -> np.ndarray:
    """Label of the connected piece of each point, shape (n,); -1 for points of no face, spring or tet."""
    used, (edges, corners) = np.zeros(len(body.points), bool), body.held_points()
    used[corners] = True
    return np.where(used, topology.labels_of_islands(len(used), edges), -1)


def _check_support(scene: Scene) -> Iterator[Problem]:
    """What keeps each body from falling: pins that leave something free, or colliders; and no loose pieces."""
    falls = bool(np.any(np.asarray(scene.gravity) != 0.0))
    for body in scene.bodies():
        path, n = body.path, len(body.points)
        if body.is_particles and n == 0:                      # what pours comes later
            continue
        held, hard = np.zeros(n, bool), np.zeros(n, bool)
        for pin in (p for p in scene.pins if p.body == path):
            held[pin.points] = True
            hard[pin.points] |= pin.stiffness == inf
        label = np.zeros(0, np.int64) if body.is_particles else _connected_piece_labels(body)
        moved = np.where(label >= 0)[0] if body.has_surface else np.arange(n)    # others move nothing
        if hard[moved].all():
            yield thing_error(path, f"all {len(moved)} points are pinned: nothing can move", "at least one free point",
                               "pin fewer points, or make it a collider")
        for tie in scene.ties:                    # what hangs on another is held as well as that is
            if path in (tie.body, tie.other):
                held[tie.points if tie.body == path else tie.others] = True
        lands = has_collisions(scene) or body.meets_as_balls and any(not other.meets_as_balls for other in scene.bodies())
        if falls and not held.any() and not lands:
            yield object_warning(path, "no pin holds it and nothing lies below: it falls for ever", "a pin or a collider",
                                 "add a PhysicsAttachment, or apply PhysicsCollisionAPI to what it should land on")
        if body.is_particles:
            continue
        pieces = np.unique(label[label >= 0])
        loose = np.setdiff1d(pieces, label[held])
        if body.is_cluster and len(pieces) > 1 and len(loose):
            yield object_warning(path, f"its clusters make {len(pieces)} pieces that share no points, and part", "one piece",
                                 "give a larger spacing or overlap; in USD wsim:clusterSpacing, wsim:clusterOverlap")
        elif len(pieces) > 1 and len(loose):
            yield object_warning(path, f"{len(loose)} of its {len(pieces)} separate pieces are held by no pin",
                                 "one piece, or pieces meant to fall apart",
                                 "make their points shared ones, pin each of them, or split the mesh"
                                 if body.is_solid else
                                 "sew them (weld: a distance), pin each of them, or split the mesh")
        if not body.has_surface and (label < 0).any():
            yield object_warning(path, f"{(label < 0).sum()} points belong to no spring", "none", "remove them")
