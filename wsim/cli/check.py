"""`wsim check`: every problem of a scene, with its cure."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from wsim.cli.inventory import count, inventory
from wsim.simulation import report as reports
from wsim.usd.result.as_json import as_json

if TYPE_CHECKING:
    from wsim.scene import Problem, Scene

DONE, FAILED = 0, 1


def check(load: "Callable[[], Scene]", args) -> int:
    """`wsim check`: every problem of a scene, its errors first; fails if it cannot be simulated."""
    from wsim.scene import SceneError
    from wsim.scene.check.scene import check as examine
    from wsim.scene.skin import held
    from wsim.usd.settings import without_rate

    scene, problems = None, []
    try:
        scene = load()
        problems = list(dict.fromkeys([*scene.notes, *examine(scene), *without_rate(args.scene)]))
        if not any(problem.fatal for problem in problems):
            held(scene)
            problems += _touching(scene)
    except SceneError as error:
        problems += error.problems
    problems.sort(key=lambda p: not p.fatal)
    fatal = sum(p.fatal for p in problems)
    if args.json:
        print(as_json({"scene": args.scene, "errors": fatal, "problems": [
            {"path": p.path, "text": p.text, "fatal": p.fatal} for p in problems]}))
        return FAILED if fatal else DONE
    for problem in problems:
        print(problem)
    if scene and not fatal:
        from wsim.scene.check.contact import taken
        from wsim.scene.check.slivers import told
        for text in [*reports.kept(taken(scene)), *told(scene)]:
            print(text)
    counts = f"{args.scene}: {count(fatal, 'error')}, {count(len(problems) - fatal, 'warning')}"
    print(f"{counts}; {inventory(scene)}" if scene else counts)
    return FAILED if fatal else DONE


def _touching(scene: "Scene") -> "list[Problem]":
    """How what touches itself starts, which its tables say: nothing is compiled. Raises SceneError where it cannot."""
    if not any(getattr(thing, "self_collision", False) for thing in (*scene.bodies(), *scene.things("Rods"))):
        return []
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING          # no banner between the lines
    from wsim.simulation.simulation import Simulation

    return Simulation(scene, device="cpu").plan.methods.every("start")
