"""The house rules hold in every file, each rule catches a planted fault, and imports cost what they should."""

import ast
import gc
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.make.suite.slow import SLOW
from tools import lint

FILES = lint.sources()


@pytest.fixture(scope="module", autouse=True)
def without_collector():
    """As tools/lint.py itself: trees hold no garbage, and looking for it takes half of the time."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize("rule", [lint.layers, lint.cycles, lint.size, lint.kernels, lint.ports, lint.adjoints, lint.words])
def test_the_sources_keep(rule):
    assert list(rule(FILES)) == []


def test_helpers_that_tests_share_stand_in_tests_make():
    """A file of tests takes no function of another: somebody who changes a test breaks only that test."""
    named = {path: text for path, text in FILES.items() if re.search(r"\btests\.[\w.]*\btest_", text)}
    taken = [(str(path), name) for path, text in named.items() for node in ast.walk(lint.parsed(text))
             if isinstance(node, ast.ImportFrom) and re.match(r"tests\..*\btest_", node.module or "") for name in [node.module]]
    assert taken == []


def test_both_statistics_of_names_complain_when_they_get_worse():
    names = [f"{name}_of_{k}" for k in range(20) for name in ("move", "turn")]
    good, odd = ({Path(f"wsim/odd_{k}.py"): f"def {name}():\n    return 0\n" for k, name in enumerate(each)}
                 for each in (names, ["move"] * 20))
    assert list(lint.lint_names.worse_names(dict(lint.product(good).values()))) == []
    once, words = lint.lint_names.worse_names(dict(lint.product({**good, **odd}).values()))
    assert "occur once" in once and "one word" in words


def test_a_hook_under_its_old_name_is_caught():
    """It would never be called, in silence."""
    base, odd = Path("wsim/model/stage.py"), "class Odd(Method):\n    def retry(self, status): ...\n"
    (said,) = lint.lint_names.old_hooks(dict(lint.product({base: FILES[base], Path("wsim/odd.py"): odd}).values()))
    assert said == "wsim/odd.py:2: the hook `retry` is `find_remedies` now"


def test_a_constant_that_is_assigned_twice_is_caught():
    """The second value counts in functions above it too: clusters of 16 blocks were off for a day by one."""
    twice = {Path("wsim/a.py"): ast.parse("MANY = 64\ndef f():\n    return MANY\nMANY = 1000\n")}
    assert "MANY has a value since line 1" in next(lint.lint_names.constants_assigned_twice(twice))
    once = {Path("wsim/a.py"): ast.parse("A, _ = 1, 2\nB, _ = 3, 4\n")}
    assert not list(lint.lint_names.constants_assigned_twice(once))


def test_names_that_a_base_class_demands_do_not_count_again():
    body = "    def take(self): ...\n"
    text = f"class Base:\n{body}class A(Base):\n{body}class B(Base):\n{body}"
    apart = text.replace("(Base)", "")
    assert [lint.lint_names.name_shares({Path("wsim/a.py"): lint.parsed(t)})[0] for t in (text, apart)] == [1.0, 0.5]


def test_names_are_no_worse_than_they_were():
    assert list(lint.lint_names.worse_names(dict(lint.product(FILES).values()))) == []


def test_no_constant_is_assigned_twice():
    assert not list(lint.lint_names.constants_assigned_twice(dict(lint.product(FILES).values())))


def test_no_folder_is_full():
    assert list(lint.entries()) == []


def test_documents_and_scenes_name_no_place_of_one_machine():
    assert list(lint.words(lint.texts())) == []


def planted(**modules: str) -> dict[Path, str]:
    """Sources by dotted name with __ for the dot, beside the modules that they may name."""
    base = dict.fromkeys(("scene__curve", "model__state", "physics__solver__xpbd", "physics__cloth__air", "simulation__plan",
                          "simulation__simulation", "show__viewer"), "")
    found = {}
    for name, text in {**base, **modules}.items():
        place = Path(f"{name.replace('__', '/')}.py")
        found[place if name.startswith("kernels") else Path("wsim") / place] = text
    return found


@pytest.mark.parametrize(("module", "source", "words"), [
    ("scene__curve", "from wsim.model.state import State", "scene.curve stands below model.state"),
    ("scene__curve", "def f():\n    import warp", "may not import warp"),
    ("model__state", "from wsim.simulation import plan", "model.state stands below simulation.plan"),
    ("physics__solver__xpbd", "import wsim.physics.cloth.air", "methods meet"),
    ("simulation__plan", "import kernels", "twice"),
    ("simulation__plan", "from kernels.solver.xpbd import project", "twice"),
    ("simulation__simulation", "import rerun as rr", "only show.viewer, show.rerun_log may import rerun"),
    ("physics__solver__xpbd", "from pxr import Usd", "may import pxr"),
    ("simulation__plan", "from .state import State", "relative"),
    ("kernels__solver__xpbd", "from wsim.model.state import State", "kernels import warp"),
    ("kernels__solver__xpbd", "import numpy", "kernels import warp"),
    ("newcomer__file", "", "no place in LAYERS"),
])
def test_a_forbidden_import_is_caught(module, source, words):
    found = list(lint.layers(planted(**{module: source})))
    assert len(found) == 1 and words in found[0], found


@pytest.mark.parametrize(("module", "source"), [
    ("simulation__simulation", "from wsim.simulation import plan\nimport warp"),
    ("physics__solver__xpbd", "from wsim.kernels.solver import xpbd\nfrom wsim.model.state import State"),
    ("physics__solver__newcomer", "from wsim.physics.solver import xpbd"),
    ("kernels__solver__xpbd", "import warp as wp\nfrom functools import cache\nfrom wsim.kernels.motion import points"),
    ("scene__curve", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from wsim.model.state import State"),
])
def test_an_allowed_import_is_not(module, source):
    assert list(lint.layers(planted(**{"kernels__motion__points": "", module: source}))) == []


def test_a_cycle_is_caught():
    found = list(lint.cycles(planted(model__state="import wsim.scene.curve",
                                     scene__curve="from wsim.model.state import State")))
    assert found == ["wsim/model/state.py:1: cycle model.state -> scene.curve -> model.state"]


def test_a_full_folder_is_caught(tmp_path):
    for k in range(lint.ENTRIES):
        tmp_path.joinpath("wsim", "room").mkdir(parents=True, exist_ok=True)
        tmp_path.joinpath("wsim", "room", f"m{k}.py").touch()
    tmp_path.joinpath("wsim", "room", "__pycache__").mkdir()
    tmp_path.joinpath("wsim", "room", "__pycache__", "m0.cpython-311.pyc").touch()         # Python's, not the author's
    assert list(lint.entries(tmp_path)) == []
    tmp_path.joinpath("wsim", "room", "one_more.py").touch()
    (found,) = lint.entries(tmp_path)
    assert found == f"wsim/room: {lint.ENTRIES + 1} entries, at most {lint.ENTRIES}: make a room"


def test_length_counts_neither_the_docstring_nor_inner_functions():
    source = 'def outer():\n    """One.\n\n    Two."""\n    def inner():\n        return 1\n    return inner\n'
    assert lint.length(lint.ast.parse(source).body[0]) == 2


@pytest.mark.parametrize(("source", "words"), [
    ("x = 1\n" * (lint.FILE_LINES + 1), "split it"),
    ("def f():\n" + "    x = 1\n" * lint.FUNCTION_LINES, "f has"),
    (f"def f({', '.join(f'a{k}' for k in range(lint.ARGUMENTS + 1))}):\n    pass\n", "group them"),
])
def test_what_is_too_large_is_caught(source, words):
    found = list(lint.size({Path("wsim/scene/__init__.py"): source}))
    assert len(found) == 1 and words in found[0]


@pytest.mark.parametrize("kernel", [
    "@cache\ndef press(real, module):\n    @wp.kernel(module=module)\n    def press({}):\n        pass\n    return press\n",
    "@cache\ndef made(real, module):\n    def press({}):\n        pass\n    return wp.kernel(press, name='press')\n",
])
def test_every_argument_of_a_kernel_counts_those_that_it_writes_too(kernel):
    """Decorated, and handed to wp.kernel by its factory."""
    inputs = [f"a{k}: wp.array(dtype=real)" for k in range(lint.ARGUMENTS - 1)]
    outputs = ["x_out: wp.array(dtype=real)", "v_out: wp.array(dtype=real)"]
    (found,) = lint.size({Path("kernels/motion/press.py"): kernel.format(", ".join(inputs + outputs))})
    assert found.endswith(f"press takes {lint.ARGUMENTS + 1} arguments, at most {lint.ARGUMENTS}: group them")
    assert not list(lint.size({Path("kernels/motion/press.py"): kernel.format(", ".join(inputs + outputs[:1]))}))


def test_two_kernels_of_one_name_are_caught():
    source = "@wp.kernel(module=module)\ndef press(x: int):\n    pass\n"
    found = list(lint.kernels({Path("kernels/a.py"): source, Path("kernels/b.py"): source}))
    assert found == ["kernels/b.py:2: kernel press has the name of kernels/a.py:2"]
    assert not list(lint.kernels({Path("kernels/a.py"): source, Path("kernels/b.py"): source.replace("press", "blow")}))


@pytest.mark.parametrize("line", ["path = '/" + "tmp/x'", "# TO" + "DO: later", "raise NotImplemented" + "Error",
                                  "see share" + "d/x"])
def test_a_word_that_does_not_belong_is_caught(line):
    assert len(list(lint.words({Path("a.py"): line}))) == 1


OURS = ("tools", "wsim", "tests", "scenes")
OTHERS = {"numpy", "warp", "pxr", "scipy", "matplotlib", "newton", "mujoco", "phi", "mkdocs", *sys.stdlib_module_names}


@pytest.mark.parametrize("path", [p for p in FILES if p.parts[0] == "tools"], ids=str)
def test_what_a_tool_imports_of_ours_is_there(path):
    """Tools are seldom run, and mypy does not read them. Some need packages that are not installed here: read, not imported."""
    for node in ast.walk(ast.parse(FILES[path])):
        tops = [a.name for a in node.names] if isinstance(node, ast.Import) else [getattr(node, "module", None) or "tools"]
        assert {top.split(".")[0] for top in tops} <= OTHERS | {*OURS}, tops
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in OURS:
            own = FILES.get(Path(f"{node.module.replace('.', '/')}.py"))
            read = node.module.startswith("tools") and own
            there = set(re.findall(r"(?m)^(?:def |class )?(\w+(?:, \w+)*)", own)) if read else dir(import_module(node.module))
            there = {name for names in there for name in names.split(", ")}
            for name in (alias.name for alias in node.names):
                assert name in there or find_spec(f"{node.module}.{name}"), f"from {node.module} import {name}"


def test_the_table_of_slow_tests_names_tests():
    for file, names in SLOW.items():
        text = (lint.ROOT / "tests" / file).read_text(encoding="utf-8")
        assert all(f"def {name}(" in text for name in names), file


@pytest.mark.parametrize("source", ['pull = plan.method("explicit").pull', "a, b = (sim.plan.method(name) for name in NAMES)",
                                    'points = b.methods["points"]'])
def test_a_method_that_is_asked_for_by_its_name_is_caught(source):
    found = list(lint.ports(planted(simulation__plan=f"row = plan.method(row.name)\n{source}")))
    assert len(found) == 1 and "wsim/simulation/plan.py:2: the method" in found[0], found


@pytest.mark.parametrize("module, source, words", [
    ("kernels__solver__odd_adjoint", "", "kernels/solver/odd_adjoint.py:1: odd.py does not stand beside it"),
    ("physics__cloth__odd_adjoint", "", "wsim/physics/cloth/odd_adjoint.py:1: odd.py does not stand beside it"),
    ("physics__solver__xpbd", "def f():\n    from wsim.physics.solver.xpbd_adjoint import SweepAdjoint",
     "wsim/physics/solver/xpbd.py:2: imports wsim.physics.solver.xpbd_adjoint.SweepAdjoint"),
])
def test_an_adjoint_without_its_forward_file_or_known_there_is_caught(module, source, words):
    found = list(lint.adjoints(planted(physics__solver__xpbd_adjoint="import wsim.kernels.solver.xpbd_adjoint",
                                       **{module: source})))
    assert len(found) == 1 and words in found[0], found


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
    assert names == "[]" and int(count) <= 43               # see tests/scene/test_help.py
