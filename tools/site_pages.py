"""Pages that only the site has, made by mkdocs (mkdocs.yml): the gallery of example scenes, and the reference of what
`import wsim` gives, from its docstrings."""

import re
from inspect import getdoc, isclass, isfunction, ismodule, signature
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "scenes/pictures"


def gallery() -> str:
    """The table of scenes and the pictures of scenes/README.md."""
    text = (ROOT / "scenes/README.md").read_text(encoding="utf-8")
    tables = re.findall(r"(?:^\|.*\n)+", text, re.M)
    return "# Gallery\n\nRun one with `wsim examples NAME`.\n\n" + "\n".join(tables[:2])


def reference() -> str:
    """Arguments and docstring of each public name, and of the methods of classes."""
    import wsim
    return "# Python\n\nUnits are SI, angles are in radians. `help(wsim.Cloth)` prints the same.\n\n" + "\n".join(
        entry(f"wsim.{name}", getattr(wsim, name), "##") for name in sorted(wsim.__all__) if not ismodule(getattr(wsim, name)))


def entry(name: str, thing, level: str) -> str:
    """A heading, and what `help` says, as it is aligned there."""
    own = vars(thing) if isclass(thing) else {}
    methods = [entry(f"{name.rpartition('.')[2]}.{each}", method, level + "#") for each, method in own.items()
               if isfunction(method) and not each.startswith("_") and getdoc(method)]
    names = ", ".join(each for each in signature(thing).parameters if each != "self")
    said = f"{name.rpartition('.')[2]}({names})\n\n{getdoc(thing) or ''}"
    return f"{level} {name}\n\n```text\n{said}\n```\n\n" + "\n".join(methods)


def on_files(files, config):
    """Called by mkdocs."""
    files.append(File.generated(config, "index.html", content='<meta http-equiv="refresh" content="0; url=start/">'))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    files.append(File.generated(config, "api.md", content=reference()))
    for picture in PICTURES.iterdir():
        files.append(File.generated(config, f"pictures/{picture.name}", abs_src_path=str(picture)))
    return files
