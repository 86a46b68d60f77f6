"""Which methods a scene needs, and what they are made of. The table is `wsim.scene.methods.METHODS`; a method is imported where
it is needed, its `build(Build)` makes it, and when all are made each connects itself with others (`Method.connect_ports`).
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from math import isfinite
from typing import Any

import numpy as np

from wsim.model.midnodes import places_with_midnodes as node_places
from wsim.model.model import Model, edge_lengths
from wsim.model.stage import Clock, Method, Methods, Ports
from wsim.model.state import ANCHOR, CARRY, HALF, HISTORY, POINTS, STAGED, SimulationState, StateField, StatePart
from wsim.model.status import FrameStatus
from wsim.physics.cloth.constraints import Constraints
from wsim.scene import Scene
from wsim.scene.methods import (
    METHODS,
    MethodRow,
    deforming_classes,
    feels_air,
    has_other_objects,
    has_self_collision,
    has_sheets,
    has_tets,
    loads_on_deformables,
    method_colliders,
    solid_materials,
)
from wsim.scene.nodal.separate import separate_coincident_ends
from wsim.scene.nodal.touching import bodies_that_touch_as_balls
from wsim.simulation.choice import SchemeChoice


@dataclass
class Build:
    """The things that methods are made of: the tables of a scene, what it chose, and the methods that stand before in the
    table."""

    model: Model
    choice: SchemeChoice
    state: SimulationState
    status: FrameStatus
    clock: Clock
    reasons: dict[str, str] = field(default_factory=dict)
    methods: Methods = field(default_factory=Methods)

    @property
    def scene(self) -> Scene:
        return self.model.scene

    @property
    def ports(self) -> Ports:
        """Ports of the methods that stand before in the table."""
        return self.methods.ports

    @cached_property
    def colliders(self) -> Any:
        """The scene's colliders on the device; who asks poses them where a frame begins
        (`wsim.physics.contact.collider.table`)."""
        from wsim.physics.contact.collider.table import ColliderTable
        return ColliderTable(self.model, self.scene.colliders)

    @property
    def within(self) -> bool:
        """True if wind, contacts, soft pins, hard constraints or what else pushes act within a substep."""
        return bool(self.reasons["contact"]) or self.others_within

    @property
    def others_within(self) -> bool:
        """True if something else than contacts with colliders does."""
        return (any(self.reasons[row.name] for row in METHODS if row.pushes and row.name != "contact")
                or any(np.isfinite(p.stiffness) for p in self.scene.pins))

    @property
    def free(self) -> bool:
        """True if frames in which nothing can touch leave contacts out. Not on a CPU that takes substeps of all that acts in
        one launch: another, without contacts, costs more to compile than contacts that are far cost."""
        if not self.reasons["contact"] or self.others_within and self.model.fuser and not self.model.device.is_cuda:
            return False
        if self.reasons["grains"] or self.reasons["density"] or self.taken - {"aero", "contact", "loads"}:
            return False
        from wsim.physics.contact.free_flight_test import allows_free_flight
        return allows_free_flight(self.scene, self.model.gradients)

    @property
    def edges(self) -> bool:
        """True if edges of cloths meet colliders; not by Newton's method, which knows planes of points."""
        if not (has_sheets(self.scene) and (self.scene.colliders or has_other_objects(self.scene))):
            return False
        from wsim.scene.check.sharp import has_edge_contacts
        return has_edge_contacts(self.scene) and not self.model.gradients and self.choice.solver != "implicit"

    @property
    def alone(self) -> bool:
        """True if nothing but self-contact acts within a substep, and frames in which nothing is near leave it out."""
        pushes = [row.name for row in METHODS if row.pushes and self.reasons[row.name]]
        return pushes == ["selfcontact"] and not any(np.isfinite(p.stiffness) for p in self.scene.pins)

    @property
    def taken(self) -> frozenset[str]:
        """Names of all that acts within a substep of leapfrog on a GPU, where blocks that share sheets may take it along
        (`wsim.physics.motion.fused.domain_decomposition`): air, soft pins, tethers, strain limits, loads, contacts with what
        keeps its shape."""
        acts = frozenset(row.name for row in METHODS if row.pushes and self.reasons[row.name])
        leapfrog = self.choice.solver == "explicit" and len(self.choice.integrator.steps) == 2
        if not (acts <= {"aero", "contact", "xpbd"} and leapfrog and self.model.device.is_cuda):
            return frozenset()
        from wsim.physics.motion.fused.domain_decomposition import blocks_take_acts
        also = {"soft pins": any(np.isfinite(p.stiffness) for p in self.scene.pins),
                "loads": bool(loads_on_deformables(self.scene))}
        return acts | {name for name, there in also.items() if there} if blocks_take_acts(self.model) else frozenset()

    def kept(self, soft: bool) -> list[Constraints]:
        """The constraints that have a stiffness, or those that have none: XPBD holds the hard ones whatever solves for the
        forces."""
        return [r for r in self.model.constraints if r.hard != soft]


def _reason_for_solver(name: str) -> Callable[[Build], str]:
    return lambda b: b.choice.why if b.choice.solver == name else ""


def _reason_for_xpbd(b: Build) -> str:
    hard = any(r.hard for r in b.model.constraints)
    return b.choice.why if b.choice.solver == "xpbd" else "tethers or strain limits" if hard else ""


def _reason_for_contact(b: Build) -> str:
    kinds = sorted({type(c.shape).__name__.lower() for c in (*b.scene.colliders, *method_colliders(b.scene))})
    return f"colliders: {', '.join(kinds)}" if kinds and b.model.bodies else ""


NEEDED: dict[str, Callable[[Build], str]] = {
    "points": lambda b: "there are points that move" if b.model.bodies else "",
    "pins": lambda b: f"{len(b.scene.pins)} pins" if b.scene.pins else "",
    "explicit": _reason_for_solver("explicit"),
    "aero": lambda b: "a cloth has drag or lift" if feels_air(b.scene) else "",
    "implicit": _reason_for_solver("implicit"),
    "xpbd": _reason_for_xpbd,
    "shape_matching": lambda b: "bodies keep their shape in clusters" * any(body.is_cluster for body in b.scene.bodies()),
    "arrivals": lambda b: "particles come and go" * bool(b.scene.things("Particles") and b.scene.things("MaterialSink") or any(
        thing.shape is not None for thing in b.scene.things("Particles"))),
    "grains": lambda b: "points touch as balls" * bool(bodies_that_touch_as_balls(b.scene)),
    "density": lambda b: "constraints keep a fluid's density" * any(body.is_particles and body.is_fluid
                                                                    for body in b.scene.bodies()),
    "contact": _reason_for_contact,
    "selfcontact": lambda b: "surfaces collide with themselves" if has_self_collision(b.scene) and b.model.bodies else "",
    "watch": lambda b: "" if b.choice.solver == "explicit" or b.model.gradients or not b.model.bodies else "edges are watched",
    "volume": lambda b: "the corotational law may lose volume" if not b.model.gradients and any(
        m.model == "corotational" for m in solid_materials(b.scene)) else "",
    "muscles": lambda b: "springs have an actuation" if any(body.actuation for body in b.scene.bodies()) else "",
    "loads": lambda b: f"{len(found)} loads" if (found := loads_on_deformables(b.scene)) else "",
}


def reason_for_method(row: MethodRow, b: Build) -> str:
    """Reason why a scene needs a method, or ""."""
    if row.name in NEEDED or row.deforms:
        return "" if row.deforms else NEEDED[row.name](b)
    counts = {name: len(b.scene.things(name)) for name in row.owns}
    if row.owns and not counts[row.owns[0]]:                    # what the others are about
        return ""
    return ", ".join(f"{n} {name}" for name, n in counts.items() if n)


def build_method_of_row(row: MethodRow, b: Build) -> Method | None:
    """Raises SceneError where gradients are asked for and the method has none."""
    if b.model.gradients and not row.gradients:
        from wsim.scene.values.coverage import gradient_refusal
        if row.name == "selfcontact":
            raise gradient_refusal("surfaces",
                                   next(body.path for body in b.scene.bodies() if body.self_collision))
        path = b.scene.things(row.owns[0])[0].path if row.owns else next(
            (body.path for body in b.scene.bodies() if body.is_cluster or body.is_particles), "/")
        raise gradient_refusal("method", path, method=row.name.replace("_", " "))
    return (import_module(row.folder) if not row.owns else row.role("method")).build(b)


def add_watching_methods(b: Build) -> None:
    """Adds the methods that watch over what the others do: what stops being a number, and energy that comes from nowhere. A
    simulation with gradients is not repeated, and has no balance."""
    others = [part for part in b.state.parts.values() if part.name != "points"]
    if others:
        from wsim.simulation.measure.checks.guard import FiniteGuard
        b.methods.append(FiniteGuard(b.model, others, b.status))
    if not b.model.gradients:
        from wsim.simulation.measure.checks import balance
        b.methods += filter(None, [balance.build_energy_balance(b)])


# what is no method of its own, and why it is left out where it is
PARTS: list[tuple[str, str, Callable[[Build], bool]]] = [
    ("history", "backward Euler needs no earlier step", lambda b: b.clock.integrator.memory > 0.0),
    ("fem", "there is no soft body", lambda b: has_tets(b.scene)),
    ("gradients", "not asked for", lambda b: b.model.gradients),
    ("membrane", "no cloth has triangle strain", lambda b: any(body.model == "membrane" for body in b.scene.bodies())),
]


TOLD = {"tether", "membrane", "distance", "dihedral", "limit"}          # kinds that the lines below tell of


def kernel_signature(b: Build) -> list:
    """Part of a scene that decides which kernels it needs: scenes that agree in it share a Warp module."""
    scene = b.scene
    others = [row.role("method").signature(b) for row in METHODS if b.reasons.get(row.name) and row.owns
              and hasattr(row.role("method"), "signature")]
    return [sorted(name for name, reason in b.reasons.items() if reason and name != "watch"), others, b.model.real.__name__,
            b.choice.solver, b.choice.integrator.name, b.choice.iterations > 1,
            sorted({type(c.shape).__name__ for c in scene.colliders}), any(body.is_net for body in scene.bodies()),
            *(sorted({trait for body in scene.things(name) for trait in body.kernel_traits()}) for name in deforming_classes()
              if name != "Particles"),                   # they have kernels in modules of their own
            sorted({isfinite(p.stiffness) for p in scene.pins}),
            *("clearance" for _ in [0] if b.free), *("edges" for _ in [0] if b.edges),
            *("bounce" for c in scene.colliders[:1] if any(k.restitution > 0.0 for k in scene.colliders)),
            *["muscles"] * any(body.actuation for body in scene.bodies()),
            *("loads" for _ in loads_on_deformables(scene)[:1]), *sorted({r.kind for r in b.model.constraints} - TOLD)]


def point_fields(b: Build) -> tuple[StateField, ...]:
    """Fields of the points that this scene needs."""
    integrator, met = b.choice.integrator, bool(b.scene.colliders or b.reasons["contact"])
    multistep, steps = integrator.memory > 0.0, integrator.explicit and b.within
    return (POINTS + (ANCHOR if multistep or met or steps else ()) + (HISTORY if multistep else ())
            + (STAGED if integrator.solves > 1 else ()) + (CARRY if integrator.explicit else ())
            + (HALF if steps and (len(integrator.steps) > 1 or b.reasons["selfcontact"] and integrator.lags) else ()))


def module_name(b: Build) -> str:
    """Name of the Warp module of this set of kernels."""
    return "wsim_" + hashlib.sha256(json.dumps(kernel_signature(b), default=str).encode()).hexdigest()[:12]


def left_out(b: Build) -> list[dict]:
    """Methods that a plan does not have, and why."""
    none = "" if b.model.bodies else "there are no points"
    absent = [(row.name, row.without if row.owns else none or row.without) for row in METHODS
              if row.without and not b.reasons[row.name]]
    absent += [(name, without) for name, without, there in PARTS if not there(b)]
    return [{"stage": name, "why": why} for name, why in absent]


def allocate_points(b: Build) -> None:
    """Adds the points of all bodies to the state."""
    model = b.model
    if model.bodies:
        points = StatePart.allocate("points", point_fields(b), model.points, model.real, model.device)
        points.rows = {(body.path, body.world): node_places(body) for body in model.bodies}
        b.state.add(points)


def make_methods(b: Build) -> None:
    """The methods that the scene needs, in the order of the table, and those that watch over them."""
    for row in METHODS:
        made = build_method_of_row(row, b) if b.reasons[row.name] else None
        if made:
            b.methods.append(made)
    add_watching_methods(b)


def connect_methods(b: Build) -> None:
    """Each method takes what it needs of the others' ports."""
    for method in b.methods:
        method.connect_ports(b.methods)


def set_initial_positions(b: Build) -> None:
    """Initial positions with their rounding remainder, and velocities."""
    model, state = b.model, b.state
    if not model.bodies:
        return
    places = np.concatenate([separate_coincident_ends(body.places, body.edges - body.first, edge_lengths(body))
                             for body in model.bodies])
    x = places.astype(model.dtype)
    state.x.assign(x)
    state.e.assign((places - x).astype(model.dtype))
    state.v.assign(model.stack("velocities").astype(model.dtype))
