"""What each command does. Everything heavy is imported inside, when it is needed and not before."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from shlex import quote
from time import perf_counter
from typing import TYPE_CHECKING

from wsim.cli.docs import docs  # noqa: F401  (a command)
from wsim.cli.examples import examples  # noqa: F401  (a command)
from wsim.cli.progress import line
from wsim.cli.schema import schema  # noqa: F401  (a command)
from wsim.scene.methods import count
from wsim.simulation import interrupt
from wsim.simulation import report as reports
from wsim.simulation.duration import expected
from wsim.usd.result.as_json import as_json

if TYPE_CHECKING:
    from wsim.cli.run import Run
    from wsim.scene import Scene
    from wsim.simulation.simulation import Simulation

DONE, FAILED, INTERRUPTED = 0, 1, 130


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _load(args) -> "Scene":
    """The scene of a command, with what its options change."""
    from wsim import usd

    variants: dict[str, dict[str, str]] = {}
    for prim, name, value in args.variant:
        variants.setdefault(prim, {})[name] = value
    scene = usd.load(args.scene, variants=variants, frames=getattr(args, "frames", None))
    changes = {name: getattr(args, name, None) for name in ("frames", "substeps", "iterations", "solver", "integrator")}
    return replace(scene, **{name: value for name, value in changes.items() if value is not None})


def _hush() -> None:
    """Warp's banner would stand between our lines, and in the JSON."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING


def _ready() -> None:
    """Warp is there; from here on files are written, and an interruption has something to clean up."""
    from wsim.model import kernel_cache

    kernel_cache.start()
    interrupt.begin("throw")


def _simulation(scene: "Scene", args) -> "Simulation":
    _hush()
    from wsim.simulation.simulation import Simulation
    fps = (getattr(args, "fps", None) or 0.0) * getattr(args, "samples", 1) or None        # short frames
    return Simulation(scene, device=args.device, precision=args.precision or "float32", fps=fps)


def run(args) -> int:
    """`wsim run`: simulate, write, report."""
    began = perf_counter()
    import wsim.usd.result.recorder  # noqa: F401  (USD, to tell its import from the loading)
    from wsim.cli.run import default_output
    from wsim.usd.result.dependencies import refuse

    args.output = args.output or default_output(args.scene)
    seconds = {"import": perf_counter() - began}
    told: set[str] = set()
    with line(0, quiet=args.quiet) as progress:
        progress.say(f"loading {args.scene}")
        scene = _load(args)
        refuse("--png", args.png, {args.scene: "the scene"})
        seconds["load"] = perf_counter() - began - seconds["import"]
        if args.error:
            scene = _within(scene, args, progress)
            seconds["bench"] = perf_counter() - began - sum(seconds.values())
        with _prepared(scene, args) as job:
            progress.clear()
            _warn(_warnings(job), told)
            if not args.quiet:
                _say(expected(job.simulation.plan, job.steps // job.samples, job.samples))
            progress.frames, job.shown = job.steps, progress.frame
            progress.say("compiling")
            try:
                job.frames()
                code = DONE
                if args.web and sys.stderr.isatty():       # a short run would end before its page is open
                    from wsim.show.web import stay
                    began += stay(_say)
            except KeyboardInterrupt:
                code = INTERRUPTED
            except Exception as error:
                if job.recorder.kept and job.recorder.kept not in str(error):
                    progress.clear()
                    _say(f"failed: {job.kept()}")
                raise
            progress.say("measuring errors")
            seconds["errors"] = job.measure(code == DONE and (args.json or not args.quiet))
    if code == DONE and args.png:
        _draw(args, seconds)
    _close(job, args, seconds, told, began)
    if code == INTERRUPTED:
        _say(f"interrupted: {job.kept()}")
    return code


def _within(scene: "Scene", args, progress) -> "Scene":
    """The scene with what `wsim bench` recommends for an error."""
    _hush()
    from wsim.cli.bench import recommended

    progress.clear()
    scene, setting = recommended(scene, args.error, args.device, progress.say)
    args.precision = setting.precision
    progress.clear()
    return scene


@contextmanager
def _prepared(scene: "Scene", args) -> Iterator["Run"]:
    """The run that is asked for, with a viewer where one is."""
    from wsim.cli.run import prepare
    from wsim.scene import Problem
    from wsim.scene.methods import every_pin

    viewers: list = []

    def simulate(simulated: "Scene") -> "Simulation":
        if args.view or args.web:
            from wsim.show.viewer import Viewer
            from wsim.show.web import Page

            page = Page(args.port, args.bind) if args.web else None
            viewers.append(Viewer(simulated, web=page) if page else Viewer(simulated))
            if page:
                _say(page.words())
        return _simulation(simulated, args)

    try:
        job = prepare(scene, args.output, simulate, samples=args.samples, preroll=args.preroll, flatten=args.flatten,
                      restart=args.restart, stress=args.stress)
        job.reactions, job.recorder.clips, job.colour = args.reactions, args.clips, args.colour or ""
        if args.reactions and not every_pin(scene):
            job.recorder.notes.append(Problem("--reactions", "there is no pin whose force could be written", fatal=False))
        job.watchers += [viewer.log for viewer in viewers]
        yield job
    finally:
        for viewer in viewers:
            _close_viewer(viewer)


def _close_viewer(viewer) -> None:
    """A viewer that somebody closed during the run takes nothing from the result: that is a warning."""
    from wsim.scene import SceneError

    try:
        viewer.close()
    except SceneError as error:
        for problem in error.problems:
            _say(f"warning: {problem.path}: {problem.text}")


def _warnings(job: "Run") -> list[str]:
    """Each once, in their order."""
    return list(dict.fromkeys([*job.simulation.warnings, *map(str, job.recorder.notes)]))


def _warn(warnings: list[str], told: set[str]) -> None:
    """Says the warnings that were not told yet."""
    for warning in warnings:
        if warning not in told:
            _say(warning if warning.startswith("warning") else f"warning: {warning}")
    told.update(warnings)


def _draw(args, seconds: dict[str, float]) -> None:
    """The picture that `wsim run --png` asks for."""
    from wsim.show.picture import picture

    began = perf_counter()
    picture(args.output, args.png, device=args.device, colour=args.colour)
    seconds["picture"] = perf_counter() - began


def _close(job: "Run", args, seconds: dict[str, float], told: set[str], began: float) -> None:
    """The closing report; what was warned of before the run is not said again."""
    _warn(_warnings(job), told)
    if args.quiet and not args.json:
        return
    asked = perf_counter()
    report = job.simulation.report(profile=args.verbose or args.json)
    warnings = list(dict.fromkeys([*_warnings(job), *report["warnings"]]))
    _warn(warnings, told)
    seconds |= {"report": perf_counter() - asked, "total": perf_counter() - began}
    report |= {"output": job.result, "partial": job.recorder.kept, "picture": args.png if job.result else None,
               "frames": job.written, "warnings": warnings,
               "seconds": {**report.get("seconds", {}), **seconds, **job.seconds}}
    print(as_json(report) if args.json else reports.text({**report, "warnings": []}, args.verbose))


def new(args) -> int:
    """`wsim new`: a scene that refers to a bare mesh, as cloth or as a soft body."""
    from wsim.cli import new as scenes

    for note in scenes.make(args):
        _say(str(note))
    print(f"{args.output}: simulate it with: wsim run {quote(args.output)}")
    return DONE


def check(args) -> int:
    """`wsim check`: every problem of a scene."""
    from wsim.cli.check import check as examine

    return examine(lambda: _load(args), args)


def plan(args) -> int:
    """`wsim plan`: the stages and why others are left out; compiles nothing."""
    simulation = _simulation(_load(args), args)
    for warning in simulation.warnings:
        _say(warning)
    if args.json:
        from wsim.model.stage import FREE
        free = {"free": simulation.plan.table(FREE)} if simulation.plan.parted else {}
        print(as_json({"stages": simulation.plan.table(), "skipped": simulation.plan.skipped, **free}))
    else:
        print(simulation.plan.describe())
    return DONE


def bench(args) -> int:
    """`wsim bench`: time against error of this scene."""
    _hush()
    from wsim.cli import bench as command

    scene = _load(args)
    _ready()
    command.run(scene, args)
    return DONE


def fit(args) -> int:
    """`wsim fit`: parameters from an observed motion; fails where they were not found."""
    _hush()
    from wsim.cli import fit as command

    scene = _load(args)
    _ready()
    return DONE if command.run(scene, args) else FAILED


def view(args) -> int:
    """`wsim view`: a result in rerun, as a file for it, or as a web page until Ctrl-C."""
    from wsim.show.viewer import view as show
    from wsim.show.web import Page, stay

    interrupt.begin("throw")
    page = Page(args.port, args.bind)
    show(args.result, save=args.save, web=page if args.web else None, served=lambda: stay(_say, page.words() + "\n"))
    return DONE


def picture(args) -> int:
    """`wsim picture`: a result as an image file."""
    _hush()
    from wsim.show.picture import picture as draw

    _ready()
    drawn = draw(args.result, args.output, frames="all" if args.animate else args.frame, size=args.size, sheet=args.sheet,
                 device=args.device, camera=args.camera, colour=args.colour)
    for note in drawn.get("notes", ()):
        _say(str(note))
    print(f"{drawn['out']}: {count(len(drawn['frames']), 'frame')}, {drawn['size'][0]} x {drawn['size'][1]} pixels")
    return DONE


def copy(args) -> int:
    """`wsim copy`: a result under another name, with all files of it."""
    from wsim.usd.result.kinds.duplicate import copy_result

    interrupt.begin("throw")
    print(f"{copy_result(args.result, args.target)}: a copy of {args.result}, with files of its own")
    return DONE
