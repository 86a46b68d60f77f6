"""Rigid bodies in contact against closed forms. All scenes have the same kinds of shapes, so that they share their kernels."""

import numpy as np
import pytest

from tests.make.physics.rigid.contact import G, Seen, ball, box, free, tilted, world
from tests.physics.rigid.pairs import WHERE
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Surface, shapes
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def peaks(heights: list[float]) -> list[float]:
    """Vertices of the parabolas through the highest samples."""
    h, found = np.array(heights), []
    for k in range(1, len(h) - 1):
        if h[k - 1] < h[k] >= h[k + 1]:
            a, b = 0.5 * (h[k + 1] + h[k - 1]) - h[k], 0.5 * (h[k + 1] - h[k - 1])
            found.append(float(h[k] - b * b / (4.0 * a)))
    return found


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_three_bounces_are_as_high_as_restitution_says(precision):
    sim = world(ball("/ball", (0.0, 1.5, 0.0), rest=0.8), box("/box", (0.0, 1.5, 5.0), rest=0.5), precision=precision)
    heights: dict[str, list[float]] = {"/ball": [], "/box": []}
    for _ in range(220):
        sim.step()
        for path, found in heights.items():
            found.append(Seen(sim).at(path)[1] - 0.5)
    for path, e in (("/ball", 0.8), ("/box", 0.5)):
        expected = e ** (2.0 * np.arange(1, 4))
        assert np.abs(np.array(peaks(heights[path])[:3]) / expected - 1.0).max() < 5e-3
    assert np.abs(Seen(sim).spin("/box")).max() < (1e-12 if precision == "float64" else 1e-4)


def test_a_bounce_is_as_high_in_steps_of_any_length():
    for substeps in (1, 3, 20):
        sim = world(ball("/ball", (0.0, 1.5, 0.0), rest=0.8), substeps=substeps)
        heights = []
        for _ in range(70):
            sim.step()
            heights.append(Seen(sim).at("/ball")[1] - 0.5)
        assert abs(peaks(heights)[0] - 0.64) < 5e-3 * 0.64


def test_an_elastic_pair_keeps_momentum_and_energy():
    pair = [free(ball("/a", (0.0, 5.0, 0.0), rest=1.0, rub=0.0, velocity=(3.0, 0.0, 0.0))),
            free(ball("/b", (2.0, 5.3, 0.1), 0.3, rest=1.0, rub=0.0))]
    sim = world(*pair)
    mass = np.array([0.5**3, 0.3**3])[:, None]
    before = mass[0, 0] * np.array([3.0, 0.0, 0.0])
    sim.run(60)
    v = np.array([Seen(sim).speed(path) for path in ("/a", "/b")])
    assert np.linalg.norm(v[1]) > 1.0
    assert np.abs((mass * v).sum(axis=0) - before).max() < 1e-12 * before[0]
    assert abs((mass * v * v).sum() / (mass[0, 0] * 9.0) - 1.0) < 1e-10


def test_a_cradle_of_five_balls_passes_all_of_the_speed():
    row = [free(ball(f"/ball{k}", (1.0 * k, 5.0, 0.0), rest=1.0, rub=0.0, velocity=(3.0 * (k == 0), 0.0, 0.0)))
           for k in range(5)]
    sim = world(*row)
    sim.run(30)
    v = np.array([Seen(sim).speed(f"/ball{k}")[0] for k in range(5)])
    assert v[4] > 0.95 * 3.0 and np.abs(v[:4]).max() < 1e-6


def test_a_rod_that_falls_on_a_peg_turns_as_its_closed_form_says():
    """m 1, L 2, v -4, e 0.5, at its end: impulse (1 + e) m v / (1 + 3) = 1.5, so v -2.5 and spin 4.5."""
    rod = box("/rod", (0.0, 1.0, 200.0), (1.05, 0.05, 0.05), rest=0.5, rub=0.0, velocity=(0.0, -4.0, 0.0), mass=1.0,
              center=np.zeros(3), inertia=np.full(3, 1.0 / 3.0), force=(0.0, G, 0.0))
    sim = world(rod)
    sim.run(8)
    assert np.abs(Seen(sim).speed("/rod") - (0.0, -2.5, 0.0)).max() < 1e-4
    assert np.abs(Seen(sim).spin("/rod") - (0.0, 0.0, 4.5)).max() < 1e-4


def test_a_box_slides_as_far_as_friction_lets_it():
    sim = world(box("/box", (0.0, 0.5, 0.0), velocity=(3.0, 0.0, 0.0)))
    sim.run(80)
    assert abs(Seen(sim).at("/box")[0] / (9.0 / (2.0 * 0.5 * G)) - 1.0) < 1e-2
    assert np.linalg.norm(Seen(sim).speed("/box")) < 1e-5


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_box_sticks_half_a_degree_under_the_critical_angle_and_slips_half_a_degree_over_it(precision):
    critical = np.degrees(np.arctan(0.5))
    sim = world(box("/box", (0.0, 0.5, 0.0)), gravity=tilted(critical - 0.5), precision=precision)
    sim.run(60)
    start = Seen(sim).at("/box")[0]
    sim.run(120)
    assert abs(Seen(sim).at("/box")[0] - start) / 2.0 < 10e-6
    sim = world(box("/box", (0.0, 0.5, 0.0)), gravity=tilted(critical + 0.5), precision=precision)
    sim.run(60)
    expected = G * (np.sin(np.radians(critical + 0.5)) - 0.5 * np.cos(np.radians(critical + 0.5)))
    assert abs(Seen(sim).speed("/box")[0] / expected - 1.0) < 2e-2


def test_a_ball_rolls_at_five_sevenths_of_the_slope():
    sim = world(ball("/ball", (0.0, 0.5, 0.0)), gravity=tilted(10.0))
    sim.run(120)
    assert abs(Seen(sim).speed("/ball")[0] / (5.0 / 7.0 * G * np.sin(np.radians(10.0)) * 2.0) - 1.0) < 1e-2
    assert abs(Seen(sim).spin("/ball")[2] * -0.5 / Seen(sim).speed("/ball")[0] - 1.0) < 1e-2


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_ten_boxes_sink_less_than_three_millimetres_and_come_to_rest(precision):
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(10)], precision=precision)
    sim.run(600)
    seen = Seen(sim)
    assert 9.5 - seen.at("/box9")[1] < 3e-3 and np.abs(seen.v).max() < 1e-3 and abs(seen.at("/box9")[0]) < 1e-2


def test_a_hundred_kilogrammes_stand_on_nine_boxes_of_one():
    """They sink 32 mm in soft contact."""
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0), mass=1.0 if k < 9 else 100.0) for k in range(10)], precision="float32")
    sim.run(600)
    seen = Seen(sim)
    assert 9.5 - seen.at("/box9")[1] < 50e-3 and abs(seen.at("/box9")[0]) < 1e-3 and np.abs(seen.v).max() < 1e-3


def test_twenty_boxes_sink_less_than_eight_millimetres_and_come_to_rest():
    """A column of twenty sways slowly once it is pushed: what pushes its corners one after the other never lets it rest."""
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(20)], precision="float32")
    sim.run(600)
    seen = Seen(sim)
    assert 19.5 - seen.at("/box19")[1] < 8e-3 and np.abs(seen.v).max() < 1e-3 and abs(seen.at("/box19")[0]) < 1e-3


def test_a_pyramid_of_ten_rows_stands():
    rows = [(row, k) for row in range(10) for k in range(10 - row)]
    sim = world(*[box(f"/box{r}_{k}", (k + 0.5 * r - 4.5, 0.5 + r, 0.0)) for r, k in rows], precision="float32")
    sim.run(300)
    start = np.array([body.motion.at(0.0)[:3, 3] for body, _ in sim.plan.method("rigid").bodies])
    assert np.abs(Seen(sim).poses[:, :3, 3] - start).max() < 2e-3 and np.abs(Seen(sim).v).max() < 1e-3


def test_a_collider_that_moves_carries_a_box_along_and_throws_a_ball():
    """A table goes at 1 m/s: friction takes the box to its speed; a wall at 2 m/s meets a ball at rest, e = 1: 4 m/s."""
    times = np.array([0.0, 10.0])

    def going(speed: float, at) -> Motion:
        frames = np.tile(np.eye(4), (2, 1, 1))
        frames[:, :3, 3] = np.array(at) + np.outer(times * speed, (1.0, 0.0, 0.0))
        return Motion(times, frames)
    sim = world(box("/box", (0.0, 2.5, 0.0)), free(ball("/ball", (3.0, 8.0, 0.0), rest=1.0, rub=0.0)))
    scene = sim.given
    scene.collider("/table", Box((5.0, 1.0, 5.0)), motion=going(1.0, (0.0, 1.0, 0.0)))
    scene.collider("/wall", Box((0.5, 1.0, 1.0)), motion=going(2.0, (0.0, 8.0, 0.0)), static_friction=0.0, dynamic_friction=0.0)
    sim = Simulation(scene, **WHERE, precision="float64")
    sim.run(120)
    assert np.abs(Seen(sim).speed("/box") - (1.0, 0.0, 0.0)).max() < 1e-4
    assert np.abs(Seen(sim).speed("/ball") - (4.0, 0.0, 0.0)).max() < 1e-3


def test_worlds_do_not_touch_each_other_and_are_alike():
    scene = world(box("/box", (0.0, 1.5, 0.0)), ball("/ball", (0.2, 3.0, 0.1))).given
    one, three = (Simulation(scene, **WHERE, worlds=worlds) for worlds in (1, 3))
    for sim in (one, three):
        sim.run(60)
    alone, all_ = one.plan.method("rigid").get("x"), three.plan.method("rigid").get("x").reshape(3, -1, 3)
    assert np.array_equal(all_[0], alone) and np.array_equal(all_[1], alone) and np.array_equal(all_[2], alone)


def test_a_mesh_lies_as_its_hull_does():
    """A cube as a mesh, dropped on its face, rests as high as a box."""
    scene = world(box("/box", (0.0, 0.7, 0.0))).given
    points, counts, indices = shapes.box((0.5, 0.5, 0.5))
    scene.add(Body("/mesh", [Collider("/mesh/shape", Surface(points, counts, indices))], Motion.at_place((5.0, 0.7, 0.0))))
    sim = Simulation(scene, **WHERE)
    sim.run(120)
    assert abs(Seen(sim).at("/mesh")[1] - Seen(sim).at("/box")[1]) < 1e-5 and np.abs(Seen(sim).v).max() < 1e-4


def test_an_overlapping_start_does_not_pop():
    """Two boxes a fifth into each other come apart, at no more than 4 m/s."""
    sim = world(box("/low", (0.0, 0.5, 0.0)), box("/high", (0.0, 1.3, 0.0)))
    fastest = 0.0
    for _ in range(60):
        sim.step()
        fastest = max(fastest, float(np.abs(Seen(sim).v).max()))
    assert fastest < 4.5 and abs(Seen(sim).at("/high")[1] - 1.5) < 1e-2


def test_runs_are_the_same_to_the_bit():
    def ends() -> bytes:
        sim = world(*[box(f"/box{k}", (0.1 * k, 0.6 + 1.1 * k, 0.05 * k)) for k in range(4)], precision="float32")
        sim.run(60)
        return b"".join(sim.plan.method("rigid").part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))
    assert ends() == ends()


def test_a_frame_in_which_more_pairs_are_near_than_there_is_room_for_is_repeated():
    """Thirty balls in nearly one place: 435 pairs, where there is room for 256."""
    balls = [ball(f"/ball{k}", (0.02 * k, 5.0 + 0.02 * k, 0.0)) for k in range(30)]
    sim = world(*balls, precision="float32")
    sim.run(2)
    (said,) = [w for w in sim.repeats if "pairs of rigid shapes" in w]
    assert "the frame was repeated" in said and int(sim.plan.method("rigid").contacts.room) >= 30 * 29 // 2
    assert np.isfinite(Seen(sim).v).all()
