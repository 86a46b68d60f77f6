"""`wsim bench`, and what `wsim run --error` takes from it."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from wsim.bench import cache
from wsim.bench.front import Measured
from wsim.bench.report import Report, percent
from wsim.bench.study import bench, hardware, versions
from wsim.cli.progress import line
from wsim.model import kernel_cache
from wsim.scene import Problem, Scene, SceneError
from wsim.usd.result.as_json import as_json
from wsim.usd.result.atomic import replace_text
from wsim.usd.result.dependencies import refuse

if TYPE_CHECKING:
    from wsim.bench.setting import Setting


def warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def measured(scene: Scene, device: str | None, say: Callable[[str], None], **more) -> Report:
    """A bench, kept for `wsim run --error`."""
    report = bench(scene, device=device, say=say, **more)
    try:
        cache.write(cache.key(scene, report.hardware, report.versions), report)
    except OSError as error:
        warn(f"the result could not be kept for `wsim run --error`: {error}")
    return report


def run(scene: Scene, args) -> None:
    """`wsim bench`: the table, and files where they are asked for."""
    for option, file in (("--json", args.json if args.json != "-" else None), ("--plot", args.plot)):
        refuse(option, file, {args.scene: "the scene"})
    if args.plot:
        from wsim.bench import plot
        plot.needed()
    with line(0) as progress:
        report = measured(scene, args.device, progress.say, frames=args.look, budget=args.budget, quick=args.quick)
    print(as_json(report.as_dict()) if args.json == "-" else report.text())
    if args.json and args.json != "-":
        replace_text(args.json, as_json(report.as_dict()) + "\n")
    if args.plot:
        plot.plot(report, args.plot)


def recommended(scene: Scene, error: float, device: str | None, say: Callable[[str], None]) -> tuple[Scene, "Setting"]:
    """The scene with the fastest setting known to stay within an error, and that setting; benches where nothing is known.

    Raises SceneError where there is none, with the reason and what to do.
    """
    report, strange = cache.read(cache.key(scene, hardware(kernel_cache.device(device)), versions()))
    if strange:
        warn(strange)
    if report is None:
        print("no bench of this scene on this device is known: it runs first", file=sys.stderr)
        report = measured(scene, device, say)
    row = report.recommend(error)
    if row is None:
        raise SceneError(Problem("--error", _none(report, error)))
    print(f"{row.setting.options}: error {percent(row.largest)} over the first {report.frames} frames, {row.ms:.3g} ms a frame "
          "(wsim bench)", file=sys.stderr)
    return row.setting.applied(scene), row.setting


def _none(report: Report, error: float) -> str:
    """Why no setting is known for an error, and the mend."""
    if report.refused:
        return (f"no error can be promised: {report.refused}{report.mend} (options of `wsim bench`, whose latest result counts "
                "here; what it prints says what can be said instead)")
    best: Measured = min(report.rows, key=lambda r: r.error)
    doubt = report.reference["error"]
    floor = f", the reference's own error is {percent(doubt)}" if doubt > 0.1 * error else ""
    return (f"no setting tried stays within {percent(error)}: {best.setting} errs by {percent(best.largest)}{floor}; let "
            "`wsim bench` of the scene try more with a larger --budget (its result is kept), or ask for less")
