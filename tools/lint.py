"""House rules that no ready-made linter knows, held by reading the sources (ast). Run: python tools/lint.py

    layers      who may import whom, by folder; every folder of wsim has a place in the table below
    entries     of a folder
    cycles      no module imports itself by way of others
    size        files, functions, arguments
    kernels     names, which are unique
    ports       methods are asked for what they offer, not by their names
    adjoints    x_adjoint.py has x.py beside it; who launches does not know of it
    words       no place of one machine, nothing unfinished; names that occur once or have one word: tools/lint_names.py

Each rule is a function from sources to complaints, `file:line: what is wrong`; tests/tools/test_lint.py shows each of them
catch a planted fault.
"""

import ast
import gc
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tools import lint_names  # noqa: E402

TEXTS = (".md", ".toml", ".usda", ".json", ".csv", ".txt", "")
ROOT = Path(__file__).resolve().parent.parent

# Folders of wsim from the bottom up: a module imports from its own folder and the folders below. A new file needs no
# place here, a new folder does.
LAYERS = ("kernels", "geometry", "scene", "usd", "model", "physics", "simulation", "gradient", "show", "fitting", "sweep",
          "bench", "cli", "__init__", "__main__")
METHODS = {"physics.motion.points", "physics.motion.explicit", "physics.motion.loads", "physics.solver.newton",
           "physics.solver.xpbd", "physics.cloth.air", "physics.cloth.nets.muscles"}                  # never each other
USD = ("physics.rigid.usd", "physics.rigid.joints.usd", "physics.rigid.joints.moving", "physics.soft.clusters.usd",
       "physics.rigid.joints.authored", "physics.rigid.joints.stacked", "physics.rigid.joints.passive",
       "physics.rigid.joints.filters.usd", "physics.rigid.joints.actuators.usd",
       "physics.rigid.joints.instances.usd", "physics.contact.collider.cloud_usd", "physics.fluid.usd",
       "physics.fluid.liquid.usd", "physics.mpm.usd", "physics.particles.usd", "physics.position_based.usd",
       "physics.animation.usd", "physics.animation.write", "physics.rods.usd", "physics.rods.follow.usd")      # of methods
WITHOUT_WARP = ("geometry", "scene", "usd", *USD, "simulation.duration", "simulation.interrupt",
                "simulation.report", "show.camera", "show.image.png", "show.smoke.read", "show.prim", "show.shading",
                "show.visible", "cli.arguments", "cli.progress")
ONLY = {"rerun": ("show.viewer", "show.rerun_log"), "pxr": ("usd", "show", *USD), "matplotlib": ("bench", "sweep.pictures"),
        "ray": ("sweep.cluster",), "pyarrow": ("sweep.folder",),
        "torch": ("gradient.rollout.torch",), "jax": ("gradient.rollout.jax",),
        "PIL": ("show.image.animation",), "imageio": ("show.image.animation",)}     # who may import these packages

ENTRIES = 15                     # files and folders in a folder
MARKERS = ("py.typed",)          # not counted, as an empty __init__.py and links: nobody reads them
FILE_LINES, TEST_LINES, FUNCTION_LINES, ARGUMENTS = 300, 400, 45, 8
WORDS = re.compile(r"(?<![\w.:/$}<])/(?:tmp|root|home|opt|mnt|srv)/[\w.-]+|(?<!\w)share[d]/"
                   r"|\bTO[D]O\b|\bFIX[M]E\b|\bXX[X]\b|NotImplemented[E]rror|assert Tru[e]\b")


def name_of(path: Path) -> str:
    """wsim/usd/load.py -> usd.load; kernels/solver/xpbd.py -> kernels.xpbd; wsim/__init__.py -> __init__."""
    parts = list(path.with_suffix("").parts)
    if parts[0] == "wsim":
        parts = parts[1:]
    if parts[-1] == "__init__" and len(parts) > 1:
        parts = parts[:-1]
    return ".".join(parts)


def sources(root: Path = ROOT, folders=("wsim", "kernels", "tests", "tools")) -> dict[Path, str]:
    """Python files by path relative to root; links are not followed, so nothing comes twice."""
    found = {}
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            relative = path.relative_to(root)
            if not any((root / parent).is_symlink() for parent in relative.parents):
                found[relative] = path.read_text(encoding="utf-8")
    return found


@cache
def parsed(text: str) -> ast.Module:
    return ast.parse(text)


@cache
def nodes(tree: ast.Module) -> tuple[ast.AST, ...]:
    """What several rules walk through: walking is what the rules cost."""
    found: list[ast.AST] = [tree]
    for node in found:                      # which grows; ast.walk asks each child for its kind once more
        for name in node._fields:
            value = getattr(node, name, None)
            if isinstance(value, list):
                found += [item for item in value if isinstance(item, ast.AST)]
            elif isinstance(value, ast.AST):
                found.append(value)
    return tuple(found)


def product(files: dict[Path, str]) -> dict[str, tuple[Path, ast.Module]]:
    """Modules of the product by name, parsed."""
    return {name_of(path): (path, parsed(text)) for path, text in files.items()
            if path.parts[0] in ("wsim", "kernels")}


@cache
def imports(tree: ast.Module) -> tuple[tuple[int, str], ...]:
    """(line, dotted name) of every import, also inside functions, not for type checkers; `from a import b` is a.b."""
    skipped = {id(inner) for node in nodes(tree)
               if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) for inner in ast.walk(node)}
    found = []
    for node in nodes(tree):
        if not isinstance(node, (ast.Import, ast.ImportFrom)) or id(node) in skipped:
            continue
        start = "" if isinstance(node, ast.Import) else f"{'.' * node.level}{node.module or ''}."
        found += [(node.lineno, start + alias.name) for alias in node.names]
    return tuple(found)


def target(dotted: str, modules) -> str | None:
    """The module of the product that a dotted name imports, or None."""
    if dotted.split(".")[0] != "wsim" or dotted == "wsim.__version__":
        return None
    name = dotted.removeprefix("wsim").removeprefix(".")
    while name and name not in modules:
        name = name.rpartition(".")[0]
    return name or ("__init__" if dotted.count(".") < 2 else None)


def within(name: str, places: Iterable[str]) -> bool:
    """Whether a module is one of `places` or stands in one."""
    return any(name == place or name.startswith(place + ".") for place in places)


def layers(files: dict[Path, str]) -> Iterator[str]:
    modules = product(files)
    for name, (path, tree) in modules.items():
        if name.split(".")[0] not in LAYERS:
            yield f"{path}:1: '{name.split('.')[0]}' has no place in LAYERS (tools/lint.py): give it one"
            continue
        for line, dotted in imports(tree):
            wrong = forbidden(name, dotted, modules)
            if wrong:
                yield f"{path}:{line}: {wrong}"


def forbidden(name: str, dotted: str, modules) -> str:
    """Why the module `name` may not import `dotted`; "" if it may."""
    own, package = name.split(".")[0], dotted.split(".")[0]
    if dotted.startswith("."):
        return f"relative import {dotted}: write wsim.…"
    if package == "kernels":
        return "import kernels as wsim.kernels: a global `kernels` would load every kernel twice"
    if package == "warp" and (within(name, WITHOUT_WARP) or name in ("cli", "__init__", "__main__")):
        return f"'{name}' works without a device: it may not import warp"
    if package in ONLY and not within(name, ONLY[package]):
        return f"only {', '.join(ONLY[package])} may import {package}"
    if own == "kernels" and package not in ("warp", "wsim", *sys.stdlib_module_names):
        return f"kernels import warp and each other only, not {package}"
    other = target(dotted, modules)
    if other is None or other == name:
        return ""
    there = other.split(".")[0]
    if own == "kernels" and there != "kernels":
        return f"kernels import warp and each other only, not wsim.{other}"
    if {name, other} <= METHODS:
        return f"methods meet in State and contact: {name} may not import {other}"
    if there in LAYERS and LAYERS.index(there) > LAYERS.index(own):
        return f"{name} stands below {other} and may not import it"
    return ""


def entries(root: Path = ROOT, folders=("wsim", "kernels", "tests", "tools")) -> Iterator[str]:
    """Folders of sources with more files and folders than one sees at a glance; figures and schemas are not counted."""
    for top in folders:
        for folder in [root / top, *sorted((root / top).rglob("*"))]:
            if not folder.is_dir() or folder.is_symlink() or folder.name == "__pycache__" or not any(folder.glob("*.py")):
                continue
            found = [entry for entry in folder.iterdir() if not _marks(entry)
                     and (entry.is_file() or any(entry.glob("*.*")))]
            if len(found) > ENTRIES:
                yield f"{folder.relative_to(root)}: {len(found)} entries, at most {ENTRIES}: make a room"


def _marks(entry: Path) -> bool:
    """True if nobody reads an entry of a folder."""
    empty = entry.name == "__init__.py" and not entry.stat().st_size
    return entry.name in (*MARKERS, "__pycache__") or entry.is_symlink() or empty


def cycles(files: dict[Path, str]) -> Iterator[str]:
    modules = product(files)
    graph = {name: {target(dotted, modules) for _, dotted in imports(tree)} - {None, name, "__init__"}
             for name, (_, tree) in modules.items() if name != "__init__"}
    done: set[str] = set()

    def walk(name: str, trail: list[str]) -> Iterator[str]:
        if name in trail:
            yield f"{modules[name][0]}:1: cycle {' -> '.join([*trail[trail.index(name):], name])}"
        elif name not in done:
            for other in sorted(graph.get(name, ())):
                yield from walk(other, [*trail, name])
            done.add(name)

    for name in sorted(graph):
        yield from walk(name, [])


def length(node: ast.AST) -> int:
    """Lines of a function without its docstring and without the functions and classes inside it."""
    inner = [n for n in ast.iter_child_nodes(node) if isinstance(n, (ast.FunctionDef, ast.ClassDef))]
    lines = node.end_lineno - node.lineno + 1 - sum(n.end_lineno - n.lineno + 1 for n in inner)  # type: ignore[attr-defined]
    first = node.body[0]                                                                         # type: ignore[attr-defined]
    if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str):
        lines -= (first.end_lineno or first.lineno) - first.lineno + 1
    return lines


def size(files: dict[Path, str]) -> Iterator[str]:
    for path, text in files.items():
        test = path.parts[0] == "tests"
        most, lines = (TEST_LINES if test else FILE_LINES), text.count("\n")
        if lines > most:
            yield f"{path}:1: {lines} lines, at most {most}: split it into two subjects"
        for node in nodes(parsed(text)):
            if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                continue
            if length(node) > FUNCTION_LINES:
                yield f"{path}:{node.lineno}: {node.name} has {length(node)} lines, at most {FUNCTION_LINES}"
            given = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            names = [a.arg for a in given if a.arg != "self"]             # of kernels too: what they write counts
            if len(names) > ARGUMENTS and not test:
                yield f"{path}:{node.lineno}: {node.name} takes {len(names)} arguments, at most {ARGUMENTS}: group them"


def kernels(files: dict[Path, str]) -> Iterator[str]:
    """Two kernels of one name: where a plan has both in its module, Warp 1.19 replays a graph on a CPU with either for both."""
    seen: dict[str, str] = {}
    for path, text in files.items():
        for node in nodes(parsed(text)) if path.parts[0] == "kernels" else ():
            if isinstance(node, ast.FunctionDef) and any("wp.kernel" in ast.unparse(d) for d in node.decorator_list):
                place = f"{path}:{node.lineno}"
                if seen.setdefault(node.name, place) != place:
                    yield f"{place}: kernel {node.name} has the name of {seen[node.name]}"


def ports(files: dict[Path, str]) -> Iterator[str]:
    """`plan.method(...)` of anything but a row of the table, and `methods[...]`: see `wsim.model.stage.Methods`."""
    for path, text in files.items():
        for node in nodes(parsed(text)) if path.parts[0] == "wsim" else ():
            said = (ast.unparse(node.args[0]) if isinstance(node, ast.Call) and node.args
                    and isinstance(node.func, ast.Attribute) and node.func.attr == "method" else
                    ast.unparse(node.slice) if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Attribute)
                    and node.value.attr == "methods" else "row.name")
            if said != "row.name":
                yield f"{path}:{node.lineno}: the method {said}: ask for its port (plan.ports)"     # type: ignore[attr-defined]


def adjoints(files: dict[Path, str]) -> Iterator[str]:
    """Adjoints without their forward file, and forward files of wsim/physics that import one: `wsim.model.vjp.beside` does."""
    end = "_adjoint.py"
    for path, text in files.items():
        if path.parts[0] != "kernels" and path.parts[:2] != ("wsim", "physics"):
            continue
        if path.name.endswith(end):
            forward = path.with_name(path.name.removesuffix(end) + ".py")
            if forward not in files:
                yield f"{path}:1: {forward.name} does not stand beside it: name it after what it is the adjoint of"
        elif path.parts[0] == "wsim":
            yield from (f"{path}:{line}: imports {dotted}: let `wsim.model.vjp.beside` do so"
                        for line, dotted in imports(parsed(text)) if "_adjoint" in dotted)


def words(files: dict[Path, str]) -> Iterator[str]:
    for path, text in files.items():
        for number, line in enumerate(text.splitlines(), 1):
            if found := WORDS.search(line):
                yield f"{path}:{number}: '{found.group()}' does not belong into the repository"


def texts(root: Path = ROOT) -> dict[Path, str]:
    """Every text that is not Python: scenes, documents, settings, figures."""
    found = {}
    for folder in (".", ".ci", "scenes", "tools/results", "tools/results/data"):
        for path in sorted((root / folder).glob("*")):
            if path.is_file() and path.suffix in TEXTS and path.name != "LICENSE":
                found[path.relative_to(root)] = path.read_text(encoding="utf-8")
    return found


def main() -> int:
    gc.disable()                            # trees hold no garbage, and looking for it takes half of the time
    files = sources()
    ours = dict(product(files).values())
    complaints = [*layers(files), *entries(), *cycles(files), *size(files), *kernels(files), *ports(files), *adjoints(files),
                  *words(files), *words(texts()), *lint_names.worse_names(ours), *lint_names.constants_assigned_twice(ours)]
    print(lint_names.describe_names(ours))
    print("\n".join(complaints) if complaints else f"house rules hold in {len(files)} files")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
