"""Where a fit was stopped: a JSON file, from which it goes on."""

import json
from contextlib import contextmanager
from pathlib import Path

from wsim.scene import Problem, SceneError
from wsim.usd.result.atomic import replace_text


def write_fit_state(path, of: list[str], found: dict) -> None:
    """Whole or not at all. of: what is fitted."""
    replace_text(path, json.dumps({"of": of, **found}))


@contextmanager
def reading_fit_state(path, of: list[str]):
    """State of a fit that `write_fit_state` has left. Raises SceneError where it is of another fit, or what is read of it
    within is not there."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        if found["of"] != of:
            raise SceneError(Problem(str(path), f"is the state of a fit of {', '.join(found['of'])}; this one is of "
                                     f"{', '.join(of)}: give another file, or remove it"))
        yield found
    except (KeyError, TypeError, ValueError) as error:
        raise SceneError(Problem(str(path), f"is no state of a fit ({error}); give another file, or remove it")) from None
