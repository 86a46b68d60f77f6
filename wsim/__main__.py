"""`python -m wsim`, and the command `wsim`: the command line, which Ctrl-C ends in one line from the first import on."""

import sys

from wsim.simulation import interrupt


def main() -> int:
    """Exit code of the command that the process was started with."""
    interrupt.start_watching_interrupts("leave")
    from wsim.cli import main as command

    return command()


if __name__ == "__main__":
    sys.exit(main())
