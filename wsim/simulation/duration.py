"""How long a run takes, in words; a run that takes long is said beforehand."""


def duration(seconds: float) -> str:
    """4.2 s, 1:05, 2:03:04."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def long(plan) -> list[str]:
    """Warnings of many steps a frame, with the time that a frame is expected to take (`wsim.simulation.cost`)."""
    from wsim.scene.check.counts import MANY
    return [f"warning: /: {count} {what}: a frame takes about {duration(plan.seconds)}" for what, count in (
        ("substeps a frame", plan.choice.steps), ("iterations a substep", plan.choice.iterations)) if count > MANY]


def long_run(plan, frames: int) -> list[str]:
    """A warning of many frames, with the time that they are expected to take."""
    from wsim.scene.check.counts import MANY
    return [f"warning: /: {frames} frames take about {duration(plan.seconds * frames)}"] if frames > MANY else []
