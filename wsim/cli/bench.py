"""`wsim bench`, and what `wsim run --error` takes from it."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from wsim.bench import cache
from wsim.bench.front import MeasuredSetting
from wsim.bench.report import Report, format_percent
from wsim.bench.study import bench, hardware_name, versions_of_bench
from wsim.cli.progress import progress_line
from wsim.model import kernel_cache
from wsim.scene import Problem, Scene, SceneError
from wsim.usd.result.as_json import as_json
from wsim.usd.result.atomic import replace_text
from wsim.usd.result.dependencies import refuse_overwrite

if TYPE_CHECKING:
    from wsim.bench.setting import Setting


def print_bench_warning(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def measure_and_cache(scene: Scene, device: str | None, say: Callable[[str], None], **more) -> Report:
    """A bench, kept for `wsim run --error`."""
    report = bench(scene, device=device, say=say, **more)
    try:
        cache.cache_report(cache.report_cache_key(scene, report.hardware, report.versions), report)
    except OSError as error:
        print_bench_warning(f"the result could not be kept for `wsim run --error`: {error}")
    return report


def run_bench_command(scene: Scene, args) -> None:
    """`wsim bench`: the table, and files where they are asked for."""
    for option, file in (("--json", args.json if args.json != "-" else None), ("--plot", args.plot)):
        refuse_overwrite(option, file, {args.scene: "the scene"})
    if args.plot:
        from wsim.bench import plot
        plot.require_plotting()
    with progress_line(0) as progress:
        report = measure_and_cache(scene, args.device, progress.say, frames=args.look, budget=args.budget, quick=args.quick)
    print(as_json(report.as_dict()) if args.json == "-" else report.text())
    if args.json and args.json != "-":
        replace_text(args.json, as_json(report.as_dict()) + "\n")
    if args.plot:
        plot.plot_bench_report(report, args.plot)


def recommended_scene(scene: Scene, error: float, device: str | None, say: Callable[[str], None]) -> tuple[Scene, "Setting"]:
    """The scene with the fastest setting known to stay within an error, and that setting; benches where nothing is known.

    Raises SceneError where there is none, with the reason and what to do.
    """
    report, strange = cache.read_cached_report(cache.report_cache_key(scene, hardware_name(kernel_cache.warp_device(device)),
                                                                      versions_of_bench()))
    if strange:
        print_bench_warning(strange)
    if report is None:
        print("no bench of this scene on this device is known: it runs first", file=sys.stderr)
        report = measure_and_cache(scene, device, say)
    row = report.recommend(error)
    if row is None:
        raise SceneError(Problem("--error", _explain_no_setting(report, error)))
    print(f"{row.setting.options}: error {format_percent(row.largest)} over the first {report.frames} frames, {row.ms:.3g} ms "
          "a frame (wsim bench)", file=sys.stderr)
    return row.setting.applied_to_scene(scene), row.setting


def _explain_no_setting(report: Report, error: float) -> str:
    """Why no setting is known for an error, and the mend."""
    if report.refused:
        return (f"no error can be promised: {report.refused}{report.mend} (options of `wsim bench`, whose latest result counts "
                "here; what it prints says what can be said instead)")
    best: MeasuredSetting = min(report.rows, key=lambda r: r.error)
    doubt = report.reference["error"]
    floor = f", the reference's own error is {format_percent(doubt)}" if doubt > 0.1 * error else ""
    return (f"no setting tried stays within {format_percent(error)}: {best.setting} errs by "
            f"{format_percent(best.largest)}{floor}; let "
            "`wsim bench` of the scene try more with a larger --budget (its result is kept), or ask for less")
