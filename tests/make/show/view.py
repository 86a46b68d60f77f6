"""What tests/show/test_view.py shares with other tests: Stepped, needs_rerun, rows."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from wsim.scene import Scene

try:
    import rerun
except ImportError:
    rerun = None
needs_rerun = pytest.mark.skipif(rerun is None, reason="rerun is not installed (the extra `view`)")


class Stepped:
    """What a viewer asks of a simulation: here every cloth falls at 1 m/s."""

    def __init__(self, scene: Scene):
        self.scene, self.frame = scene, 0

    @property
    def time(self) -> float:
        return self.frame / self.scene.fps

    def step(self):
        self.frame += 1

    def positions(self, path):
        body = next(b for b in self.scene.bodies() if b.path == path)
        return body.motion.points(body.points) - [0, self.time, 0]

    def poses(self):
        return {c.path: c.motion.at(self.time) for c in self.scene.colliders}

    def samples(self):
        return []

    def indicators(self):
        return {"kinetic_energy": 1.0, "max_strain": 0.01, "residual": 1e-6}


def rows(path: Path) -> dict[str, int]:
    """Number of rows of each (entity, component) in an .rrd file."""
    program = Path(sys.executable).with_name("rerun")
    done = subprocess.run([str(program), "rrd", "print", "-v", str(path)], capture_output=True, text=True, check=True)
    found: dict[str, int] = {}
    for count, columns in re.findall(r"with (\d+) rows .*data columns: \[(.*)\]", done.stdout):
        for column in columns.split():
            name = re.sub(r"@\w+:", " ", column)
            found[name] = found.get(name, 0) + int(count)
    return found
