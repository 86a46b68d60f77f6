"""`wsim sweep` and `wsim warm`."""

import sys
from time import perf_counter

from wsim.cli.commands import _load_scene_of_command, _silence_warp_banner, _simulation_of_command, _start_warp_for_command
from wsim.cli.progress import Progress
from wsim.cli.sweep_options import sweep_settings
from wsim.scene import Problem, SceneError
from wsim.simulation.duration import format_duration

FAILURES = 12          # failed runs that are told one by one


def sweep(args) -> int:
    """`wsim sweep`: a table and results; fails where a run did, which the table lists."""
    from wsim.sweep.sweep import Sweep

    _silence_warp_banner()
    if args.plot:
        from wsim.sweep.pictures import require_matplotlib
        require_matplotlib()
    if args.sheet and args.keep == "none":
        raise SceneError(Problem("--sheet", "draws results, and none is kept; give --keep last too"))
    prepared = Sweep.prepare_sweep(args.scene, args.vary, args.output, latin=args.latin, seed=args.seed, resume=args.resume,
                                   settings=sweep_settings(args), variants=_variants_by_prim(args))
    failed = _run_sweep_with_progress(prepared, args)
    _draw_sweep_pictures(args)
    return _print_sweep_outcome(prepared, failed)


def fits(args) -> int:
    """`wsim fit --many`: a table of fits, or one of all; fails where one did, which the table lists."""
    from wsim.cli import fit as command
    from wsim.sweep.many import prepare_specimen_fits as prepare

    _silence_warp_banner()
    if not args.output:
        raise SceneError(Problem("-o", "names the folder of the table of --many; give one"))
    asked = {"start": command.parse_name_values("--start", args.start), "priors": command.parse_priors(args.prior),
             "noise": args.noise, "force_noise": args.force_noise, "accuracy": args.accuracy or 0.0, "limit": args.limit}
    prepared = prepare(args.scene, args.many, args.parameters, args.output, asked=asked, resume=args.resume,
                       settings=sweep_settings(args), variants=_variants_by_prim(args))
    return _print_sweep_outcome(prepared, _run_sweep_with_progress(prepared, args))


def _print_sweep_outcome(prepared, failed: int) -> int:
    print(f"{prepared.folder.path / 'runs.csv'}: {len(prepared.draws)} runs, {failed} failed")
    return 1 if failed else 0


def _variants_by_prim(args) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for prim, name, value in args.variant:
        found.setdefault(prim, {})[name] = value
    return found


def _run_sweep_with_progress(prepared, args) -> int:
    """Runs all, with progress; how many failed."""
    _start_warp_for_command()
    quiet = getattr(args, "quiet", False) or getattr(args, "json", False)
    total, before, began = len(prepared.draws), len(prepared.folder.rows), perf_counter()
    progress = Progress(total, quiet=quiet)

    def show_sweep_progress(done: int, of: int) -> None:
        each = (perf_counter() - began) / max(done - before, 1)
        progress.note(f"run {done}/{of}  {each:.3g} s/run  {format_duration(each * (of - done))} left")
    progress.say(f"{total} runs" + (f", {before} there already" if before else ""))
    if not quiet:
        prepared.said = lambda text: print(text, file=sys.stderr)
    failed: list[dict] = []
    try:
        for row in prepared.rows(show_sweep_progress):
            failed += [row] * (row["status"] != "done")
    finally:
        progress.clear()
        for row in failed[:FAILURES]:
            print(f"run {row['run']} failed: {row['why']}", file=sys.stderr)
        if len(failed) > FAILURES:
            print(f"and {len(failed) - FAILURES} more, see the column `why`", file=sys.stderr)
    return len(failed)


def _draw_sweep_pictures(args) -> None:
    """The contact sheet and the plots that are asked for."""
    if not (args.sheet or args.plot):
        return
    from wsim.sweep import pictures
    if args.sheet:
        print(pictures.draw_contact_sheet(args.output, device=args.device))
    for column in args.plot:
        print(pictures.plot_table_column(args.output, column))


def warm(args) -> int:
    """`wsim warm`: kernels of scenes, compiled and kept in the cache."""
    _silence_warp_banner()
    from wsim.sweep.warm import compile_kernels_ahead
    _start_warp_for_command()
    for path in args.scene:
        own = _SingleSceneArguments(args, path)
        began = perf_counter()
        modules = compile_kernels_ahead(_simulation_of_command(_load_scene_of_command(own), own))
        print(f"{path}: {', '.join(modules)} ({perf_counter() - began:.3g} s)")
    return 0


class _SingleSceneArguments:
    """The arguments with one scene of several."""

    def __init__(self, args, scene: str):
        self.__dict__.update(vars(args))
        self.scene = scene
