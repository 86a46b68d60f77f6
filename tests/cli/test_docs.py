"""The documentation (wsim/docs): its snippets run, its links lead somewhere, its sentences are short. READMEs of
folders are short too."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import pytest
from pxr import Sdf

from tools.lint import ROOT
from wsim import cli
from wsim.cli.docs import documentation_pages
from wsim.kernels.soft import material
from wsim.physics.cloth import kind
from wsim.scene import integrator, methods, solid, solids

BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.M | re.S)
FILE = re.compile(r"# ([\w/]+\.py)\n")             # the first line of a snippet that is to be saved
PAGES = documentation_pages()
READMES = [path for folder in ("wsim", "kernels") for path in sorted((ROOT / folder).rglob("README.md"))
           if path.resolve() == path]                                     # of folders, for who changes the code; not of links
LISTS = [ROOT / "scenes/README.md", ROOT / "scenes/examples/README.md", ROOT / "tools/README.md",
         *sorted((ROOT / "tools/results").glob("*.md"))]                       # tests/tools/test_readme.py holds their length
EXTRAS = "torch", "jax"
TABLES = (methods.METHODS, solids.SOLIDS, solid.MODELS, integrator.TABLE, kind.TABLE, material.TABLE)


def text(name: str) -> str:
    return PAGES[name].read_text(encoding="utf-8")


def sentences(page: str) -> list[list[str]]:
    """Words of each sentence of the prose; a cell of a table and a row of a list are sentences of their own."""
    prose = BLOCK.sub("", page)
    prose = re.sub(r"^(#.*|\|[-|]+\|)$", "", prose, flags=re.M)
    prose = re.sub(r"`[^`]*`", "code", re.sub(r"\]\([^)]*\)", "]", prose))
    parts = re.split(r"(?<=[.:;!?])\s+(?=[A-Z\[`*c])|\n\s*\n|\||\n(?=[-\d])", prose)
    return [words for part in parts if (words := re.findall(r"[\w'-]+", part))]


@pytest.fixture
def tables():
    """Tables of rows, which are as before when the test ends."""
    before = [table.copy() for table in TABLES]
    yield
    for table, rows in zip(TABLES, before, strict=True):
        table.clear()
        (table.update if isinstance(table, dict) else table.extend)(rows)


@pytest.mark.parametrize("name", PAGES)
def test_snippets_run_one_after_the_other(name, tmp_path, monkeypatch, tables):
    """From a folder that has nothing but `scenes`."""
    (tmp_path / "scenes").symlink_to(ROOT / "scenes", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    names: dict = {}
    missing = {extra for extra in EXTRAS if not find_spec(extra)}
    left = set()
    for language, code in BLOCK.findall(text(name)):
        if needs := {extra for extra in missing if f"import {extra}" in code}:
            left |= needs
            continue
        if (file := FILE.match(code)) and language == "python":
            (tmp_path / file[1]).parent.mkdir(exist_ok=True)
            (tmp_path / file[1]).write_text(code, encoding="utf-8")
        elif language == "python":
            exec(compile(code, PAGES[name].name, "exec"), names)
        elif language == "usda":
            assert Sdf.Layer.CreateAnonymous().ImportFromString(f"#usda 1.0\n{code}")
        elif language != "text":
            for line in code.strip().splitlines():
                assert line.startswith("wsim ") and cli.main(shlex.split(line)[1:]) == 0, line
    if left:
        pytest.skip(f"the others ran; could not import {', '.join(sorted(left))}")


@pytest.mark.parametrize("path", [*PAGES.values(), *READMES, *LISTS], ids=lambda path: str(path.relative_to(ROOT)))
def test_sentences_are_short(path):
    """At most 20 words in the median, and 40 words."""
    found = sentences(path.read_text(encoding="utf-8"))
    counts = [len(words) for words in found]
    assert median(counts) <= 20
    assert max(counts) <= 40, max(found, key=len)


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_readmes_of_folders_are_short(path: Path):
    """At most 300 words. Guides stand in wsim/docs, theory in docstrings, figures in tools/results."""
    assert len(path.read_text(encoding="utf-8").split()) <= 300


@pytest.mark.parametrize("path", [*PAGES.values(), *READMES], ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_are_named_are_there(path: Path):
    """Paths from the root of the repository; of READMEs also what the first column of a table names."""
    page = path.read_text(encoding="utf-8")
    named = [ROOT / name for name in re.findall(r"`((?:wsim|kernels|tests|tools|scenes)/[\w./]+)`", page)]
    if path in READMES:
        cells = re.findall(r"^\|([^|]*)\|", page, re.M)
        named += [path.parent / name for cell in cells for name in re.findall(r"`([\w.]+)`", cell)]
    assert [str(each) for each in named if not each.exists()] == []


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_to_pages(name):
    links = re.findall(r"\]\((?!http)([^)#]+)\)", text(name))
    assert all((PAGES[name].parent / link).exists() for link in links)


def test_a_page_is_printed_by_its_name(capsys):
    assert cli.main(["docs"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[:len(PAGES)]] == list(PAGES)
    assert cli.main(["docs", "rigid-bodies"]) == 0 and capsys.readouterr().out == text("rigid_bodies")
    assert cli.main(["docs", "clot"]) == 1 and "did you mean cloth?" in capsys.readouterr().err


@pytest.mark.parametrize("word, page", [("sand", "material_points"), ("water", "liquids"), ("joints", "rigid_bodies"),
                                        ("rope", "hair"), ("muscle", "recipes"), ("mpm", "material_points")])
def test_a_word_leads_to_the_page_that_is_about_it(word, page, capsys):
    assert cli.main(["docs", word]) == 1 and page in capsys.readouterr().err.partition("did you mean")[2]


def test_a_word_of_no_page_gets_the_list_of_pages(capsys):
    assert cli.main(["docs", "xylophone"]) == 1 and "there are: start, concepts" in capsys.readouterr().err
