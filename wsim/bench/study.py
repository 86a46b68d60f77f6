"""The bench of a scene: a reference, then rows beside it, within a budget of seconds."""

import platform
from collections.abc import Callable
from math import isfinite
from pathlib import Path

import warp as wp

from wsim import __version__
from wsim.bench.budget import Budget
from wsim.bench.reference import make_reference_solution
from wsim.bench.report import Report
from wsim.bench.sweep import BenchSweep
from wsim.bench.track import SampledFrames, largest_body_extent
from wsim.model import kernel_cache
from wsim.scene import Problem, Scene, SceneError
from wsim.scene.check.scene import check_scene

WINDOW = 0.5           # [s] looked at unless frames are named
BUDGET, QUICK = 120.0, 30.0      # [s]


def default_bench_frames(scene: Scene) -> int:
    """Frames that are looked at unless named: about WINDOW."""
    return max(1, min(scene.frames, round(WINDOW * scene.fps)))


def hardware_name(device: wp.Device) -> str:
    """Name of what a time was measured on: the GPU, or the CPU's and its count."""
    if device.is_cuda:
        return str(device.name)
    import os
    info = Path("/proc/cpuinfo")
    lines = info.read_text(errors="replace").splitlines() if info.exists() else []
    name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor())
    return f"{name or platform.machine()}, {os.cpu_count()} cores"


def versions_of_bench() -> dict[str, str]:
    """Versions of what the times and errors were measured with."""
    return {"wsim": __version__, "warp": wp.config.version}


def bench(scene: Scene, *, device: str | None = None, frames: int | None = None, budget: float | None = None,
          quick: bool = False, say: Callable[[str], None] = lambda text: None) -> Report:
    """Time against error of this very scene, over solvers, integrators, substeps, iterations and precision.

    frames    looked at; None: the scene's, at most about half a second
    budget    [s] that it may take, compiling included; the last run begun is finished
    quick     fewer settings, and a budget of QUICK unless one is given
    say       is told what runs now
    Raises SceneError where the scene cannot be simulated, where nothing moves, and for an argument out of range.
    """
    budget = (QUICK if quick else BUDGET) if budget is None else budget
    if not 0.0 < budget < float("inf"):
        raise SceneError(Problem("budget", f"found {budget:g}; allowed is a finite number of seconds above 0"))
    if frames is not None and frames < 1:
        raise SceneError(Problem("frames", f"found {frames}; allowed is 1 or more"))
    fatal = [p for p in check_scene(scene) if p.fatal]
    if fatal:
        raise SceneError(fatal)
    where = kernel_cache.warp_device(device)
    clock, look = Budget(budget), SampledFrames(str(where), frames or default_bench_frames(scene))
    reference = make_reference_solution(scene, look, clock, say)
    sweep = BenchSweep(scene, look, reference, clock, say, step=4 if quick else 2)
    sweep.all(quick)
    if not sweep.rows:
        raise SceneError(Problem("/", "no setting ran: " + "; ".join(f"{d['setting']} {d['why']}" for d in sweep.left_out)))
    known = {"setting": str(reference.track.setting), "error": reference.error, "seconds": reference.seconds,
             "ratio": reference.ratio if isfinite(reference.ratio) else None, "notes": reference.notes}
    return Report(scene.source or "scene", len(reference.track.start), largest_body_extent(scene), scene.fps, look.frames,
                  str(where),
                  hardware_name(where), "wall clock" if where.is_cuda else "CPU seconds of all threads", versions_of_bench(),
                  known, [float(g) for g in reference.growth], look.sampled, reference.refused, sweep.rows, sweep.left_out,
                  clock.spent)
