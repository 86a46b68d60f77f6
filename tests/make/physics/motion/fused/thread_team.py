"""What tests/physics/motion/fused/test_thread_team.py shares with other tests: scene."""

from tests.make.physics.motion.fused.kernel_fusion import blown, cube, everything
from wsim.scene import Scene

LONG = 400             # substeps: a frame in which helpers have time to come
MADE = {"everything": everything, "blown": blown, "cube": cube}


def scene(name: str) -> Scene:
    found = MADE[name]()
    found.substeps, found.integrator = LONG, "leapfrog"
    return found
