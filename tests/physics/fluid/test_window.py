"""A part of a fluid that follows its smoke: how far from the whole, where it goes, and what is told and refused."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method
from wsim.physics.fluid.objects import Source
from wsim.scene import Motion, SceneError
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

SIZE = 64


def puff(margin: float, *, n: int = SIZE, sides: tuple[str, ...] = ("open",) * 6, frames: int = 12, **more) -> Simulation:
    """A ball of warm smoke that rises from near the floor of a flat box of 1 m, 1 s long."""
    x = (np.arange(n) + 0.5) / n
    far = np.hypot(*np.meshgrid(x - 0.4, x - 0.2, indexing="ij"))[..., None]
    ball = np.where(far < 0.1, 1.0 - far / 0.1, 0.0)
    scene = box((n, n), size=1.0, sides=sides, seconds=1.0, frames=frames, gravity=(0.0, -9.81, 0.0), smoke=ball,
                temperature=40.0 * ball, steps=2, margin=margin, **more)
    return Simulation(scene, device="cpu")


def rise(sim: Simulation) -> float:
    smoke = method(sim).arrays(0)["smoke"]
    return float((smoke * (np.arange(SIZE) + 0.5)[None, :, None]).sum() / smoke.sum() / SIZE - 0.2)


def test_the_wider_the_margin_the_nearer_to_the_whole():
    whole = puff(0.0)
    whole.run()
    found, cells = [], []
    for margin in (0.25, 0.5, 1.0):
        sim = puff(margin)
        sim.run()
        found.append(abs(rise(sim) / rise(whole) - 1.0))
        cells.append(method(sim).windows[0].domain.layout.cells)
    assert found[0] > found[1] > found[2] and found[2] < 0.02
    assert cells[0] < cells[1] < cells[2] <= SIZE * SIZE and cells[0] < 0.5 * SIZE * SIZE


def test_what_is_solved_follows_the_smoke_and_air_elsewhere_is_at_rest():
    sim = puff(0.3, lift=0.02)
    first = method(sim).windows[0].box
    sim.run()
    window, now = method(sim).windows[0], method(sim).arrays(0)
    low, high = window.box
    assert low[1] > first[0][1] and high[1] > first[1][1]
    x, y = np.meshgrid(np.arange(SIZE + 1), np.arange(SIZE), indexing="ij")
    away = (x < low[0]) | (x > high[0]) | (y < low[1]) | (y >= high[1])
    assert away.any() and not now["u"][..., 0][away].any() and now["u"].any()
    places = np.argwhere(now["smoke"][..., 0] > 1e-3)
    assert (places >= low[:2] + 4).all() and (places < high[:2]).all()
    assert sim.indicators()["fluid_smoke"] == pytest.approx(now["smoke"].sum() / SIZE ** 3, rel=1e-6)


def test_a_frame_that_outgrows_its_part_is_repeated():
    """Air that a source blows through twenty cells in one frame, faster than any margin foresees."""
    def jet(margin):
        scene = box((128, 64), size=2.0, seconds=0.25, frames=1, steps=12, margin=margin)
        scene.add(Source("/jet", Sphere(0.06), smoke=40.0, velocity=(4.0, 0.0, 0.0), motion=Motion.at_place((0.3, 0.5, 0.0))))
        return Simulation(scene, device="cpu")
    sim, whole = jet(0.25), jet(0.0)
    first = method(sim).windows[0].box[1][0]
    sim.run()
    whole.run()
    smoke, all_ = (method(s).arrays(0)["smoke"] for s in (sim, whole))
    last = np.argwhere(all_ > 1e-3)[:, 0].max()
    assert last > first - 4 and method(sim).windows[0].box[1][0] >= last + 2
    assert smoke.sum() == pytest.approx(all_.sum(), rel=1e-2) and sim.frame == 1


def test_a_part_is_the_same_run_to_run_and_the_whole_where_it_reaches_all_sides():
    ends = []
    for margin in (0.4, 0.4, 30.0, 0.0):
        sim = puff(margin, frames=4, pressure="multigrid")
        sim.run(4)
        ends.append(method(sim).arrays(0))
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])
    assert all(np.array_equal(ends[2][name], ends[3][name]) for name in ends[0])


def test_a_plan_says_how_much_is_solved_and_how_wrong_that_is():
    stage = puff(0.75).plan.method("fluid").stages[0].what
    assert "4096 cells, of which" in stage and "a margin of 0.75" in stage and "0.1 to 0.5 % off" in stage


def test_what_cannot_be_is_refused():
    with pytest.raises(SceneError, match="no side is open"):
        puff(0.5, sides=("closed",) * 6)
    with pytest.raises(SceneError, match="margin is -1"):
        puff(-1.0)
    with pytest.raises(SceneError, match="solves a part of its air alone"):
        scene = puff(0.5).scene
        Simulation(scene, device="cpu", gradients=True)
