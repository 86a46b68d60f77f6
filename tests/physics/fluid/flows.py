"""Flows with a known answer, on a grid, and how far from it a run ends."""

import numpy as np

from wsim.physics.fluid.objects import Fluid
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation

TURN = 2.0 * np.pi
PERIODIC = ("periodic",) * 6
NAMES = ("u", "v", "w")
# extrema on the centre lines of a cavity under a lid of unit speed: least u, most and least v (Botella, Peyret 1998, tables 9
# and 10; at 400, which they have not, Marchi, Suero, Araki 2009, on 1024 x 1024 cells); all are checked by test_cavity.py
CAVITY = {100: (-0.2140424, 0.1795728, -0.2538030), 400: (-0.3287295, 0.3038323, -0.4540580),
          1000: (-0.3885698, 0.3769447, -0.5270771)}


def box(n: tuple[int, ...], *, size: float = TURN, seconds: float = 2.0, frames: int = 1, **more) -> Scene:
    """A scene with one fluid of n cells, the first axis `size` [m] long, of so many frames in all `seconds`."""
    cell = size / n[0]
    shape = np.array([*n, 1, 1][:3])
    still = (0.0, 0.0, 0.0)
    scene = Scene(fps=frames / seconds, gravity=more.pop("gravity", still), frames=frames, wind=more.pop("wind", still))
    scene.add(Fluid("/fluid", np.zeros(3), shape * cell, cell, **more))
    return scene


def method(sim: Simulation):
    return sim.plan.method("fluid")


def places(layout, axis: int, cell: float) -> list[np.ndarray]:
    """Coordinates [m] of the faces of an axis."""
    rows = [cell * (np.arange(m) + (0.0 if a == axis else 0.5)) for a, m in enumerate(layout.faces(axis))]
    return np.meshgrid(*rows, indexing="ij")


def put(sim: Simulation, velocity, k: int = 0) -> None:
    """Starts fluid k with velocity(axis, x, y, z) on its faces."""
    m = method(sim)
    layout, cell = m.layouts[k], m.pairs[k][0].cell
    for a in range(layout.dim):
        values = np.broadcast_to(velocity(a, *places(layout, a, cell)), layout.faces(a))
        m.field(k, NAMES[a]).assign(values.ravel().astype(sim.model.dtype))


def error(sim: Simulation, velocity) -> float:
    """Root of the mean square of the velocity less velocity(axis, x, y, z), over faces."""
    m = method(sim)
    layout, cell, now = m.layouts[0], m.pairs[0][0].cell, m.arrays(0)
    return float(np.sqrt(sum(np.mean((now[NAMES[a]] - velocity(a, *places(layout, a, cell))) ** 2) for a in range(layout.dim))))


def taylor_green(drift: float = 0.0, time: float = 0.0):
    """Vortices of Taylor and Green (1937), at rest in air that drifts along (1, 1): an exact solution without viscosity."""
    def velocity(axis, x, y, z):
        x, y = x - drift * time, y - drift * time
        return drift + (np.sin(x) * np.cos(y) if axis == 0 else -np.cos(x) * np.sin(y))
    return velocity


def abc(axis, x, y, z):
    """Arnold, Beltrami, Childress: curl u = u, so that u is steady without viscosity."""
    return (np.sin(z) + np.cos(y), np.sin(x) + np.cos(z), np.sin(y) + np.cos(x))[axis]


def run(n: tuple[int, ...], start, *, courant: float = 1.0, fastest: float = 1.0, seconds: float = 2.0,
        precision: str = "float32", **more) -> Simulation:
    """One frame of a periodic box with steps in which air of the speed `fastest` crosses `courant` cells."""
    steps = round(seconds * fastest / (courant * TURN / n[0]))
    more = {"sides": PERIODIC, "tolerance": 1e-6} | more
    sim = Simulation(box(n, seconds=seconds, steps=max(steps, 1), **more), device="cpu", precision=precision)
    put(sim, start)
    sim.step()
    return sim
