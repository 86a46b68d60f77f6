"""The methods of wsim: a row each, in the order in which their stages run within a phase; contacts come last.

A row is data; nothing is imported by it. What else a method needs stands in its folder, in files by role, which are imported
when a scene holds such a thing:

    objects    dataclasses of the scene; NumPy only
    check      check(thing, scene) yields Problems
    initial    check(scene) yields Problems of how sound things stand to each other at the start
    usd        load(reading, prim) -> thing, things or None, author(stage, thing, units); within(reading, prim) -> paths of
               prims that are the thing's, and no colliders of the scene; imports pxr, never Warp
    method     build(Build) -> Method, see `wsim.simulation.methods`
    show       triangles(prim) -> points (n, 3) and triangles (t, 3), in the prim's frame and the units of the stage

Cloth, springs, soft bodies, colliders, pins, ties and loads have lists of their own in a scene, and rows for what simulates
them alone; what they are checked and read by stands in scene/check and usd/prims.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any


@dataclass(frozen=True)
class Row:
    """owns: names of its dataclasses; unseen: those of them that results hold nothing of; posed: whether they only pose what
    others simulate; claims: names of USD types or applied APIs that its `usd` reads; without: why it is left out where a scene
    lacks it; gradients: whether recordings differentiate through it; pushes: whether it acts on points within a substep."""

    name: str
    folder: str
    owns: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    posed: bool = False
    claims: tuple[str, ...] = ()
    without: str = ""
    gradients: bool = False
    pushes: bool = False

    def role(self, name: str) -> Any:
        """A file of the folder, or None where it has none."""
        place = f"{self.folder}.{name}"
        return import_module(place) if find_spec(place) else None


JOINTS = tuple(f"Physics{kind}Joint" for kind in ("Fixed", "Revolute", "Prismatic", "Spherical", "Distance"))

METHODS: list[Row] = [
    Row("points", "wsim.physics.motion.points", without="there are no points", gradients=True),
    Row("pins", "wsim.physics.motion.pins", without="nothing is pinned", gradients=True),
    Row("explicit", "wsim.physics.motion.explicit", without="another solver is chosen", gradients=True),
    Row("aero", "wsim.physics.cloth.air", without="no cloth has drag or lift", gradients=True, pushes=True),
    Row("implicit", "wsim.physics.solver.newton", without="another solver is chosen", gradients=True),
    Row("xpbd", "wsim.physics.solver.xpbd", without="another solver is chosen, and nothing is hard", gradients=True,
        pushes=True),
    Row("rigid", "wsim.physics.rigid", owns=("Body", "Joint", "Group", "FilteredPairs"),
        unseen=("Joint", "Group", "FilteredPairs"),
        claims=("PhysicsRigidBodyAPI", "PhysicsJoint", *JOINTS, "PhysicsCollisionGroup", "PhysicsFilteredPairsAPI",
                "PointInstancer"),
        without="there is no rigid body", gradients=True),
    Row("fluid", "wsim.physics.fluid", owns=("Fluid", "Source"), unseen=("Source",),
        claims=("WsimFluidDomainAPI", "WsimFluidSourceAPI"), without="there is no fluid", gradients=True),
    Row("liquid", "wsim.physics.fluid.liquid", owns=("Liquid", "LiquidSource"), unseen=("LiquidSource",),
        claims=("WsimLiquidDomainAPI", "WsimLiquidSourceAPI"), without="there is no liquid"),
    Row("mpm", "wsim.physics.mpm", owns=("MaterialPoints",), without="there are no material points"),
    Row("rods", "wsim.physics.rods", owns=("Rods",), without="there is no rod"),
    Row("follow", "wsim.physics.rods.follow", owns=("Followers",), posed=True, claims=("WsimRodsAPI",),
        without="no hair follows guides"),
    Row("bones", "wsim.physics.animation", owns=("Skeleton",), unseen=("Skeleton",), posed=True, claims=("Skeleton",),
        without="nothing follows a skeleton", gradients=True),
    Row("contact", "wsim.physics.contact.method", without="there is no collider", gradients=True, pushes=True),
    Row("selfcontact", "wsim.physics.selfcontact.method", without="no surface collides with itself", pushes=True),
    Row("watch", "wsim.physics.motion.overstretch", gradients=True),
    Row("volume", "wsim.physics.soft.volume", gradients=True),
    Row("muscles", "wsim.physics.cloth.muscles", without="no spring has an actuation", gradients=True),
    Row("loads", "wsim.physics.motion.loads", without="nothing is loaded", gradients=True),
]


def owner(name: str) -> Row | None:
    """The row that owns a dataclass of that name."""
    return next((row for row in METHODS if name in row.owns), None)


def role(name: str, file: str) -> Any:
    """A file of the folder that owns a dataclass of that name."""
    row = owner(name)
    assert row is not None
    return row.role(file)


def claimant(names) -> Row | None:
    """The row that reads prims of one of these types or APIs."""
    return next((row for row in METHODS if not set(row.claims).isdisjoint(names)), None)


def named(scene, path: str | None) -> Any:
    """The object of a scene at a path, the scene itself at "/"; None where there is none."""
    return scene if path == "/" else next((thing for thing in things(scene) if thing.path == path), None)


def things(scene) -> list:
    """All objects of a scene that may have values."""
    return [*scene.bodies(), *every_pin(scene), *scene.colliders, *scene.loads, *(thing for _, thing in every(scene))]


def carried(scene) -> list:
    """Colliders that move with things of methods, and are met."""
    if not scene.others:
        return []
    apart = dressed(scene)
    return [c for _, thing in every(scene) if thing.path not in apart for c in getattr(thing, "colliders", ()) if c.meets]


def followers(scene, thing) -> list[str]:
    """Paths of the colliders and pins whose points follow a thing, such as a skeleton."""
    return [*(c.path for c in scene.colliders if getattr(getattr(c.shape, "poses", None), "skeleton", None) is thing),
            *(p.path for p in scene.pins if p.follows is not None and p.follows.skin.skeleton is thing)]


def dressed(scene) -> set[str]:
    """Paths of the bodies that drive what others follow: that meets points in their stead."""
    driving = [thing for _, thing in every(scene) if getattr(thing, "bodies", None)]
    return {path for thing in driving if followers(scene, thing) for path in thing.bodies.values()}


def moving(scene) -> bool:
    """True if a scene holds something that methods simulate, or would."""
    return any(not row.posed for row, _ in every(scene)) if scene.others else False


def collides(scene) -> bool:
    """True if points may meet something."""
    return bool(scene.colliders or carried(scene) or touches(scene))


def every_pin(scene) -> list:
    """Pins of bodies, and those of rods."""
    return [*scene.pins, *(pin for rods in scene.things("Rods") for pin in rods.pins)]


def loads_of_bodies(scene) -> list:
    """Loads of cloths, spring nets and soft bodies: others are of what methods hold, such as rods."""
    paths = {body.path for body in scene.bodies()} if scene.loads else set()
    return [load for load in scene.loads if load.body in paths]


def touches(scene) -> bool:
    """True if a surface collides with itself."""
    return any(body.self_collision for body in (*scene.cloths, *scene.softs))


def every(scene) -> Iterator[tuple[Row, Any]]:
    """(row, thing) of what a scene holds of methods that have no list of their own in it."""
    for row in METHODS:
        for name in row.owns:
            yield from ((row, thing) for thing in scene.things(name))


def count(n: int, noun: str) -> str:
    """1 pin, 2 pins; 1 body, 2 bodies"""
    return f"{n} {noun}" if n == 1 else f"{n} {noun[:-1]}ies" if noun.endswith("y") else f"{n} {noun}s"


def _noun(name: str) -> str:
    """Of a class of things, each of which may be many: body, fluid domain; rod prim."""
    words = re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return f"{words[:-1]} prim" if words.endswith("s") else words


def inventory(scene) -> str:
    """Text that counts what a scene holds."""
    kinds: dict[str, list] = {"cloth": scene.cloths, "spring net": scene.springs, "soft body": scene.softs,
                              "skin": [skin for soft in scene.softs for skin in soft.skins],
                              "collider": scene.colliders, "pin": scene.pins, "load": scene.loads,
                              **{_noun(name): found for name, found in scene.others.items()}}
    things = ", ".join(count(len(found), noun) for noun, found in kinds.items() if found)
    sizes = {"point": sum(len(body.points) for body in scene.bodies()), "tet": sum(len(soft.tets) for soft in scene.softs)}
    size = ", ".join(count(n, noun) for noun, n in sizes.items() if n)
    steps = ("solver auto, which chooses substeps and integrator" if scene.solver == "auto" else
             f"{count(scene.substeps, 'substep')}, {count(scene.iterations, 'iteration')}, solver {scene.solver}, "
             f"integrator {scene.integrator}")
    return f"{things or 'nothing'}; {f'{size}; ' if size else ''}{count(scene.frames, 'frame')} of 1/{scene.fps:g} s, {steps}"
