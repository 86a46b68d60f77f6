"""What usd-core's validators say of everything that wsim writes, with its schemas registered and without; and how programs that
do not import wsim get to know them."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.make.usd.validate import validate
from wsim import usd
from wsim.cli import main
from wsim.scene.samples import ColourSample
from wsim.usd.result.recorder import Recorder

SCENES = sorted(path.stem for path in Path("scenes").glob("*.usda"))
BARE = """
import sys
from pxr import Usd, UsdValidation
assert "wsim" not in sys.modules
known = bool(Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("WsimClothAPI"))
errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(
    Usd.Stage.Open(sys.argv[1]))
print(known, [e.GetMessage() for e in errors])
"""


def record(scene, path, clips: bool = False, **more) -> None:
    """Two frames in which everything stays, with all that can be written of it."""
    recorder = Recorder(scene, path, restart_fields=lambda: {b.path: {"e": np.ones(3)} for b in scene.bodies()}, **more)
    recorder.clips = clips
    places = {b.path: b.motion.points(b.points) for b in scene.bodies()}
    stress = {s.path: {name: np.ones(len(s.points)) for name in ("vonMises", "strain")} for s in scene.softs}
    forces = {p.path: np.ones((len(p.points), 3)) for p in scene.pins}
    colours = [ColourSample(path, np.ones((len(x), 3))) for path, x in places.items()]
    poses = {c.path: c.motion.at(0.0) for c in scene.colliders}
    for k in range(2):
        recorder.append(recorder.time_code(k), places, places, poses, stress, forces, colours)
    recorder.close()


def ours(path) -> list[str]:
    """Less what is said of an asset as it was given: a texture reader of a downloaded character."""
    return [line for line in validate(path) if "/Materials/Cesium_Man_effect" not in line]


@pytest.mark.parametrize("name", SCENES)
def test_an_example_and_its_result_pass_the_validators(tmp_path, name):
    assert ours(f"scenes/{name}.usda") == []
    record(usd.load(f"scenes/{name}.usda"), tmp_path / "out.usdc")
    assert ours(tmp_path / "out.usdc") == []


@pytest.mark.parametrize("more", [{"flatten": True}, {"clips": True}, {"velocities": False, "normals": False}])
def test_every_form_of_a_result_passes(tmp_path, more):
    record(usd.load("scenes/bear.usda"), tmp_path / "out.usda", **more)
    assert validate(tmp_path / "out.usda") == []


@pytest.mark.parametrize("name, more", [("racket", []), ("racket", ["--flatten"]), ("plume", []), ("plume", ["--clips"])])
def test_what_bodies_and_smoke_write_passes(tmp_path, name, more):
    """Transforms, volumes and their files, fields of a restart: of a frame that was simulated."""
    out = tmp_path / "out.usdc"
    words = ["run", f"scenes/{name}.usda", "-o", str(out), "--frames", "1", "--device", "cpu", "--quiet", *more]
    assert main(words) == 0 and validate(out) == []


@pytest.mark.parametrize("words", [["cloth", "scenes/assets/unisex_shirt.usd", "--ground", "0"],
                                   ["softbody", "scenes/assets/bear_tet.usdc"], ["fluid", "scenes/assets/bunny.usd"],
                                   ["liquid", "scenes/assets/bunny.usd"], ["rigid"], ["hair"], ["smoke"], ["sand"]])
def test_what_new_makes_passes(tmp_path, words):
    assert main(["new", *words, "-o", str(tmp_path / "scene.usda")]) == 0
    assert validate(tmp_path / "scene.usda") == []


def test_the_validators_find_faults_of_such_files(tmp_path):
    """A material without its binding API, and points outside of the extent's file: the check checks."""
    text = Path("scenes/hanging_cloth.usda").read_text().replace('"MaterialBindingAPI"', '"PhysicsCollisionAPI"')
    (tmp_path / "s.usda").write_text(text)
    assert any("MaterialBindingAPI" in line for line in validate(tmp_path / "s.usda"))


def bare(path, **environment) -> str:
    """Another program: whether it knows wsim's schemas, and what its validators say."""
    done = subprocess.run([sys.executable, "-c", BARE, os.path.abspath(path)], capture_output=True, text=True, cwd="/",
                          env={**os.environ, **environment}, check=True)
    return done.stdout.strip()


def test_a_program_that_knows_nothing_of_wsim_opens_a_result_and_one_line_tells_it(tmp_path, capsys):
    record(usd.load("scenes/flag.usda"), tmp_path / "out.usdc")
    assert bare(tmp_path / "out.usdc") == "False []"
    capsys.readouterr()
    assert main(["schema"]) == 0
    name, _, value = capsys.readouterr().out.strip().partition("=")
    assert bare(tmp_path / "out.usdc", **{name: value}) == "True []"


def test_the_line_keeps_what_others_have_set(monkeypatch, capsys):
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", os.pathsep.join(["/a", "/b"]))
    main(["schema"])
    first, *rest = capsys.readouterr().out.strip().partition("=")[2].split(os.pathsep)
    assert os.path.isfile(os.path.join(first, "plugInfo.json")) and rest == ["/a", "/b"]


def test_importing_wsim_usd_is_enough():
    code = ('import wsim.usd; from pxr import Usd; '
            'print(bool(Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("WsimClothAPI")))')
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"
