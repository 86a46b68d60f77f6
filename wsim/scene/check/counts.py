"""How many steps are many: what a scene asks for is refused where it would never end, and said where it takes long."""

MANY, MOST = 10_000, 1_000_000       # substeps of a frame, iterations, frames: from which one is warned, and refused beyond


def refuse_large_count(what: str, count: int, mend: str) -> None:
    """Raises SceneError beyond MOST."""
    from wsim.scene import Problem, SceneError

    if count > MOST:
        raise SceneError(Problem("/", f"{what} is {count}; allowed is up to {MOST}; {mend}"))


def checked_count(what: str, value, least: int = 0) -> int:
    """A count that a call was given. Raises SceneError for what is none, and beyond MOST."""
    from operator import index

    from wsim.scene import Problem, SceneError

    try:
        found = index(value)
    except TypeError:
        found = -1
    if isinstance(value, bool) or not least <= found <= MOST:
        raise SceneError(Problem(what, f"found {value!r}; allowed is a whole number, {least} to {MOST}"))
    return found
