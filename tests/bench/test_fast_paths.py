"""Rows of the registry of fast paths name code, switches and tests that are there; native code has a row or a reason."""

import importlib
import re
from pathlib import Path

import pytest

from wsim.bench.fast_paths import LEAST, NATIVE, ROWS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("row", ROWS, ids=lambda r: f"{r.device}: {r.name}")
def test_a_row_names_what_is_there_and_gains_enough(row):
    assert row.gain is None or row.gain >= LEAST
    assert row.gain is not None or row.device == "cuda" and row.measured == "not yet"
    module, _, path = row.off[0].partition(":")
    owner = importlib.import_module(module)
    for part in path.split("."):
        owner = getattr(owner, part)
    for file in row.code:
        assert (ROOT / file).is_file(), file
    file, _, name = row.test.partition("::")
    assert not name or re.search(rf"^def {name}\(", (ROOT / file).read_text(), re.M), row.test
    assert (ROOT / file).is_file()


def test_every_file_of_native_code_has_a_row_or_a_reason():
    found = {str(f.relative_to(ROOT)) for f in (ROOT / "kernels").rglob("*.py") if "func_native" in f.read_text()}
    rows = {file for row in ROWS for file in row.code}
    assert found - rows - NATIVE.keys() == set() and NATIVE.keys() - found == set() and not rows & NATIVE.keys()


def test_the_page_has_the_table():
    from tools.bench.choice.fast_paths import table
    assert table() in (ROOT / "tools" / "results" / "fast_paths.md").read_text()
