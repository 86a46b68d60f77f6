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

Things of rows with `deforms` are bodies of points (`wsim.scene.bodies.Deformable`): rows behind them, which own nothing, move
them. Colliders, pins, ties and loads have lists of their own in a scene; scene/check and usd/prims check and read them.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from wsim.scene.nodal.touching import has_self_collision
from wsim.scene.values.cost import MethodCost


@dataclass(frozen=True)
class MethodRow:
    """owns: names of its dataclasses; unseen: those of them that results hold nothing of; posed: whether they only pose what
    others simulate; claims: names of USD types or applied APIs that its `usd` reads; without: why it is left out where a scene
    lacks it; gradients: whether recordings differentiate through it; pushes: whether it acts on points within a substep;
    deforms: whether its things are bodies of points, in the order of the rows, which others move; cost: what it costs."""

    name: str
    folder: str
    owns: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    posed: bool = False
    claims: tuple[str, ...] = ()
    without: str = ""
    gradients: bool = False
    pushes: bool = False
    deforms: bool = False
    cost: MethodCost | None = None

    def role(self, name: str) -> Any:
        """A file of the folder, or None where it has none."""
        place = f"{self.folder}.{name}"
        return import_module(place) if find_spec(place) else None


JOINTS = tuple(f"Physics{kind}Joint" for kind in ("Fixed", "Revolute", "Prismatic", "Spherical", "Distance"))

METHODS: list[MethodRow] = [
    MethodRow("cloth", "wsim.physics.cloth", owns=("Cloth",), deforms=True, gradients=True),
    MethodRow("springs", "wsim.physics.cloth.nets", owns=("Springs",), deforms=True, gradients=True),
    MethodRow("soft", "wsim.physics.soft", owns=("Soft",), deforms=True, gradients=True),
    MethodRow("clusters", "wsim.physics.soft.clusters", owns=("Clusters",), deforms=True),
    MethodRow("particles", "wsim.physics.position_based", owns=("Particles",), claims=("WsimParticlesAPI",), deforms=True),
    MethodRow("points", "wsim.physics.motion.points", without="there are no points", gradients=True),
    MethodRow("pins", "wsim.physics.motion.pins", without="nothing is pinned", gradients=True),
    MethodRow("explicit", "wsim.physics.motion.explicit", without="another solver is chosen", gradients=True,
              cost=MethodCost({"step": 4.7e-6, "spring": 1.3e-11, "element": 2.2e-11, "block": 3.2e-6, "tet": 1.05e-10,
               "sheet": 1.8e-6, "shared": 5.8e-10, "sent": 4.5e-7, "limited": 4.6e-6, "struck": 3.3e-6, "tried": 1.6e-7,
               "faced": 1.6e-5, "cluster": 3.5e-7, "clustered": 9e-11}, {"step": 2.6e-7, "spring": 1.18e-9, "element": 1.32e-8,
               "packed": 1.9e-9, "beside": 3.5e-8, "block": 1.8e-6, "tet": 5e-8},
               "wsim.simulation.cost:count_explicit_choice")),
    MethodRow("aero", "wsim.physics.cloth.air", without="no cloth has drag or lift", gradients=True, pushes=True,
              cost=MethodCost({"blown": 9e-6}, {"blown": 2e-6, "aired": 6e-8})),
    MethodRow("implicit", "wsim.physics.solver.newton", without="another solver is chosen", gradients=True,
              cost=MethodCost({"newton": 1.2e-4, "solved": 5e-9, "damped": 5e-9, "assembled": 3.9e-9, "gradient": 5.6e-5,
               "conjugate": 2.2e-8, "iterated": 3e-5, "pressed": 8.3e-4}, {"newton": 2e-5, "solved": 1.02e-6, "damped": 8e-7,
               "assembled": 1.09e-7, "gradient": 0.0, "conjugate": 9.4e-8, "pressed": 0.0},
               "wsim.simulation.cost:count_newton_choice")),
    MethodRow("xpbd", "wsim.physics.solver.xpbd", without="another solver is chosen, and nothing is hard", gradients=True,
              pushes=True,
              cost=MethodCost({"rest": 1.6e-5, "sweep": 3.6e-5, "projection": 2.1e-11}, {"rest": 4.5e-6, "sweep": 6e-7,
               "projection": 1.43e-8}, "wsim.simulation.cost:count_sweeps_choice")),
    MethodRow("shape_matching", "wsim.physics.soft.clusters.method", without="there are no clusters", pushes=True,
              cost=MethodCost({"matched": 1.5e-5, "member": 1.1e-10, "spun": 1.4e-9}, {"matched": 3.4e-6, "member": 2.25e-8,
               "spun": 5.2e-8}, "wsim.simulation.predicted.scene_counts:count_clusters")),
    MethodRow("arrivals", "wsim.physics.position_based.arrivals", without="no particles come or go"),
    MethodRow("grains", "wsim.physics.position_based.grains", without="there are no grains", pushes=True),
    MethodRow("density", "wsim.physics.position_based.fluid", without="no fluid moves by constraints", pushes=True),
    MethodRow("rigid", "wsim.physics.rigid", owns=("Body", "Joint", "Actuator", "Group", "FilteredPairs"),
              unseen=("Joint", "Actuator", "Group", "FilteredPairs"),
              claims=("PhysicsRigidBodyAPI", "PhysicsJoint", *JOINTS, "PhysicsCollisionGroup", "PhysicsFilteredPairsAPI",
                      "PointInstancer", "MjcActuator", "NewtonActuator"),
              without="there is no rigid body", gradients=True,
              cost=MethodCost({"rigid": 2.2e-4, "contact": 7e-8, "joint": 3.8e-4}, {"rigid": 2.5e-5, "contact": 6.5e-7,
               "joint": 1.25e-5}, "wsim.simulation.predicted.scene_counts:count_rigid")),
    MethodRow("fluid", "wsim.physics.fluid", owns=("Fluid", "Source"), unseen=("Source",),
              claims=("WsimFluidDomainAPI", "WsimFluidSourceAPI"), without="there is no fluid", gradients=True,
              cost=MethodCost({"grid": 0.0015, "cell": 3e-9, "walled": 0.0, "sheeted": 3e-7, "emitted": 1e-11},
               {"grid": 1e-4, "cell": 2e-6, "walled": 8e-7, "sheeted": 1.9e-5, "emitted": 1.5e-8},
               "wsim.simulation.predicted.scene_counts:count_smoke")),
    MethodRow("liquid", "wsim.physics.fluid.liquid", owns=("Liquid", "LiquidSource"), unseen=("LiquidSource",),
              claims=("WsimLiquidDomainAPI", "WsimLiquidSourceAPI"), without="there is no liquid",
              cost=MethodCost({"tank": 0.003, "drop": 1.5e-8}, {"tank": 0.0, "drop": 1e-5},
               "wsim.simulation.predicted.scene_counts:count_liquids")),
    MethodRow("mpm", "wsim.physics.mpm", owns=("MaterialPoints", "MaterialSink"), unseen=("MaterialSink",),
              claims=("WsimMaterialPointsAPI", "WsimMaterialSinkAPI", "NewtonPointsDeformableSimAPI", "PhysxParticleSetAPI"),
              without="there are no material points", gradients=True, pushes=True,
              cost=MethodCost({"transfer": 7e-5, "particle": 5.7e-10, "pushed": 4.4e-4, "meshed": 2.7e-4, "enclosed": 0.0,
                               "long": 0.01, "solved_particle": 1e-9},
                              {"transfer": 6e-5, "particle": 4e-7, "pushed": 8e-4, "meshed": 0.0, "enclosed": 7e-7,
                               "long": 6e-4, "solved_particle": 1.6e-6},
                              "wsim.simulation.predicted.scene_counts:count_material_points")),
    MethodRow("rods", "wsim.physics.rods", owns=("Rods",), without="there is no rod",
              cost=MethodCost({"rods": 0.001, "rod": 7e-9, "ropes": 0.013, "rope": 4e-6}, {"rods": 0.0, "rod": 4e-6,
               "ropes": 0.003, "rope": 1e-5}, "wsim.simulation.predicted.scene_counts:count_strands")),
    MethodRow("follow", "wsim.physics.rods.follow", owns=("Followers",), posed=True, claims=("WsimRodsAPI",),
              without="no hair follows guides"),
    MethodRow("bones", "wsim.physics.animation", owns=("Skeleton",), unseen=("Skeleton",), posed=True, claims=("Skeleton",),
              without="nothing follows a skeleton", gradients=True),
    MethodRow("contact", "wsim.physics.contact.method", without="there is no collider", gradients=True, pushes=True,
              cost=MethodCost({"touch": 5.1e-6, "near": 3e-11, "mesh": 4e-5, "wide": 6e-6, "met": 3e-11}, {"touch": 1e-6,
               "near": 1.6e-8, "mesh": 0.0, "wide": 0.0, "met": 1.2e-7})),
    MethodRow("selfcontact", "wsim.physics.contact.selfcontact.method", without="no surface collides with itself", pushes=True,
              cost=MethodCost({"surfaces": 4e-4, "surfaced": 1e-8}, {"surfaces": 1e-4, "surfaced": 1.3e-5})),
    MethodRow("watch", "wsim.physics.motion.divergence_monitor", gradients=True),
    MethodRow("volume", "wsim.physics.soft.volume", gradients=True),
    MethodRow("muscles", "wsim.physics.cloth.nets.muscles", without="no spring has an actuation", gradients=True),
    MethodRow("loads", "wsim.physics.motion.loads", without="nothing is loaded", gradients=True),
]


def owning_method(name: str) -> MethodRow | None:
    """The row that owns a dataclass of that name."""
    return next((row for row in METHODS if name in row.owns), None)


def method_file(name: str, file: str) -> Any:
    """A file of the folder that owns a dataclass of that name."""
    return next(row for row in METHODS if name in row.owns).role(file)


def claiming_method(names) -> MethodRow | None:
    """The row that reads prims of one of these types or APIs."""
    return next((row for row in METHODS if not set(row.claims).isdisjoint(names)), None)


def object_at_path(scene, path: str | None) -> Any:
    """The object of a scene at a path, the scene itself at "/"; None where there is none."""
    return scene if path == "/" else next((thing for thing in objects_with_values(scene) if thing.path == path), None)


def objects_with_values(scene) -> list:
    """All objects of a scene that may have values."""
    return [*scene.bodies(), *all_scene_pins(scene), *scene.colliders, *scene.loads,
            *(thing for _, thing in each_method_object(scene))]


def method_colliders(scene) -> list:
    """Colliders that move with things of methods, and are met."""
    if not has_other_objects(scene):
        return []
    apart = driving_bodies(scene)
    return [c for _, thing in each_method_object(scene) if thing.path not in apart for c in getattr(thing, "colliders", ())
            if c.meets]


def paths_following(scene, thing) -> list[str]:
    """Paths of the colliders and pins whose points follow a thing, such as a skeleton."""
    return [*(c.path for c in scene.colliders if getattr(getattr(c.shape, "poses", None), "skeleton", None) is thing),
            *(p.path for p in scene.all_pins() if p.follows is not None and p.follows.skin.skeleton is thing)]


def driving_bodies(scene) -> set[str]:
    """Paths of the bodies that drive what others follow: that meets points in their stead."""
    driving = [thing for _, thing in each_method_object(scene) if getattr(thing, "bodies", None)]
    return {path for thing in driving if paths_following(scene, thing) for path in thing.bodies.values()}


def has_method_objects(scene) -> bool:
    """True if a scene holds something that methods simulate, or would."""
    return any(not row.posed for row, _ in each_method_object(scene))


def has_collisions(scene) -> bool:
    """True if points may meet something."""
    return bool(scene.colliders or method_colliders(scene) or has_self_collision(scene))


def all_scene_pins(scene) -> list:
    """Pins of bodies, and those that objects such as rods have themselves."""
    return [*scene.pins, *(pin for _, thing in each_method_object(scene) for pin in getattr(thing, "pins", ()))]


def pins_of_object(scene, path: str) -> list:
    """The list that pins of an object stand in: its own, or the scene's."""
    own = (thing.pins for _, thing in each_method_object(scene) if thing.path == path and hasattr(thing, "pins"))
    return next(own, scene.pins)


def loads_on_deformables(scene) -> list:
    """Loads of cloths, spring nets and soft bodies: others are of what methods hold, such as rods."""
    paths = {body.path for body in scene.bodies()} if scene.loads else set()
    return [load for load in scene.loads if load.body in paths]


def point_objects(scene) -> list:
    """All objects of a scene that have points which can be held, loaded or dragged: bodies, rods, ...."""
    return [*scene.bodies(), *(thing for _, thing in each_method_object(scene) if hasattr(thing, "refused"))]


def has_sheets(scene) -> bool:
    """True if a body of a scene is a sheet."""
    return any(body.is_sheet for body in scene.bodies())


def has_tets(scene) -> bool:
    """True if a body of a scene is filled with tetrahedra."""
    return any(body.is_solid for body in scene.bodies())


def solid_materials(scene) -> list:
    """Materials of all bodies that are filled with tetrahedra."""
    return [material for body in scene.bodies() if body.is_solid for material in body.materials]


def feels_air(scene) -> bool:
    """True if air pushes a body of points."""
    return any(body.feels_air for body in scene.bodies())


def scene_skins(scene) -> list:
    """Meshes that follow bodies of a scene."""
    return [skin for body in scene.bodies() for skin in body.skins]


def place_among(scene, body) -> int:
    """Place of a body among those of its class."""
    return next(k for k, each in enumerate(scene.things(type(body).__name__)) if each is body)


def deforming_classes() -> list[str]:
    """Names of the classes of bodies of points, in the order of the state's arrays."""
    return [name for row in METHODS if row.deforms for name in row.owns]


def has_other_objects(scene) -> bool:
    """True if a scene holds something that is no body of points, collider or what holds and loads these."""
    deforming = deforming_classes()
    return any(found and name not in deforming for name, found in scene.objects.items())


def each_body_of_points(scene) -> Iterator[tuple[MethodRow, Any]]:
    """(row, thing) of the bodies of points of a scene, in the order of the state's arrays."""
    for row in (row for row in METHODS if row.deforms):
        for name in row.owns:
            yield from ((row, thing) for thing in scene.things(name))


def other_objects(scene) -> list:
    """All that a scene holds of methods besides bodies of points."""
    return [thing for _, thing in each_method_object(scene)]


def each_method_object(scene) -> Iterator[tuple[MethodRow, Any]]:
    """(row, thing) of what a scene holds besides bodies of points."""
    for row in (row for row in METHODS if not row.deforms):
        for name in row.owns:
            yield from ((row, thing) for thing in scene.things(name))


def count_noun(n: int, noun: str) -> str:
    """1 pin, 2 pins; 1 body, 2 bodies"""
    return f"{n} {noun}" if n == 1 else f"{n} {noun[:-1]}ies" if noun.endswith("y") else f"{n} {noun}s"


def separated_words(name: str) -> str:
    """MaterialPoints: material points."""
    return re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _class_noun(name: str) -> str:
    """Of a class of things, or their noun, each of which may be many: body, fluid domain; rod prim, particle prim."""
    words = separated_words(name)
    return f"{words[:-1]} prim" if words.endswith("s") else words


def describe_scene_contents(scene) -> str:
    """Text that counts what a scene holds."""
    bodies, deforming = scene.bodies(), deforming_classes()
    kinds: dict[str, list] = {**{_class_noun(n): [b for b in bodies if b.noun == n] for n in {b.noun: 0 for b in bodies}},
                              "skin": scene_skins(scene), "collider": scene.colliders, "pin": scene.pins, "load": scene.loads,
                              **{_class_noun(name): found for name, found in scene.objects.items() if name not in deforming}}
    things = ", ".join(count_noun(len(found), noun) for noun, found in kinds.items() if found)
    sizes = {"point": sum(len(body.points) for body in bodies), "tet": sum(len(body.tets) for body in bodies if body.is_solid)}
    size = ", ".join(count_noun(n, noun) for noun, n in sizes.items() if n)
    own = f"{count_noun(scene.substeps, 'substep')}, {count_noun(scene.iterations, 'iteration')}, solver {scene.solver}"
    steps = (f"{own}, integrator {scene.integrator}" if scene.solver != "auto" else
             own if any(body.is_particles for body in bodies) else "solver auto, which chooses substeps and integrator")
    return (f"{things or 'nothing'}; {f'{size}; ' if size else ''}{count_noun(scene.frames, 'frame')} of 1/{scene.fps:g} s, "
            f"{steps}")
