"""How many steps are many: what a scene asks for is refused where it would never end, and said where it takes long."""

from wsim.progress import duration

MANY, MOST = 10_000, 1_000_000       # substeps of a frame, iterations, frames: from which one is warned, and refused beyond


def refuse(what: str, count: int, mend: str) -> None:
    """Raises SceneError beyond MOST."""
    from wsim.scene import Problem, SceneError

    if count > MOST:
        raise SceneError(Problem("/", f"{what} is {count}; allowed is up to {MOST}; {mend}"))


def long(plan) -> list[str]:
    """Warnings of many steps a frame, with the time that a frame is expected to take (`wsim.cost`)."""
    return [f"warning: /: {count} {what}: a frame takes about {duration(plan.seconds)}" for what, count in (
        ("substeps a frame", plan.choice.steps), ("iterations a substep", plan.choice.iterations)) if count > MANY]


def long_run(plan, frames: int) -> list[str]:
    """A warning of many frames, with the time that they are expected to take."""
    return [f"warning: /: {frames} frames take about {duration(plan.seconds * frames)}"] if frames > MANY else []
