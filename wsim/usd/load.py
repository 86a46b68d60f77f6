"""A stage -> `Scene`: one walk that says what each prim is, then one reader for each kind.

Prims that are inactive or abstract are not there. Invisible prims and guides count: physics does not ask what is
seen. Instance proxies collide, but cannot be cloth, since a result cannot be written over them.
"""

import os
from dataclasses import dataclass, field

import numpy as np
from pxr import Tf, Usd, UsdGeom

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.check.scene import check
from wsim.scene.methods import claimant, moving, role
from wsim.usd import names
from wsim.usd.attributes import read
from wsim.usd.load_varying import finish
from wsim.usd.prims.cloth import load_cloth
from wsim.usd.prims.colliders import load_collider
from wsim.usd.prims.numbers import refuse_numbers, refuse_types
from wsim.usd.prims.pins import is_followed, is_tie, load_painted, load_pin, load_tie
from wsim.usd.prims.springs import load_springs
from wsim.usd.settings import frames_of, load_settings, note_range, refuse_units
from wsim.usd.spelling import spelling, targets
from wsim.usd.stage import Reading, Units, applied, open_stage, quiet, reason, source_of

SIMULATED = (names.SURFACE_SIM, names.CURVES_SIM, names.VOLUME_SIM, names.WSIM_SPRINGS)


@dataclass
class Prims:
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
        scene.source = source_of(path, scene.notes, variants)
        scene.frames = scene.frames if frames is None else frames
        return scene
    notes: list[Problem] = []
    stage = open_stage(path, variants, notes)
    scene = read_stage(stage, notes, frames)
    scene.frames = scene.frames if frames is None else frames
    scene.source, scene.variants = os.fspath(path), {prim: dict(sets) for prim, sets in (variants or {}).items()}
    return scene


def read_stage(stage: Usd.Stage, notes: list[Problem] | None = None, frames: int | None = None) -> Scene:
    """The scene of an open stage; see `load`."""
    reading = Reading(stage, Units.of(stage), problems=list(notes or []))
    with quiet(reading.problems, stage), np.errstate(over="ignore", invalid="ignore"):    # what is no number is reported
        try:
            return _read(reading, frames)
        except Tf.ErrorException as error:
            raise SceneError(Problem(stage.GetRootLayer().realPath or "stage", f"holds a value that USD cannot read: "
                                     f"{reason(error)[:200]}; author it again")) from None


def _read(reading: Reading, frames: int | None) -> Scene:
    refuse_units(reading)
    refuse_types(reading)
    reading.frames = frames_of(reading, frames)
    found = _walk(reading)
    if found.skel_roots:
        from wsim.usd.prims.skeletons import bindings
        reading.skinned = bindings(found.skel_roots)
    scene = load_settings(reading, found.scenes)
    pairs = _pairs(reading, found)
    for prim, body in pairs:
        _load_body(reading, scene, prim, body)
    reading.points = bool(pairs)
    taken = {prim.GetPath() for prim, _ in pairs}
    taken.update(path for row, prim in found.others for path in getattr(row.role("usd"), "within", _nothing)(reading, prim))
    for prim in found.colliders:
        if prim.GetPath() not in taken and not _in_body(prim, found):
            collider = load_collider(reading, prim)
            if collider is not None:
                scene.colliders.append(collider)
    rods = scene.things("Rods")
    by_path = {thing.path: thing for thing in (*scene.bodies(), *rods)}
    above = {str(body.GetPath()): by_path.get(str(prim.GetPath())) for prim, body in pairs}
    by_path = {**{k: v for k, v in above.items() if v is not None}, **by_path}
    failed = any(problem.fatal for problem in reading.problems)
    for prim in found.attachments if not failed else ():
        if is_tie(prim) and not is_followed(reading, prim):
            tie = load_tie(reading, prim, by_path)
            scene.ties += [tie] if tie is not None else []
            continue
        pin = load_pin(reading, prim, by_path)
        if pin is not None:
            next((each.pins for each in rods if each.path == pin.body), scene.pins).append(pin)
    if found.loads and not failed:
        from wsim.usd.prims.loads import load_load
        scene.loads += [load for prim in found.loads if (load := load_load(reading, prim, by_path)) is not None]
    for row, prim in found.others:
        given = row.role("usd").load(reading, prim)
        for thing in given if isinstance(given, list) else [given] if given is not None else []:
            scene.add(thing)
    _order(scene, found.scenes)
    return _finished(reading, scene, found)


def _nothing(reading: Reading, prim: Usd.Prim) -> list:
    return []


def _load_body(reading: Reading, scene: Scene, prim: Usd.Prim, body: Usd.Prim) -> None:
    apis = applied(prim)
    if prim.IsInstanceProxy():
        root = prim
        while not root.IsInstance():
            root = root.GetParent()
        reading.fail(prim.GetPath(), f"is to be simulated and lies in the instance {root.GetPath()}, whose contents "
                     f"cannot be written over; author instanceable = false on {root.GetPath()}")
    elif names.VOLUME_SIM in apis:
        from wsim.usd.prims.soft import load_soft
        soft = load_soft(reading, prim, body)
        if soft is not None:
            scene.softs.append(soft)
            scene.pins += load_painted(reading, prim, soft)
    elif names.SURFACE_SIM in apis:
        cloth = load_cloth(reading, prim, body)
        if cloth is not None:
            scene.cloths.append(cloth)
            scene.pins += load_painted(reading, prim, cloth)
    elif names.WSIM_SPRINGS not in apis and (rods := role("Rods", "usd")).simulates(prim):
        found = rods.load_rods(reading, prim, body)
        if found is not None:
            scene.add(found)
    else:
        springs = load_springs(reading, prim, body)
        if springs is not None:
            scene.springs.append(springs)


def _walk(reading: Reading) -> Prims:
    """Sorts the prims of a stage by what they are, and notes what wsim does not simulate."""
    found = Prims()
    prims = iter(Usd.PrimRange(reading.stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsPseudoRoot():
            continue
        apis, kind = applied(prim), prim.GetTypeName()
        if row := claimant((*apis, str(kind))):
            found.others.append((row, prim))
        spelling(reading, prim)
        targets(reading, prim)
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
        if names.COLLISION in apis and _collides(prim):
            found.colliders.append(prim)
    return found


def _collides(prim: Usd.Prim) -> bool:
    enabled = prim.GetAttribute("physics:collisionEnabled")
    return not enabled or enabled.Get(prim.GetStage().GetStartTimeCode()) is not False


def _pairs(reading: Reading, found: Prims) -> list[tuple[Usd.Prim, Usd.Prim]]:
    """(simulation geometry, body) of everything to simulate."""
    pairs: list[tuple[Usd.Prim, Usd.Prim]] = []
    claimed: set = set()
    for body in list(found.bodies):
        sims = [p for p in found.simulated if p.GetPath() == body.GetPath()] or [
            p for p in found.simulated if p.GetParent().GetPath() == body.GetPath() and p not in found.bodies]
        claimed.update(p.GetPath() for p in sims)
        if len(sims) > 1:
            reading.fail(body.GetPath(), f"is one deformable body with {len(sims)} simulation geometries ("
                         f"{', '.join(str(p.GetPath()) for p in sims)}); allowed is one: give each its own "
                         f"{names.BODY}")
        elif not sims and not any(api in names.FEATURES for api in applied(body)):
            reading.warn(body.GetPath(), f"has {names.BODY}, and neither it nor a direct child has a simulation API "
                         f"(such as {names.SURFACE_SIM}); it is left out")
        elif not sims:
            continue                                  # a feature that is not simulated: said so already
        elif read(body, "Body", "enabled") is False:
            reading.warn(body.GetPath(), "physics:bodyEnabled is off: it is left out")
        elif read(body, "Body", "kinematic"):
            _kinematic_body(reading, found, sims[0], body)
        else:
            pairs.append((sims[0], body))
            if names.VOLUME_SIM not in applied(sims[0]):
                _followers(reading, sims[0], body)
    for prim in found.simulated:
        if prim.GetPath() not in claimed:
            reading.warn(prim.GetPath(), f"has a simulation API and no {names.BODY} on it or its parent; it is taken "
                                         "as a body")
            pairs.append((prim, prim))
    return pairs


def _kinematic_body(reading: Reading, found: Prims, sim: Usd.Prim, body: Usd.Prim) -> None:
    """An animated deformable pushes as a mesh collider."""
    reading.warn(body.GetPath(), f"physics:kinematicEnabled is on: {sim.GetPath()} moves as animated and collides as "
                                 "a mesh")
    found.bodies.remove(body)
    if sim.GetPath() not in {p.GetPath() for p in found.colliders}:
        found.colliders.append(sim)


def _followers(reading: Reading, sim: Usd.Prim, body: Usd.Prim) -> None:
    """Notes what lies in a body of cloth or springs and will not follow it; a soft body has skins."""
    for prim in Usd.PrimRange(body):
        if prim.IsA(UsdGeom.PointBased) and prim.GetPath() != sim.GetPath() and not prim.HasRelationship(names.GUIDES):
            reading.warn(prim.GetPath(), f"lies in the deformable body {body.GetPath()} and is not its simulation "
                         "geometry: it does not follow yet")


def _in_body(prim: Usd.Prim, found: Prims) -> bool:
    """True for point-based geometry of a deformable body: it belongs to the body and is no obstacle."""
    return prim.IsA(UsdGeom.PointBased) and any(prim.GetPath().HasPrefix(body.GetPath()) for body in found.bodies)


def _order(scene: Scene, scenes: list[Usd.Prim]) -> None:
    """Puts objects in the order that a save noted; others keep that of the stage, behind them."""
    relationship = scenes[0].GetRelationship(names.ORDER) if scenes else None
    if relationship:
        try:
            place = {str(path): i for i, path in enumerate(relationship.GetTargets())}
        except Tf.ErrorException:
            raise SceneError(Problem(str(relationship.GetPath()), "is an attribute in some layer; it must be a relationship: "
                                     "author it again")) from None
        lists: list[list] = [scene.cloths, scene.springs, scene.softs, scene.colliders, scene.pins, scene.ties, scene.loads]
        for kind in [*lists, *(soft.skins for soft in scene.softs)]:
            kind.sort(key=lambda thing: place.get(thing.path, len(place)))


def _finished(reading: Reading, scene: Scene, found: Prims) -> Scene:
    """The scene with its warnings. Raises SceneError if anything fatal was found."""
    finish(reading, scene)
    if found.skel_roots:
        from wsim.usd.prims.skeletons import skinned
        solid = [*scene.bodies(), *(skin for soft in scene.softs for skin in soft.skins), *scene.colliders]
        skinned(reading, [reading.stage.GetPrimAtPath(thing.path) for thing in solid])
    fatal = [problem for problem in reading.problems if problem.fatal]
    if scene.bodies() or moving(scene):
        note_range(reading)
        fatal += [problem for problem in check(scene) if problem.fatal and not (fatal and problem.lacks)]
        said = {problem.path for problem in fatal}
        fatal += refuse_numbers(reading, said | ({str(prim.GetPath()) for prim in found.scenes} if "/" in said else set()))
    elif not fatal:                               # the notes say why: a reference without a file, a body left out
        from wsim.usd.new.hints import nothing
        fatal += [nothing(reading.stage, found.simulated, found.meshes, found.tet_meshes), *_grouped(reading.problems)]
    if fatal:
        raise SceneError(list(dict.fromkeys(fatal)))
    scene.notes = _grouped(reading.problems)
    return scene


def _grouped(notes: list[Problem]) -> list[Problem]:
    """The same note on many prims as one."""
    paths: dict[str, list[str]] = {}
    for note in notes:
        paths.setdefault(note.text, []).append(note.path)
    grouped = []
    for text, where in paths.items():
        others = ", ".join(where[1:4]) + (f" and {len(where) - 4} more" if len(where) > 4 else "")
        grouped.append(Problem(where[0], text + (f" (also: {others})" if others else ""), fatal=False))
    return grouped
