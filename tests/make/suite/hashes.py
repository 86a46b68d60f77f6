"""Hashes of functions that many modules of the tests have in common are looked up, while their names mean the same.

Warp names a module by the hash of all functions that its kernels call, and for each module anew looks at every name of their
sources: a third of the time of tests of rigid bodies and trees. Here a function keeps its hash, with what each of its names
meant, what its `wp.static` expressions gave, and the hashes of the functions that it calls. Where any of these is another by
now, Warp hashes it anew. A name of a module that is not Warp's is not followed: such a function is hashed each time.
"""

import ast
from types import ModuleType
from typing import Any

from warp._src.context import Function, ModuleHasher

HASH = ModuleHasher.hash_adjoint
NOTHING = object()


def meanings(adj) -> tuple[dict, list[tuple[str, Any]]] | None:
    """(cells of the closure, what each name that is not local means now); None: a name is that of a module."""
    function, local = adj.func, adj.assigned_name_ids()
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    names = {node.id for node in adj.reference_nodes() if isinstance(node, ast.Name)} - set(local)
    found = [(name, meaning(adj, cells, name)) for name in sorted(names)]
    if any(isinstance(value, ModuleType) and value.__name__.partition(".")[0] != "warp" for _, value in found):
        return None
    return cells, found


def meaning(adj, cells: dict, name: str) -> Any:
    try:
        return cells[name].cell_contents if name in cells else adj.func.__globals__.get(name, NOTHING)
    except ValueError:                          # a cell that has no value yet
        return NOTHING


def state(adj) -> tuple:
    """What else a hash is of."""
    return (adj.tree, adj.source, getattr(adj, "callable_arg_values", None), tuple(adj.arg_types.items()),
            tuple(adj.resolved_static_expressions.items()), tuple(adj.deferred_static_expressions))


def hash_of(hasher, function) -> bytes:
    return hasher.hash_builtin_function(function) if function.is_builtin() else hasher.hash_function(function)


def holds(hasher, adj, known: tuple) -> bool:
    """Whether a hash that was kept is that of now."""
    (cells, names), was, called = known[:3]
    return (was == state(adj) and all(meaning(adj, cells, name) is value for name, value in names)
            and all(f not in hasher.functions_in_progress and hash_of(hasher, f) == digest for f, digest in called))


def hash_adjoint(hasher, adj) -> bytes:
    """Instead of Warp's `ModuleHasher.hash_adjoint`."""
    known = getattr(adj, "kept_hash", None)
    if known is not None and holds(hasher, adj, known):
        return known[3]
    names, around, references = meanings(adj), set(hasher.functions_in_progress), adj.get_references()
    adj.get_references = lambda: references        # Warp asks once more
    try:
        digest = HASH(hasher, adj)
    finally:
        adj.__dict__.pop("get_references", None)
    statics = [*adj.resolved_static_expressions.values(), *(value for _, value in adj.deferred_static_expressions)]
    called = [] if names is None else [*references[2], *(each for each in statics if isinstance(each, Function))]
    if names is not None and around.isdisjoint(called):
        adj.kept_hash = names, state(adj), [(f, hash_of(hasher, f)) for f in called], digest
    return digest
