"""What tests/usd/result/test_partial.py shares with other tests: run."""

import subprocess
import sys
import textwrap

from tools import lint


def run(script: str, *arguments) -> subprocess.Popen:
    """Another process, with the functions of `recorder`."""
    imports = ("import os, resource, signal, sys\nfrom tests.make.usd.result.recorder import *\n"
               "from wsim.usd.result import partial\nfrom wsim.usd.result.restart import ResultReader\n")
    root = lint.ROOT
    command = [sys.executable, "-c", imports + textwrap.dedent(script), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=root)
