"""`python -m wsim`: the command line."""

import sys

from wsim.cli import main

if __name__ == "__main__":
    sys.exit(main())
