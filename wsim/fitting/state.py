"""Where a fit was stopped: a JSON file, from which it goes on."""

import json
import os
from contextlib import contextmanager
from pathlib import Path

from wsim.scene import Problem, SceneError


def write(path, of: list[str], found: dict) -> None:
    """Under a temporary name, which is then changed: never a half. of: what is fitted."""
    temporary = Path(f"{os.fspath(path)}.{os.getpid()}~")
    try:
        temporary.write_text(json.dumps({"of": of, **found}), encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def reading(path, of: list[str]):
    """What `write` has left. Raises SceneError where it is of another fit, or what is read of it within is not there."""
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
        if found["of"] != of:
            raise SceneError(Problem(str(path), f"is the state of a fit of {', '.join(found['of'])}; this one is of "
                                     f"{', '.join(of)}: give another file, or remove it"))
        yield found
    except (KeyError, TypeError, ValueError) as error:
        raise SceneError(Problem(str(path), f"is no state of a fit ({error}); give another file, or remove it")) from None
