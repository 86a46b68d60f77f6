"""A rerun recording: to a file, or to a viewer that is started where none runs. The only file that imports rerun."""

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.show.shading import MeshLook
from wsim.show.web import RerunServer, WebPage

PORT = 9876                      # rerun's own
PATIENCE = 20.0                  # [s] until a started viewer must listen
PLOTS = ("energy", "strain")     # a plot each; all other indicators share one
INSTEAD = "serve a page (--web), or write a file (wsim view RESULT -o run.rrd) and open that on a screen (rerun run.rrd)"
Eye = tuple[np.ndarray, np.ndarray]                  # place (3,) and what it looks at (3,) [m]
MISSING = 'rerun is not installed; install it by: pip install -e ".[view]"'


def rerun_package():
    """The rerun package, loaded only here. Raises SceneError with the mend when it is not installed."""
    try:
        import rerun
    except ImportError as error:
        if (error.name or "").split(".")[0] not in ("rerun", "rerun_bindings", "pyarrow"):
            raise                            # installed and broken: its own words help more
        raise SceneError(Problem("view", MISSING)) from None
    return rerun


class RerunLog:
    """A rerun recording with a time line of frames and one of seconds: into a file, to a web page, or to a viewer.

    name    of the recording                       up      "X", "Y" or "Z"
    save    path of a file                         web     a page to serve
    eye     where the view is from, and what it looks at [m]; None: as rerun chooses
    """

    def __init__(self, name: str, up: str, save=None, web: WebPage | None = None, eye: Eye | None = None):
        self.rr = rr = rerun_package()
        self.eye, self.server = eye, None
        self.stream = rr.RecordingStream("wsim")
        self.stream.send_recording_name(name)
        if save is not None:
            self.stream.save(check_recording_path(Path(save)), default_blueprint=self._viewer_blueprint())
        elif web is not None:
            self.server = RerunServer(_find_rerun_program(), web)
            self.stream.connect_grpc(self.server.data, default_blueprint=self._viewer_blueprint())
        else:
            _start_viewer_process()
            self.stream.connect_grpc(f"rerun+http://127.0.0.1:{PORT}/proxy", default_blueprint=self._viewer_blueprint())
        axis = {"X": rr.ViewCoordinates.RIGHT_HAND_X_UP, "Y": rr.ViewCoordinates.RIGHT_HAND_Y_UP,
                "Z": rr.ViewCoordinates.RIGHT_HAND_Z_UP}[up]
        self.stream.log("world", axis, static=True)

    def _viewer_blueprint(self):
        import rerun.blueprint as rrb

        plots = [rrb.TimeSeriesView(origin=f"plots/{name}", name=name) for name in (*PLOTS, "other")]
        eye = None if self.eye is None else rrb.EyeControls3D(position=self.eye[0], look_target=self.eye[1])
        seen = rrb.Spatial3DView(origin="world", name="scene", eye_controls=eye)
        return rrb.Blueprint(rrb.Horizontal(seen, rrb.Vertical(*plots),
                                            column_shares=[3, 1]), collapse_panels=True)

    def at(self, frame: float, seconds: float) -> None:
        """Sets the time: what is logged from here on belongs to this frame (whole, or the nearest one) and time [s]."""
        self.stream.set_time("frame", sequence=round(frame))
        self.stream.set_time("time", duration=seconds)

    def plot(self, values: Mapping[str, float]) -> None:
        """A point of each curve: names with "energy" and "strain" in the plots of that name."""
        for name, value in values.items():
            plot = next((p for p in PLOTS if p in name), "other")
            self.stream.log(f"plots/{plot}/{name}", self.rr.Scalars(float(value)))

    def log_beads(self, path: str, places: np.ndarray, radii: np.ndarray, color: np.ndarray) -> None:
        """Spheres (n, 3), (n,) [m] at the log's time. color: linear, (3,), or (n, 3) of each."""
        self.stream.log("world" + path, self.rr.Points3D(places.astype(np.float32), radii=radii.astype(np.float32),
                                                         colors=linear_to_srgb(np.atleast_2d(color))))

    def close(self) -> None:
        """All that was logged has left; a file is complete."""
        try:
            self.stream.flush()
        except RuntimeError as error:
            raise SceneError(Problem("view", f"the rerun viewer is gone ({error}); {INSTEAD}")) from None
        finally:
            self.stream.disconnect()
            if self.server:
                self.server.close()


class LoggedMesh:
    """One mesh in a log. Corners that share point, normal and colour are one vertex; the topology is sent once."""

    def __init__(self, log: RerunLog, look: MeshLook):
        self.log, self.look, self.started = log, look, False
        corners = np.stack([look.triangles, look.normal_of, look.color_of], axis=-1).reshape(-1, 3)
        vertices, corner = np.unique(corners, axis=0, return_inverse=True)
        self.faces = corner.reshape(-1, 3).astype(np.uint32)
        self.point, self.normal, self.color = vertices.T

    def send(self, points: np.ndarray, colors: np.ndarray | None = None) -> None:
        """World positions [m] (n, 3) at the log's time; colors: linear, as many as the look has, where they change."""
        fields = {"vertex_positions": points[self.point].astype(np.float32),
                  "vertex_normals": self.look.normals(points)[self.normal].astype(np.float32)}
        mesh, path = self.log.rr.Mesh3D, "world" + self.look.path
        if colors is not None:
            fields["vertex_colors"] = linear_to_srgb(colors)[self.color]
        if self.started:
            self.log.stream.log(path, mesh.from_fields(**fields))
            return
        fields.setdefault("vertex_colors", linear_to_srgb(self.look.colors)[self.color])
        self.log.stream.log(path, mesh(triangle_indices=self.faces, **fields))
        self.started = True


def linear_to_srgb(colors: np.ndarray) -> np.ndarray:
    """Linear colours (k, 3) as sRGB bytes (IEC 61966-2-1)."""
    c = np.clip(np.asarray(colors, float), 0.0, 1.0)
    return np.round(255.0 * np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1.0 / 2.4) - 0.055)).astype(np.uint8)


def check_recording_path(save: Path) -> Path:
    """Path where a recording is written. Raises SceneError for another ending, FileNotFoundError without a folder."""
    if save.suffix != ".rrd":
        raise SceneError(Problem(str(save), f"recordings end in .rrd; found '{save.suffix}'"))
    if not save.parent.is_dir():
        raise FileNotFoundError(f"{save}: there is no folder {save.parent}; make it first")
    return save


def _viewer_answers() -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.2)
        return probe.connect_ex(("127.0.0.1", PORT)) == 0


def _find_rerun_program() -> str:
    """The program `rerun`: that of this Python's environment, else the shell's."""
    beside = Path(sys.executable).with_name("rerun")
    program = str(beside) if beside.exists() else shutil.which("rerun")
    if program is None:
        raise SceneError(Problem("view", MISSING))
    return program


def _start_viewer_process() -> None:
    """Starts a viewer on 127.0.0.1 unless something listens there already, and waits until it does."""
    if _viewer_answers():
        return
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise SceneError(Problem("view", f"there is no screen to show it on; {INSTEAD}"))
    process = subprocess.Popen([_find_rerun_program(), "--bind", "127.0.0.1", "--port", str(PORT)], stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL, start_new_session=True)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and process.poll() is None:
        if _viewer_answers():
            return
        time.sleep(0.1)
    raise SceneError(Problem("view", f"the rerun viewer did not start; {INSTEAD}"))
