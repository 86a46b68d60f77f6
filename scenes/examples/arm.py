"""An arm that draws a circle: three position servos follow curves, which are those of the arm's angles on the circle, from
the closed form of two links. A servo stays behind its goal by damping / stiffness times the speed, and the weight bends it by
its torque / stiffness. The script says how far the hand is from its goal for soft and stiff servos, damped alike, and what an
inertial unit at the hand reads.

    python scenes/examples/arm.py [OUT]          # OUT.usdc, a result layer, and OUT.png, a picture
"""

import sys

import numpy as np

from wsim import Box, Curve, Cylinder, Motion, Plane, Scene, Simulation
from wsim.geometry import rotation
from wsim.show.camera import Camera
from wsim.show.picture import picture

UPPER, LOWER, HEIGHT = 0.4, 0.35, 0.3          # lengths [m] of both links, and height of the shoulder
RADIUS, CENTRE = 0.15, (0.45, 0.35, 0.0)       # [m] of the circle, which lies across x
FPS, FRAMES, PERIOD = 60.0, 120, 2.5           # of the video; [s] of a turn
LIMIT = 60.0                                   # [N m] of each servo
INERTIA = 0.3                                  # [kg m^2] of the arm about its shoulder, for damping that is critical


def on_circle(time: np.ndarray) -> np.ndarray:
    """Places (n, 3) [m] of the hand."""
    a = 2.0 * np.pi * np.asarray(time) / PERIOD
    return np.stack([np.full_like(a, CENTRE[0]), CENTRE[1] + RADIUS * np.cos(a), RADIUS * np.sin(a)], axis=1)


def angles(places: np.ndarray) -> np.ndarray:
    """(n, 3) of waist (about y), shoulder and elbow (about z) [rad], with the hand at these places, elbow up."""
    x, y, z = places[:, 0], places[:, 1] - HEIGHT, places[:, 2]
    out = np.hypot(x, z)
    elbow = -np.arccos((out**2 + y**2 - UPPER**2 - LOWER**2) / (2.0 * UPPER * LOWER))
    shoulder = np.arctan2(y, out) - np.arctan2(LOWER * np.sin(elbow), UPPER + LOWER * np.cos(elbow))
    return np.stack([np.arctan2(-z, x), shoulder, elbow], axis=1)


def scene_of(stiffness: float) -> Scene:
    """The arm, which starts on the circle; stiffness [N m/rad] of its servos."""
    scene = Scene(fps=FPS, frames=FRAMES, substeps=8)
    scene.collider("/floor", Plane())
    times = np.arange(FRAMES + 1) / FPS
    goals = angles(on_circle(times))
    waist, shoulder, elbow = goals[0]
    first = rotation.quaternion_exponential(np.array([0.0, waist, 0.0]))

    def turned(angle: float) -> np.ndarray:
        return rotation.quat_product(first, rotation.quaternion_exponential(np.array([0.0, 0.0, angle])))

    def placed(at, turn) -> Motion:
        return Motion.through([0], [at], [turn])
    up, out = np.array([0.0, HEIGHT, 0.0]), np.array([1.0, 0.0, 0.0])
    along, beyond = (rotation.quat_rotate(turned(angle), out) for angle in (shoulder, shoulder + elbow))
    joint, axis = up + UPPER * along, rotation.quat_rotate(first, np.array([0.0, 0.0, 1.0]))
    parts = [scene.body("/post", Cylinder(0.06, 0.5 * HEIGHT), motion=placed(0.5 * up, rotation.quat_product(
                 first, rotation.quaternion_exponential(np.array([-0.5 * np.pi, 0.0, 0.0])))), density=800.0),
             scene.body("/upper", Box((0.5 * UPPER, 0.03, 0.03)), motion=placed(up + 0.5 * UPPER * along, turned(shoulder))),
             scene.body("/lower", Box((0.5 * LOWER, 0.02, 0.02)), motion=placed(joint + 0.5 * LOWER * beyond,
                                                                               turned(shoulder + elbow)))]
    for part in parts:
        part.colliders[0].meets = False
    hinges = [scene.joint("revolute", "/waist", None, parts[0], at=(0.0, 0.0, 0.0), axis=(0, 1, 0)),
              scene.joint("revolute", "/shoulder", parts[0], parts[1], at=up, axis=axis),
              scene.joint("revolute", "/elbow", parts[1], parts[2], at=joint, axis=axis)]
    for k, hinge in enumerate(hinges):
        scene.actuator("position", f"{hinge.path}_servo", hinge, stiffness=stiffness,
                       damping=2.0 * np.sqrt(INERTIA * stiffness), force_range=(-LIMIT, LIMIT),
                       control=Curve(times, goals[:, k] - goals[0, k]))                  # from its start
    return scene


def hand_of(simulation: Simulation) -> np.ndarray:
    M = simulation.poses("/lower")["/lower"]
    return M[:3, :3] @ np.array([0.5 * LOWER, 0.0, 0.0]) + M[:3, 3]


def follow(stiffness: float, frames: int = FRAMES, out: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(places of the hand (frames, 3) [m], specific force there (frames, 3) [m/s^2]) with servos of that stiffness."""
    simulation, places, forces = Simulation(scene_of(stiffness), device="cpu"), [], []

    def note(sim: Simulation) -> None:
        places.append(hand_of(sim))
        forces.append(sim.imu("/lower", at=(0.5 * LOWER, 0.0, 0.0)).force[0])
    if out:
        with simulation.record(f"{out}.usdc"):
            simulation.run(frames, note)
    else:
        simulation.run(frames, note)
    return np.array(places), np.array(forces)


def main(out: str | None = None) -> None:
    goals = on_circle(np.arange(1, FRAMES + 1) / FPS)
    for stiffness in (1e3, 1e4, 1e5):
        places, forces = follow(stiffness, out=out if stiffness == 1e5 else None)
        off = np.linalg.norm(places - goals, axis=1)[FRAMES // 3:]
        print(f"servos of {stiffness:6.0f} N m/rad: the hand is {1e3 * off.mean():6.2f} mm from its goal, "
              f"{1e3 * off.max():6.2f} mm at most; it feels {np.linalg.norm(forces, axis=1).max():.1f} m/s^2 at most")
    if out:
        picture(f"{out}.usdc", f"{out}.png", sheet=4, size=(720, 480),
                camera=Camera.look((1.15, 0.8, 1.15), (0.24, 0.34, 0.0)))


if __name__ == "__main__":
    main(*sys.argv[1:2])
