"""How many steps are many: what a scene asks for is refused where it would never end, and said where it takes long."""

from wsim.progress import duration
from wsim.scene import Problem, SceneError

MANY, MOST = 10_000, 1_000_000       # substeps of a frame, iterations, frames: from which one is warned, and refused beyond


def refuse(what: str, count: int, mend: str) -> None:
    """Raises SceneError beyond MOST."""
    if count > MOST:
        raise SceneError(Problem("/", f"{what} is {count}; allowed is up to {MOST}; {mend}"))


def long(plan) -> list[str]:
    """Warnings, with the time that a plan's frames are expected to take (`wsim.cost`)."""
    scene, each, found = plan.model.scene, plan.seconds, []
    for what, count in (("substeps a frame", plan.choice.steps), ("iterations a substep", plan.choice.iterations)):
        if count > MANY:
            found.append(f"warning: /: {count} {what}: a frame takes about {duration(each)}, all {scene.frames} about "
                         f"{duration(each * scene.frames)}")
    if scene.frames > MANY and not found:
        found.append(f"warning: /: {scene.frames} frames take about {duration(each * scene.frames)}")
    return found
