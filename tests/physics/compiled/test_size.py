"""Means that keep a first frame short: passes that are called at one place each, and functions that stand alone on a CPU."""

import ast
import inspect
import textwrap
from collections import Counter

import pytest
import warp as wp
from warp._src import codegen

from wsim.kernels.rigid.complementarity.converged import converged
from wsim.kernels.rigid.joint.passes import linked
from wsim.kernels.rigid.narrow.epa import penetration
from wsim.kernels.rigid.passes import substeps
from wsim.model.compiler import variants

PASSES = {"prepare", "warm", "thrown", "begun", "ended", "placed"}
OF = {substeps: PASSES | {"solve"}, converged: PASSES | {"solved"},
      linked: PASSES - {"thrown"} | {"solve", "lined", "reset", "joined", "loosed"}}       # impacts are a kernel of their own


@pytest.mark.parametrize("factory", OF, ids=lambda f: f.__name__)
def test_each_pass_is_called_at_one_place_of_a_kernel_of_substeps(factory):
    """Compilers put a pass in wherever it is called: at two places it is compiled twice."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(factory)))
    (kernel,) = [f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and f.name.startswith("rigid_")]
    calls = Counter(c.func.id for c in ast.walk(kernel) if isinstance(c, ast.Call) and isinstance(c.func, ast.Name))
    assert {name: calls[name] for name in OF[factory]} == dict.fromkeys(OF[factory], 1)


def test_functions_that_stand_by_themselves_do_so_on_a_cpu_and_nowhere_else():
    function = penetration(frozenset({"hull"}), wp.float32)
    assert function.inline_hint == variants.APART
    with variants.single():
        assert getattr(codegen, variants.WORDS).get(function.inline_hint)
    with variants.single(cpu=False):
        assert not getattr(codegen, variants.WORDS).get(function.inline_hint)
    assert getattr(codegen, variants.WORDS).get(function.inline_hint)
