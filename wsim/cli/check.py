"""`wsim check`: every problem of a scene, with its cure."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from wsim.scene.methods import count_noun, describe_scene_contents
from wsim.simulation import report as reports
from wsim.usd.result.as_json import as_json

if TYPE_CHECKING:
    from wsim.scene import Problem, Scene

DONE, FAILED = 0, 1


def report_scene_problems(load: "Callable[[], Scene]", args) -> int:
    """`wsim check`: every problem of a scene, its errors first; fails if it cannot be simulated."""
    from wsim.scene import SceneError
    from wsim.scene.check.scene import check_scene as examine
    from wsim.usd.result.kinds.places import unwritable_prims
    from wsim.usd.settings import warn_missing_frame_rate
    from wsim.usd.stage import open_stage

    scene, problems = None, []
    try:
        scene = load()
        problems = list(dict.fromkeys([*scene.notes, *examine(scene), *warn_missing_frame_rate(args.scene)]))
        if not any(problem.fatal for problem in problems):
            problems += unwritable_prims(open_stage(args.scene, scene.variants), scene)
        if not any(problem.fatal for problem in problems):
            problems += _problems_of_tables(scene)
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
        from wsim.scene.check.contact import automatic_thicknesses
        from wsim.scene.check.slivers import describe_slivers
        for text in [*reports.kept_distance_lines(automatic_thicknesses(scene)), *describe_slivers(scene)]:
            print(text)
    counts = f"{args.scene}: {count_noun(fatal, 'error')}, {count_noun(len(problems) - fatal, 'warning')}"
    print(f"{counts}; {describe_scene_contents(scene)}" if scene else counts)
    return FAILED if fatal else DONE


def _problems_of_tables(scene: "Scene") -> "list[Problem]":
    """Problems that the tables of a run say, where a scene has what they may refuse: surfaces that touch themselves, named
    steps, smoothed contacts. Nothing is compiled. Raises SceneError where it cannot run."""
    touching = any(getattr(thing, "self_collision", False) for thing in (*scene.bodies(), *scene.things("Rods")))
    if not (touching or scene.contact_width or scene.integrator != "auto" or scene.solver == "explicit"):
        return []
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING          # no banner between the lines
    from wsim.simulation.simulation import Simulation

    return Simulation(scene, device="cpu").plan.ports.start_warnings
