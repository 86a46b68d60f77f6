"""The viewer as a web page: its ports, its address, and that the page and the data are there (looked at in headless Chromium
by hand)."""

import socket
import urllib.request

import pytest

from tests.conftest import grid
from tests.show.test_view import Stepped, needs_rerun
from wsim.cli import main
from wsim.scene import Scene, SceneError
from wsim.show import web
from wsim.show.viewer import Viewer, view


def free() -> int:
    """A port that is free, and so is the next one."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
        return port


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def scene() -> Scene:
    made = Scene()
    made.cloth("/cloth", *grid(4))
    return made


def test_the_address_names_the_data_on_the_next_port():
    assert web.address(9190) == "http://localhost:9190/?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9191%2Fproxy"
    assert "ssh -L 9190:localhost:9190 -L 9191:localhost:9191 HOST" in web.words(9190)


@pytest.mark.parametrize("taken", [0, 1])
def test_a_port_that_is_taken_is_said_with_the_mend(taken):
    port = free()
    with socket.socket() as other:
        other.bind(("0.0.0.0", port + taken))
        other.listen()
        with pytest.raises(SceneError, match=f"port {port + taken} is not free .* give another N"):
            web.checked(port)
    assert web.checked(port) == port
    with pytest.raises(SceneError, match="allowed is 1 to 65534"):
        web.checked(65535)


def test_a_page_and_a_file_are_not_asked_for_at_once(capsys):
    with pytest.raises(SystemExit):
        main(["view", "a.usda", "--web", "-o", "a.rrd"])
    assert "give one of them" in capsys.readouterr().err


@needs_rerun
def test_a_running_simulation_is_served(tmp_path):
    port, made = free(), scene()
    viewer = Viewer(made, web=port)
    sim = Stepped(made)
    sim.step()
    viewer.log(sim)
    with urllib.request.urlopen(f"http://localhost:{port}/") as page:
        assert page.status == 200 and b"rerun" in page.read().lower()
    assert answers(port + 1)
    viewer.close()


@needs_rerun
def test_a_result_is_served_until_it_is_left(tmp_path):
    from wsim import save
    save(scene(), tmp_path / "s.usda")
    port, seen = free(), []

    def served() -> None:
        seen.append((answers(port), answers(port + 1)))
    view(tmp_path / "s.usda", web=port, served=served)
    assert seen == [(True, True)]


@pytest.mark.parametrize("terminal", [True, False])
def test_the_page_of_a_run_stays_where_a_person_watches(terminal, tmp_path, monkeypatch, capsys):
    """A run of a few seconds would be over before its page is open; a script is not held up."""
    from wsim import save
    left = []

    class Page:
        def __init__(self, scene, web):
            self.log = left.append

        def close(self):
            left.append("closed")
    monkeypatch.setattr("wsim.show.viewer.Viewer", Page)
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal, raising=False)
    monkeypatch.setattr("wsim.simulation.interrupt.wait", lambda: left.append("left"))
    save(scene(), tmp_path / "s.usda")
    files = [str(tmp_path / "s.usda"), "-o", str(tmp_path / "o.usdc")]
    assert main(["run", *files, "--frames", "1", "--web", "--device", "cpu"]) == 0
    assert left[-2:] == ["left", "closed"] if terminal else "left" not in left
    assert ("view: Ctrl-C ends it" in capsys.readouterr().err) == terminal
