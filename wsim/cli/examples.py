"""`wsim examples`: the scenes that come with wsim, and a run of one in the current folder."""

import re
from difflib import get_close_matches
from pathlib import Path
from textwrap import shorten

from wsim.scene import Problem, SceneError

FOLDER = Path(__file__).resolve().parent.parent / "scenes"
DOCUMENTATION = re.compile(r'^ *doc = "(.*)"', re.MULTILINE)
HEAD = 1000                # characters of a file, in which its documentation stands


def shipped_scenes() -> dict[str, Path]:
    """Files of the example scenes by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.usda"))}


def stage_documentation(path: Path) -> str:
    """The documentation of a stage, as its file begins."""
    with path.open(encoding="utf-8") as file:
        found = DOCUMENTATION.search(file.read(HEAD))
    return found[1] if found else ""


def examples(args) -> int:
    """Lists the example scenes."""
    scenes = shipped_scenes()
    for name, path in scenes.items():
        print(f"{name:{max(map(len, scenes))}}  {shorten(stage_documentation(path), 100, placeholder=' ...')}")
    print("\nRun one in this folder: wsim examples NAME. Comments in the file say how it was made.")
    return 0


def run_command(args) -> list[str]:
    """Arguments of the `wsim run` that simulates an example into NAME.usdc and NAME.png of the current folder."""
    scenes = shipped_scenes()
    if args.name not in scenes:
        close = get_close_matches(args.name, scenes, 1)
        raise SceneError(Problem(args.name, f"no example has this name{f'; did you mean {close[0]}?' if close else ''}; "
                                 "`wsim examples` lists all"))
    options = [text for name in ("frames", "device") if getattr(args, name) is not None
               for text in (f"--{name}", str(getattr(args, name)))]
    return ["run", str(scenes[args.name]), "-o", f"{args.name}.usdc", "--png", f"{args.name}.png", *options]
