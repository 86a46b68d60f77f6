"""A wheel holds all of the product, kernels and scenes inside wsim, and nothing beside it."""

import shutil
import subprocess
import sys
import zipfile

import pytest

from tools.lint import ROOT

PARTS = ("pyproject.toml", "README.md", "LICENSE", "wsim", "kernels", "scenes")


@pytest.fixture(scope="module")
def names(tmp_path_factory) -> set[str]:
    """Files in a wheel that is built from a copy of the sources, as `pip install .` builds it."""
    pytest.importorskip("pip")
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("wheel")
    for part in PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, tree / part, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / part, tree / part)
    done = subprocess.run([sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(out), str(tree)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(next(out.glob("*.whl"))) as wheel:
        return set(wheel.namelist())


def under(folder: str) -> set[str]:
    """Files of a folder at the root, by their paths in it."""
    return {str(p.relative_to(ROOT / folder)) for p in (ROOT / folder).rglob("*")
            if p.is_file() and "__pycache__" not in p.parts and p.name != ".gitkeep"}


@pytest.mark.parametrize("folder", ["kernels", "scenes"])
def test_root_folders_are_inside_the_package(names, folder):
    wanted = {name for name in under(folder) if not name.startswith("pictures/")}      # those are the documentation's
    assert {f"wsim/{folder}/{name}" for name in wanted} <= names


def test_schemas_are_inside(names):
    assert {f"wsim/usd/schema/{name}" for name in under("wsim/usd/schema")} <= names
    assert "wsim/usd/schema/plugInfo.json" in names


def test_nothing_else_is_installed(names):
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"wsim"}


def test_a_type_checker_is_told_that_it_is_typed(names):
    assert "wsim/py.typed" in names


def test_an_editable_clone_is_imported_from_its_parent_folder(tmp_path):
    """There the clone itself, a folder named wsim without __init__.py, comes first."""
    pytest.importorskip("pip")
    clone, prefix = tmp_path / "wsim", tmp_path / "prefix"
    clone.mkdir()
    for part in ("pyproject.toml", "README.md", "LICENSE", "wsim"):
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, clone / part, ignore=shutil.ignore_patterns("__pycache__", "kernels", "scenes"))
        else:
            shutil.copy(ROOT / part, clone / part)
    done = subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--ignore-installed", "--prefix",
                           str(prefix), "-e", str(clone)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    site = next(prefix.rglob("site-packages"))
    code = (f"import sys, site; sys.path += {[p for p in sys.path if 'site-packages' in p]!r}; site.addsitedir({str(site)!r}); "
            "import wsim; print(wsim.Scene().up, wsim.__file__)")
    done = subprocess.run([sys.executable, "-S", "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.split() == ["Y", str(clone / "wsim" / "__init__.py")], done.stderr
