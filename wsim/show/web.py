"""The rerun viewer as a web page, for machines without a screen: the page on one port, the data that it shows on the next.

    http://localhost:9090/?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9091%2Fproxy

Both ports listen on 127.0.0.1: who reaches the data port may write into the viewer, and rerun asks for no password. From
another machine both ports are forwarded (ssh -L 9090:localhost:9090 -L 9091:localhost:9091 HOST), and the address above is
opened there. `--bind` names another address, with a warning. rerun's own Python calls listen on all addresses (0.41), so that
the server is a process of rerun's command line, which takes an address. It keeps what was logged for pages that are opened
later, up to MEMORY of the machine's memory, and ends with the process that started it.
"""

import ipaddress
import os
import socket
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from urllib.parse import quote

from wsim.scene import Problem, SceneError
from wsim.simulation import interrupt

PORT, LOCAL = 9090, "127.0.0.1"
MEMORY = "25%"
PATIENCE = 20.0                  # [s] until a started server must listen
# Ends the command and what it started when the pipe to it closes, as it does when this process ends in any way.
GUARD = 'exec 3<&0; "$@" & p=$!; { read -r _ <&3; kill 0; } & wait $p'


@dataclass(frozen=True)
class WebPage:
    """A page to serve: its port (the next one is that of its data), and the IP address on which both listen."""

    port: int = PORT
    bind: str = LOCAL

    @property
    def local(self) -> bool:
        """True if only this machine reaches it."""
        return ipaddress.ip_address(self.bind).is_loopback

    @property
    def host(self) -> str:
        """Host in an address that a browser opens."""
        number = ipaddress.ip_address(self.bind)
        name = "localhost" if number.is_loopback else socket.gethostname() if number.is_unspecified else self.bind
        return f"[{name}]" if ":" in name else name

    def address(self) -> str:
        """Address at which a browser on this machine, or one to which both ports are forwarded, finds the page."""
        data = quote(f"rerun+http://{self.host}:{self.port + 1}/proxy", safe="")
        return f"http://{self.host}:{self.port}/?url={data}"

    def words(self) -> str:
        """Text about a page that is served."""
        text = f"view: open {self.address()}\n"
        if self.local:
            return text + (f"view: from another machine first: ssh -L {self.port}:localhost:{self.port} -L "
                           f"{self.port + 1}:localhost:{self.port + 1} HOST")
        return text + (f"warning: --bind {self.bind}: everyone who reaches this address sees the page and can write into it; "
                       "leave --bind out to serve this machine only")

    def check(self) -> None:
        """Raises SceneError, with the fix, where an address is none of this machine, or one of the ports is not free."""
        if not 1 <= self.port <= 65534:
            raise SceneError(Problem("--port", f"{self.port} is no port that has a next one; allowed is 1 to 65534"))
        try:
            family = socket.AF_INET6 if ipaddress.ip_address(self.bind).version == 6 else socket.AF_INET
        except ValueError:
            raise SceneError(Problem("--bind", f"{self.bind} is no IP address; give one of this machine, 0.0.0.0 for all of "
                                     "them, or leave it out")) from None
        for port in (self.port, self.port + 1):
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    probe.bind((self.bind, port))
                except OSError as error:
                    if not _is_own_address(self.bind, family):
                        raise SceneError(Problem("--bind", f"{self.bind} is no address of this machine ({error.strerror}); "
                                                 "give one that is, or leave it out")) from None
                    raise SceneError(Problem("--port", f"port {port} is not free ({error.strerror}); the page takes --port N, "
                                             f"what it shows N + 1: give another N (now {self.port})")) from None


def _is_own_address(bind: str, family: int) -> bool:
    with socket.socket(family) as probe:
        try:
            probe.bind((bind, 0))
        except OSError:
            return False
    return True


def serve_until_interrupt(say: Callable[[str], None], words: str = "") -> float:
    """Says so, and serves until Ctrl-C; seconds that that took."""
    began = perf_counter()
    interrupt.set_interrupt_mode("throw")
    say(f"{words}view: Ctrl-C ends it")
    interrupt.wait_for_interrupt()
    return perf_counter() - began


class RerunServer:
    """The page and its data, served by rerun's program `program` until `close`. Raises SceneError where it does not start."""

    def __init__(self, program: str, page: WebPage):
        page.check()
        command = [program, "--serve-web", "--bind", page.bind, "--port", str(page.port + 1), "--web-viewer-port",
                   str(page.port), "--server-memory-limit", MEMORY]
        if not page.local:                                  # a page of another host may read the data
            command += ["--cors-allow-origin", f"http://*:{page.port}"]
        if os.name == "posix":
            command = ["sh", "-c", GUARD, "sh", *command]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                        start_new_session=True)
        everywhere = ipaddress.ip_address(page.bind).is_unspecified
        self.host = {4: LOCAL, 6: "::1"}[ipaddress.ip_address(page.bind).version] if everywhere else page.bind
        self.data = f"rerun+http://{f'[{self.host}]' if ':' in self.host else self.host}:{page.port + 1}/proxy"
        try:
            self._wait(page.port, page.port + 1)
        except BaseException:
            self.close()
            raise

    def _wait(self, *ports: int) -> None:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end and self.process.poll() is None:
            if all(_port_answers(self.host, port) for port in ports):
                return
            time.sleep(0.05)
        raise SceneError(Problem("--web", "the server of rerun did not start; write a file instead (wsim view RESULT -o "
                                 "run.rrd), and open that by: rerun run.rrd"))

    def close(self) -> None:
        if self.process.stdin:
            self.process.stdin.close()                      # see GUARD
        if os.name != "posix":
            self.process.terminate()
        self.process.wait()


def _port_answers(host: str, port: int) -> bool:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.settimeout(0.2)
        return probe.connect_ex((host, port)) == 0
