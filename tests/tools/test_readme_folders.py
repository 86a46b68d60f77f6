"""Snippets of the READMEs of folders work as they stand."""

import re
import shlex

import wsim
from tests.make.tools.readme import FOLDERS
from tools.lint import ROOT


def snippets(folder: str) -> list[str]:
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    return re.findall(r"^```(?:python)?\n(.*?)^```", text, re.M | re.S)


def test_there_are_no_others():
    assert {folder: len(snippets(folder)) for folder in FOLDERS} == {
        "scenes": 1, "scenes/examples": 0, "tools": 0, "tools/results": 0, "wsim/fitting": 0, "wsim/gradient": 0,
        "wsim/physics": 0, "wsim/sweep": 0}


def test_the_pictures_of_the_scenes_are_made_by_commands_that_there_are():
    """Of scenes and frames that there are, into pictures that are there, with options that the command line takes."""
    (loop,) = snippets("scenes")
    named = re.findall(r"([a-z_]+) (\d+)", loop.partition("; do")[0])
    drawn = {path.stem for path in (ROOT / "scenes/pictures").glob("*.png")}
    assert len(named) > 20 and {name for name, _ in named} <= drawn & {path.stem for path in (ROOT / "scenes").glob("*.usda")}
    from wsim.cli import build_argument_parser
    for name, frame in named:
        assert 0 < int(frame) <= wsim.load(ROOT / "scenes" / f"{name}.usda").frames
    lines = [line.strip() for line in loop.splitlines() if "wsim " in line]
    commands = [c.strip() for line in lines for c in line.split("&&")]
    assert len(commands) >= 3
    for command in commands:
        words = shlex.split(command.replace("$1", named[0][0]).replace("$2", named[0][1]), comments=True)
        assert words[0] == "wsim" and build_argument_parser().parse_args(words[1:]).command in ("run", "picture")
