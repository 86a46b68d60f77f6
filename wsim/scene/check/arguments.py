"""Arguments of `Scene` methods that nothing takes, and arguments that lack: one line with the path and the nearest name, where
Python would name a constructor that the caller has not called."""

import re
import sys
from collections.abc import Callable, Iterator
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, signature
from types import TracebackType
from typing import Any, TypeVar

from wsim.scene.check.problem import Problem, SceneError

UNKNOWN = re.compile(r"(?P<callee>\S+)\(\) got an unexpected keyword argument '(?P<name>\w+)'")
LACKING = re.compile(r"(?P<callee>\S+)\(\) missing \d+ required (?:positional|keyword-only) arguments?: (?P<names>.*)")
TOLD = 190                                    # letters of names in a message, at most
OWN = ("self", "scene", "more")               # no names for a caller

MEANT = {"angular_velocity": "spin", "omega": "spin", "angular_damping": "spin_drag", "linear_damping": "drag",
         "linear_velocity": "velocity", "position": "at", "translate": "at", "bounce": "restitution",
         "friction": "static_friction"}                        # names of other programs: the one here, where a method has it
TURNS = ("orientation", "rotation", "rotate", "quat", "transform", "pose", "matrix")      # what a motion says here

NOUNS = {"onto": "collider", "body": "body with points"}
FIXES = {"onto": "name a collider; scene.tie(PATH, BODY, POINTS, RIGID_BODY) holds points at a rigid body"}

C = TypeVar("C", bound=type)


def object_of_path(path: str, name: str, wanted, things: list, noun: str = "") -> Any:
    """The one of some things whose path an argument of that name wants. Raises SceneError where there is none."""
    found = next((each for each in things if each.path == wanted), None)
    if found is None:
        noun, there = noun or NOUNS[name], (", ".join(each.path for each in things) or "none")[:160]
        raise SceneError(Problem(path, f"{name} is {wanted!r:.60}, which is no {noun} of the scene; there are: {there}; fix: "
                                       f"{FIXES.get(name, 'name one of these, or add it first')}"))
    return found


def name_wrong_arguments(cls: C) -> C:
    """The class, whose methods with a path and further arguments raise SceneError for names that nothing takes."""
    for name, method in list(vars(cls).items()):
        if callable(method) and not name.startswith("_"):
            parameters = signature(method).parameters
            if "path" in parameters and any(p.kind is Parameter.VAR_KEYWORD for p in parameters.values()):
                setattr(cls, name, _with_named_arguments(method, [*parameters].index("path")))
    return cls


def _with_named_arguments(method: Callable, place: int) -> Callable:
    """A method whose argument number `place` is the path."""
    @wraps(method)
    def call(*args, **named):
        try:
            return method(*args, **named)
        except TypeError as error:
            path = str(named.get("path", args[place] if len(args) > place else "/"))
            problem = wrong_argument(path, named, error, method.__name__)
            if problem is None:
                raise
        raise SceneError(problem)                      # outside, so that no other traceback stands above it
    return call


def wrong_argument(path: str, named: dict, error: TypeError, method: str) -> Problem | None:
    """What a TypeError says of the caller's own arguments; None where it says something else."""
    below = error.__traceback__.tb_next if error.__traceback__ else None
    if below is None:                                 # the caller's call does not fit the method itself
        return None
    if (found := UNKNOWN.match(str(error))) and found["name"] in named:
        names = known_arguments(found["callee"], below)
        meant = MEANT.get(found["name"])
        close = [meant] if meant in names else [] if meant else get_close_matches(found["name"], names, 1)
        fix = f"write {close[0]}" if close else f"leave it out; help(wsim.Scene.{method}) says more"
        if found["name"] in TURNS and "motion" in names:
            fix = "give motion=Motion.still(M), M of 4 x 4 for columns"
        if found["name"] == "kinematic":
            fix = "add scene.collider(PATH, SHAPE, motion=...), which moves as you say"
        if found["name"] == "at":
            fix = "shift its points, or give motion=Motion.still(M)" if "motion" in names else "shift its points"
        told = next(k for k in range(len(names), -1, -1) if len(", ".join(names[:k])) < TOLD)
        return Problem(path, f"{found['name']} is no argument of scene.{method}; allowed: {', '.join(names[:told])}"
                             f"{' ...' * (len(names) > told)}; fix: {fix}")
    if lacking := LACKING.match(str(error)):
        names = re.findall(r"'(\w+)'", lacking["names"])
        given = ", ".join(f"{name}=..." for name in names)
        return Problem(path, f"has no {' and no '.join(names)}; allowed: a value; fix: give scene.{method}(..., {given})")
    return None


def known_arguments(callee: str, below: TracebackType) -> list[str]:
    """Names that a callable of wsim takes, and those of the functions that the call went through."""
    found = [name for made in _callables(callee) for name, p in signature(made).parameters.items()
             if p.kind is not Parameter.VAR_KEYWORD]
    step: TracebackType | None = below
    while step is not None:
        code = step.tb_frame.f_code
        found += code.co_varnames[:code.co_argcount + code.co_kwonlyargcount]
        step = step.tb_next
    return [name for name in dict.fromkeys(found) if name not in OWN]


def _callables(callee: str) -> Iterator[Any]:
    """The class or function of wsim by the name in a TypeError, `Cloth.__init__`."""
    name = callee.removesuffix(".__init__")
    for module in [m for key, m in sys.modules.items() if key.startswith("wsim.")]:
        made = vars(module).get(name)
        if getattr(made, "__module__", None) == module.__name__:
            yield made
            return
