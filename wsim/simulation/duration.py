"""How long a run takes, in words; a run that takes long is said beforehand."""

from collections.abc import Sequence
from statistics import median

from wsim.scene.methods import has_sheets

DEAR = 10.0              # steps over those that a scene names, from which a run looks for triangles that need them
SLOW = 10.0              # [s] a frame: beyond, a run says so before it starts


def format_duration(seconds: float) -> str:
    """4.2 s, 1:05, 2:03:04."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def warn_steps(plan, fps: float | None = None) -> list[str]:
    """Warnings of many steps a frame, with the time that a frame is expected to take (`wsim.simulation.cost`), and of triangles
    that make them many; and where no setting holds so many frames a second of wall clock."""
    from wsim.scene.check.counts import MANY
    late = []
    if fps is not None and plan.seconds * fps > 1.0:
        late = [f"warning: /: {fps:g} frames a second are not held: a frame by the fastest setting takes about "
                f"{_format_short_time(plan.seconds)}; a coarser mesh or a GPU (--device cuda:0) takes less"]
    steps, scene = plan.choice.steps, plan.model.scene
    late += plan.choice.need.warnings(scene, plan.choice.substeps)
    if has_sheets(scene) and steps > DEAR * scene.substeps:
        from wsim.scene.check.slivers import warn_of_slivers
        late += map(str, warn_of_slivers(scene, steps))
    if scene.things("Particles"):
        from wsim.simulation.predicted.sweep_strain import warn_of_loaded_strain
        late += warn_of_loaded_strain(plan.model, plan.choice)
    if not plan.fits:
        late.append(f"warning: /: {steps} substeps a frame: a graph of them would take {plan.recorded() / 2**30:.2g} GiB, more "
                    "than half of what is free; they are launched one by one, which takes longer; give fewer")
    return late + [f"warning: /: {count} {what}: a frame takes about {format_duration(plan.seconds)}" for what, count in (
        ("substeps a frame", steps), ("iterations a substep", plan.choice.iterations)) if count > MANY]


def warn_of_missed_rate(fps: float | None, times: Sequence[float]) -> list[str]:
    """Warnings where half of the frames, which took `times` [ms], are longer than so many a second of wall clock allow."""
    if fps is None or not times or median(times) * fps <= 1e3:
        return []
    return [f"warning: /: {fps:g} frames a second were asked for, and half of the frames took {median(times):.3g} ms and more: "
            "what was predicted does not hold here; ask for as many more"]


def expected_time_and_error(plan, frames: int, samples: int = 1) -> str:
    """Text of what a frame and the run are expected to take and err by, in one line; samples: of the plan's frames a frame."""
    each, error = plan.seconds * samples, plan.choice.error
    errs = "" if error is None else f"; expected error {percent_of_size(error)} of the size, more where small folds grow"
    return (f"about {_format_short_time(each)} a frame, {_format_short_time(each * frames)} for {frames} frames, after kernels "
            f"are compiled{errs}")


def percent_of_size(error: float) -> str:
    """An error over a scene's size."""
    return f"{100.0 * error:.2g} %" if error < 1.0 else "over 100 %"


def _format_short_time(seconds: float) -> str:
    return format_duration(seconds) if seconds >= 1.0 else f"{1e3 * seconds:.0f} ms"


def long_run(plan, frames: int, samples: int = 1) -> list[str]:
    """Warnings of a frame that is expected to take longer than SLOW, and of many frames; samples as
    `expected_time_and_error`."""
    from wsim.scene.check.counts import MANY
    each = plan.seconds * samples
    found = [f"warning: /: a frame takes about {format_duration(each)}, and {frames} of them {format_duration(each * frames)}; "
             "fewer --substeps, a coarser mesh or a GPU (--device cuda:0) take less"] if each > SLOW else []
    steps = frames * samples
    return found + ([f"warning: /: {steps} frames take about {format_duration(each * frames)}"] if steps > MANY else [])
