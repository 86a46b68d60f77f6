"""`wsim sweep` and `wsim warm`."""

import sys
from time import perf_counter

from wsim.cli.commands import _hush, _load, _ready, _simulation
from wsim.cli.progress import Progress
from wsim.simulation.duration import duration


def settings(args):
    """Settings of a sweep from its arguments."""
    from wsim.sweep.job import Settings
    changes = {name: getattr(args, name, None) for name in ("frames", "substeps", "iterations", "solver", "integrator")}
    return Settings(device=args.device, precision=args.precision or "float32", keep=getattr(args, "keep", "none"),
                    changes={k: v for k, v in changes.items() if v is not None}, worlds=getattr(args, "worlds", None),
                    workers=args.workers, cores=args.cores, address=args.address, retries=getattr(args, "retries", 2))


def sweep(args) -> int:
    """`wsim sweep`: a table and results; fails where a run did, which the table lists."""
    from wsim.sweep.sweep import Sweep

    _hush()
    variants: dict[str, dict[str, str]] = {}
    for prim, name, value in args.variant:
        variants.setdefault(prim, {})[name] = value
    prepared = Sweep.prepared(args.scene, args.vary, args.output, latin=args.latin, seed=args.seed, resume=args.resume,
                              settings=settings(args), variants=variants)
    _ready()
    total, before, began = len(prepared.draws), len(prepared.folder.rows), perf_counter()
    progress = Progress(total, quiet=args.quiet)

    def told(done: int, of: int) -> None:
        each = (perf_counter() - began) / max(done - before, 1)
        progress.note(f"run {done}/{of}  {each:.3g} s/run  {duration(each * (of - done))} left")
    progress.say(f"{total} runs" + (f", {before} there already" if before else ""))
    prepared.said = lambda text: (progress.clear(), print(text, file=sys.stderr)) if not args.quiet else None
    failed = 0
    try:
        for row in prepared.rows(told):
            failed += row["status"] != "done"
    finally:
        progress.clear()
    _pictures(args)
    table = prepared.folder.path / "runs.csv"
    print(f"{table}: {total} runs, {failed} failed")
    return 1 if failed else 0


def _pictures(args) -> None:
    """The contact sheet and the plots that are asked for."""
    if not (args.sheet or args.plot):
        return
    from wsim.sweep import pictures
    for column in args.plot:
        print(pictures.plot(args.output, column))
    if args.sheet:
        print(pictures.sheet(args.output, device=args.device))


def warm(args) -> int:
    """`wsim warm`: kernels of scenes, compiled and kept in the cache."""
    _hush()
    from wsim.sweep.warm import warmed
    _ready()
    for path in args.scene:
        own = _One(args, path)
        began = perf_counter()
        modules = warmed(_simulation(_load(own), own))
        print(f"{path}: {', '.join(modules)} ({perf_counter() - began:.3g} s)")
    return 0


class _One:
    """The arguments with one scene of several."""

    def __init__(self, args, scene: str):
        self.__dict__.update(vars(args))
        self.scene = scene
