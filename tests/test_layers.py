"""The house rules hold in every file, each rule catches a planted fault, and imports cost what they should."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools import lint

FILES = lint.sources()


@pytest.mark.parametrize("rule", [lint.layers, lint.cycles, lint.size, lint.kernels, lint.words])
def test_the_sources_keep(rule):
    assert list(rule(FILES)) == []


def test_documents_and_scenes_name_no_place_of_one_machine():
    assert list(lint.words(lint.texts())) == []


def planted(**modules: str) -> dict[Path, str]:
    """Sources by dotted name with __ for the dot, beside the modules that they may name."""
    base = dict.fromkeys(("scene", "state", "xpbd", "aero", "plan", "simulation", "view"), "")
    named = {Path("wsim", f"{name.replace('__', '/')}.py"): text for name, text in {**base, **modules}.items()
             if not name.startswith("kernels")}
    device = {Path(f"{name.replace('__', '/')}.py"): text for name, text in modules.items()
              if name.startswith("kernels")}
    return named | device


@pytest.mark.parametrize(("module", "source", "words"), [
    ("scene", "from wsim.state import State", "scene stands below state"),
    ("scene", "def f():\n    import warp", "may not import warp"),
    ("state", "from wsim import simulation", "state stands below simulation"),
    ("xpbd", "import wsim.aero", "methods meet"),
    ("plan", "import kernels", "twice"),
    ("plan", "from kernels.xpbd import project", "twice"),
    ("simulation", "import rerun as rr", "only view may import rerun"),
    ("xpbd", "from pxr import Usd", "may import pxr"),
    ("plan", "from .state import State", "relative"),
    ("kernels__xpbd", "from wsim.state import State", "kernels import warp"),
    ("kernels__xpbd", "import numpy", "kernels import warp"),
    ("newcomer", "", "no place in LAYERS"),
])
def test_a_forbidden_import_is_caught(module, source, words):
    found = list(lint.layers(planted(**{module: source})))
    assert len(found) == 1 and words in found[0], found


@pytest.mark.parametrize(("module", "source"), [
    ("simulation", "from wsim import plan\nimport warp"),
    ("xpbd", "from wsim.kernels import xpbd\nfrom wsim.state import State"),
    ("kernels__xpbd", "import warp as wp\nfrom functools import cache\nfrom wsim.kernels import points"),
    ("scene", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from wsim.state import State"),
])
def test_an_allowed_import_is_not(module, source):
    assert list(lint.layers(planted(**{module: source, "kernels__points": ""}))) == []


def test_a_cycle_is_caught():
    found = list(lint.cycles(planted(state="import wsim.scene", scene="from wsim.state import State")))
    assert found == ["wsim/scene.py:1: cycle scene -> state -> scene"]


def test_length_counts_neither_the_docstring_nor_inner_functions():
    source = 'def outer():\n    """One.\n\n    Two."""\n    def inner():\n        return 1\n    return inner\n'
    assert lint.length(lint.ast.parse(source).body[0]) == 2


@pytest.mark.parametrize(("source", "words"), [
    ("x = 1\n" * (lint.FILE_LINES + 1), "split it"),
    ("def f():\n" + "    x = 1\n" * lint.FUNCTION_LINES, "f has"),
    (f"def f({', '.join(f'a{k}' for k in range(lint.ARGUMENTS + 1))}):\n    pass\n", "group them"),
])
def test_what_is_too_large_is_caught(source, words):
    found = list(lint.size({Path("wsim/scene.py"): source}))
    assert len(found) == 1 and words in found[0]


def test_two_kernels_of_one_name_are_caught():
    source = "@wp.kernel(module=module)\ndef press(x: int):\n    pass\n"
    found = list(lint.kernels({Path("kernels/a.py"): source, Path("kernels/b.py"): source}))
    assert found == ["kernels/b.py:2: kernel press has the name of kernels/a.py:2"]
    assert not list(lint.kernels({Path("kernels/a.py"): source, Path("kernels/b.py"): source.replace("press", "blow")}))


@pytest.mark.parametrize("line", ["path = '/" + "tmp/x'", "# TO" + "DO: later", "raise NotImplemented" + "Error",
                                  "see share" + "d/x"])
def test_a_word_that_does_not_belong_is_caught(line):
    assert len(list(lint.words({Path("a.py"): line}))) == 1


def run(code: str) -> str:
    """What a fresh interpreter prints in the repository's root."""
    done = subprocess.run([sys.executable, "-c", code], cwd=lint.ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_wsim_starts_nothing_heavy():
    heavy = "('numpy', 'warp', 'pxr', 'rerun', 'kernels', 'argparse')"
    assert run(f"import wsim, sys; print([m for m in {heavy} if m in sys.modules])") == "[]\n"


def test_scenes_and_stages_work_without_warp():
    code = "import wsim, sys; wsim.Scene(), wsim.load, wsim.shapes, wsim.Recorder; print('warp' in sys.modules)"
    assert run(code) == "False\n"


def test_there_is_no_global_kernels_module():
    """The root is on sys.path here, so that a bare `import kernels` anywhere would succeed."""
    code = "import wsim, sys; wsim.Simulation; print('wsim.kernels' in sys.modules, 'kernels' in sys.modules)"
    assert run(code) == "True False\n"


def test_import_wsim_takes_a_few_milliseconds():
    """About one; ten times that is allowed, for a busy machine. The least of five fresh interpreters."""
    code = "import time; t = time.perf_counter(); import wsim; print(time.perf_counter() - t)"
    assert min(float(run(code)) for _ in range(5)) < 0.010


def test_every_public_name_is_there():
    wrong = "[n for n in wsim.__all__ if getattr(wsim, n).__name__.split('.')[-1] != n]"
    names, count = run(f"import wsim; print({wrong}, len(wsim.__all__))").rsplit(" ", 1)
    assert names == "[]" and int(count) <= 25
