"""Means that keep a first frame short: passes that are called at one place each, and functions that stand alone on a CPU."""

import ast
import inspect
import textwrap
from collections import Counter
from pathlib import Path

import pytest
import warp as wp
from warp._src import codegen

from wsim.kernels.rigid import passes
from wsim.kernels.rigid.complementarity.converged import converged_step_kernel
from wsim.kernels.rigid.joint.passes import linked_substep_kernel
from wsim.kernels.rigid.narrow.gjk import gjk_search_func
from wsim.kernels.rigid.passes import body_substep_kernel
from wsim.model.compiler import variants

PASSES = {"prepare", "warm", "thrown", "begun", "ended", "placed"}
OF = {body_substep_kernel: PASSES | {"solve"}, converged_step_kernel: PASSES | {"solved"},
      # impacts are a kernel of their own
      linked_substep_kernel: PASSES - {"thrown"} | {"solve", "lined", "reset", "joined", "loosed"}}


@pytest.mark.parametrize("factory", OF, ids=lambda f: f.__name__)
def test_each_pass_is_called_at_one_place_of_a_kernel_of_substeps(factory):
    """Compilers put a pass in wherever it is called: at two places it is compiled twice."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(factory)))
    (kernel,) = [f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and f.name.startswith("rigid_")]
    calls = Counter(c.func.id for c in ast.walk(kernel) if isinstance(c, ast.Call) and isinstance(c.func, ast.Name))
    assert {name: calls[name] for name in OF[factory]} == dict.fromkeys(OF[factory], 1)


def test_functions_that_stand_by_themselves_do_so_on_a_cpu_and_nowhere_else():
    function = gjk_search_func(frozenset({"hull"}), wp.float32)
    assert function.inline_hint == variants.APART
    with variants.single_variant():
        assert getattr(codegen, variants.WORDS).get(function.inline_hint)
    with variants.single_variant(cpu=False):
        assert not getattr(codegen, variants.WORDS).get(function.inline_hint)
    assert getattr(codegen, variants.WORDS).get(function.inline_hint)


def locals_named_as_numbers(path: Path) -> list[str]:
    """Variables that a function makes, reads fields of, and that have the name of a number of Warp's."""
    found = []
    for function in (each for each in ast.walk(ast.parse(path.read_text())) if isinstance(each, ast.FunctionDef)):
        made = {n.id for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        read = {n.value.id for n in ast.walk(function) if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name)}
        found += [f"{path.name} {function.name}: {name}" for name in sorted(made & read)
                  if isinstance(getattr(wp, name, None), (int, float))]
    return found


def test_a_kernel_has_one_hash_whatever_was_compiled_before():
    """Warp 1.19 takes `e.x` of a variable e for its constant `wp.e` until the function has been compiled, and hashes that: a
    process that has compiled it looks for, and compiles, another module than the next one."""
    kernels = Path(passes.__file__).parents[1]
    assert [each for path in sorted(kernels.rglob("*.py")) for each in locals_named_as_numbers(path)] == []
