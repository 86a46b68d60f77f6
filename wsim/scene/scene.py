"""What exists: plain data in SI units (m, kg, s, rad), NumPy only, one to one with what a USD stage can say.

A scene holds objects, each named by its prim path. Points are kept in the object's own frame [m], in the precision that they
are given in, beside a local-to-world `motion` in float64. A save followed by a load gives the same, to float32.

    scene = Scene(gravity=(0, -9.81, 0))
    flag = scene.cloth("/flag", *shapes.sheet(1.0, 1.0, 32, 32), material=Fabric(stretch=500.0))
    scene.pin("/pins", flag, points=range(33))
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.scene import solids
from wsim.scene.attachments import Load, Pin, Tie, Varying, as_curve_over_time, pin_onto_collider
from wsim.scene.bodies import ArrayDataclass, DefaultCount, Deformable, body_in_single_precision
from wsim.scene.check.arguments import name_wrong_arguments, object_of_path
from wsim.scene.check.problem import Problem, SceneError
from wsim.scene.curve import Motion
from wsim.scene.methods import METHODS, deforming_classes, describe_scene_contents, method_file, owning_method, pins_of_object
from wsim.scene.solids import Box, Capsule, Collider, Cone, Cylinder, Plane, Shape, Sphere, Surface

if TYPE_CHECKING:
    from wsim.physics.cloth.nets.objects import Springs
    from wsim.physics.cloth.objects import Cloth
    from wsim.physics.soft.objects import Soft

__all__ = ["Box", "Capsule", "Collider", "Cone", "Cylinder", "Deformable", "Load", "Motion", "Pin", "Plane", "Problem", "Scene",
           "SceneError", "Shape", "Sphere", "Surface", "Tie", "Varying"]

COLLIDER_FIELDS = ("static_friction", "dynamic_friction", "restitution", "thickness", "approximation", "solref", "solimp")


def _motion_or_placement(path: str, at, more: dict) -> Motion:
    """The motion among arguments, or the place `at`. Raises SceneError for both, and for what is no Motion."""
    motion = more.get("motion")
    if np.shape(at) != (3,):
        raise SceneError(Problem(path, f"at is {at}; allowed are three lengths [m]"))
    if motion is None:
        return Motion.at_place(at)
    if not isinstance(motion, Motion):
        raise SceneError(Problem(path, f"motion is {motion!r}; allowed is a Motion, such as Motion.through(times, places)"))
    if np.any(at):
        raise SceneError(Problem(path, f"at is {tuple(at)}, beside a motion, which says where it is; leave one of them out"))
    return motion


def _objects_of_class(name: str, doc: str) -> Any:
    """A list of `Scene.objects` as an attribute."""
    return property(lambda s: s.objects.setdefault(name, []), lambda s, things: s.objects.update({name: things}), doc=doc)


@name_wrong_arguments
@dataclass(eq=False, repr=False)
class Scene(ArrayDataclass):
    """A scene: everything there is, as in `Scene(up="Z", fps=30.0, frames=60)`. Frame f is at time f / fps [s] after `start`;
    a substep is h = 1 / fps / substeps.

    gravity         acceleration, (3,) [m/s^2]; None: 9.81 against `up`
    wind            velocity of the air, (3,) [m/s]
    air_density     [kg/m^3]; air_drag: decay rate of every point's velocity [1/s]
    up              axis that points up, "Y" or "Z"
    fps             frames (time codes) a second [1/s]; start: time code of the first frame [frames], the initial state
    frames          how many frames to simulate
    substeps        substeps a frame, where neither the solver nor, if nobody named them, stacks of bodies choose more
    iterations      solver iterations a substep
    solver          of the elastic forces: "auto" (weighs cost against error), "explicit", "xpbd" or "implicit"
    integrator      of time: "auto" (what suits the solver), or a name of `wsim.scene.integrator.TABLE`
    contact_width   distance over which contacts are soft [m]; 0: hard contacts
    contact_tolerance   residual of rigid contacts at which sweeps end [m/s]; 0: after `iterations`
    contact_model   of rigid bodies: "rigid", or "mujoco": soft as in MuJoCo, see `Collider.solref`
    coordinates     of bodies with joints: "auto", "maximal" (each body has six) or "reduced" (those of the joints)
    sleep_speed     speed of rigid bodies under which an island goes to sleep [m/s]; 0: none does
    error           wanted RMS error of positions over the scene's size [1], for "auto"
    objects         what methods simulate, {class name: list}; `scene.cloth(...)`, `net`, `soft`, `clusters`, `particles`,
                    `body`, `joint`, `rods`, `smoke`, `liquid`, `mpm`, `add`
    colliders       list of `Collider`; `scene.collider(...)`
    pins, ties      lists of `Pin`, `Tie`; `scene.pin(...)`, `scene.tie(...)`
    loads           list of `Load`; `scene.force(...)`, `scene.traction(...)`
    varying         list of `Varying`; the fields above have their values at the start
    source          file that it was loaded from
    notes           list of `Problem`: what the loader warned about
    variants        chosen USD variants, {prim path: {variant set: variant}}
    """

    gravity: tuple[float, float, float] = None  # type: ignore[assignment]  # set from `up` below
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    air_density: float = 1.2
    air_drag: float = 0.0
    up: str = "Y"
    fps: float = 24.0
    start: float = 0.0
    frames: int = 96
    substeps: int = DefaultCount(10)
    iterations: int = 4
    solver: str = "auto"
    integrator: str = "auto"
    contact_width: float = 0.0
    contact_tolerance: float = 0.0
    contact_model: str = "rigid"
    coordinates: str = "auto"
    sleep_speed: float = 0.0
    error: float = 0.01
    objects: dict[str, list] = field(default_factory=dict)
    colliders: list[Collider] = field(default_factory=list)
    pins: list[Pin] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    varying: list[Varying] = field(default_factory=list)
    source: str | None = field(default=None, compare=False)
    notes: list["Problem"] = field(default_factory=list, compare=False)
    variants: dict[str, dict[str, str]] = field(default_factory=dict, compare=False)

    def __post_init__(self):
        if self.gravity is None:
            self.gravity = (0.0, 0.0, -9.81) if self.up == "Z" else (0.0, -9.81, 0.0)
        self.objects = {name: [] for name in deforming_classes()} | self.objects

    def __repr__(self) -> str:
        return f"<Scene{f' {self.source}' if self.source else ''}: {describe_scene_contents(self)}>"

    def add(self, thing):
        """Adds an object of a method. Raises SceneError where no method owns its class."""
        if owning_method(name := type(thing).__name__) is None:
            said = f"is a {name}, which no method simulates; there are: {', '.join(n for row in METHODS for n in row.owns)}"
            raise SceneError(Problem(getattr(thing, "path", "/"), said))
        self.objects.setdefault(name, []).append(thing)
        return thing

    def things(self, name: str) -> list:
        """Objects of a class, by its name."""
        return self.objects.get(name, [])

    def with_objects(self, name: str, things: list) -> "Scene":
        """The scene with other objects of a class, by its name; the given one stays as it is."""
        return replace(self, objects={**self.objects, name: things})

    cloths = _objects_of_class("Cloth", "Its cloths; `scene.cloth(...)` adds one.")
    springs = _objects_of_class("Springs", "Its spring nets; `scene.net(...)` adds one.")
    softs = _objects_of_class("Soft", "Its soft bodies; `scene.soft(...)` adds one.")

    def exchanged(self, thing, new) -> "Scene":
        """The scene with another object in the place of one; the given one stays as it is."""
        lists: dict = {name: [new if each is thing else each for each in getattr(self, name)]
                       for name in ("colliders", "pins", "ties", "loads")}
        objects = {name: [new if each is thing else each for each in found] for name, found in self.objects.items()}
        return replace(self, **lists, objects=objects)

    def cloth(self, path: str, points, counts, indices=None, **more) -> "Cloth":
        """Adds a cloth; see `Cloth` for the fields."""
        return self.add(method_file("Cloth", "objects").Cloth(path, points, counts, indices, **more))

    def net(self, path: str, points, edges, stiffness, masses, **more) -> "Springs":
        """Adds a spring net; see `Springs` for the fields."""
        return self.add(method_file("Springs", "objects").Springs(path, points, edges, stiffness, masses, **more))

    def soft(self, path: str, points, tets, **more) -> "Soft":
        """Adds a soft body; see `Soft` for the fields."""
        return self.add(method_file("Soft", "objects").Soft(path, points, tets, **more))

    def clusters(self, path: str, points, **more) -> Any:
        """Adds points (n, 3) [m] kept in clusters by shape matching, with mass=... [kg] of all or masses=... (n,); see
        `wsim.physics.soft.clusters.objects.Clusters`."""
        return self.add(method_file("Clusters", "objects").Clusters(path, points, **more))

    def collider(self, path: str, shape: Shape, at=(0.0, 0.0, 0.0), **more) -> Collider:
        """Adds a collider at a place `at` (3,) [m], or with motion=...; a `Plane()` placed `at` one is a floor facing `up`."""
        shape = shape if "motion" in more else solids.upright_plane(shape, self.up)
        more["motion"] = _motion_or_placement(path, at, more)
        self.colliders.append(Collider(path, shape, **more))
        return self.colliders[-1]

    def particles(self, path: str, shape=None, at=(0.0, 0.0, 0.0), radius=0.01, **more) -> Any:
        """Adds grains, or material="fluid", that constraints move (`wsim.physics.position_based.objects.Particles`), of a
        `radius` [m]: they fill a closed shape at a place `at` (3,) [m] or with motion=..., or are points=... (n, 3) [m]; pour:
        a `Pour` of later ones. Raises SceneError where a shape is open, or holds no particle or too many."""
        more["motion"] = _motion_or_placement(path, at, more)
        return self.add(method_file("Particles", "objects").make_particles(path, shape, radius, more))

    def body(self, path: str, shape=None, at=(0.0, 0.0, 0.0), **more) -> Any:
        """Adds a rigid body (`wsim.Body`) of one shape, at a place `at` (3,) [m] or with motion=...; several shapes are its
        colliders=[...]. more: fields of `Body`, and of the collider: static_friction, dynamic_friction, restitution ..."""
        if shape is not None:
            surface = {name: more.pop(name) for name in COLLIDER_FIELDS if name in more}
            more["colliders"] = [Collider(f"{path}/shape", shape, **surface)]
        more["motion"] = _motion_or_placement(path, at, more)
        return self.add(method_file("Body", "objects").Body(path, **more))

    def joint(self, kind: str, path: str, body0=None, body1=None, at=(0.0, 0.0, 0.0), axis=(1.0, 0.0, 0.0), **more) -> Any:
        """Adds a joint (`wsim.Joint`) of two rigid bodies, or a body and a collider, which may move by keys, or their paths;
        None: the world. kind: "fixed", "revolute" (turns about `axis`), "prismatic" (slides along it), "spherical". at, axis
        (3,): world [m]. more: low, high [rad] or [m], fields of `Joint`. Raises SceneError for another kind or body."""
        ends = [self._rigid_body_at(path, body) for body in (body0, body1)]
        return self.add(method_file("Joint", "joints.joint").joint_of_kind(kind, path, *ends, at=at, axis=axis, **more))

    def actuator(self, kind: str, path: str, joint, control=0.0, **more) -> Any:
        """Adds a `wsim.Actuator` on a joint: "motor", "position" or "velocity" servo, "general"; control: number or `Curve`."""
        return method_file("Joint", "joints.actuators.actuator").add_actuator(self, kind, path, joint, control, **more)

    def _rigid_body_at(self, path: str, body) -> Any:
        """A rigid body, or a collider, by its path."""
        return body if not isinstance(body, str) else object_of_path(
            path, "body", body, [*self.things("Body"), *self.colliders], "rigid body or collider")

    def rods(self, path: str, points, counts, **more) -> Any:
        """Adds rods or hair (`wsim.Rods`): points (n, 3) [m], strand behind strand, counts of points of each strand."""
        return self.add(method_file("Rods", "objects").Rods(path, points, counts, **more))

    def hair(self, path: str, collider: Collider, number: int, length: float, where=None, segments: int = 8, **more) -> Any:
        """Adds hair (`wsim.Rods`) that grows from a collider and goes with it: `number` strands of `length` [m], spread evenly,
        straight out, clamped at their roots. where: bool of places (n, 3) [m], which triangles have hair (None: all)."""
        return self.add(method_file("Rods", "objects").grow_hair(path, collider, number, length, where, segments, more))

    def smoke(self, path: str, low, high, cell: float, **more) -> Any:
        """Adds a box of air (`wsim.Fluid`), corners `low` and `high` (3,) [m], cells of edge `cell` [m]; see `smoke_source`."""
        return self.add(method_file("Fluid", "objects").Fluid(path, low, high, cell, **more))

    def liquid(self, path: str, low, high, cell: float, **more) -> Any:
        """Adds an empty box for liquid (`wsim.Liquid`), corners `low` and `high` (3,) [m], cells of edge `cell` [m]."""
        return self.add(method_file("Liquid", "objects").Liquid(path, low, high, cell, **more))

    def mpm(self, path: str, shape=None, at=(0.0, 0.0, 0.0), **more) -> Any:
        """Adds a body of particles that break, pour and pile up (`wsim.physics.mpm.objects.MaterialPoints`): a closed shape
        at a place `at` (3,) [m] or with motion=..., or points=... (n, 3) [m] with volumes=... [m^3]; material "jelly",
        "snow", "sand", "water" or one of their classes; cell: edge of a cell [m], one for all bodies; velocity (3,) [m/s];
        pour: `Pour(start, end, rate)`. As in `scene.mpm("/heap", Box((0.1, 0.1, 0.1)), cell=0.04, material="sand")`."""
        more["motion"] = _motion_or_placement(path, at, more)
        return self.add(method_file("MaterialPoints", "objects").MaterialPoints(path, shape, **more))

    def sink(self, path: str, shape, at=(0.0, 0.0, 0.0), **more) -> Any:
        """Adds a shape that takes particles of `particles` and `mpm` away, at a place `at` (3,) [m] or with motion=...; a
        `Plane()` takes what is below it. That of a liquid is `liquid_source(role="sink")`."""
        shape = shape if "motion" in more else solids.upright_plane(shape, self.up)
        more["motion"] = _motion_or_placement(path, at, more)
        return self.add(method_file("MaterialSink", "objects").MaterialSink(path, shape, **more))

    def smoke_source(self, path: str, fluid, shape, at=(0.0, 0.0, 0.0), **more) -> Any:
        """Adds a shape that smoke, heat or air comes from (`wsim.Source`) to a box of air, or its path; at a place `at` (3,)
        [m] or with motion=.... A `PointCloud` is the balls about many points."""
        return self._source("Source", "fluid", path, fluid, shape, at, more)

    def liquid_source(self, path: str, liquid, shape, at=(0.0, 0.0, 0.0), **more) -> Any:
        """Adds a shape that liquid fills at the start (`wsim.LiquidSource`; role="source": that it flows from, "sink": vanishes
        in) to a box for liquid, or its path; at a place `at` (3,) [m] or with motion=...."""
        return self._source("LiquidSource", "liquid", path, liquid, shape, at, more)

    def _source(self, name: str, of: str, path: str, domain, shape, at, more: dict) -> Any:
        shape = shape if "motion" in more else solids.upright_plane(shape, self.up)
        more |= {"motion": _motion_or_placement(path, at, more), of: getattr(domain, "path", domain)}
        return self.add(getattr(method_file(name, "objects"), name)(path, shape, **more))

    def pin(self, path: str, body, points, onto=None, **more) -> Pin:
        """Holds points (k,), counted from 0, of a body, or its path; see `Pin`. onto: a collider, or its path, with which they
        go; on skin each goes with its nearest face. As in `scene.pin("/collar", cape, range(9), onto=man)`."""
        pin = Pin(path, body if isinstance(body, str) else body.path, points, **more)
        if onto is not None:
            holders = [*self.bodies(), *self.things("Rods"), *self.things("MaterialPoints")]
            body = object_of_path(path, "body", pin.body, holders)
            onto = object_of_path(path, "onto", getattr(onto, "path", onto), self.colliders)
            pin = pin_onto_collider(pin, body, onto)
        pins_of_object(self, pin.body).append(pin)
        return pin

    def tie(self, path: str, body, points, other, others=None, places=None) -> Tie:
        """Adds a tie: points (indices) of a body become points of a soft body, the first the first of `others`, and so on.
        Without `others`: a rigid body holds them where they are, or at `places` (k, 3) [m] in its frame; they pull at it."""
        self.ties.append(Tie(path, getattr(body, "path", body), points, getattr(other, "path", other), others, places))
        return self.ties[-1]

    def force(self, path: str, body, points, force, weights=None) -> Load:
        """Adds a force [N], (3,) or a Curve over time, on points (indices) of a body: their sum, or, with `weights`, that part
        of it on each (1 for each: all of it on every one)."""
        share = None if weights is None else np.broadcast_to(np.asarray(weights, np.float32), np.shape(points)).copy()
        self.loads.append(Load(path, getattr(body, "path", body), as_curve_over_time(force), points, share))
        return self.loads[-1]

    def traction(self, path: str, body, triangles, traction) -> Load:
        """Adds a traction [Pa], (3,) or a Curve, on triangles (m, 3) of a cloth or soft body (`surface_triangles_among`)."""
        self.loads.append(Load(path, getattr(body, "path", body), as_curve_over_time(traction), triangles=triangles))
        return self.loads[-1]

    def all_pins(self) -> list[Pin]:
        """Pins of cloths, nets, soft bodies, rods and material points."""
        return [pin for holder in (self, *self.things("Rods"), *self.things("MaterialPoints")) for pin in holder.pins]

    def single(self) -> "Scene":
        """Doubles rounded to float32, for a run in float32: rest lengths are those of the points that it begins with."""
        own = {name: [body_in_single_precision(thing) for thing in self.things(name)] for name in deforming_classes()}
        return replace(self, objects=self.objects | own, pins=[body_in_single_precision(pin) for pin in self.pins])

    def bodies(self) -> list[Deformable]:
        """Bodies of points: cloths, springs, soft bodies, in the order of the state's arrays."""
        return [thing for name in deforming_classes() for thing in self.things(name)]
