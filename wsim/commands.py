"""What each command does. Everything heavy is imported inside, when it is needed and not before."""

import os
import sys
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

from wsim import report as reports
from wsim.progress import line

if TYPE_CHECKING:
    from wsim.run import Run
    from wsim.scene import Scene
    from wsim.simulation import Simulation

DONE, FAILED, INTERRUPTED = 0, 1, 130


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _load(args) -> "Scene":
    """The scene of a command, with what its options change."""
    from wsim import usd

    variants: dict[str, dict[str, str]] = {}
    for prim, name, value in args.variant:
        variants.setdefault(prim, {})[name] = value
    scene = usd.load(args.scene, variants=variants)
    changes = {name: getattr(args, name, None) for name in ("frames", "substeps", "iterations", "integrator")}
    return replace(scene, **{name: value for name, value in changes.items() if value is not None})


def _hush() -> None:
    """Warp's banner would stand between our lines, and in the JSON."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING


def _simulation(scene: "Scene", args) -> "Simulation":
    _hush()
    from wsim.simulation import Simulation

    return Simulation(scene, device=args.device, precision=args.precision)


def run(args) -> int:
    """`wsim run`: simulate, write, report."""
    began = perf_counter()
    seconds = {}
    import wsim.recorder  # noqa: F401  (USD, counted as import)

    seconds["import"] = perf_counter() - began
    code, job = DONE, None
    with line(0, quiet=args.quiet) as progress:
        progress.say(f"loading {args.scene}")
        scene = _load(args)
        seconds["load"] = perf_counter() - began - seconds["import"]
        job = _job(scene, args)
        for warning in job.simulation.warnings:
            progress.clear()
            _say(warning)
        told = len(job.simulation.warnings)
        progress.frames = (job.preroll + scene.frames - job.first) * job.samples
        progress.say("compiling")
        job.shown = progress.frame
        try:
            job.frames()
        except KeyboardInterrupt:
            code = INTERRUPTED
    _picture_of(job, args, seconds)
    seconds["total"] = perf_counter() - began
    _close(job, args, seconds, told)
    if code == INTERRUPTED:
        _say(f"interrupted: {args.output} holds the {job.written} frames so far")
    return code


def _job(scene: "Scene", args) -> "Run":
    """Everything that is needed before the first frame, so that what cannot work fails before it costs time."""
    from wsim.partial import check_output
    from wsim.recorder import Recorder
    from wsim.run import Run, finer, later

    check_output(args.output)
    simulated = later(finer(scene, args.samples), args.preroll / scene.fps)
    simulation = _simulation(simulated, args)
    job = Run(scene, simulation, Recorder(scene, args.output, flatten=args.flatten), args.samples, args.preroll)
    if args.view:
        from wsim.view import Viewer

        job.each.append(Viewer(scene).log)
    return job


def _picture_of(job: "Run", args, seconds: dict) -> None:
    if args.png:
        from wsim.picture import picture

        began = perf_counter()
        picture(args.output, args.png, device=args.device)
        seconds["picture"] = perf_counter() - began


def _close(job: "Run", args, seconds: dict, told: int) -> None:
    """The closing report; warnings that were said before the run are not said again."""
    if args.quiet and not args.json:
        for warning in job.simulation.warnings[told:]:
            _say(warning)
        return
    report = job.simulation.report()
    report["seconds"] = {**report.get("seconds", {}), **seconds, **job.seconds}
    report |= {"output": args.output, "picture": args.png, "frames": job.written}
    if args.json:
        print(reports.as_json(report))
    else:
        print(reports.text({**report, "warnings": report["warnings"][told:]}))


def new(args) -> int:
    """`wsim new cloth`: a scene that refers to a bare mesh."""
    from wsim.usd.author import author_cloth

    author_cloth(args.mesh, args.output, prim=args.prim, fabric=args.fabric, weld=args.weld)
    print(f"{args.output}: simulate it with: wsim run {args.output} -o {os.path.splitext(args.output)[0]}_out.usdc")
    return DONE


def check(args) -> int:
    """`wsim check`: every problem of a scene, its errors first; fails if it cannot be simulated."""
    from wsim.check import check as examine
    from wsim.scene import SceneError

    scene = None
    try:
        scene = _load(args)
        problems = list(dict.fromkeys([*scene.notes, *examine(scene)]))
    except SceneError as error:
        problems = error.problems
    problems.sort(key=lambda p: not p.fatal)
    fatal = sum(p.fatal for p in problems)
    if args.json:
        print(reports.as_json({"scene": args.scene, "errors": fatal, "problems": [
            {"path": p.path, "text": p.text, "fatal": p.fatal} for p in problems]}))
        return FAILED if fatal else DONE
    for problem in problems:
        print(problem)
    counts = f"{args.scene}: {fatal} errors, {len(problems) - fatal} warnings"
    print(f"{counts}; {_inventory(scene)}" if scene else counts)
    return FAILED if fatal else DONE


def _inventory(scene: "Scene") -> str:
    """What a scene holds, in words."""
    points = sum(len(body.points) for body in scene.bodies())
    return (f"{len(scene.cloths)} cloths and {len(scene.springs)} spring nets of {points} points, "
            f"{len(scene.colliders)} colliders, {len(scene.pins)} pins; {scene.frames} frames of 1/{scene.fps:g} s, "
            f"{scene.substeps} substeps, {scene.iterations} iterations, {scene.integrator}")


def plan(args) -> int:
    """`wsim plan`: the stages and why others are left out; compiles nothing."""
    simulation = _simulation(_load(args), args)
    for warning in simulation.warnings:
        _say(warning)
    if args.json:
        print(reports.as_json({"stages": simulation.plan.table(), "skipped": simulation.plan.skipped}))
    else:
        print(simulation.plan.describe())
    return DONE


def view(args) -> int:
    """`wsim view`: a result in rerun."""
    from wsim.view import view as show

    show(args.result)
    return DONE


def picture(args) -> int:
    """`wsim picture`: a result as an image file."""
    _hush()
    from wsim.picture import picture as draw

    frames = "all" if args.animate else args.frame
    drawn = draw(args.result, args.output, frames=frames, size=args.size, sheet=args.sheet, device=args.device,
                 camera=args.camera)
    for note in drawn.get("notes", ()):
        _say(str(note))
    print(f"{drawn['out']}: {len(drawn['frames'])} frames, {drawn['size'][0]} x {drawn['size'][1]} pixels")
    return DONE
