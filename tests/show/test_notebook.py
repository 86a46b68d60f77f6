"""A host program: HTML of scenes and simulations, the logger "wsim", and nothing printed."""

import base64
import logging
import re
import subprocess
import sys

import wsim
from wsim import Scene, Simulation, Sphere, shapes

QUIET = """
import wsim
scene = wsim.Scene(frames=2)
scene.cloth("/cloth", *wsim.shapes.sheet(1.0, 1.0, 3, 3, horizontal=True), weld=0.001)
wsim.Simulation(scene, device="cpu").run()
"""


def falling() -> Scene:
    scene = Scene(frames=2)
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 3, 3, horizontal=True, at=(0, 1, 0)))
    scene.collider("/ball", Sphere(0.3))
    return scene


def test_a_notebook_shows_a_picture_of_a_scene_and_of_the_frame_of_a_simulation():
    scene = falling()
    sim = Simulation(scene, device="cpu")
    sim.run(1)
    before, positions = sim.frame, sim.positions("/cloth").copy()
    for thing in (scene, sim):
        html = thing._repr_html_()
        image = base64.b64decode(re.search(r'base64,([^"]+)"', html)[1])
        assert image[:8] == b"\x89PNG\r\n\x1a\n" and len(image) > 2000 and "&lt;Scene" in html
    assert sim.frame == before and (sim.positions("/cloth") == positions).all() and sim.watchers[1:] == []


def test_what_cannot_be_drawn_is_text():
    html = wsim.Scene()._repr_html_()
    assert "no picture: /: nothing here can move" in html and "&lt;Scene: nothing" in html


def test_the_logger_has_warnings_the_build_and_frames(caplog):
    scene = falling()
    scene.cloths[0].points[:, 0] *= 100.0                     # larger than a cloth should be: a warning
    with caplog.at_level(logging.DEBUG, logger="wsim"):
        sim = Simulation(scene, device="cpu")
        sim.run(2)
    said = [(record.levelname, record.getMessage()) for record in caplog.records if record.name == "wsim"]
    assert [text for level, text in said if level == "WARNING"] == [w.removeprefix("warning: ") for w in sim.warnings]
    assert sim.warnings and any("built in" in text and "substeps a frame" in text for level, text in said if level == "INFO")
    assert sum(text.startswith("frame ") and text.endswith(" ms") for level, text in said if level == "DEBUG") == 2


def test_a_library_prints_nothing():
    """Neither Warp's banner, nor lines of modules, nor warnings, where a host has no handler."""
    done = subprocess.run([sys.executable, "-c", QUIET], capture_output=True, text=True, check=True)
    assert done.stdout == "" and done.stderr == ""
