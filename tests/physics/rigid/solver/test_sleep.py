"""Sleep of rigid bodies by islands: who sleeps, who wakes, and that waking goes on as if nobody had slept."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.physics.rigid.contact import Seen, ball, box, world
from tests.make.physics.rigid.solver.sleep import asleep
from wsim.physics.rigid import forms
from wsim.scene import Box
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

FORMS = ("listed", "coloured")


@pytest.fixture(params=FORMS, autouse=True)
def form(request, monkeypatch):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.ContactPassForm(request.param))


def sleepy(*bodies, speed: float = 0.05, **more) -> Simulation:
    return Simulation(replace(world(*bodies, **more).given, sleep_speed=speed), device="cpu")


def column(n: int, x: float = 0.0) -> list:
    return [box(f"/c{x:g}_{k}".replace("-", "m").replace(".", "_"), (x, 0.5 + k, 0.0)) for k in range(n)]


def test_a_column_sleeps_after_half_a_second_and_nothing_moves_any_more():
    sim = sleepy(*column(3))
    sim.run(20)
    assert not any(asleep(sim).values())
    sim.run(40)
    assert all(asleep(sim).values())
    before = sim.plan.method("rigid").poses()
    sim.run(60)
    assert np.array_equal(sim.plan.method("rigid").poses(), before) and not Seen(sim).v.any()
    assert sim.indicators()["rigid_asleep"] == 5.0


def test_without_a_speed_nothing_falls_asleep():
    sim = world(*column(2))
    assert sim.plan.method("rigid").sleep is None and "calm" not in sim.plan.method("rigid").part.arrays


def test_a_ball_that_falls_on_a_column_wakes_it_and_no_other():
    sim = sleepy(*column(3), *column(3, 20.0), ball("/ball", (0.0, 8.0, 0.0), rest=0.0))
    sim.run(45)
    first = asleep(sim)
    assert first["/c0_2"] and first["/c20_2"] and not first["/ball"]
    woken = False
    for _ in range(40):
        sim.step()
        now = asleep(sim)
        woken |= not (now["/c0_0"] or now["/c0_1"] or now["/c0_2"])
        assert now["/c20_0"] and now["/c20_2"]
    assert woken
    sim.run(90)
    assert all(asleep(sim).values())


def test_who_is_woken_goes_on_as_who_never_slept():
    """A box that is set in motion on a column: the same way as where nobody has slept, but for what sleep took of the speed."""
    def slid(speed: float) -> np.ndarray:
        sim = sleepy(*column(4), speed=speed)
        sim.run(90)
        sim.set("/c0_3", "velocity", (1.0, 0.0, 0.0))
        sim.run(30)
        assert not any(list(asleep(sim).values())[:4]) if speed > 0.05 else True
        return np.array([Seen(sim).at(f"/c0_{k}") for k in range(4)])
    assert np.abs(slid(0.06) - slid(1e-9)).max() < 2e-4


def test_a_force_and_gravity_that_are_set_wake():
    sim = sleepy(*column(2), *column(2, 20.0))
    sim.run(60)
    assert all(asleep(sim).values())
    sim.set("/c0_1", "force", (0.0, 3e4, 0.0))
    sim.run(10)
    assert Seen(sim).speed("/c0_1")[1] > 1.0 and asleep(sim)["/c20_0"]
    sim.set("/", "gravity", (0.0, 5.0, 0.0))
    sim.run(10)
    assert Seen(sim).speed("/c20_0")[1] > 0.5


def test_a_collider_that_moves_wakes_what_it_touches():
    times, frames = np.array([0.0, 1.5, 10.0]), np.tile(np.eye(4), (3, 1, 1))
    frames[:, :3, 3] = [(-3.0, 0.5, 0.0), (-3.0, 0.5, 0.0), (5.5, 0.5, 0.0)]
    scene = replace(world(*column(1), *column(1, 20.0)).given, sleep_speed=0.05)
    scene.collider("/ram", Box((0.5, 0.4, 0.5)), motion=Motion(times, frames))
    sim = Simulation(scene, device="cpu")
    sim.run(85)
    assert all(asleep(sim).values())
    sim.run(180)
    assert not asleep(sim)["/c0_0"] and asleep(sim)["/c20_0"] and Seen(sim).at("/c0_0")[0] > 0.1


def test_a_body_that_starts_asleep_hangs_until_something_comes_near():
    hangs = box("/hangs", (0.0, 5.0, 0.0), asleep=True)
    sim = Simulation(world(hangs, ball("/ball", (0.0, 8.0, 0.0))).given, device="cpu")
    sim.run(30)
    assert Seen(sim).at("/hangs")[1] == 5.0 and asleep(sim)["/hangs"]
    sim.run(60)
    assert not asleep(sim)["/hangs"] and Seen(sim).at("/hangs")[1] < 3.0


def test_a_repeated_run_and_a_restart_are_the_same_to_the_bit():
    def made() -> Simulation:
        return sleepy(*column(3), ball("/ball", (0.1, 9.0, 0.0)))

    def ends(sim: Simulation) -> bytes:
        return b"".join(a.numpy().tobytes() for a in sim.plan.method("rigid").part.arrays.values())
    whole, half, other = made(), made(), made()
    whole.run(120)
    half.run(50)
    assert any(asleep(half).values()) and not all(asleep(half).values())
    other.restart(50, {path: half.fields(path) for path in half.state.paths()})
    other.run(70)
    assert ends(other) == ends(whole)


def test_what_starts_asleep_is_said_in_usd(tmp_path, form):
    from wsim.usd import load, save
    scene = world(box("/a", (0.0, 0.5, 0.0), asleep=True), box("/b", (3.0, 0.5, 0.0))).given
    save(replace(scene, sleep_speed=0.02), tmp_path / "s.usda")
    back = load(tmp_path / "s.usda")
    assert [body.asleep for body in back.things("Body")][:2] == [True, False] and back.sleep_speed == 0.02
