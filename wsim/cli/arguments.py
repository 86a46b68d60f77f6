"""Arguments of the command line: what a text stands for, or why it stands for nothing."""

import argparse
import os

CHOSEN = ("solver", "integrator", "substeps", "iterations", "precision")       # by `wsim run --error`
TINY, HUGE = 1e-30, 1e30
FAR = 1e5                     # [m] as `wsim.scene.check.objects.FAR`


def parse_positive_count(text: str) -> int:
    """An argument that counts: 1, 2, 3 ..., up to what ends in time."""
    return _parse_bounded_count(text, 1)


def parse_count_or_zero(text: str) -> int:
    """An argument that counts and may be 0."""
    return _parse_bounded_count(text, 0)


def _parse_bounded_count(text: str, least: int) -> int:
    value = int(text)
    from wsim.scene.check.counts import MOST
    if not least <= value <= MOST:
        raise argparse.ArgumentTypeError(f"{text} is too {'small' if value < least else 'large'}; it must be {least} to {MOST}")
    return value


def parse_length(text: str) -> float:
    """A length [m] >= 0."""
    value = float(text)
    if not 0.0 <= value <= FAR:
        raise argparse.ArgumentTypeError(f"{text} is no length; it must be a number of metres, 0 to {FAR:g}")
    return value


def parse_height(text: str) -> float:
    """A height [m], which may be below 0."""
    value = float(text)
    if not -FAR <= value <= FAR:
        raise argparse.ArgumentTypeError(f"{text} is no height; it must be a number of metres, {-FAR:g} to {FAR:g}")
    return value


def parse_positive_number(text: str) -> float:
    """A number > 0, of which squares and quotients are finite too."""
    value = float(text)
    if not TINY <= value <= HUGE:
        raise argparse.ArgumentTypeError(f"{text} is out of range; it must be {TINY:g} to {HUGE:g}")
    return value


def parse_nonempty_name(text: str) -> str:
    """The name of a file, a prim or a device: not an empty one, as of a variable that a shell does not know."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty; give a name, or leave the option out")
    return text


def parse_error_fraction(text: str) -> float:
    """An error over the scene's size: 1% or 0.01."""
    number, percent, rest = text.partition("%")
    value = float(number) / (100.0 if percent else 1.0)
    if rest or not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no error; it must be above 0 and at most 100 %: write 1% or 0.01")
    return value


def _file_with_ending(text: str, *endings: str) -> str:
    """A file to write, in a folder that is there: found out now and not after the simulation."""
    if not text.lower().endswith(endings):
        raise argparse.ArgumentTypeError(f"{text} has another ending; allowed is {', '.join(endings)}")
    return file_in_existing_folder(text)


def file_in_existing_folder(text: str) -> str:
    """A file, in a folder that is there."""
    folder = os.path.dirname(os.path.abspath(parse_nonempty_name(text)))
    if not os.path.isdir(folder):
        raise argparse.ArgumentTypeError(f"{text}: there is no folder {folder}; make it first")
    return text


def image_file_name(text: str) -> str:
    return _file_with_ending(text, ".png", ".gif", ".apng", ".mp4")


def plot_file_name(text: str) -> str:
    return _file_with_ending(text, ".png", ".svg")


def report_file_name(text: str) -> str:
    return text if text == "-" else _file_with_ending(text, ".json")


def parse_pixel_size(text: str) -> tuple[int, int]:
    """960x540"""
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is no size; write it as 960x540")
    return int(width), int(height)


def parse_variant_choice(text: str) -> tuple[str, str, str]:
    """/prim:set=variant"""
    prim, _, rest = text.partition(":")
    name, _, value = rest.partition("=")
    if not (prim.startswith("/") and name and value):
        raise argparse.ArgumentTypeError(f"{text} is no variant; write it as /prim:set=variant")
    return prim, name, value


def conflicting_options(args: argparse.Namespace) -> str:
    """Text about options that exclude each other; "" where none do."""
    if args.command == "run" and args.restart and args.preroll:
        return "--restart goes on from a frame, --preroll settles before the first one: give one of them"
    if args.command == "view" and args.web and args.save:
        return "--web serves a page, -o writes a file: give one of them"
    if args.command == "run" and args.clips and args.flatten:
        return "--clips writes a file a frame, --flatten one file of all: give one of them"
    if args.command == "run" and args.error:
        given = [f"--{name}" for name in CHOSEN if getattr(args, name) is not None]
        if given:
            return f"--error chooses {', '.join(CHOSEN)}: leave out {' '.join(given)}, or --error"
    given = [f"--{n}" for n in ("error", "substeps", "iterations") if getattr(args, n, None)]
    if getattr(args, "fps", None) and given:
        return f"--fps chooses substeps and iterations by their error: leave out {' '.join(given)}, or --fps"
    if args.command == "fit" and bool(args.to) == bool(args.many):
        return "--to OBSERVED is one specimen, --many OBSERVED ... are several: give one of them"
    if args.command == "fit" and args.shared and not args.joint:
        return "--shared says which parameters a joint fit shares: give --joint too"
    if args.command == "fit" and args.copies and args.many and not args.joint:
        return "--copies is of one fit, --many without --joint are fits of few copies each: leave it out"
    return ""


for _kind, _name in ((parse_positive_count, "number"), (parse_count_or_zero, "number"), (parse_length, "length"),
                     (parse_height, "height"), (parse_positive_number, "number"), (parse_error_fraction, "error")):
    _kind.__name__ = _name                      # argparse says "invalid number value"
