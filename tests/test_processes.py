"""Two processes that share a run: every test once, failures and skips as of one process, a death told."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import FEW

ROOT = Path(__file__).resolve().parent.parent
FILE = """
import os, time, pytest
def test_first():
    until = time.monotonic() + 60.0 * (%(k)d == 0 and "DEATH" in os.environ)
    while not os.path.exists("ran") and time.monotonic() < until:          # until the second process has begun
        time.sleep(0.05)
    with open("ran", "a") as file:
        file.write(f"{os.getpid()} %(k)d\\n")
@pytest.mark.skip(reason="none")
def test_is_skipped():
    pass
def test_last():
    assert "%(k)d" != "1"
    if os.environ.get("DEATH") == "%(k)d":
        os._exit(3)
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs pytest on twice as many files as two processes ask for; what it returned and printed."""
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
    (tmp_path / "conftest.py").write_text(f"import sys\nsys.path.insert(0, {str(ROOT)!r})\nfrom tests.processes import *\n")
    for k in range(2 * FEW):
        (tmp_path / f"test_{k:02}.py").write_text(FILE % {"k": k})

    def run(processes: int, *options: str, death: int = -1) -> tuple[int, str]:
        if processes == 2:
            monkeypatch.setenv("DEATH", str(death))
        done = subprocess.run([sys.executable, "-m", "pytest", f"--processes={processes}", *options], cwd=tmp_path,
                              capture_output=True, text=True)
        return done.returncode, done.stdout
    return run


@pytest.mark.parametrize("options", [("-q",), ("-v", "-p", "no:cacheprovider")])
def test_every_test_runs_once_and_what_fails_is_told(run, tmp_path, options):
    code, text = run(2, *options)
    ran = [line.split() for line in (tmp_path / "ran").read_text().splitlines()]
    assert sorted(int(k) for _, k in ran) == list(range(2 * FEW)) and len({process for process, _ in ran}) == 2
    assert code == 1 and "FAILED test_01.py::test_last" in text and '"1" != "1"' in text
    assert re.search(rf"\b1 failed, {4 * FEW - 1} passed, {2 * FEW} skipped in", text)


def test_a_second_process_that_dies_is_told(run):
    code, text = run(2, "-q", death=2 * FEW - 1)
    assert code == 1 and "the second process ended with 3" in text


def test_one_process_is_enough_where_one_is_asked_for(run, tmp_path):
    assert run(1, "-q")[0] == 1
    assert len({line.split()[0] for line in (tmp_path / "ran").read_text().splitlines()}) == 1
