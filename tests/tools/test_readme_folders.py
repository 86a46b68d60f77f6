"""Snippets of the READMEs of folders run as they stand, after what their reader has made before: a scene, a simulation."""

import re
import shlex

import numpy as np
import pytest

import wsim
from tests.tools.test_readme import FOLDERS
from tools.lint import ROOT
from wsim import cli
from wsim.scene import Scene, Sphere, shapes
from wsim.scene.curve import Motion


def snippets(folder: str) -> list[str]:
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    return re.findall(r"^```(?:python)?\n(.*?)^```", text, re.M | re.S)


def hung(**more) -> Scene:
    """A cloth of 9 points that is held at one of them."""
    scene = Scene(frames=24, substeps=8, solver="explicit", integrator="leapfrog", **more)
    cloth = scene.cloth("/World/Cloth", *shapes.sheet(1.0, 1.0, 2, 2))
    scene.pin("/World/Pin", cloth, [0])
    return scene


def test_there_are_no_others():
    assert {folder: len(snippets(folder)) for folder in FOLDERS} == {
        "scenes": 1, "scenes/examples": 0, "tools": 0, "tools/results": 0, "wsim/fitting": 1, "wsim/gradient": 2,
        "wsim/physics": 3, "wsim/sweep": 2}


def test_loads_push_and_pull():
    """The cloth goes along the force; the bar gets longer by the traction on its end."""
    loads, _, _ = snippets("wsim/physics")
    scene = hung(gravity=(0.0, 0.0, 0.0))
    block, tets = shapes.block((1.0, 0.2, 0.2), (4, 1, 1))
    bar = scene.soft("/bar", block, tets, material=wsim.Bulk(young=1e5))
    scene.pin("/wall", bar, np.flatnonzero(block[:, 0] < -0.49))
    points = np.flatnonzero(block[:, 0] > 0.49)
    text, last = loads.rstrip().rsplit("\n", 1)
    names = {"scene": scene, "cloth": scene.cloths[0], "bar": bar, "points": points}
    exec(compile(text, "README.md", "exec"), names)
    names["simulation"] = simulation = wsim.Simulation(scene, device="cpu")
    exec(compile(last, "README.md", "exec"), names)
    simulation.run(2)
    moved = simulation.positions("/bar") - block
    assert moved[points, 0].min() > 0.0
    assert simulation.velocities("/World/Cloth")[8, 1] < -0.1


def test_a_cloth_is_carried_along_a_path_at_an_even_pace():
    _, curves, _ = snippets("wsim/physics")
    scene = hung()
    scene.pins.clear()
    turns = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, np.sin(0.2), 0.0, np.cos(0.2)], [0.0, np.sin(0.3), 0.0, np.cos(0.3)]])
    names = {"scene": scene, "cloth": scene.cloths[0], "quaternions": turns,
             "places": np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.1, 0.0]])}
    exec(compile(curves, "README.md", "exec"), names)
    simulation = wsim.Simulation(scene, device="cpu")
    before = simulation.positions("/World/Cloth")[[0, 8]]
    simulation.run(2)
    pin = scene.pins[0]
    M = pin.motion.at(simulation.time) @ np.linalg.inv(pin.motion.at(0.0))
    expected = before @ M[:3, :3].T + M[:3, 3]
    assert np.abs(simulation.positions("/World/Cloth")[[0, 8]] - expected).max() < 1e-6


def test_a_box_of_air_has_a_fire():
    _, _, air = snippets("wsim/physics")
    scene = Scene(frames=1)
    exec(compile(air.replace("1 / 64", "1 / 16"), "README.md", "exec"), {"scene": scene, "Sphere": Sphere, "Motion": Motion})
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.step()
    assert simulation.indicators()["fluid_smoke"] > 0.0


def test_a_run_is_differentiated():
    """Of half the squared distance from where the cloth was."""
    differentiate, _ = snippets("wsim/gradient")
    scene = hung()
    names = {"wsim": wsim, "scene": scene, "wanted": scene.cloths[0].points}
    exec(compile(differentiate, "README.md", "exec"), names)
    gradient = names["gradient"]
    assert np.isfinite(gradient.material("stretch")).all() and np.abs(gradient.gravity()).max() > 0.0
    assert gradient.velocities().shape == (9, 3) and np.isfinite(gradient.targets("/World/Pin")).all()


def test_products_and_views_and_layers_follow():
    torch = pytest.importorskip("torch")
    from wsim.gradient.recording import Recording
    _, follow = snippets("wsim/gradient")
    scene = hung()
    simulation = wsim.Simulation(scene, gradients=True, precision="float64")
    recording = Recording(simulation, frames=24)
    names = {"recording": recording, "simulation": simulation, "torch": torch,
             "stretch": torch.tensor([1000.0], dtype=torch.float64), "velocities": torch.zeros((9, 3), dtype=torch.float64)}
    exec(compile(follow, "README.md", "exec"), names)
    assert names["x"].shape == (1, 9, 3) == names["v"].shape


def test_the_products_of_that_snippet_need_no_torch():
    """What stands below the lines of PyTorch."""
    from wsim.gradient.recording import Recording
    _, follow = snippets("wsim/gradient")
    simulation = wsim.Simulation(hung(), gradients=True, precision="float64")
    parts = [part for part in follow.split("\n\n") if "torch" not in part]
    assert len(parts) == 1
    names = {"recording": Recording(simulation, frames=2)}
    exec(compile(parts[0], "README.md", "exec"), names)
    product = names["f"].jvp({"/World/Cloth:stretch": 1.0})
    assert np.abs(product.value).max() > 0.0 and np.max(product.error) < np.abs(product.value).max()


def test_a_fit_is_a_command(tmp_path, capsys):
    """SCENE and OBSERVED are files of the reader's; the cloth is hung and seen with another stretch."""
    (fit,) = snippets("wsim/fitting")
    scene, seen = hung(), hung()
    scene.frames = seen.frames = 6
    seen.cloths[0].material = wsim.Fabric(stretch=1300.0, bend=2e-5)
    wsim.save(scene, tmp_path / "scene.usda")
    wsim.save(seen, tmp_path / "other.usda")
    simulation = wsim.Simulation(tmp_path / "other.usda", device="cpu")
    with simulation.record(tmp_path / "observed.usdc"):
        simulation.run()
    words = shlex.split(fit.replace("SCENE", str(tmp_path / "scene.usda")).replace("OBSERVED", str(tmp_path / "observed"))
                        .replace("FITTED", str(tmp_path / "fitted")))
    assert words[0] == "wsim" and cli.main([*words[1:], "--device", "cpu"]) == 0
    assert "stretch" in capsys.readouterr().out and (tmp_path / "fitted.usda").is_file()


def test_the_pictures_of_the_scenes_are_made_by_commands_that_there_are():
    """Of scenes and frames that there are, into pictures that are there, with options that the command line takes."""
    (loop,) = snippets("scenes")
    named = re.findall(r"([a-z_]+) (\d+)", loop.partition("; do")[0])
    drawn = {path.stem for path in (ROOT / "scenes/pictures").glob("*.png")}
    assert len(named) > 20 and {name for name, _ in named} <= drawn & {path.stem for path in (ROOT / "scenes").glob("*.usda")}
    from wsim.cli import parser
    for name, frame in named:
        assert 0 < int(frame) <= wsim.load(ROOT / "scenes" / f"{name}.usda").frames
    lines = [line.strip() for line in loop.splitlines() if "wsim " in line]
    commands = [c.strip() for line in lines for c in line.split("&&")]
    assert len(commands) >= 3
    for command in commands:
        words = shlex.split(command.replace("$1", named[0][0]).replace("$2", named[0][1]), comments=True)
        assert words[0] == "wsim" and parser().parse_args(words[1:]).command in ("run", "picture")


def test_a_sweep_is_run_from_the_command_line_and_from_python(tmp_path, monkeypatch, capsys):
    """The example of its page, with fewer values and frames."""
    command, code = snippets("wsim/sweep")
    scene = hung()
    scene.cloths[0].path = scene.pins[0].body = "/World/Flag"
    scene.frames = 2
    wsim.save(scene, str(tmp_path / "flag.usda"))
    (tmp_path / "winds.csv").write_text("0,0,0\n")
    monkeypatch.chdir(tmp_path)
    asked = shlex.split(command.replace("10000,20", "1000,2").replace(" --plot max_strain", ""))[1:]
    assert cli.main([*asked, "--device", "cpu"]) == 0
    assert "2 runs, 0 failed" in capsys.readouterr().out and (tmp_path / "stretches" / "sheet.png").exists()
    exec(compile(code.replace('"stretches"', '"others"'), "README.md", "exec"), {"wsim": wsim})
    assert len(capsys.readouterr().out.splitlines()) == 3
