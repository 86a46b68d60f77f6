"""The README is short, its links lead somewhere, its figures were measured, and its text works: each quick start is run as it
stands, from a folder that has nothing but `scenes`."""

import json
import re
import shlex
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.make.tools.readme import FOLDERS
from tools import ci, schema_table
from tools.lint import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
PROSE = re.sub(r"^```.*?^```", "", TEXT, flags=re.M | re.S)
SHORT = ("scenes", "scenes/examples", "tools", "tools/results")
RESULTS = ROOT / "tools/results"


def section(title: str) -> str:
    return TEXT.partition(f"\n## {title}")[2].partition("\n## ")[0]


def snippets(title: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", section(title), re.M | re.S)


@pytest.fixture
def home(tmp_path, monkeypatch):
    (tmp_path / "scenes").symlink_to(ROOT / "scenes", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_it_is_short():
    assert len(TEXT.splitlines()) <= 120 and len(TEXT.split()) <= 900


def test_every_snippet_is_run_by_a_test():
    told = re.findall(r"^```(\w+)", TEXT, re.M)
    run = {"Install": 2, "For artists": 1, "For pipelines": 1, "For research": 2}
    assert {title: len(snippets(title, r"\w+")) for title in run} == run and len(told) == sum(run.values())
    assert len(ci.commands()) == 2 and "wsim run scenes/hanging_cloth.usda -o hanging.usdc" in ci.commands()[0]


@pytest.mark.parametrize("folder", SHORT)
def test_pages_of_folders_are_short(folder):
    """At most 300 words, besides commands in blocks and tables."""
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    prose = re.sub(r"^\|.*$", "", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), flags=re.M)
    assert 20 < len(prose.split()) <= 300


def linked() -> list[tuple[str, str]]:
    found = []
    pages = [ROOT / folder / "README.md" for folder in ("", *FOLDERS)]
    for page in [*pages, *(path for path in RESULTS.glob("*.md") if path not in pages)]:
        text = page.read_text(encoding="utf-8")
        folder = page.parent.relative_to(ROOT).as_posix()
        found += [(folder, link) for link in re.findall(r"\]\(([^)#]+)\)", text) if not link.startswith("http")]
    return found


@pytest.mark.parametrize("folder, link", linked())
def test_links_and_pictures_are_there(folder, link):
    assert (ROOT / folder / link).resolve().exists()


def measured(value) -> list[float]:
    """Every number of a result file."""
    if isinstance(value, dict):
        return [x for each in value.values() for x in measured(each)]
    if isinstance(value, list):
        return [x for each in value for x in measured(each)]
    return [float(value)] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def test_no_figure_stands_in_it_that_the_results_do_not_hold():
    """Times in ms or us, errors as 2.6e-7: each is a number of tools/results/data, rounded to as many digits."""
    held = [x for path in sorted((RESULTS / "data").glob("*.json")) for x in measured(json.loads(path.read_text()))]
    figures = re.findall(r"\b(\d+(?:\.\d+)?(?:e-\d+)?) (?:ms|us|m)\b", PROSE)
    assert len(figures) >= 4
    for figure in figures:
        digits, near = len(re.sub(r"e.*|\.", "", figure).lstrip("0")), abs(float(figure))
        assert any(f"{x:.{digits - 1}e}" == f"{near:.{digits - 1}e}" for x in held if 0.5 * near <= x <= 2.0 * near), figure


def test_every_page_of_measurements_is_in_the_index_and_every_file_of_rows_on_a_page():
    index = (RESULTS / "README.md").read_text(encoding="utf-8")
    pages = [path for path in RESULTS.glob("*.md") if path.name != "README.md"]
    assert [path.name for path in pages if f"({path.name})" not in index] == []
    said = " ".join(path.read_text(encoding="utf-8") for path in pages)
    assert [path.name for path in (RESULTS / "data").iterdir() if path.name not in said] == []


def test_the_table_of_the_schema_is_that_of_the_schema():
    text = schema_table.PAGE.read_text(encoding="utf-8")
    assert schema_table.BEGIN in text and schema_table.written(text) == text


def test_an_artist_comes_in_five_commands_from_a_bare_mesh_to_a_pinned_cloth_over_a_moving_collider(home):
    (block,) = snippets("For artists", "sh")
    commands = [shlex.split(line) for line in block.strip().splitlines()]
    assert len(commands) <= 5 and [c[0] for c in commands] == ["wsim"] * (len(commands) - 1) + ["usdview"]
    for command in commands[:-1]:
        done = subprocess.run([sys.executable, "-m", "wsim", *command[1:]], capture_output=True, text=True,
                              env={**ci.os.environ, "PYTHONPATH": str(ROOT)})
        assert done.returncode == 0, done.stderr
    assert (home / "curtain.png").stat().st_size > 10_000
    stage = Usd.Stage.Open(commands[-1][1])                                  # what usdview opens
    mesh = next(p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh))
    points = UsdGeom.PointBased(mesh).GetPointsAttr()
    codes = points.GetTimeSamples()
    first, last = (np.array(points.Get(code)) for code in (codes[0], codes[-1]))
    top = first[:, 1] > first[:, 1].max() - 1e-6
    assert len(codes) == stage.GetEndTimeCode() - stage.GetStartTimeCode() + 1 and top.sum() == 31
    assert np.abs(last - first)[top].max() < 1e-6 and np.abs(last - first)[~top].max() > 0.1
    ball = next(p for p in stage.Traverse() if p.IsA(UsdGeom.Sphere))
    centre = np.array(UsdGeom.XformCache(codes[-1]).GetLocalToWorldTransform(ball))[3, :3]
    assert (np.linalg.norm(last - centre, axis=1) > 0.15 - 1e-4).all()       # none of it inside the ball
    assert np.linalg.norm(last - centre, axis=1).min() < 0.16


def test_a_pipeline_simulates_a_stage_and_records_it(home, capsys):
    (block,) = snippets("For pipelines", "python")
    exec(compile(block, "README.md", "exec"), {})
    stage = Usd.Stage.Open(str(home / "flag.usdc"))
    points = UsdGeom.PointBased(stage.GetPrimAtPath("/World/Flag")).GetPointsAttr()
    assert len(points.GetTimeSamples()) == 9 and "max_strain" in capsys.readouterr().out
    assert stage.GetRootLayer().customLayerData["wsim"]["scene"] == "flag.usda"


def test_a_researcher_drops_a_jelly_in_ten_lines_and_fits_its_stiffness_in_ten_more(home, capsys):
    drop, fit = snippets("For research", "python")
    for block in (drop, fit):
        assert len([line for line in block.splitlines() if line.strip()]) <= 10
    names: dict = {}
    exec(compile(drop, "README.md", "exec"), names)
    seen = np.array(names["seen"])
    assert seen.shape == (12, len(names["points"]), 3) and -1e-3 < seen[..., 1].min() < 1e-3     # it has touched
    exec(compile(fit, "README.md", "exec"), names)
    found = names["found"]
    error = found.errors["young"]
    assert found.converged and 0.0 < error < 100.0 and abs(found.values["young"] - 2e4) < 3.0 * error
    assert "error bar" in capsys.readouterr().out


def test_each_package_has_a_lowest_version_that_ci_can_try():
    project = {"dependencies": ["numpy>=2.1", "warp-lang>=1.19,<2"], "optional-dependencies": {
        "test": [], "view": ["rerun-sdk>=0.41"], "plot": [], "picture": ["imageio[ffmpeg]>=2.31"]}}
    assert ci.lowest(project) == ["numpy==2.1", "warp-lang==1.19", "rerun-sdk==0.41", "imageio==2.31"]
    with pytest.raises(SystemExit, match="'pillow' has no lower bound"):
        ci.lowest(project | {"dependencies": ["pillow"]})
    assert len(ci.lowest(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"])) > 5
