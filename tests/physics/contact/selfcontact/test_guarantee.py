"""Surfaces never end a substep with an intersection, keep momentum, and pay nothing for flying together."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.selfcontact.momentum import moments
from tests.physics.contact.selfcontact.rig import SOLVERS, THIN, crossed, crumple, layers, run, said, solvers, thrown
from tools.draws.scenes import drawn
from wsim.kernels.contact.selfcontact import pairs, step_clamp
from wsim.physics.contact.selfcontact import method, near
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion


def by_substep(scene, frames: int):
    """The simulation, with frames of one substep each, after so many of its own frames."""
    scene.fps, scene.substeps, steps = scene.fps * scene.substeps, 1, frames * scene.substeps
    sim = run(scene)
    for _ in range(steps):
        sim.step()
        yield sim


@pytest.mark.parametrize("seed", range(2))
def test_a_crumpled_sheet_has_no_intersection_in_any_substep(seed):
    for sim in by_substep(crumple(seed), 4):
        assert crossed(sim) == 0, sim.frame
    assert said(sim)["held"] == 0


def test_sheets_that_are_thrown_have_no_intersection_in_any_substep_by_the_midpoint():
    """Which steps to the end, and gains no energy."""
    scene, energy = drawn(8, "newton midpoint"), []
    for sim in by_substep(scene, 5):
        assert crossed(sim) == 0, sim.frame
        energy.append(sum(sim.indicators()[name] for name in ("kinetic_energy", "elastic_energy")))
    told = said(sim)
    assert sim.plan.integrator == "implicit_midpoint" and told["cut"] == told["held"] == 0 < told["near_pairs"]
    assert max(energy) < 1.05 * energy[0]


def test_the_same_sheet_passes_through_itself_without():
    scene = crumple(0)
    scene.cloths[0].self_collision = False
    sim = run(scene)
    sim.run(4)
    assert crossed(sim) > 0


def test_layers_that_fly_and_turn_together_are_not_touched():
    """Twelve layers 3 mm apart, 2 mm thick, at 20 m/s: nothing is pushed, projected or cut, and they go as without."""
    places = []
    for on in (True, False):
        sim = run(layers(12, 8, 3e-3, velocity=(20.0, 0.0, 0.0), spin=5.0, on=on))
        sim.run(8)
        places.append(np.concatenate([sim.positions(b.path) for b in sim.model.bodies]))
        if on:
            told = said(sim)
    assert told["projected"] == told["cut"] == told["held"] == 0 and told["near_pairs"] > 0
    assert np.abs(places[0] - places[1]).max() == 0.0
    assert told["searches"] <= 3


def test_results_are_the_same_from_run_to_run():
    found = []
    for _ in range(2):
        sim = run(crumple(1))
        sim.run(3)
        found.append(sim.positions("/sheet"))
    assert np.array_equal(*found)


def test_a_list_without_room_is_made_again_though_one_for_a_proof_follows(monkeypatch):
    """Of 900 points that fly at each other each substep has two lists; the first finds no room, and what it left out counts. It
    is the last that the frame makes."""
    places, lists = [], []
    grow = method.SelfContactMethod.grow

    def counted(self, wanted):
        lists.append(int(self.status.said(method.SAID)[step_clamp.SEARCHES]))
        return grow(self, wanted)
    monkeypatch.setattr(method.SelfContactMethod, "grow", counted)
    monkeypatch.setattr(near.NearPairList, "estimate_pair_room", lambda self, at: None)
    for each in (100, 1):
        monkeypatch.setattr(near, "EACH", each)
        sim = run(crumple(3, 30, 16.0))
        room = sim.plan.method("selfcontact").near.capacity
        sim.step()
        places.append(sim.positions())
        assert (sim.plan.method("selfcontact").near.capacity > room) == (each == 1)
    assert said(sim)["searches"] > 15.0 and np.array_equal(*places)
    assert lists[0] == 1 and sum("there was room for" in w for w in sim.repeats) == 1      # an estimate beside it has its own


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "newton bdf2")))
def test_lists_that_grow_leave_their_graph_valid(solver):
    """A frame is repeated by the graph that was captured for a shorter list, and ends to the bit where it would with room from
    the start. It begins with a new list, as repeated frames do."""
    places = []
    for short in (False, True):
        sim = run(crumple(3, 24, 8.0, **solver))
        own = sim.plan.method("selfcontact")
        sim.run(2)
        if short:
            own.near.room(1024)
            own.settle.room()
        else:
            own.near.anew()
        sim.graphs.forget("the test has changed the list")
        captured = len(sim.graphs.log)
        sim.step()
        places.append(sim.positions())
        assert (own.near.capacity > 1024) and len(sim.graphs.log) == captured + 1
        assert short == any("was room for 1024" in w for w in sim.repeats)
    assert np.array_equal(*places)


def test_a_list_that_is_half_full_gets_room_between_frames(monkeypatch):
    """No frame is repeated or captured anew for it, and pairs remember what they did: the run has the bits of one with room."""
    places = []
    for each in (100, 30):
        monkeypatch.setattr(near, "EACH", each)
        sim = run(crumple(3, 24, 8.0, **SOLVERS["xpbd"]))
        own = sim.plan.method("selfcontact").near
        room = own.capacity
        sim.run(3)
        captured = len(sim.graphs.log)
        sim.step()
        places.append(sim.positions())
        assert (own.capacity > room) == (each == 30) and not sim.repeats and len(sim.graphs.log) == captured
    assert np.array_equal(*places)


def test_a_first_list_finds_room_before_its_frame_is_recorded(monkeypatch):
    places = []
    for each in (100, 1):
        monkeypatch.setattr(near, "EACH", each)
        sim = run(layers(4, 20, 2.5e-3, velocity=(0.0, 1.0, 0.0)))
        room = sim.plan.method("selfcontact").near.capacity
        sim.step()
        places.append(sim.positions("/layer1"))
        assert not [w for w in sim.repeats if "there was room for" in w]
        assert (sim.plan.method("selfcontact").near.capacity > room) == (each == 1)
    assert np.array_equal(*places)


def test_pairs_that_are_pressed_in_turn_keep_their_momentum():
    """Where lists are made in each substep, by XPBD on a CPU; no pair is cut, and hardly one is left to be projected."""
    sim = run(crumple(0, 24, 16.0, **SOLVERS["xpbd"]))
    before, _, size, _ = moments(sim)
    sim.run(3)
    told = said(sim)
    assert np.abs(moments(sim)[0] - before).max() < 1e-6 * size
    assert told["searches"] > 45.0 and told["cut"] == told["held"] == 0.0 and crossed(sim) == 0


def test_energy_that_cuts_take_is_counted(monkeypatch):
    """Two sheets that fly at each other, with neither contacts nor projections: cuts alone stop them, and take what is lost; of
    one substep more and more of the motion, several running."""
    for name, value in (("SWEEPS", 0), ("LAST", 0), ("LONGER", 0), ("ROUNDS", 0), ("LOSS", 1000)):
        monkeypatch.setattr(method, name, value)
    scene = layers(2, 3, 0.0125, substeps=1, iterations=1)
    scene.fps *= 10.0
    for cloth, sign in zip(scene.cloths, (1.0, -1.0), strict=True):
        cloth.velocities = np.broadcast_to((0.0, 3.0 * sign, 0.0), cloth.points.shape).copy()
    sim = run(scene)
    masses, h = sim.model.stack("masses"), 1.0 / scene.fps
    kinetic = [0.5 * 9.0 * masses.sum()]
    for _ in range(5):
        sim.step()
        kinetic.append(sim.indicators()["kinetic_energy"])
    told, lost = said(sim), -np.diff(kinetic)
    assert crossed(sim) == 0 and told["cut"] > 0 and kinetic[-1] < 0.01 * kinetic[0]
    wanted = np.sum(kinetic[:-1]) * h                                    # motions of a substep are those of the one before
    assert told["cut_energy"] == pytest.approx(lost.sum() / wanted, rel=1e-3)
    assert told["cut_run"] == (lost > 0.1 * np.array(kinetic[:-1])).sum() > 1


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton", "newton bdf2", "xpbd", "xpbd bdf2")))
def test_sheets_that_meet_within_a_substep_are_projected_and_not_cut(solver):
    """28 mm a substep, 23 thicknesses, more than two edges: projections lead points out of their tubes several times over, each
    time there is a list of where they are, and momentum stays."""
    sim = run(thrown(2, **{**solver, "substeps": 12, "iterations": 2}))
    before, _, size, _ = moments(sim)
    for _ in range(2):
        sim.step()
        assert crossed(sim) == 0
    told = said(sim)
    assert told["projected"] > 0 and told["cut"] == told["held"] == told["repeated"] == 0, told
    assert np.abs(moments(sim)[0] - before).max() < 1e-6 * size


def test_cuts_end_where_proofs_do(monkeypatch):
    """The same sheets, without projections: points near the places where they meet are cut, and no others, though cut points
    leave tubes that lead ahead. With projections again nothing more is, and edges get their lengths back, which swing."""
    with monkeypatch.context() as patch:
        patch.setattr(method, "ROUNDS", 0)
        patch.setattr(method, "LOSS", 1000)
        sim = run(thrown(2, **{**SOLVERS["newton"], "substeps": 12, "iterations": 2}))
        for _ in range(2):
            sim.step()
            assert crossed(sim) == 0
    told, strained = said(sim), sim.indicators()["max_strain"]
    assert told["cut"] > 0 and told["held"] == 0, told
    for _ in range(12):
        sim.step()
        assert crossed(sim) == 0
    assert said(sim)["cut"] == told["cut"] and said(sim)["held"] == 0
    assert sim.indicators()["max_strain"] < 0.2 * strained


@pytest.mark.parametrize("turn", [step_clamp.RIGID, step_clamp.HELD])
def test_what_is_held_goes_by_the_motion_of_all(turn):
    """Motions of a substep at random beside 20 m/s: what is held keeps its shape, and its momentum where that is all; by round
    HELD it is the first sheet, and the other goes on as it did."""
    sim = run(layers(2, 5, 0.02, velocity=(20.0, 0.0, 0.0), spin=3.0))
    sim.step()
    found, s = sim.plan.method("selfcontact"), sim.state
    before = s.d.numpy() - s.e.numpy() + np.random.default_rng(5).normal(size=s.d.shape + (3,)) * 5e-3
    s.d.assign(before + s.e.numpy())
    x, near, first = s.x.numpy().copy(), found.near, slice(0, sim.model.bodies[0].count)
    near.move(found.at(), 0)
    near.word(pairs.ROUND).fill_(turn)
    marks = near.sums.cut.numpy()
    marks[first] = near.words.numpy()[pairs.EPOCH]
    near.sums.cut.assign(marks)
    data = found.surfaces.data
    sim.model.launch(found.guarantee.cut, len(x), [data, found.at(), near.frames, near.words, near.sums], [s.d, found.said])
    after = s.d.numpy() - s.e.numpy()
    held = slice(None) if turn == step_clamp.RIGID else first
    ends, starts = (places[held][:, None] - places[held][None] for places in (x + after, x))
    assert np.abs(np.linalg.norm(ends, axis=2) - np.linalg.norm(starts, axis=2)).max() < 1e-6
    assert np.abs((after - before)[held]).max() > 1e-3 and np.linalg.norm(after[held], axis=1).min() > 0.02
    if turn == step_clamp.HELD:
        assert np.abs((after - before)[first.stop:]).max() < 1e-8
    else:
        masses = 1.0 / data.w.numpy()
        assert np.abs(masses @ (after - before)).max() < 1e-6 * 0.02 * masses.sum()


def clap(speed: float, stretch: float = 300.0, **more):
    """Two flat sheets that meet at a speed [m/s]."""
    scene = layers(2, 6, 0.05, **more)
    for cloth, sign in zip(scene.cloths, (1.0, -1.0), strict=True):
        cloth.velocities = np.broadcast_to((0.0, 0.5 * sign * speed, 0.0), cloth.points.shape).copy()
        cloth.material = replace(THIN, stretch=stretch, shear=0.25 * stretch)
    return scene


def told_fast(sim) -> list[str]:
    return [w for w in sim.warnings if w.endswith("substeps would do")]


@pytest.mark.parametrize("solver", first_and_slow(solvers("xpbd", "newton")))
def test_sheets_that_meet_by_more_than_an_edge_in_a_substep_are_told_how_many_would_do(solver):
    """As many as make it half of a mean edge: v / (edge / 2) a second; with these nothing is told."""
    sim = run(clap(60.0, **{**solver, "substeps": 10, "iterations": 2}))
    sim.step()
    edge = sim.plan.method("selfcontact").surfaces.edge
    wanted = np.ceil(10 * np.floor(100.0 * 60.0 / 600.0 / edge) / 50.0)
    assert told_fast(sim) == ["frame 1: surfaces that met came nearer by more than an edge in a substep, and stretched for it; "
                              f"{wanted:.0f} substeps would do"]
    sim = run(clap(60.0, **{**solver, "substeps": int(wanted), "iterations": 2}))
    sim.step()
    assert np.abs(sim.velocities("/layer0")[:, 1].mean()) < 1.0 and not told_fast(sim)


def test_auto_takes_the_substeps_that_sheets_meet_in():
    sim = run(clap(60.0, stretch=1e6, solver="auto", substeps=1, error=0.05))
    before = sim.plan.clock.substeps
    assert sim.plan.choice.solver != "explicit"
    sim.step()
    edge, taken = sim.plan.method("selfcontact").surfaces.edge, sim.plan.clock.substeps
    assert before < taken and 60.0 / (60.0 * taken) <= 0.5 * edge * 1.02 and not told_fast(sim)
    assert [w for w in sim.repeats if f"{taken} substeps instead of {before} from here on; the frame was repeated" in w]


@pytest.mark.parametrize("gap", [1e-7, 3e-7])
def test_what_is_so_near_that_rounding_tells_is_projected_and_not_held(gap):
    """Sheets a few roundings apart, as jams leave them, that would come nearer by half of it."""
    sim = run(layers(2, 5, gap))
    found, s, clock = sim.plan.method("selfcontact"), sim.state, sim.plan.clock
    found.choose_frame_form(clock)
    found.before_frame(0.0, clock)
    d = np.zeros((len(s.d), 3))
    d[:, 1] = 0.25 * gap * np.repeat([1.0, -1.0], [b.count for b in sim.model.bodies])
    s.e.zero_()
    s.d.assign(d.astype(sim.model.dtype))
    found.near.search(found.at())
    found.guarantee.begin(found.at())
    found.said.zero_()
    found.guarantee.keep(found.at(), s.d, lambda: pytest.fail("points left their tubes"), found.said)
    told, nearer = found.said.numpy(), np.subtract(*(s.d.numpy()[b.first:b.last, 1].mean() for b in sim.model.bodies))
    assert told[step_clamp.PROJECTED] == 1 and told[step_clamp.CUT] == told[step_clamp.CLOSE] == 0, told
    assert nearer < 0.5 * gap and np.abs((1.0 / found.surfaces.data.w.numpy()) @ s.d.numpy()).max() < 1e-12


@pytest.mark.parametrize("solver", first_and_slow(solvers("newton bdf2", "xpbd bdf2", "newton", "xpbd", "leapfrog", "rk4")))
def test_sheets_that_a_body_strikes_do_not_cross(solver):
    """By BDF2 proofs began where the memory of a push has points instead of where they were: 28 pairs crossed."""
    scene = layers(2, 8, 0.02, **solver)
    scene.add(Body("/box", [Collider("/box/shape", Box((0.05, 0.05, 0.05)))], Motion.at_place((0.0, 0.09, 0.0)),
                   velocity=(0.0, -4.0, 0.0), spin=(3.0, 1.0, 5.0), mass=0.3))
    sim = run(scene)
    for _ in range(3):
        sim.step()
        assert crossed(sim) == 0
    told = said(sim)
    assert told["cut"] == told["held"] == 0 and sim.velocities("/layer0")[:, 1].min() < -1.0
