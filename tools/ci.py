"""What a newcomer does, then the checks: the README's commands in a fresh copy and environment.

The first command, which installs and runs a scene, has an empty kernel cache, as a newcomer has. The tests keep theirs from run
to run (keys are hashes of what is compiled): in WSIM_CI_KERNELS, or in ~/.cache/wsim-ci; an empty value keeps nothing. One
that has grown beyond LARGE is emptied first. mypy keeps there what it knows of each file, by hashes too. Python keeps bytecode
in the copy, whatever the environment says: without, every process of the tests would read all sources anew. pip leaves it to
Python to compile what is imported: half of pip's time was to compile all of Warp, NumPy and USD.

Tests that were skipped run again with the extras that they need, and those alone: by pytest's report of the first run. Steps
of one process run beside each other (CHECKS): lint while the extras are installed, types while those tests run.

The first command must leave nothing that git would add. With the word `full` (`.ci/full`), tests marked slow run, and then
tests of each package's use with the lowest versions that pyproject.toml allows, also of Python; WSIM_CI_LOWEST=1 asks for the
latter without the former.

The commands are taken from the `sh` blocks of the README's section Install, so that they cannot drift apart; its quick starts
are run by tests/tools/test_readme.py. Prints each step with its time, and at the end pytest's closing line; exits with 1 if
anything failed. Needs python3 (3.11 to 3.14) and a package index.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as xml
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).resolve().parents[1]
LITTER = shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.egg-info", ".*_cache", "build", "dist")
REPORT, AGAIN = "../report.xml", "../again.txt"         # of the tests of the second command; those of them that the extras run
OTHER = re.compile("CUDA|GPU")                          # in reasons to skip that no extra mends
CHECKS = {".venv/bin/pip install -q --no-compile -e '.[dev,view,plot,picture]'": (".venv/bin/python tools/lint.py",),
          f".venv/bin/pytest -q @{AGAIN}": (".venv/bin/ruff check .", ".venv/bin/mypy")}     # a step, and what runs meanwhile
SLOW = ".venv/bin/pytest -q -m slow"
PINS = "../lowest.txt"                                  # constraints of the lowest versions
EXTRAS = "test", "view", "plot", "picture"              # that are tried by them
LOWEST = (f".lowest/bin/pip install -q --no-compile -c {PINS} -e '.[{','.join(EXTRAS)}]'",
          ".lowest/bin/pytest -q tests/usd/test_usd.py tests/usd/result/test_record.py tests/cli/test_run.py tests/show "
          "tests/geometry tests/simulation/test_simulation.py tests/gradient/test_gradients.py "
          "tests/physics/fluid/test_result.py tests/sweep/test_sweep.py tests/fitting/test_fit.py")
BOUND = re.compile(r"([\w.-]+)(?:\[[\w,]+\])?>=([\w.]+)(?:,<[\w.]+)?")
LARGE = 4e9                                     # [bytes] of kernels of the tests; one commit's are 0.5e9
CLOSING = re.compile(r"\b(passed|failed|errors?)\b.* in [\d.]+s")
MADE = ("hanging.usdc", "hanging.png")          # what the first command must leave behind


def commands() -> list[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## Install\n")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S)
    if len(blocks) != 2:
        sys.exit("README.md, Install, must hold two sh blocks: install and run, install and test")
    return [block.strip() for block in blocks]


def copy(to: Path) -> None:
    """The files that git knows or would add; without git, all but the litter."""
    listed = subprocess.run(["git", "ls-files", "-z", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True)
    if listed.returncode:
        shutil.copytree(ROOT, to, symlinks=True, ignore=LITTER)
        return
    for name in listed.stdout.decode().split("\0"):
        source, target = ROOT / name, to / name
        if name and (source.is_symlink() or source.is_file()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target, follow_symlinks=False)


def untracked(folder: Path) -> set[str]:
    """What git would add, were this folder its working tree; nothing without git."""
    listed = subprocess.run(["git", f"--work-tree={folder}", "ls-files", "-o", "--exclude-standard"], cwd=ROOT,
                            capture_output=True, text=True)
    return set(listed.stdout.splitlines())


def lowest(project: dict) -> list[str]:
    """Constraints of pip: the lowest version that a project allows of each package that it and EXTRAS need. Raises SystemExit
    where a package has no lower bound."""
    pins = []
    for need in (*project["dependencies"], *(need for extra in EXTRAS for need in project["optional-dependencies"][extra])):
        found = BOUND.fullmatch(need)
        if not found:
            sys.exit(f"pyproject.toml: {need!r} has no lower bound, or one of another form; write it as name>=1.2")
        pins.append(f"{found[1]}=={found[2]}")
    return pins


def oldest() -> tuple[str, ...]:
    """Commands that try the lowest versions, and their constraints where those look for them; none without that Python."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    python = "python" + BOUND.match("python" + project["requires-python"])[2]
    if not shutil.which(python):
        print(f"lowest versions are not tried: there is no {python}", flush=True)
        return ()
    pins = " ".join(f"'{pin}'" for pin in lowest(project))
    return f"{python} -m venv .lowest && printf '%s\\n' {pins} >{PINS}", *LOWEST


def further() -> tuple[str, ...]:
    """Commands after the checks, as the words of this command and the environment ask."""
    full = "full" in sys.argv[1:]
    return (SLOW,) * full + (oldest() if full or os.environ.get("WSIM_CI_LOWEST", "0") not in ("", "0") else ())


def kept() -> Path | None:
    """Where kernels of the tests are kept; None where they are not, or cannot be."""
    named = os.environ.get("WSIM_CI_KERNELS")
    if named == "":
        return None
    place = Path(named) if named else Path("~/.cache/wsim-ci").expanduser()
    try:
        place.mkdir(parents=True, exist_ok=True)
        if sum(f.stat().st_size for f in place.rglob("*") if f.is_file()) > LARGE:
            shutil.rmtree(place)
            place.mkdir()
        (place / "used").touch()
    except OSError as error:
        print(f"kernels of the tests are not kept: {error}", flush=True)
        return None
    return place


def skipped(report: Path) -> list[str]:
    """Tests that were skipped, by pytest's JUnit report, as pytest takes them; files, where one was skipped whole."""
    names = []
    for case in xml.parse(report).iter("testcase") if report.is_file() else ():
        skip = case.find("skipped")
        if skip is None or skip.get("type") == "pytest.xfail" or OTHER.search(f"{skip.get('message')} {skip.text}"):
            continue
        file, name = case.get("classname"), case.get("name")
        names.append(f"{file.replace('.', '/')}.py::{name}" if file else f"{name.replace('.', '/')}.py")
    return names


def step(command: str, folder: Path, environment: dict[str, str], say: Callable[[str], None]) -> tuple[bool, list[str]]:
    """Runs a command, passing on what it prints: (success, its lines)."""
    say(f"\n$ {command}\n")
    began, lines = perf_counter(), []
    with subprocess.Popen(["bash", "-euo", "pipefail", "-c", command], cwd=folder, env=environment, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, errors="replace") as process:
        for line in process.stdout:
            lines.append(line.rstrip())
            say(line)
    say(f"-- {'ok' if process.returncode == 0 else f'FAILED ({process.returncode})'}, {perf_counter() - began:.1f} s\n")
    return process.returncode == 0, lines


def show(text: str) -> None:
    print(text, end="", flush=True)


def run_steps(command: str, meanwhile: tuple[str, ...], folder: Path,
              environment: dict[str, str]) -> tuple[list[str], list[str]]:
    """Runs a command, and others one after another meanwhile, whose output comes behind: (those that failed, lines of the
    first)."""
    held: list[str] = []

    def run_others() -> list[str]:
        return [other for other in meanwhile if not step(other, folder, environment, held.append)[0]]
    with ThreadPoolExecutor(1) as pool:
        others = pool.submit(run_others)
        good, lines = step(command, folder, environment, show)
        failed = [command] * (not good) + others.result()
    show("".join(held))
    return failed, lines


def main() -> int:
    failed, closing = [], []
    with tempfile.TemporaryDirectory(prefix="wsim-ci-") as place:
        folder = Path(place, "wsim")
        copy(folder)
        before = untracked(folder)
        strange = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE")
        environment = {k: v for k, v in os.environ.items() if k not in strange}
        environment |= {"WARP_CACHE_PATH": str(Path(place, "kernels")), "PIP_COMPILE": "0"}
        steps = dict.fromkeys(commands(), ()) | CHECKS | dict.fromkeys(further(), ())
        for number, (command, meanwhile) in enumerate(steps.items()):
            if number == 1 and (cache := kept()):
                print(f"kernels are kept: {sum(1 for _ in cache.rglob('*.meta'))} modules were there", flush=True)
                environment |= {"WARP_CACHE_PATH": str(cache), "MYPY_CACHE_DIR": str(cache / "mypy")}
            reporting = {"PYTEST_ADDOPTS": f"--junitxml={REPORT}"} if number == 1 else {}
            bad, lines = run_steps(command, meanwhile, folder, environment | reporting)
            failed += bad
            if number == 0 and (left := untracked(folder) - before):
                failed.append("the first command leaves what git would add: " + " ".join(sorted(left)[:5]))
            if number == 1:
                again = skipped(folder / REPORT)
                if again:                       # else pytest finds no list and fails, where an empty one would run all
                    (folder / AGAIN).write_text("\n".join(again), encoding="utf-8")
                print(f"skipped, and run again with the extras: {len(again)}", flush=True)
            closing += [x for x in lines if CLOSING.search(x)][-1:]
        missing = [name for name in MADE if not (folder / name).is_file() or not (folder / name).stat().st_size]
        failed += [f"the first command left no {name}" for name in missing]
    print("\n" + "\n".join(closing or ["no closing line of pytest"]))
    print("all steps passed" if not failed else "FAILED: " + "; ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
