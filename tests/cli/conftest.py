"""What the tests of the command line share: a scene as a file, where its result goes, Ctrl-C as in a terminal."""

import signal

import pytest

from wsim.usd import save


@pytest.fixture
def stage(scene, tmp_path):
    """The scene as a file."""
    scene.frames = 4
    path = str(tmp_path / "scene.usda")
    save(scene, path)
    return path


@pytest.fixture
def out(tmp_path):
    return str(tmp_path / "out.usdc")


@pytest.fixture
def heard():
    """Ctrl-C as in a terminal: a shell starts what it puts in the background with it ignored, and children inherit that."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
