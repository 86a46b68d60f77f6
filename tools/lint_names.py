"""Two statistics of names in wsim/ and kernels/, and a rule that lets neither get worse.

    once       share of definitions (functions, methods, classes, nested ones too) whose name no other definition has.
               Somebody who searches the tree for such a name finds one place. Definitions whose name a base class or a role of
               files demands are left out, see `inherited_names` and ROLE_NAMES
    one word   share of functions and methods without an underscore inside their name

Dunders are left out of both. ONCE and ONE_WORD are the shares that were reached. Write better ones when names have improved.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ONCE, ONE_WORD = 0.78, 0.29          # at least, at most
# what files of a method's folder must offer under these names: see wsim/scene/methods.py
ROLES = ("objects", "check", "initial", "usd", "method", "show")
ROLE_NAMES = ("check", "load", "author", "author_at", "within", "build", "signature", "triangles")
# hooks of `wsim.model.stage.Method` under names that they no longer have: a method that still uses one is never called there
OLD_HOOKS = {"enter": "choose_frame_form", "meet": "connect_ports", "reserve": "lengthen_lists", "retry": "find_remedies",
             "notes": "frame_warnings", "kept": "kept_distances", "restored": "prepare_restart", "resumed": "resume_run",
             "set": "set_value"}


@dataclass(frozen=True)
class Definition:
    """A function or class: its name, whether it is a function, and whether a protocol demands the name."""

    name: str
    function: bool
    demanded: bool


def named_definitions(trees: dict[Path, ast.Module]) -> list[Definition]:
    """Every definition of the product without dunders."""
    product = {path: tree for path, tree in trees.items() if path.parts[0] in ("wsim", "kernels")}
    methods, bases = class_tables(product)
    found: list[Definition] = []

    def walk_definitions(node: ast.AST, path: Path, owner: ast.ClassDef | None, top: bool) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                if not (child.name.startswith("__") and child.name.endswith("__")):
                    demanded = (child.name in inherited_names(owner.name, methods, bases) if owner is not None else
                                top and path.stem in ROLES and child.name in ROLE_NAMES)
                    found.append(Definition(child.name, not isinstance(child, ast.ClassDef), demanded))
                walk_definitions(child, path, child if isinstance(child, ast.ClassDef) else None, False)
            else:
                walk_definitions(child, path, owner, top)

    for path, tree in product.items():
        walk_definitions(tree, path, None, True)
    return found


def class_tables(trees: dict[Path, ast.Module]) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Methods and bases of classes, by the class's name."""
    methods: dict[str, set[str]] = {}
    bases: dict[str, set[str]] = {}
    for tree in trees.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                methods.setdefault(node.name, set()).update(n.name for n in node.body if isinstance(n, ast.FunctionDef))
                bases.setdefault(node.name, set()).update(ast.unparse(b).split("[")[0].split(".")[-1] for b in node.bases)
    return methods, bases


def inherited_names(name: str, methods: dict[str, set[str]], bases: dict[str, set[str]]) -> set[str]:
    """Methods that the bases of a class have in this tree: a method of the class does not choose such a name itself. A row
    protocol (`wsim.model.stage.Method`, terms of Newton's method) is such a base: its hooks count where the base defines them,
    and not again in each row. Classes that share names without a base do not count as a protocol."""
    found: set[str] = set()
    seen, todo = {name}, list(bases.get(name, ()))
    while todo:
        base = todo.pop()
        if base not in seen:
            seen.add(base)
            found |= methods.get(base, set())
            todo += bases.get(base, ())
    return found


def name_shares(trees: dict[Path, ast.Module]) -> tuple[float, float]:
    """Share of names that occur once, and of functions with one word."""
    found = named_definitions(trees)
    chosen = [d.name for d in found if not d.demanded]
    count = Counter(chosen)
    functions = [d.name for d in found if d.function]
    return (sum(n == 1 for n in count.values()) / max(len(chosen), 1),
            sum("_" not in name.strip("_") for name in functions) / max(len(functions), 1))


def describe_names(trees: dict[Path, ast.Module]) -> str:
    once, one_word = name_shares(trees)
    return f"{100 * once:.1f} % of names occur once, {100 * one_word:.1f} % of functions have a name of one word"


def worse_names(trees: dict[Path, ast.Module]) -> Iterator[str]:
    """Complaints where a share is worse than the one that was reached."""
    yield from old_hooks(trees)
    once, one_word = name_shares(trees)
    if once < ONCE:
        yield (f"tools/lint_names.py:1: {100 * once:.2f} % of names occur once, at least {100 * ONCE:.2f}: give new functions "
               "and classes names that nothing else in wsim/ and kernels/ has")
    if one_word > ONE_WORD:
        yield (f"tools/lint_names.py:1: {100 * one_word:.2f} % of functions have a name of one word, at most "
               f"{100 * ONE_WORD:.2f}: name new functions by a verb and its object")


def old_hooks(trees: dict[Path, ast.Module]) -> Iterator[str]:
    """Complaints where a method of a plan defines a hook under an old name."""
    methods, bases = class_tables(trees)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and "find_remedies" in inherited_names(node.name, methods, bases):
                yield from (f"{path}:{inner.lineno}: the hook `{inner.name}` is `{OLD_HOOKS[inner.name]}` now"
                            for inner in node.body if isinstance(inner, ast.FunctionDef) and inner.name in OLD_HOOKS)


def constants_assigned_twice(files: dict[Path, ast.Module]) -> Iterator[str]:
    """Constants of a module that a second assignment replaces for all functions of the file, those above it too."""
    for path, tree in files.items():
        seen: dict[str, int] = {}
        for statement in tree.body:
            targets = (statement.targets if isinstance(statement, ast.Assign) else
                       [statement.target] if isinstance(statement, ast.AnnAssign) else [])
            for name in (node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)):
                if name in seen and name != "_":
                    yield f"{path}:{statement.lineno}: {name} has a value since line {seen[name]}: rename one of the two"
                seen[name] = statement.lineno
