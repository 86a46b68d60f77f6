"""Arguments of the command line: what a text stands for, or why it stands for nothing."""

import argparse
import os


def whole(text: str) -> int:
    """An argument that counts: 1, 2, 3 ..."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is too small; it must be 1 or more")
    return value


def whole_or_none(text: str) -> int:
    """An argument that counts and may be 0."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; it must be 0 or more")
    return value


def length(text: str) -> float:
    """A length [m] >= 0."""
    value = float(text)
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no length; it must be a finite number of metres, 0 or more")
    return value


def positive(text: str) -> float:
    """A finite number > 0."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is out of range; it must be finite and above 0")
    return value


def fraction(text: str) -> float:
    """An error over the scene's size: 1% or 0.01."""
    number, percent, rest = text.partition("%")
    value = float(number) / (100.0 if percent else 1.0)
    if rest or not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no error; it must be above 0 and at most 100 %: write 1% or 0.01")
    return value


def _file(text: str, *endings: str) -> str:
    """A file to write, in a folder that is there: found out now and not after the simulation."""
    if not text.lower().endswith(endings):
        raise argparse.ArgumentTypeError(f"{text} has another ending; allowed is {', '.join(endings)}")
    folder = os.path.dirname(os.path.abspath(text))
    if not os.path.isdir(folder):
        raise argparse.ArgumentTypeError(f"{text}: there is no folder {folder}; make it first")
    return text


def image(text: str) -> str:
    return _file(text, ".png", ".gif", ".apng")


def drawing(text: str) -> str:
    return _file(text, ".png", ".svg")


def report(text: str) -> str:
    return text if text == "-" else _file(text, ".json")


def pixels(text: str) -> tuple[int, int]:
    """960x540"""
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is no size; write it as 960x540")
    return int(width), int(height)


def variant(text: str) -> tuple[str, str, str]:
    """/prim:set=variant"""
    prim, _, rest = text.partition(":")
    name, _, value = rest.partition("=")
    if not (prim.startswith("/") and name and value):
        raise argparse.ArgumentTypeError(f"{text} is no variant; write it as /prim:set=variant")
    return prim, name, value


for _kind, _name in ((whole, "number"), (whole_or_none, "number"), (length, "length"), (positive, "number"),
                     (fraction, "error")):
    _kind.__name__ = _name                      # argparse says "invalid number value"
