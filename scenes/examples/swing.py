"""A soft swing that learns to pump: a strip of rubber hangs from a hand, and the hand's way, frame by frame, is found by the
gradient of where the lower end is after 40 frames. It is used to move by a few centimetres; one and a half, in time with the
swing, bring the lower end fifteen times as far out. (A walker's controls would be found the same way, but for its contacts.)

    python scenes/examples/swing.py
"""

import numpy as np

import wsim
from wsim import Bulk, Scene, Simulation, shapes
from wsim.fitting import Settings, Track

OUT = 0.25             # [m] where the lower end should be, sideways
HAND, STEP = 0.03, 0.03  # [m] that the hand is used to move by, in all and from frame to frame


def scene_of(frames: int = 40) -> Scene:
    """0.6 m long, 4 x 4 cm; swings once in about 1.3 s."""
    scene = Scene(fps=30.0, frames=frames, solver="explicit", substeps=60, air_drag=0.2)
    points, tets = shapes.block((0.04, 0.6, 0.04), (1, 10, 1))
    body = scene.soft("/strip", points, tets, material=Bulk(2e5, 0.3, 1e3))
    scene.pin("/hand", body, np.flatnonzero(points[:, 1] > points[:, 1].max() - 1e-6))
    return scene


def run(frames: int = 40, limit: float = 40.0, out: float = OUT) -> dict:
    scene = scene_of(frames)
    points = scene.softs[0].points.astype(np.float64)
    lower = np.flatnonzero(points[:, 1] < points[:, 1].min() + 1e-6)
    wanted = points[lower] + (out, 0.6 - np.sqrt(0.36 - out**2), 0.0)
    target = Track("/strip", np.array([frames]), wanted[None], points=lower, sigma=0.02)
    found = wsim.fit(scene, [target], f"motion[smooth={STEP}]", priors={"motion[]": (0.0, HAND)},
                     settings=Settings(device="cpu", limit=limit))
    sim = Simulation(found.scene, device="cpu")
    sim.run()
    return {"reached": sim.positions()[lower, 0].mean() - points[lower, 0].mean(), "hand": found.values["motion[]"],
            "gradients": found.simulations, "converged": found.converged, "text": found.text()}


if __name__ == "__main__":
    r = run()
    print(r["text"])
    x = r["hand"][:, 0]
    print(f"the hand moves by {100.0 * x.min():+.1f} to {100.0 * x.max():+.1f} cm, the lower end comes "
          f"{100.0 * r['reached']:.1f} cm out (wanted {100.0 * OUT:.0f}): {r['reached'] / np.abs(x).max():.1f} times as far")
    print("way of the hand [cm]:", " ".join(f"{100.0 * v:+.1f}" for v in x[::3]))
