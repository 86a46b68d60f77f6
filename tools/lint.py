"""House rules that no ready-made linter knows, held by reading the sources (ast). Run: python tools/lint.py

    layers      who may import whom; every module of wsim has a place in the table below
    cycles      no module imports itself by way of others
    size        files, functions, arguments
    kernels     names, which are unique
    words       no place of one machine, nothing unfinished

Each rule is a function from sources to complaints, `file:line: what is wrong`; tests/test_layers.py shows each of them
catch a planted fault.
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

TEXTS = (".md", ".toml", ".usda", ".json", ".csv", ".txt", "")
ROOT = Path(__file__).resolve().parent.parent

# From the bottom up; a module imports from its own row and the rows below it. A name stands for a module of wsim and
# for everything in a folder of that name.
LAYERS = (
    ("curve", "fabric", "bulk", "bodies", "latest", "polygon", "scene", "solids", "topology", "normals", "shapes",
     "color", "check", "integrator", "stability", "apart", "check_object", "check_soft", "check_tie", "tetra", "skin",
     "locality", "kempe", "camera", "look", "png", "gif", "progress", "report", "atomic", "lock", "counts", "inventory",
     "arguments", "interrupt", "check_varying", "masses", "check_pins", "check_loads", "nodal", "check_contact",
     "barrier", "chord", "signed", "bending"),
    ("kernels",),
    ("stage", "state", "order", "ties", "middles", "model", "linear", "multigrid", "cluster", "abreast", "slots", "march",
     "tape", "kernel_cache", "curvature"),
    ("contact",),
    ("cloth", "soft", "reshape"),
    ("frequency", "choice", "sweep_strain", "reasons", "covered", "cost"),
    ("elastic", "elements", "fem", "plastic", "pressure", "force_adjoint", "gather", "watch", "touching_adjoint", "gcr",
     "line_search", "active_set", "momentum", "newton_curvature"),
    ("adjoint", "xpbd_adjoint", "points_adjoint"),
    ("points", "explicit", "implicit", "aero", "xpbd", "muscles", "loads", "rigid", "fluid", "pose"),
    ("plan",),
    ("measure", "broken", "mend", "exceeded", "stress", "reaction", "reaction_adjoint", "reaction_law", "reaction_xpbd",
     "simulation", "parameters", "sensitivity", "growth", "reshape_adjoint", "element_gradient", "seeds", "segments",
     "frames", "recording", "live", "varying", "limits"),
    ("input", "rest_inputs", "controls", "contact_inputs", "inputs", "arrays", "differences", "products", "trust",
     "layer", "layer_jax"),
    ("usd", "provenance", "crate", "dependencies", "partial", "sublayer", "overs", "restart", "recorder", "fitting",
     "drawn", "visible", "view", "picture"),
    ("cli", "bench", "new", "commands", "run", "__main__", "__init__"),
)
METHODS = {"points", "explicit", "implicit", "aero", "xpbd", "muscles", "loads", "rigid", "fluid", "pose"}   # never each other
READS_USD = {"usd", "provenance", "crate", "dependencies", "partial", "sublayer", "overs", "restart", "recorder", "drawn",
             "visible"}
WITHOUT_WARP = {*LAYERS[0], *READS_USD, "cli", "__init__", "__main__"}
ONLY = {"rerun": {"view"}, "pxr": {*READS_USD, "view", "picture"}, "matplotlib": {"bench"}, "torch": {"layer"},
        "jax": {"layer_jax"}}   # who may import these packages

FILE_LINES, TEST_LINES, FUNCTION_LINES, ARGUMENTS = 300, 400, 45, 8
WORDS = re.compile(r"(?<![\w.:/$}<])/(?:tmp|root|home|opt|mnt|srv)/[\w.-]+|(?<!\w)share[d]/"
                   r"|\bTO[D]O\b|\bFIX[M]E\b|\bXX[X]\b|NotImplemented[E]rror|assert Tru[e]\b")


def name_of(path: Path) -> str:
    """wsim/usd/load.py -> usd.load; kernels/xpbd.py -> kernels.xpbd; wsim/__init__.py -> __init__."""
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


def product(files: dict[Path, str]) -> dict[str, tuple[Path, ast.Module]]:
    """Modules of the product by name, parsed."""
    return {name_of(path): (path, ast.parse(text)) for path, text in files.items()
            if path.parts[0] in ("wsim", "kernels")}


def imports(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of every import, also inside functions, not for type checkers; `from a import b` is a.b."""
    skipped = {id(inner) for node in ast.walk(tree)
               if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.lineno, f"{'.' * node.level}{node.module or ''}.{alias.name}") for alias in node.names)


def target(dotted: str, modules) -> str | None:
    """The module of the product that a dotted name imports, or None."""
    if dotted.split(".")[0] != "wsim" or dotted == "wsim.__version__":
        return None
    name = dotted.removeprefix("wsim").removeprefix(".")
    while name and name not in modules:
        name = name.rpartition(".")[0]
    return name or ("__init__" if dotted.count(".") < 2 else None)


def layer(name: str) -> int | None:
    return next((k for k, row in enumerate(LAYERS) if name.split(".")[0] in row), None)


def layers(files: dict[Path, str]) -> Iterator[str]:
    modules = product(files)
    for name, (path, tree) in modules.items():
        if layer(name) is None:
            yield f"{path}:1: '{name}' has no place in LAYERS (tools/lint.py): give it one"
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
    if package == "warp" and own in WITHOUT_WARP:
        return f"'{name}' works without a device: it may not import warp"
    if package in ONLY and own not in ONLY[package]:
        return f"only {', '.join(sorted(ONLY[package]))} may import {package}"
    if own == "kernels" and package not in ("warp", "wsim", *sys.stdlib_module_names):
        return f"kernels import warp and each other only, not {package}"
    other = target(dotted, modules)
    if other is None or other == name:
        return ""
    there = other.split(".")[0]
    if own == "kernels" and there != "kernels":
        return f"kernels import warp and each other only, not wsim.{other}"
    if own in METHODS and there in METHODS and own != there:
        return f"methods meet in State and contact: {name} may not import {other}"
    here, below = layer(name), layer(other)
    if here is not None and below is not None and below > here:
        return f"{name} stands below {other} and may not import it"
    return ""


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
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                continue
            if length(node) > FUNCTION_LINES:
                yield f"{path}:{node.lineno}: {node.name} has {length(node)} lines, at most {FUNCTION_LINES}"
            given = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            names = [a.arg for a in given if a.arg != "self" and not a.arg.endswith("_out")]    # outputs stand apart
            if len(names) > ARGUMENTS and not test:
                yield f"{path}:{node.lineno}: {node.name} takes {len(names)} arguments, at most {ARGUMENTS}: group them"


def kernels(files: dict[Path, str]) -> Iterator[str]:
    """Two kernels of one name: where a plan has both in its module, Warp 1.19 replays a graph on a CPU with either for both."""
    seen: dict[str, str] = {}
    for path, text in files.items():
        for node in ast.walk(ast.parse(text)) if path.parts[0] == "kernels" else ():
            if isinstance(node, ast.FunctionDef) and any("wp.kernel" in ast.unparse(d) for d in node.decorator_list):
                place = f"{path}:{node.lineno}"
                if seen.setdefault(node.name, place) != place:
                    yield f"{place}: kernel {node.name} has the name of {seen[node.name]}"


def words(files: dict[Path, str]) -> Iterator[str]:
    for path, text in files.items():
        for number, line in enumerate(text.splitlines(), 1):
            found = WORDS.search(line)
            if found:
                yield f"{path}:{number}: '{found.group()}' does not belong into the repository"


def texts(root: Path = ROOT) -> dict[Path, str]:
    """Every text that is not Python: scenes, documents, settings, figures."""
    found = {}
    for folder in (".", ".ci", "scenes", "tools/results"):
        for path in sorted((root / folder).glob("*")):
            if path.is_file() and path.suffix in TEXTS and path.name != "LICENSE":
                found[path.relative_to(root)] = path.read_text(encoding="utf-8")
    return found


def main() -> int:
    files = sources()
    complaints = [*layers(files), *cycles(files), *size(files), *kernels(files), *words(files), *words(texts())]
    print("\n".join(complaints) if complaints else f"house rules hold in {len(files)} files")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
