"""What tests/physics/motion/test_soft_pins.py shares with other tests: balance, pulled."""

import numpy as np

from wsim.scene import Motion, Pin, Scene

PULLS = ((30.0, (0.0, 0.0, 0.0)), (90.0, (0.4, 0.1, 0.0)), (15.0, (0.0, 0.2, -0.3)))       # stiffness [N/m], place [m]


def pulled(count: int, points: int = 40, *, pulls=PULLS, **more) -> Scene:
    """Points of 50 g that `count` soft pins pull, each, and one spring that does not matter; air that slows them down."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, air_drag=20.0, **more)
    places = np.zeros((points + 1, 3))
    places[:, 2] = np.linspace(0.0, 1.0, points + 1)
    scene.net("/net", places, [[0, points]], [1e-6], [0.05])
    own = np.arange(points)[::-1]                        # in another order than points have
    for k, (stiffness, place) in enumerate(pulls[:count]):
        scene.pins.append(Pin(f"/pin{k}", "/net", own, stiffness=stiffness, damping=0.01,
                              motion=Motion.still(), places=np.tile(place, (points, 1))))
    return scene


def balance(count: int, pulls=PULLS) -> np.ndarray:
    return sum(k * np.array(a) for k, a in pulls[:count]) / sum(k for k, _ in pulls[:count])
