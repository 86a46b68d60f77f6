"""A cloth is thrown so that it hangs upright in a frame 1.5 m away, half a second later: the velocity of each of its points at
the start is found by the adjoint (`velocities[]` of `wsim.fit`). It starts flat, turns on its way, and the air drags at it.

    python scenes/examples/throw_cloth.py
"""

import numpy as np

import wsim
from wsim import Fabric, Scene, Simulation
from wsim.fitting import Settings, Track
from wsim.scene import shapes

AWAY = (1.5, 0.3, 0.0)         # [m] from the cloth's middle at the start to that of the frame
COARSE = 0.5                   # [m/s] that neighbours' velocities differ by


def scene_of(cells: int, frames: int = 12) -> Scene:
    scene = Scene(fps=24.0, frames=frames, solver="explicit")
    scene.cloth("/cloth", *shapes.sheet(0.5, 0.5, cells, cells, horizontal=True), drag=1.0, lift=0.5,
                material=Fabric(stretch=200.0, shear=100.0, bend=1e-3, density=300.0))
    return scene


def run(cells: int = 8, limit: float = 160.0) -> dict:
    scene = scene_of(cells)
    upright = shapes.sheet(0.5, 0.5, cells, cells)[0] + AWAY
    target = Track("/cloth", np.array([scene.frames]), upright[None], sigma=5e-3)              # 5 mm are near enough
    found = wsim.fit(scene, [target], f"velocities[smooth={COARSE}]", priors={"velocities[]": (0.0, 10.0)},
                     settings=Settings(device="cpu", limit=limit))
    thrown = Simulation(found.scene, device="cpu")                                   # in float32, as a film would
    thrown.run()
    missed = np.linalg.norm(thrown.positions() - upright, axis=1)
    v, t = found.values["velocities[]"], scene.frames / scene.fps
    without_air = (np.array(AWAY) - (0.0, -0.5 * 9.81 * t**2, 0.0)) / t
    return {"missed": missed, "velocity": v.mean(axis=0), "without_air": without_air, "gradients": found.simulations,
            "converged": found.converged, "spread": np.ptp(v, axis=0)}


if __name__ == "__main__":
    r = run()
    print(f"{r['gradients']:.0f} gradients; mean velocity {r['velocity'].round(2)} m/s (without air "
          f"{r['without_air'].round(2)}), points differ by up to {r['spread'].round(2)} m/s")
    print(f"missed the frame by {1e3 * r['missed'].mean():.1f} mm in the mean, {1e3 * r['missed'].max():.1f} mm at most")
