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
from wsim.cli.progress import progress_line
from wsim.cli.schema import schema  # noqa: F401  (a command)
from wsim.scene.methods import count_noun
from wsim.simulation import interrupt
from wsim.simulation import report as reports
from wsim.simulation.duration import expected_time_and_error
from wsim.usd.result.as_json import as_json

if TYPE_CHECKING:
    from wsim.cli.run import RecordedRun
    from wsim.scene import Scene
    from wsim.simulation.simulation import Simulation

DONE, FAILED, INTERRUPTED = 0, 1, 130


def _print_to_stderr(text: str) -> None:
    print(text, file=sys.stderr)


def _load_scene_of_command(args) -> "Scene":
    """The scene of a command, with what its options change."""
    from wsim import usd

    variants: dict[str, dict[str, str]] = {}
    for prim, name, value in args.variant:
        variants.setdefault(prim, {})[name] = value
    scene = usd.load(args.scene, variants=variants, frames=getattr(args, "frames", None))
    changes = {name: getattr(args, name, None) for name in ("frames", "substeps", "iterations", "solver", "integrator")}
    return replace(scene, **{name: value for name, value in changes.items() if value is not None})


def _silence_warp_banner() -> None:
    """Warp's banner would stand between our lines, and in the JSON."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING


def _start_warp_for_command() -> None:
    """Warp is there; from here on files are written, and an interruption has something to clean up."""
    from wsim.model import kernel_cache

    kernel_cache.start_warp()
    interrupt.set_interrupt_mode("throw")


def _simulation_of_command(scene: "Scene", args) -> "Simulation":
    _silence_warp_banner()
    from wsim.simulation.simulation import Simulation
    fps = (getattr(args, "fps", None) or 0.0) * getattr(args, "samples", 1) or None        # short frames
    return Simulation(scene, device=args.device, precision=args.precision or "float32", fps=fps)


def run(args) -> int:
    """`wsim run`: simulate, write, report."""
    began = perf_counter()
    import wsim.usd.result.recorder  # noqa: F401  (USD, to tell its import from the loading)
    from wsim.cli.run import default_output
    from wsim.usd.result.dependencies import refuse_overwrite

    args.output = args.output or default_output(args.scene)
    seconds = {"import": perf_counter() - began}
    told: set[str] = set()
    with progress_line(0, quiet=args.quiet) as progress:
        progress.say(f"loading {args.scene}")
        scene = _load_scene_of_command(args)
        refuse_overwrite("--png", args.png, {args.scene: "the scene"})
        seconds["load"] = perf_counter() - began - seconds["import"]
        if args.error:
            scene = _scene_within_error(scene, args, progress)
            seconds["bench"] = perf_counter() - began - sum(seconds.values())
        with _prepared_run_with_viewer(scene, args) as job:
            progress.clear()
            _print_new_warnings(_distinct_run_warnings(job), told)
            if not args.quiet:
                _print_to_stderr(expected_time_and_error(job.simulation.plan, job.steps // job.samples, job.samples))
            progress.frames, job.shown = job.steps, progress.frame
            progress.say("compiling")
            try:
                job.frames()
                code = DONE
                if args.web and sys.stderr.isatty():       # a short run would end before its page is open
                    from wsim.show.web import serve_until_interrupt
                    began += serve_until_interrupt(_print_to_stderr)
            except KeyboardInterrupt:
                code = INTERRUPTED
            except Exception as error:
                if job.recorder.kept and job.recorder.kept not in str(error):
                    progress.clear()
                    _print_to_stderr(f"failed: {job.kept()}")
                raise
            progress.say("measuring errors")
            seconds["errors"] = job.measure(code == DONE and (args.json or not args.quiet))
    if code == DONE and args.png:
        _draw_run_picture(args, seconds)
    _print_closing_report(job, args, seconds, told, began)
    if code == INTERRUPTED:
        _print_to_stderr(f"interrupted: {job.kept()}")
    return code


def _scene_within_error(scene: "Scene", args, progress) -> "Scene":
    """The scene with what `wsim bench` recommends for an error."""
    _silence_warp_banner()
    from wsim.cli.bench import recommended_scene

    progress.clear()
    scene, setting = recommended_scene(scene, args.error, args.device, progress.say)
    args.precision = setting.precision
    progress.clear()
    return scene


@contextmanager
def _prepared_run_with_viewer(scene: "Scene", args) -> Iterator["RecordedRun"]:
    """The run that is asked for, with a viewer where one is."""
    from wsim.cli.run import prepare_recorded_run
    from wsim.scene import Problem
    from wsim.scene.methods import all_scene_pins

    viewers: list = []

    def simulate_with_viewer(simulated: "Scene") -> "Simulation":
        if args.view or args.web:
            from wsim.show.viewer import Viewer
            from wsim.show.web import WebPage

            page = WebPage(args.port, args.bind) if args.web else None
            viewers.append(Viewer(simulated, web=page) if page else Viewer(simulated))
            if page:
                _print_to_stderr(page.words())
        return _simulation_of_command(simulated, args)

    try:
        job = prepare_recorded_run(scene, args.output, simulate_with_viewer, samples=args.samples, preroll=args.preroll,
                                   flatten=args.flatten, restart=args.restart, stress=args.stress)
        job.reactions, job.recorder.clips, job.colour = args.reactions, args.clips, args.colour or ""
        if args.reactions and not all_scene_pins(scene):
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
            _print_to_stderr(f"warning: {problem.path}: {problem.text}")


def _distinct_run_warnings(job: "RecordedRun") -> list[str]:
    """Each once, in their order."""
    return list(dict.fromkeys([*job.simulation.warnings, *map(str, job.recorder.notes)]))


def _print_new_warnings(warnings: list[str], told: set[str]) -> None:
    """Says the warnings that were not told yet."""
    for warning in warnings:
        if warning not in told:
            _print_to_stderr(warning if warning.startswith("warning") else f"warning: {warning}")
    told.update(warnings)


def _draw_run_picture(args, seconds: dict[str, float]) -> None:
    """The picture that `wsim run --png` asks for."""
    from wsim.show.picture import picture

    began = perf_counter()
    picture(args.output, args.png, device=args.device, colour=args.colour)
    seconds["picture"] = perf_counter() - began


def _print_closing_report(job: "RecordedRun", args, seconds: dict[str, float], told: set[str], began: float) -> None:
    """The closing report; what was warned of before the run is not said again."""
    _print_new_warnings(_distinct_run_warnings(job), told)
    if args.quiet and not args.json:
        return
    asked = perf_counter()
    report = job.simulation.report(profile=args.verbose or args.json)
    warnings = list(dict.fromkeys([*_distinct_run_warnings(job), *report["warnings"]]))
    _print_new_warnings(warnings, told)
    seconds |= {"report": perf_counter() - asked, "total": perf_counter() - began}
    report |= {"output": job.result, "partial": job.recorder.kept, "picture": args.png if job.result else None,
               "frames": job.written, "warnings": warnings,
               "seconds": {**report.get("seconds", {}), **seconds, **job.seconds}}
    print(as_json(report) if args.json else reports.report_text({**report, "warnings": []}, args.verbose))


def new(args) -> int:
    """`wsim new`: a scene that refers to a bare mesh, as cloth or as a soft body."""
    from wsim.cli import new as scenes

    for note in scenes.author_new_scene(args):
        _print_to_stderr(str(note))
    print(f"{args.output}: simulate it with: wsim run {quote(args.output)}")
    return DONE


def check(args) -> int:
    """`wsim check`: every problem of a scene."""
    from wsim.cli.check import report_scene_problems as examine

    return examine(lambda: _load_scene_of_command(args), args)


def plan(args) -> int:
    """`wsim plan`: the stages and why others are left out; compiles nothing."""
    simulation = _simulation_of_command(_load_scene_of_command(args), args)
    for warning in simulation.warnings:
        _print_to_stderr(warning)
    if args.json:
        from wsim.model.stage import FREE
        free = {"free": simulation.plan.table(FREE)} if simulation.plan.parted else {}
        print(as_json({"stages": simulation.plan.table(), "skipped": simulation.plan.skipped, **free}))
    else:
        print(simulation.plan.describe())
    return DONE


def bench(args) -> int:
    """`wsim bench`: time against error of this scene."""
    _silence_warp_banner()
    from wsim.cli import bench as command

    scene = _load_scene_of_command(args)
    _start_warp_for_command()
    command.run_bench_command(scene, args)
    return DONE


def fit(args) -> int:
    """`wsim fit`: parameters from an observed motion; fails where they were not found."""
    _silence_warp_banner()
    from wsim.cli import fit as command

    scene = _load_scene_of_command(args)
    _start_warp_for_command()
    return DONE if command.run_fit_command(scene, args) else FAILED


def view(args) -> int:
    """`wsim view`: a result in rerun, as a file for it, or as a web page until Ctrl-C."""
    from wsim.show.viewer import view as show
    from wsim.show.web import WebPage, serve_until_interrupt

    interrupt.set_interrupt_mode("throw")
    page = WebPage(args.port, args.bind)
    show(args.result, save=args.save, web=page if args.web else None,
         served=lambda: serve_until_interrupt(_print_to_stderr, page.words() + "\n"))
    return DONE


def picture(args) -> int:
    """`wsim picture`: a result as an image file."""
    _silence_warp_banner()
    from wsim.show.picture import picture as draw

    _start_warp_for_command()
    drawn = draw(args.result, args.output, frames="all" if args.animate else args.frame, size=args.size, sheet=args.sheet,
                 device=args.device, camera=args.camera, colour=args.colour)
    for note in drawn.get("notes", ()):
        _print_to_stderr(str(note))
    print(f"{drawn['out']}: {count_noun(len(drawn['frames']), 'frame')}, {drawn['size'][0]} x {drawn['size'][1]} pixels")
    return DONE


def copy(args) -> int:
    """`wsim copy`: a result under another name, with all files of it."""
    from wsim.usd.result.kinds.duplicate import copy_result

    interrupt.set_interrupt_mode("throw")
    print(f"{copy_result(args.result, args.target)}: a copy of {args.result}, with files of its own")
    return DONE
