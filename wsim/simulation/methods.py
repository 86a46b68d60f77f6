"""The methods that a plan can be made of: a row each, in the order in which their stages run within a phase.

A row is data. Its module is imported where the scene needs it (`needed`), and `build(Build) -> Method` there makes it; when all
are made, each connects itself with others (`Method.meet`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from math import isfinite
from typing import Any

import numpy as np

from wsim.model.model import Model
from wsim.model.stage import Clock, Method
from wsim.model.state import State
from wsim.model.status import Status
from wsim.physics.cloth.constraints import HARD, Rows
from wsim.scene import Scene
from wsim.simulation.choice import Choice


@dataclass
class Build:
    """What methods are made of: the tables of a scene, what it chose, and the methods that stand before in the table.

    constraints    of each body of world 0, by path
    """

    model: Model
    choice: Choice
    constraints: dict[str, list[Rows]]
    state: State
    status: Status
    clock: Clock
    reasons: dict[str, str] = field(default_factory=dict)
    methods: dict[str, Any] = field(default_factory=dict)

    @property
    def scene(self) -> Scene:
        return self.model.scene

    @property
    def within(self) -> bool:
        """Whether wind, contacts, soft pins or hard constraints act within a substep."""
        return (any(self.reasons[name] for name in ("aero", "xpbd", "contact"))
                or any(np.isfinite(p.stiffness) for p in self.scene.pins))

    def kept(self, soft: bool) -> dict[str, list[Rows]]:
        """The constraints that have a stiffness, or those that have none: XPBD holds the hard ones whatever solves for the
        forces."""
        return {path: [r for r in found if (r.kind not in HARD) == soft] for path, found in self.constraints.items()}


@dataclass(frozen=True)
class Row:
    """needed: why a scene needs it, or ""; without: why it is left out else."""

    name: str
    module: str
    needed: Callable[[Build], str]
    without: str

    def build(self, b: Build) -> Method:
        return import_module(self.module).build(b)


def _solver(name: str) -> Callable[[Build], str]:
    return lambda b: b.choice.why if b.choice.solver == name else ""


def _xpbd(b: Build) -> str:
    hard = any(r.kind in HARD for found in b.constraints.values() for r in found)
    return b.choice.why if b.choice.solver == "xpbd" else "tethers or strain limits" if hard else ""


def _contact(b: Build) -> str:
    kinds = sorted({type(c.shape).__name__.lower() for c in b.scene.colliders})
    return f"colliders: {', '.join(kinds)}" if kinds else ""


METHODS: list[Row] = [
    Row("points", "wsim.physics.motion.points", lambda b: "there are points that move", "there are no points"),
    Row("pins", "wsim.physics.motion.pins", lambda b: f"{len(b.scene.pins)} pins" if b.scene.pins else "", "nothing is pinned"),
    Row("explicit", "wsim.physics.motion.explicit", _solver("explicit"), "another solver is chosen"),
    Row("aero", "wsim.physics.cloth.air", lambda b: "a cloth has drag or lift" if any(
        c.drag or c.lift for c in b.scene.cloths) else "", "no cloth has drag or lift"),
    Row("implicit", "wsim.physics.solver.newton", _solver("implicit"), "another solver is chosen"),
    Row("xpbd", "wsim.physics.solver.xpbd", _xpbd, "another solver is chosen, and nothing is hard"),
    Row("contact", "wsim.physics.contact.method", _contact, "there is no collider"),
    Row("watch", "wsim.physics.motion.overstretch", lambda b: "" if b.choice.solver == "explicit" or b.model.gradients else
        "edges are watched", ""),
    Row("muscles", "wsim.physics.cloth.muscles", lambda b: "springs have an actuation" if any(
        s.actuation for s in b.scene.springs) else "", "no spring has an actuation"),
    Row("loads", "wsim.physics.motion.loads", lambda b: f"{len(b.scene.loads)} loads" if b.scene.loads else "",
        "nothing is loaded"),
]

# what is no method of its own, and why it is left out where it is
PARTS: list[tuple[str, str, Callable[[Build], bool]]] = [
    ("history", "backward Euler needs no earlier step", lambda b: b.clock.multistep),
    ("fem", "there is no soft body", lambda b: bool(b.scene.softs)),
    ("rigid", "there is no rigid body", lambda b: False),
    ("fluid", "there is no fluid", lambda b: False),
    ("gradients", "not asked for", lambda b: b.model.gradients),
    ("membrane", "no cloth has triangle strain", lambda b: any(c.model == "membrane" for c in b.scene.cloths)),
]


def signature(b: Build) -> list:
    """What of a scene decides which kernels it needs: scenes that agree in it share a Warp module."""
    scene, inf = b.scene, float("inf")
    return [sorted(name for name, reason in b.reasons.items() if reason and name != "watch"), b.model.real.__name__,
            b.choice.solver, b.choice.integrator.name, b.choice.iterations > 1,
            sorted({type(c.shape).__name__ for c in scene.colliders}), bool(scene.springs),
            sorted({(c.model, c.material.damping > 0, c.material.bend > 0, isfinite(c.material.strain_limit), c.tethers)
                    for c in scene.cloths}),
            sorted({(s.damping > 0, len(s.stiffness) > 1) for s in scene.springs}),
            sorted({(m.model, m.damping > 0, m.yield_strain < inf, s.pressure != 0.0, s.quadratic)
                    for s in scene.softs for m in s.materials}),
            sorted({isfinite(p.stiffness) for p in scene.pins}),
            *("bounce" for c in scene.colliders[:1] if any(k.restitution > 0.0 for k in scene.colliders)),
            *("muscles" for s in scene.springs[:1] if any(n.actuation for n in scene.springs)),
            *("loads" for _ in scene.loads[:1])]
