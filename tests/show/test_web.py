"""The viewer as a web page: its ports, its address, and that the page and the data are there (looked at in headless Chromium
by hand)."""

import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tests.conftest import grid
from tests.make.show.view import Stepped, needs_rerun
from wsim.cli import main
from wsim.scene import Scene, SceneError
from wsim.show.viewer import Viewer, view
from wsim.show.web import WebPage


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
    assert WebPage(9190).address() == "http://localhost:9190/?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9191%2Fproxy"
    assert "ssh -L 9190:localhost:9190 -L 9191:localhost:9191 HOST" in WebPage(9190).words()


@pytest.mark.parametrize("taken", [0, 1])
def test_a_port_that_is_taken_is_said_with_the_mend(taken):
    port = free()
    with socket.socket() as other:
        other.bind(("0.0.0.0", port + taken))
        other.listen()
        with pytest.raises(SceneError, match=f"port {port + taken} is not free .* give another N"):
            WebPage(port).check()
    WebPage(port).check()
    with pytest.raises(SceneError, match="allowed is 1 to 65534"):
        WebPage(65535).check()


def test_a_page_and_a_file_are_not_asked_for_at_once(capsys):
    with pytest.raises(SystemExit):
        main(["view", "a.usda", "--web", "-o", "a.rrd"])
    assert "give one of them" in capsys.readouterr().err


@needs_rerun
def test_a_running_simulation_is_served(tmp_path):
    port, made = free(), scene()
    viewer = Viewer(made, web=WebPage(port))
    sim = Stepped(made)
    sim.step()
    viewer.log(sim)
    with urllib.request.urlopen(f"http://localhost:{port}/") as page:
        assert page.status == 200 and b"rerun" in page.read().lower()
    assert listens(port) == listens(port + 1) == {"0100007F"}             # 127.0.0.1, and no other address
    viewer.close()
    assert ended(port)


def ended(port: int) -> bool:
    """Neither port answers any more, after what the system takes to end a process."""
    end = time.monotonic() + 20.0
    while (answers(port) or answers(port + 1)) and time.monotonic() < end:
        time.sleep(0.02)
    return not answers(port) and not answers(port + 1)


def listens(port: int) -> set[str]:
    """Addresses on which something listens at a port, in the kernel's own digits (RFC 1122's order of bytes reversed)."""
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            place, state = line.split()[1], line.split()[3]
            if int(place.split(":")[1], 16) == port and state == "0A":
                found.add(place.split(":")[0])
    return found


@needs_rerun
def test_the_server_ends_with_the_process_that_started_it():
    port = free()
    child = subprocess.Popen([sys.executable, "-c", f"""
from wsim.show.rerun_log import _find_rerun_program
from wsim.show.web import RerunServer, WebPage
server = RerunServer(_find_rerun_program(), WebPage({port}))
print("ready", flush=True)
input()"""], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "ready\n" and answers(port) and answers(port + 1)
    child.kill()
    child.wait()
    assert ended(port)


def test_another_address_is_warned_of_and_a_foreign_one_refused():
    assert "warning: --bind 0.0.0.0: everyone who reaches this address" in WebPage(9190, "0.0.0.0").words()
    assert "warning" not in WebPage(9190, "127.0.0.1").words() and "warning" not in WebPage(9190, "::1").words()
    assert WebPage(9190, "::1").address().startswith("http://localhost:9190/")
    for bind, said in (("192.0.2.1", "is no address of this machine"), ("everywhere", "is no IP address")):    # RFC 5737
        with pytest.raises(SceneError, match=f"--bind: {bind} {said}"):
            WebPage(9190, bind).check()


@needs_rerun
def test_a_result_is_served_until_it_is_left(tmp_path):
    from wsim import save
    save(scene(), tmp_path / "s.usda")
    port, seen = free(), []

    def served() -> None:
        seen.append((answers(port), answers(port + 1)))
    view(tmp_path / "s.usda", web=WebPage(port), served=served)
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
    monkeypatch.setattr("wsim.simulation.interrupt.wait_for_interrupt", lambda: left.append("left"))
    save(scene(), tmp_path / "s.usda")
    files = [str(tmp_path / "s.usda"), "-o", str(tmp_path / "o.usdc")]
    assert main(["run", *files, "--frames", "1", "--web", "--device", "cpu"]) == 0
    assert left[-2:] == ["left", "closed"] if terminal else "left" not in left
    assert ("view: Ctrl-C ends it" in capsys.readouterr().err) == terminal
