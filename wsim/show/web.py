"""The rerun viewer as a web page, for machines without a screen: the page on one port, what it shows on the next.

    http://localhost:9090/?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A9091%2Fproxy

The page is served to the machine itself. From another one both ports are forwarded (ssh -L 9090:localhost:9090 -L
9091:localhost:9091 HOST), and the address above is opened there: browsers take data from localhost only. The server keeps what
was logged for pages that are opened later, up to MEMORY of the machine's memory, and ends with its process.
"""

import socket
from collections.abc import Callable
from time import perf_counter
from urllib.parse import quote

from wsim.scene import Problem, SceneError
from wsim.simulation import interrupt

PORT = 9090
MEMORY = "25%"


def checked(port: int) -> int:
    """The port, if it and the next one are free here. Raises SceneError with the mend."""
    if not 1 <= port <= 65534:
        raise SceneError(Problem("--port", f"{port} is no port that has a next one; allowed is 1 to 65534"))
    for each in (port, port + 1):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("0.0.0.0", each))
            except OSError as error:
                raise SceneError(Problem("--port", f"port {each} is not free ({error.strerror}); the page takes --port N, what "
                                         f"it shows N + 1: give another N (now {port})")) from None
    return port


def address(port: int) -> str:
    """Address at which a browser on this machine, or one to which both ports are forwarded, finds the page."""
    return f"http://localhost:{port}/?url={quote(f'rerun+http://localhost:{port + 1}/proxy', safe='')}"


def words(port: int) -> str:
    """Text about a page that is served."""
    return (f"view: open {address(port)}\n"
            f"view: from another machine first: ssh -L {port}:localhost:{port} -L {port + 1}:localhost:{port + 1} HOST")


def stay(say: Callable[[str], None], words: str = "") -> float:
    """Says so, and serves until Ctrl-C; seconds that that took."""
    began = perf_counter()
    interrupt.begin("throw")
    say(f"{words}view: Ctrl-C ends it")
    interrupt.wait()
    return perf_counter() - began


def serve(rr, stream, blueprint, port: int) -> None:
    """Begins to serve a recording stream of the package `rr` (rerun), and the page for it. Raises SceneError where a port is
    taken."""
    checked(port)
    uri = stream.serve_grpc(grpc_port=port + 1, default_blueprint=blueprint, server_memory_limit=MEMORY)
    rr.serve_web_viewer(web_port=port, open_browser=False, connect_to=uri)
