"""A stage -> `Scene`: one walk that says what each prim is, then one reader for each kind.

Prims that are inactive or abstract are not there. Invisible prims and guides count: physics does not ask what is
seen. Instance proxies collide, but cannot be cloth, since a result cannot be written over them.
"""

import os
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np
from pxr import Tf, Usd, UsdGeom

from wsim.scene import Pin, Problem, Scene, SceneError, Tie
from wsim.scene.check.scene import check_scene
from wsim.scene.methods import (
    claiming_method,
    deforming_classes,
    has_method_objects,
    method_file,
    pins_of_object,
    point_objects,
    scene_skins,
)
from wsim.usd import names
from wsim.usd import stage as stages
from wsim.usd.attributes import read_attribute
from wsim.usd.load_varying import attach_varying
from wsim.usd.prims.colliders import load_collider
from wsim.usd.prims.numbers import refuse_numbers, refuse_types
from wsim.usd.prims.pins import is_followed, is_tie, load_painted, load_pin, load_tie
from wsim.usd.settings import authored_frame_count, load_settings, refuse_units, warn_missing_time_range
from wsim.usd.spelling import check_spelling, warn_missing_targets

SIMULATED = (names.SURFACE_SIM, names.CURVES_SIM, names.VOLUME_SIM, names.WSIM_SPRINGS, names.WSIM_SHAPES)


@dataclass
class SortedPrims:
    """Prims by what they are."""

    scenes: list = field(default_factory=list)
    bodies: list = field(default_factory=list)
    simulated: list = field(default_factory=list)
    colliders: list = field(default_factory=list)
    attachments: list = field(default_factory=list)
    loads: list = field(default_factory=list)
    meshes: list = field(default_factory=list)
    tet_meshes: list = field(default_factory=list)
    skel_roots: list = field(default_factory=list)
    others: list = field(default_factory=list)           # (row of a method, prim)


def load(path, variants: dict[str, dict[str, str]] | None = None, frames: int | None = None) -> Scene:
    """The scene of a USD file, or of a `Usd.Stage`, in SI units, as in `Simulation(load("flag.usda", frames=24))`.

    path        a .usda, .usdc, .usd or .usdz file; or an open stage, read as it is now
    variants    {prim path: {variant set: variant}} to choose before reading
    frames      how many are to be simulated; None: those of the stage, whose endTimeCode must be within reach then

    Warnings are in `scene.notes`. Raises SceneError with everything fatal: a file that cannot be opened, nothing that
    can be simulated in it, values out of range.
    """
    if isinstance(path, Usd.Stage):
        scene = read_stage(path, frames=frames)
        scene.source = stages.stage_source_file(path, scene.notes, variants)
        scene.frames = scene.frames if frames is None else frames
        return scene
    notes: list[Problem] = []
    stage = stages.open_stage(path, variants, notes)
    scene = read_stage(stage, notes, frames)
    scene.frames = scene.frames if frames is None else frames
    scene.source, scene.variants = os.fspath(path), {prim: dict(sets) for prim, sets in (variants or {}).items()}
    return scene


def read_stage(stage: Usd.Stage, notes: list[Problem] | None = None, frames: int | None = None) -> Scene:
    """The scene of an open stage; see `load`."""
    reading = stages.StageReading(stage, stages.StageUnits.of(stage), problems=list(notes or []))
    # what is no number is reported
    with stages.collect_warnings(reading.problems, stage), np.errstate(over="ignore", invalid="ignore"):
        try:
            return _read_scene(reading, frames)
        except Tf.ErrorException as error:
            raise SceneError(Problem(stage.GetRootLayer().realPath or "stage", f"holds a value that USD cannot read: "
                                     f"{stages.usd_error_text(error)[:200]}; author it again")) from None


def _read_scene(reading: stages.StageReading, frames: int | None) -> Scene:
    refuse_units(reading)
    refuse_types(reading)
    reading.frames = authored_frame_count(reading, frames)
    found = _classify_prims(reading)
    if found.skel_roots:
        from wsim.usd.prims.skeletons import skeleton_bindings
        reading.skinned = skeleton_bindings(found.skel_roots)
    scene = load_settings(reading, found.scenes)
    pairs = _simulated_pairs(reading, found)
    for prim, body in pairs:
        _load_deformable_body(reading, scene, prim, body)
    reading.points = bool(pairs)
    taken = {prim.GetPath() for prim, _ in pairs}
    taken.update(path for row, prim in found.others
                 for path in getattr(row.role("usd"), "within", lambda *_: [])(reading, prim))
    for prim in found.colliders:
        if prim.GetPath() not in taken and not _is_part_of_deformable(prim, found):
            collider = load_collider(reading, prim)
            if collider is not None:
                scene.colliders.append(collider)
    _load_owned_things(reading, scene, [other for other in found.others if not other[0].posed])
    by_path = {thing.path: thing for thing in point_objects(scene)}
    above = {str(body.GetPath()): by_path[path] for prim, body in pairs if (path := str(prim.GetPath())) in by_path}
    by_path = {**above, **by_path}
    failed = any(problem.fatal for problem in reading.problems)
    for prim in found.attachments if not failed else ():
        shared = is_tie(prim) and not is_followed(reading, prim)
        pin: Pin | Tie | None = (load_tie if shared else load_pin)(reading, prim, by_path)
        if isinstance(pin, Tie):
            scene.ties.append(pin)
        elif pin is not None:
            pins_of_object(scene, pin.body).append(pin)
    if found.loads and not failed:
        from wsim.usd.prims.loads import load_applied_force
        scene.loads += [load for prim in found.loads if (load := load_applied_force(reading, prim, by_path)) is not None]
    _load_owned_things(reading, scene, [other for other in found.others if other[0].posed])     # by what pins asked for
    _sort_things(scene, found.scenes)
    return _finish_scene(reading, scene, found)


def _load_owned_things(reading: stages.StageReading, scene: Scene, others: list) -> None:
    for row, prim in others:
        given = row.role("usd").load(reading, prim)
        for thing in given if isinstance(given, list) else [given] if given is not None else []:
            scene.add(thing)


def _load_deformable_body(reading: stages.StageReading, scene: Scene, prim: Usd.Prim, body: Usd.Prim) -> None:
    apis = stages.applied_schemas(prim)
    if prim.IsInstanceProxy():
        root = prim
        while not root.IsInstance():
            root = root.GetParent()
        reading.fail(prim.GetPath(), f"is to be simulated and lies in the instance {root.GetPath()}, whose contents cannot be "
                     f"written over; author instanceable = false on {root.GetPath()}")
    elif names.VOLUME_SIM in apis or names.SURFACE_SIM in apis:
        kind = "soft" if names.VOLUME_SIM in apis else "cloth"
        if (thing := import_module(f"wsim.usd.prims.{kind}").load_body(reading, prim, body)) is not None:
            scene.pins += load_painted(reading, prim, scene.add(thing))
    else:
        if names.WSIM_SHAPES in apis:
            found = method_file("Clusters", "usd").load_body(reading, prim, body)
        elif names.WSIM_SPRINGS not in apis and (rods := method_file("Rods", "usd")).simulates(prim):
            found = rods.load_rods(reading, prim, body)
        else:
            found = import_module("wsim.usd.prims.springs").load_body(reading, prim, body)
        if found is not None:
            scene.add(found)


def _classify_prims(reading: stages.StageReading) -> SortedPrims:
    """Sorts the prims of a stage by what they are, and notes what wsim does not simulate."""
    found = SortedPrims()
    prims = iter(Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsPseudoRoot():
            continue
        apis, kind = stages.applied_schemas(prim), prim.GetTypeName()
        if row := claiming_method((*apis, str(kind))):
            found.others.append((row, prim))
        check_spelling(reading, prim)
        warn_missing_targets(reading, prim)
        if kind == "PointInstancer":
            prims.PruneChildren()
        elif kind == names.PHYSICS_SCENE:
            found.scenes.append(prim)
        elif kind == names.ATTACHMENT:
            found.attachments.append(prim)
        elif kind == names.ELEMENT_FILTER:
            reading.warn(prim.GetPath(), f"{kind} is not used yet: every collider acts on every body")
        elif kind == "SkelRoot":
            found.skel_roots.append(prim)
        elif kind in ("Mesh", "TetMesh"):
            (found.meshes if kind == "Mesh" else found.tet_meshes).append(prim)
        if names.WSIM_LOAD in apis:
            found.loads.append(prim)
        if names.BODY in apis:
            found.bodies.append(prim)
        if any(api in apis for api in SIMULATED):
            found.simulated.append(prim)
        if names.COLLISION in apis and _collision_enabled(prim):
            found.colliders.append(prim)
    return found


def _collision_enabled(prim: Usd.Prim) -> bool:
    enabled = prim.GetAttribute("physics:collisionEnabled")
    return not enabled or enabled.Get(prim.GetStage().GetStartTimeCode()) is not False


def _simulated_pairs(reading: stages.StageReading, found: SortedPrims) -> list[tuple[Usd.Prim, Usd.Prim]]:
    """(simulation geometry, body) of everything to simulate."""
    pairs, claimed = [], set()      # type: list[tuple[Usd.Prim, Usd.Prim]], set
    for body in list(found.bodies):
        sims = [p for p in found.simulated if p.GetPath() == body.GetPath()] or [
            p for p in found.simulated if p.GetParent().GetPath() == body.GetPath() and p not in found.bodies]
        claimed.update(p.GetPath() for p in sims)
        if len(sims) > 1:
            reading.fail(body.GetPath(), f"is one deformable body with {len(sims)} simulation geometries ("
                         f"{', '.join(str(p.GetPath()) for p in sims)}); allowed is one: give each its own " f"{names.BODY}")
        elif not sims and not any(claiming_method(stages.applied_schemas(prim)) for prim in (body, *body.GetChildren())):
            reading.warn(body.GetPath(), f"has {names.BODY}, and neither it nor a direct child has a simulation API (such as "
                         f"{names.SURFACE_SIM}); it is left out")
        elif not sims:
            continue                                  # a method reads it
        elif read_attribute(body, "Body", "enabled") is False:
            reading.warn(body.GetPath(), "physics:bodyEnabled is off: it is left out")
        elif read_attribute(body, "Body", "kinematic"):
            _load_kinematic_body(reading, found, sims[0], body)
        else:
            pairs.append((sims[0], body))
            if names.VOLUME_SIM not in stages.applied_schemas(sims[0]):
                _warn_of_followers(reading, sims[0], body)
    for prim in found.simulated:
        if prim.GetPath() not in claimed:
            reading.warn(prim.GetPath(), f"has a simulation API and no {names.BODY} on it or its parent; it is taken as a body")
            pairs.append((prim, prim))
    return pairs


def _load_kinematic_body(reading: stages.StageReading, found: SortedPrims, sim: Usd.Prim, body: Usd.Prim) -> None:
    """An animated deformable pushes as a mesh collider."""
    reading.warn(body.GetPath(), f"physics:kinematicEnabled is on: {sim.GetPath()} moves as animated and collides as "
                                 "a mesh")
    found.bodies.remove(body)
    if sim.GetPath() not in {p.GetPath() for p in found.colliders}:
        found.colliders.append(sim)


def _warn_of_followers(reading: stages.StageReading, sim: Usd.Prim, body: Usd.Prim) -> None:
    """Notes what lies in a body of cloth or springs and will not follow it; a soft body has skins."""
    for prim in Usd.PrimRange(body):
        if prim.IsA(UsdGeom.PointBased) and prim.GetPath() != sim.GetPath() and not prim.HasRelationship(names.GUIDES):
            reading.warn(prim.GetPath(), f"lies in the deformable body {body.GetPath()} and is not its simulation geometry: it "
                         "does not follow yet")


def _is_part_of_deformable(prim: Usd.Prim, found: SortedPrims) -> bool:
    """True for point-based geometry of a deformable body: it belongs to the body and is no obstacle."""
    return prim.IsA(UsdGeom.PointBased) and any(prim.GetPath().HasPrefix(body.GetPath()) for body in found.bodies)


def _sort_things(scene: Scene, scenes: list[Usd.Prim]) -> None:
    """Puts objects in the order that a save noted; others keep that of the stage, behind them."""
    relationship = scenes[0].GetRelationship(names.ORDER) if scenes else None
    if relationship:
        try:
            place = {str(path): i for i, path in enumerate(relationship.GetTargets())}
        except Tf.ErrorException:
            raise SceneError(Problem(str(relationship.GetPath()), "is an attribute in some layer; it must be a relationship: "
                                     "author it again")) from None
        lists: list[list] = [scene.colliders, scene.pins, scene.ties, scene.loads, *(body.skins for body in scene.bodies())]
        for kind in [*(scene.things(name) for name in deforming_classes()), *lists]:
            kind.sort(key=lambda thing: place.get(thing.path, len(place)))


def _finish_scene(reading: stages.StageReading, scene: Scene, found: SortedPrims) -> Scene:
    """The scene with its warnings. Raises SceneError if anything fatal was found."""
    attach_varying(reading, scene)
    if found.skel_roots:
        from wsim.usd.prims.skeletons import refuse_skinned
        solid = [*scene.bodies(), *scene_skins(scene), *scene.colliders]
        refuse_skinned(reading, [reading.stage.GetPrimAtPath(thing.path) for thing in solid])
    fatal = [problem for problem in reading.problems if problem.fatal]
    if scene.bodies() or has_method_objects(scene):
        warn_missing_time_range(reading)
        fatal += [problem for problem in check_scene(scene) if problem.fatal and not (fatal and problem.lacks)]
        said = {problem.path for problem in fatal}
        fatal += refuse_numbers(reading, said | ({str(prim.GetPath()) for prim in found.scenes} if "/" in said else set()))
    elif not fatal:                               # the notes say why: a reference without a file, a body left out
        from wsim.usd.new.hints import nothing_to_simulate
        fatal += [nothing_to_simulate(reading.stage, found.simulated, found.meshes, found.tet_meshes),
                  *_group_notes(reading.problems)]
    if fatal:
        raise SceneError(list(dict.fromkeys(fatal)))
    scene.notes = _group_notes(reading.problems)
    return scene


def _group_notes(notes: list[Problem]) -> list[Problem]:
    """The same note on many prims as one."""
    paths: dict[str, list[str]] = {}
    for note in notes:
        paths.setdefault(note.text, []).append(note.path)
    grouped = []
    for text, where in paths.items():
        others = ", ".join(where[1:4]) + (f" and {len(where) - 4} more" if len(where) > 4 else "")
        grouped.append(Problem(where[0], text + (f" (also: {others})" if others else ""), fatal=False))
    return grouped
