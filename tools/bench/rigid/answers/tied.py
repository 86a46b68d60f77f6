"""Ropes tied to rigid bodies: what they lose in free flight, and the period of a weight.

    python -m tools.bench.rigid.answers.tied

Float64, frames of 1/60 s. Prints rows of tools/results/rods.md, with the CPU time of a frame on one core [ms]:

    momentum    change of the linear and angular momentum of a body and a rope of 0.08 kg that whirl, over both, in 30 frames
    flail       part of its energy that a handle, a rope and a ball lose in a second
    period      error of the period of a weight on a rope of 1 m from 0.3 rad, beside the arithmetic-geometric mean
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[4]))

from wsim import Box, Scene, Simulation, Sphere  # noqa: E402

G, ANGLE, SWINGS = 9.81, 0.3, 3


def timed_run(scene: Scene, frames: int):
    """(simulation before its first frame, call that runs all and returns CPU ms a frame)."""
    simulation = Simulation(scene, device="cpu", precision="float64")
    simulation.load()

    def run() -> float:
        began = time.process_time()
        simulation.run(frames)
        return (time.process_time() - began) / frames * 1e3
    return simulation, run


def whirling(mass: float, substeps: int) -> Scene:
    """A body of a mass [kg] and a rope of 0.08 kg that whirl about each other in free flight."""
    scene = Scene(fps=60, substeps=substeps, gravity=(0.0, 0.0, 0.0))
    x = np.stack([np.linspace(0.1, 1.1, 9), np.zeros(9), np.zeros(9)], axis=1)
    rope = scene.rods("/rope", x, [9], diameters=0.01, young=1e7, velocities=np.cross((0.0, 0.0, 3.0), x) + (0.0, 0.0, 0.3))
    body = scene.body("/body", Box((0.1, 0.06, 0.03)), mass=mass, spin=(0.0, 0.0, 3.0), velocity=(0.1, 0.2, 0.3))
    scene.tie("/tie", rope, [0], body)
    return scene


def momenta(simulation) -> tuple[np.ndarray, np.ndarray]:
    """Linear [kg m/s] and angular momentum [kg m^2/s] about the origin, of a rope and a body, (3,) each."""
    rods, rigid = simulation.plan.method("rods"), simulation.plan.method("rigid")
    x, v = rods.points(0)
    m = rods.table.values["m"].reshape(-1)[rods.table.place[0]][:, None]
    p, c = rigid.read("p"), rigid.origin + rigid.get("x") + rigid.get("e")
    return (m * v).sum(0) + p.sum(0), np.cross(x, m * v).sum(0) + (rigid.read("L") + np.cross(c, p)).sum(0)


def print_momenta() -> None:
    for mass in (8e-5, 1.0, 80.0):
        for substeps in (4, 8, 16):
            simulation, run = timed_run(whirling(mass, substeps), 30)
            p, L = momenta(simulation)
            ms = run()
            q, K = momenta(simulation)
            linear, angular = (np.linalg.norm(new - old) / np.linalg.norm(old) for new, old in ((q, p), (K, L)))
            print(f"momentum, body of {mass:g} kg, {substeps:2d} substeps: {linear:.1e}, angular {angular:.1e}, {ms:.2f} ms")


def print_periods() -> None:
    """A heavy ball on a light rope: its distance from the pin counts, and the rope's weight does not."""
    length, radius = 1.0, 0.05
    reach = length + radius
    inertia = 1.0 + 0.4 * (radius / reach)**2
    a, b = 1.0, np.cos(0.5 * ANGLE)
    for _ in range(6):
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    exact = 2.0 * np.pi * np.sqrt(reach / G * inertia) / a
    for substeps in (2, 4, 8, 16):
        scene = Scene(fps=60, substeps=substeps, gravity=(0.0, -G, 0.0))
        way = np.array([np.sin(ANGLE), -np.cos(ANGLE), 0.0])
        x = np.linspace(0.0, length, 9)[:, None] * way
        rope = scene.rods("/rope", x, [9], diameters=0.01, young=1e9, density=1e-3, bend=0.0)
        scene.pin("/pin", rope, [0])
        ball = scene.body("/ball", Sphere(radius), at=reach * way, mass=1.0)
        scene.tie("/tie", rope, [8], ball)
        simulation, _ = timed_run(scene, 1)
        places, began = [simulation.poses()["/ball"][0, 3]], time.process_time()
        for _ in range(int(exact * SWINGS * 60) + 10):
            simulation.step()
            places.append(simulation.poses()["/ball"][0, 3])
        ms, x = (time.process_time() - began) / len(places) * 1e3, np.array(places)
        k = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
        zeros = (k + x[k] / (x[k] - x[k + 1])) / 60.0
        found = (zeros[-1] - zeros[0]) / (len(zeros) - 1)
        print(f"period, {substeps:2d} substeps: {found:.5f} s, exact {exact:.5f}, error {found / exact - 1.0:.1e}, {ms:.2f} ms")


def print_flails() -> None:
    for substeps in (4, 8, 16):
        scene = Scene(fps=60, substeps=substeps, gravity=(0.0, 0.0, 0.0))
        turn = np.array([0.0, 0.0, 6.0])
        x = np.stack([np.linspace(0.2, 0.7, 7), np.zeros(7), np.zeros(7)], axis=1)
        rope = scene.rods("/rope", x, [7], diameters=0.01, young=1e7, velocities=np.cross(turn, x))
        handle = scene.body("/handle", Box((0.2, 0.02, 0.02)), mass=0.6, spin=turn)
        at = np.array([0.76, 0.0, 0.0])
        ball = scene.body("/ball", Sphere(0.06), at=at, mass=1.0, spin=turn, velocity=np.cross(turn, at))
        scene.tie("/near", rope, [0], handle)
        scene.tie("/far", rope, [6], ball)
        simulation, run = timed_run(scene, 60)
        before = simulation.plan.method("rigid").indicators(None, None)["rigid_energy"]
        ms = run()
        after = simulation.plan.method("rigid").indicators(None, None)["rigid_energy"]
        print(f"flail, {substeps:2d} substeps: bodies lose {1.0 - after / before:.1%} of their energy in a second, {ms:.2f} ms")


if __name__ == "__main__":
    print_momenta()
    print_flails()
    print_periods()
