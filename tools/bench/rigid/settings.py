"""Engines, and the settings that each runs a scene at: its own default, and one at which the columns stand."""

from dataclasses import dataclass

HEAVY = "100 kg on nine"


@dataclass(frozen=True)
class Engine:
    """runner: file of this folder; modules: what its environment must have; own: wsim's interpreter runs it; gpu: it runs on
    the device that is asked for."""

    runner: str
    modules: tuple[str, ...] = ()
    own: bool = False
    gpu: bool = False


ENGINES = {
    "wsim": Engine("run_wsim.py", own=True, gpu=True),
    "mujoco": Engine("run_mujoco.py", ("mujoco",)),
    "newton": Engine("run_newton.py", ("newton", "warp"), gpu=True),
}

WSIM = ({}, {"substeps": 8, "iterations": 2}, {"substeps": 8, "iterations": 4})
MUJOCO = ({"steps": 8}, {"steps": 4})                    # of 1/480 s, nearest to its own 2 ms
ALONE = {                                                # what only one scene wants
    ("wsim", "tennis racket"): ({"substeps": 4}, {"substeps": 4, "precision": "float64"}, {"substeps": 1}),
    ("mujoco", "tennis racket"): ({"steps": 8}, {"steps": 4}, {"steps": 4, "integrator": "RK4"}),
    ("wsim", "three bounces"): ({}, {"substeps": 8, "iterations": 2}),
    ("mujoco", "three bounces"): ({"steps": 8}, {"steps": 4}, {"steps": 32}),
    ("mujoco", "sliding box"): ({"steps": 8}, {"steps": 4}, {"steps": 4, "cone": "elliptic"}),
}
NEWTON = ({"solver": "xpbd", "steps": 4}, {"solver": "xpbd", "steps": 16, "iterations": 8}, {"solver": "vbd", "steps": 4},
          {"solver": "vbd", "steps": 4, "iterations": 10, "stiff": True})
NEWTON_GPU = ({"solver": "mujoco", "steps": 4}, {"solver": "steel", "steps": 4})       # minutes to compile for a CPU
EVERYWHERE = {"wsim": WSIM, "mujoco": MUJOCO, "newton": NEWTON}


def settings(engine: str, problem: str, gpu: bool = False) -> tuple[dict, ...]:
    found = ALONE.get((engine, problem), EVERYWHERE[engine])
    return found + NEWTON_GPU if gpu and engine == "newton" else found


def words(engine: str, setting: dict) -> str:
    """A setting in short: 8 x 2 are substeps and iterations a frame."""
    steps = setting.get("substeps", setting.get("steps"))
    sweeps = setting.get("iterations")
    said = "default" if not setting else f"{steps}" + (f" x {sweeps}" if sweeps else "")
    more = [k if v is True else str(v) for k, v in setting.items() if k not in ("substeps", "steps", "iterations", "solver")]
    return " ".join(filter(None, [setting.get("solver", ""), ", ".join([said, *more])]))
