"""Rigid contact colour by colour, as a GPU does it, by one thread of a CPU."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.rigid.contact import Seen, ball, box, free, world
from tests.make.physics.rigid.solver.colours import check_colours, heap
from wsim.kernels.rigid import launches
from wsim.kernels.rigid.kinds import first_of_thread
from wsim.physics.rigid import forms


@wp.kernel(module="rigid_spread", enable_backward=False)
def begins(threads: int, first_out: wp.array(dtype=int)):
    i = wp.tid()
    first_out[i] = first_of_thread(i, threads)


@pytest.fixture(autouse=True)
def coloured(monkeypatch):
    monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.ContactPassForm("coloured"))


def test_no_two_manifolds_of_a_colour_have_a_body_in_common():
    sim = world(*heap(), precision="float32")
    most = 0
    for _ in range(12):
        sim.run(10)
        most = max(most, check_colours(sim))
    assert 3 < most < 16


def test_pairs_that_stay_keep_their_colours():
    """A column at rest: each pair has its colour of the frame before, and no round is run for them."""
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(6)], precision="float32")
    sim.run(30)
    contacts = sim.plan.method("rigid").contacts
    used, colour = contacts.list.count.numpy() > 0, contacts.list.colour.numpy().copy()
    contacts.parts[0].arrays["colour"].assign(np.where(used, 7 + 2 * colour, -1).astype(np.int32))
    sim.step()
    assert np.array_equal(contacts.list.colour.numpy()[used], 7 + 2 * colour[used]) and used.sum() > 5


def test_the_order_within_a_colour_changes_no_bit():
    """What a GPU's threads do in any order: the list of each colour turned round gives the same run."""
    def turned(work) -> None:
        order, starts = work.order.numpy(), work.starts.numpy()
        for k in range(int(work.colours.numpy()[0])):
            order[starts[k]:starts[k + 1]] = order[starts[k]:starts[k + 1]][::-1].copy()
        work.order.assign(order)

    def ends(act) -> bytes:
        sim = world(*heap(20), precision="float32")
        sim.load()
        contacts, clock = sim.plan.method("rigid").contacts, sim.plan.clock
        contacts.before_frame(0.0, clock)
        advance = contacts.form.advance
        contacts.form.advance = lambda *given: (act(contacts.work), advance(*given))
        for _ in range(60):
            contacts.advance(clock)
        return b"".join(contacts.method.part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))

    assert ends(turned) == ends(lambda work: None)


def test_launches_of_passes_and_colours_give_the_bits_of_one_launch(monkeypatch):
    """With more colours than have a launch of their own."""
    def ends(name: str) -> bytes:
        monkeypatch.setattr(forms, "choose_pass_form", lambda device, shapes: forms.ContactPassForm(name))
        spots = [(0.6 * (k % 5) - 1.2, 1.4, 0.6 * (k // 5) - 1.2) for k in range(25)]
        sim = world(box("/plate", (0.0, 0.6, 0.0), (2.0, 0.5, 2.0)), *heap(10)[5:],
                    *[box(f"/top{k}", at, (0.25, 0.25, 0.25), rest=0.3) for k, at in enumerate(spots)], precision="float32")
        sim.run(40)
        assert check_colours(sim) > launches.LAUNCHED
        return b"".join(sim.plan.method("rigid").part.arrays[name].numpy().tobytes() for name in ("x", "q", "p", "L"))
    assert ends("launches") == ends("coloured")


def test_a_plate_under_many_boxes_has_more_manifolds_than_colours():
    """What finds no colour is solved in turn, is told, and holds."""
    spots = [(0.6 * (k % 9) - 2.4, 1.26, 0.6 * (k // 9) - 2.4) for k in range(81)]
    sim = world(box("/plate", (0.0, 0.5, 0.0), (3.0, 0.5, 3.0)),
                *[box(f"/box{k}", at, (0.25, 0.25, 0.25)) for k, at in enumerate(spots)], precision="float32")
    sim.run(120)
    contacts = sim.plan.method("rigid").contacts
    assert int(contacts.work.colours.numpy()[0]) == 61
    assert contacts.in_turn == 22
    seen = Seen(sim)
    heights = np.array([seen.at(f"/box{k}")[1] for k in range(81)])
    assert np.abs(heights - 1.25).max() < 2e-3 and np.abs(seen.v).max() < 1e-3


@pytest.mark.parametrize("n, most", [(10, 3e-3), (20, 8e-3)])
def test_a_column_stands_and_sinks_no_more_than_this(n, most):
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0)) for k in range(n)], precision="float32")
    sim.run(600)
    seen = Seen(sim)
    assert n - 0.5 - seen.at(f"/box{n - 1}")[1] < most and np.abs(seen.v).max() < 1e-3


def test_a_hundred_kilogrammes_stand_on_nine_boxes_of_one():
    sim = world(*[box(f"/box{k}", (0.0, 0.5 + k, 0.0), mass=1.0 if k < 9 else 100.0) for k in range(10)], precision="float32")
    sim.run(600)
    seen = Seen(sim)
    assert 9.5 - seen.at("/box9")[1] < 50e-3 and np.abs(seen.v).max() < 1e-3


def test_a_heap_without_weight_keeps_its_momentum():
    """Balls that fly at each other, with friction and bounces."""
    rng = np.random.default_rng(0)
    spots = [(1.2 * (k % 3), 8.0 + 1.2 * (k // 9), 1.2 * (k // 3 % 3)) for k in range(27)]
    balls = [free(ball(f"/ball{k}", at, rest=0.5, velocity=rng.uniform(-1, 1, 3) - 2.0 * (np.array(at) - (1.2, 9.2, 1.2))))
             for k, at in enumerate(spots)]
    sim = world(*balls)
    method = sim.plan.method("rigid")

    before = method.get("p")[:27]
    sim.run(30)
    after = method.get("p")[:27]
    assert np.abs((after - before).sum(axis=0)).max() < 1e-14 * np.abs(before).sum() < 1e-3 * np.abs(after - before).sum()
    assert check_colours(sim) >= 1


def test_a_form_has_a_name_of_the_table():
    with pytest.raises(ValueError, match="there are listed, coloured, block, cluster, launches"):
        forms.ContactPassForm("quick")


def test_threads_of_all_blocks_share_the_constraints_of_a_colour():
    """Each begins with another one, and the first warp of every block comes before any second one."""
    threads, blocks = 4096, 16
    first = wp.zeros(threads, dtype=int, device="cpu")
    wp.launch(begins, threads, [threads], [first], device="cpu")
    found = first.numpy()
    assert sorted(found) == list(range(threads))
    assert {int(np.flatnonzero(found == 32 * k)[0]) // (threads // blocks) for k in range(blocks)} == set(range(blocks))
