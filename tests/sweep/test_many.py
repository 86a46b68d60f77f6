"""Fits of many specimens: a row each, or one fit of all."""

import numpy as np
import pytest

import wsim
from tests.make.sweep.sweep import hung, table
from wsim import cli
from wsim.scene import SceneError
from wsim.sweep.job import Settings
from wsim.sweep.many import fit_specimens

CPU = Settings(device="cpu")
TRUTH = [200.0, 300.0, 450.0]


@pytest.fixture(scope="module")
def specimens(tmp_path_factory) -> tuple[str, list[str]]:
    """A scene, and runs of it with three stiffnesses, in float64, written in float32."""
    folder = tmp_path_factory.mktemp("specimens")
    scene = hung(folder / "hung.usda", frames=6)
    how = Settings(device="cpu", precision="float64", keep="all")
    rows = list(wsim.sweep(scene, f"stretch=list({','.join(map(str, TRUTH))})", folder / "seen", settings=how))
    return scene, [str(folder / "seen" / row["result"]) for row in rows]


def test_each_specimen_has_its_own_stiffness(specimens, tmp_path):
    scene, seen = specimens
    rows = list(fit_specimens(scene, seen, "stretch", tmp_path / "fits", settings=CPU))
    assert [row["status"] for row in rows] == ["done"] * 3
    np.testing.assert_allclose([row["stretch"] for row in rows], TRUTH, rtol=1e-3)
    assert all(0.0 < row["stretch:error"] < 1.0 and row["converged"] for row in rows)
    assert [float(row["stretch"]) for row in table(tmp_path / "fits")] == [row["stretch"] for row in rows]


def test_the_command_line_fits_many_and_all_at_once(specimens, tmp_path, capsys):
    scene, seen = specimens
    assert cli.main(["fit", scene, "--many", *seen[:2], "--parameters", "stretch", "-o", str(tmp_path / "fits"),
                     "--device", "cpu"]) == 0
    assert "runs.csv: 2 runs, 0 failed" in capsys.readouterr().out
    assert cli.main(["fit", scene, "--many", seen[0], seen[0], "--joint", "--parameters", "stretch", "--device", "cpu",
                     "-o", str(tmp_path / "joint.usda")]) == 0
    assert wsim.load(tmp_path / "joint.usda").cloths[0].material.stretch == pytest.approx(TRUTH[0], rel=1e-3)


def test_specimens_that_share_one_parameter_have_a_layer_each(specimens, tmp_path, capsys):
    scene, seen = specimens
    asked = ["fit", scene, "--many", *seen[:2], "--parameters", "stretch,damping", "--shared", "damping", "--device", "cpu",
             "-o", str(tmp_path / "joint.usda")]
    assert cli.main([*asked, "--joint"]) == 0
    assert "stretch@2" in capsys.readouterr().out
    fabrics = [wsim.load(tmp_path / f"joint.{k}.usda").cloths[0].material for k in (1, 2)]
    np.testing.assert_allclose([f.stretch for f in fabrics], TRUTH[:2], rtol=1e-3)
    np.testing.assert_allclose([f.damping for f in fabrics], [1e-3, 1e-3], rtol=1e-2)
    with pytest.raises(SystemExit):
        cli.main(asked)
    assert "give --joint too" in capsys.readouterr().err


def test_what_is_no_specimen_is_refused_before_anything_runs(specimens, tmp_path):
    scene, seen = specimens
    with pytest.raises(SceneError, match="there is no such file"):
        fit_specimens(scene, [*seen, str(tmp_path / "nothere.usdc")], "stretch", tmp_path / "fits", settings=CPU)
    with pytest.raises(SceneError, match="is no parameter"):
        fit_specimens(scene, seen, "strech", tmp_path / "fits", settings=CPU)
    assert not (tmp_path / "fits").exists()
