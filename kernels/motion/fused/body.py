"""A kernel as a function of its thread, so that other kernels can run it: the same source, and so the same bits.

    kernel     k(a, b, ...)             with i = wp.tid()
    function   k(thread, a, b, ...)     with i = thread

Kernels over one dimension. Warp's code transformers rewrite the call of `wp.tid` before it is compiled.
"""

import ast
from functools import cache
from types import FunctionType

import warp as wp

from wsim.kernels.math.marks import owns_points

MODULE = "wsim_fused_bodies"             # nothing of it is compiled by itself
THREAD = "thread_"


class _Thread(ast.NodeTransformer):
    """`wp.tid()` becomes the first argument."""

    def visit_Call(self, node: ast.Call) -> ast.AST:          # noqa: N802
        self.generic_visit(node)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "tid":
            return ast.copy_location(ast.Name(THREAD, ast.Load()), node)
        return node


@cache
def kernel_body(kernel: wp.Kernel, number: int) -> wp.Function:
    """The function of a kernel, inlined where it is called; number: of those that one kernel calls."""
    f = kernel.func
    copy = FunctionType(f.__code__, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
    copy.__annotations__ = {THREAD: int, **kernel.adj.arg_types}
    copy.__module__, copy.__qualname__ = f.__module__, f.__qualname__
    return wp.Function(copy, f"{kernel.key}_body_{number}", "", module=wp.get_module(MODULE), code_transformers=[_Thread()],
                       inline_hint="forceinline")


@cache
def copy_array_kernel(dtype) -> wp.Kernel:
    """Kernel: entries of an array go into another, from `first` on to `into` on. It runs inside of others only."""

    @owns_points
    @wp.kernel(module=MODULE, enable_backward=False)
    def copy_own(source: wp.array(dtype=dtype), into: int, first: int, array_out: wp.array(dtype=dtype)):
        i = wp.tid()
        array_out[into + i] = source[first + i]

    return copy_own


@cache
def zero_array_kernel(dtype) -> wp.Kernel:
    """Kernel: entries of an array become zero. It runs inside of others only."""

    @wp.kernel(module=MODULE, enable_backward=False)
    def zero_entries(array_out: wp.array(dtype=dtype)):
        i = wp.tid()
        array_out[i] = dtype(0)

    return zero_entries
