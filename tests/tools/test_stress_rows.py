"""The tools of tools/stress: a judge that can fail, energies that agree with the engine's, and a handful of rows."""

import time
from dataclasses import replace

import numpy as np
import pytest

from tools.stress import acts, energy, examples, judge, rows, run, scenes, soft_rows, solvers, table
from tools.stress.__main__ import chosen, verdict_of
from wsim.scene.integrator import SOLVERS, TABLE
from wsim.scene.nodal.separate import NUDGE, separate_coincident_ends
from wsim.simulation.simulation import Simulation

SWEEPS = next(s for s in solvers.SOLVERS if s.name == "xpbd/backward_euler")
AUTO = solvers.SOLVERS[0]


def row(name: str) -> rows.Row:
    return next(r for r in table.ROWS if r.name == name)


def record(**more) -> judge.Record:
    """A run that holds: energy falls, strain goes."""
    good = {"energy": [1.0, 0.9], "budget": [1.0, 1.0], "strain": [0.5, 1e-4], "bound": 1e-3, "momentum": [0.0, 1e-7],
            "momentum_bound": 1e-6, "drift_bound": 1e-5, "jitter_bound": 1e-4, "seconds": 1.0, "limit": 2.0}
    return judge.Record("made up", "xpbd", "backward_euler", **(good | more))


def test_a_run_that_holds_is_held():
    assert judge.judge(record(), {}) == judge.Verdict(True, "held")


@pytest.mark.parametrize("kind, fault", [
    ("finite", {"finite": False}), ("energy", {"energy": [1.0, 1.1]}), ("energy", {"energy": [1.0, float("nan")]}),
    ("energy", {"energy": [0.1, 0.0], "budget": [0.0, 0.0]}), ("strain", {"strain": [0.5, 2e-3]}),
    ("strain", {"strain": [0.5, float("nan")]}), ("strain", {"strain": []}), ("momentum", {"momentum": [0.0, 1e-5]}),
    ("momentum", {"momentum": [float("nan")]}), ("drift", {"drift": 1e-4}), ("jitter", {"jitter": 1e-3}),
    ("time", {"seconds": 3.0}), ("time", {"hung": True}), ("refusal", {"refusal": "no"}), ("broke", {"broke": "KeyError"})])
def test_every_fault_is_found_and_named(kind, fault):
    found = judge.faults(record(**fault))
    assert [k for k, _ in found] == [kind]
    assert not judge.judge(record(**fault), {}).held


def test_symplectic_euler_may_swing_as_far_as_its_invariant_lets_it():
    """x'' = -w^2 x in NumPy from any phase: E never exceeds swing(h w / 2) times its first value, and comes near it."""
    w, h, most = 1.0, 1.2, 0.0
    for phase in np.linspace(0.0, np.pi, 60):
        x, v = np.cos(phase), np.sin(phase)
        for _ in range(200):
            v -= h * w * w * x
            x += h * v
            most = max(most, 0.5 * (v * v + w * w * x * x) / 0.5)
    bound = judge.swing(0.5 * h * w)
    assert 0.95 * bound < most <= bound * (1.0 + 1e-12)
    assert not judge.judge(record(energy=[1.0, 1.5]), {}).held and judge.judge(record(energy=[1.0, 1.5], swing=1.5), {}).held


def test_what_is_listed_beforehand_holds_and_says_why():
    verdict = judge.judge(record(refusal="too stiff"), {"refusal": "beyond the limit"})
    assert verdict.held and "beyond the limit" in verdict.text


@pytest.mark.parametrize("fault", [{"finite": False}, {"hung": True}, {"broke": "KeyError"}, {"momentum": [1.0]}])
def test_no_number_no_end_and_no_answer_cannot_be_listed(fault):
    every = dict.fromkeys(("finite", "time", "broke", "momentum", "refusal", "strain", "energy"), "because")
    assert not judge.judge(record(**fault), every).held


def test_the_decay_bounds_every_damped_oscillator():
    """x'' + c x' + w^2 x = 0 from x = 1 at rest, by its two roots, below, at and above critical damping."""
    for w, c in ((10.0, 1.0), (5.0, 10.0 - 1e-6), (1.0, 10.0), (0.1, 10.0)):
        r1, r2 = np.roots([1.0, c, w * w]).astype(complex)
        for t in np.linspace(0.0, 20.0, 200):
            x = ((r1 * np.exp(r2 * t) - r2 * np.exp(r1 * t)) / (r1 - r2)).real
            assert abs(x) <= judge.decay(w, c, t) * (1.0 + 1e-6) + 1e-12


@pytest.mark.parametrize("kind, more", [("springs", {}), ("membrane", {}), ("membrane", {"fabric": {"poisson": -0.9}})])
def test_energies_agree_with_the_engine(kind, more):
    """A scattered sheet in float64; both sum the same terms in other orders."""
    simulation = Simulation(solvers.given(scenes.hung(kind, **more), SWEEPS), device="cpu", precision="float64")
    simulation.set("/sheet", "positions", simulation.positions() + 0.01 * np.random.default_rng(0).normal(size=(81, 3)))
    (_, parts), = energy.elastic_of(simulation.scene)
    assert parts.stored(simulation.positions()) == pytest.approx(simulation.indicators()["elastic_energy"], rel=1e-9)


@pytest.mark.parametrize("poisson", [0.0, -0.9, 0.49])
def test_a_substep_frees_no_more_than_is_stored(poisson):
    (_, parts), = energy.elastic_of(scenes.hung(fabric={"poisson": poisson}))
    x = scenes.hung().cloths[0].points * np.array([1.1, 0.9, 1.0])
    whole, h = parts.stored(x), 1.0 / 600.0
    assert 0.0 < parts.stored(x, 10.0 * h) < parts.stored(x, h) < whole
    assert parts.stored(x, 1e-9) == pytest.approx(whole, rel=1e-6)


def test_the_fastest_frequency_is_above_the_exact_one():
    """Of a chain of equal masses, fixed at one end: 2 sqrt(k / m) cos(pi / (2 (2 n + 1))), below the row sum's."""
    chain = scenes.chain(np.full(9, 0.01), 100.0)
    exact = 2.0 * np.sqrt(100.0 / 0.01) * np.cos(np.pi / (2 * (2 * 8 + 1)))
    assert exact <= energy.fastest(chain) <= 1.02 * exact


def test_an_explicit_solver_beyond_its_limit_is_listed_and_others_are_not():
    stiff = scenes.hung("springs", 1e9)
    leapfrog = next(s for s in solvers.SOLVERS if s.integrator == "leapfrog")
    assert "refusal" in solvers.listed(stiff, leapfrog)
    assert not solvers.listed(stiff, AUTO) and not solvers.listed(scenes.hung("springs", 1.0), leapfrog)


def test_auto_is_never_excused_but_where_the_scene_itself_is_wrong():
    excused = {r.name for r in table.ROWS if r.reasons("auto", "auto")}
    assert excused == {"coincident, rest 0"} | {f"soft {name}, corotational" for name in soft_rows.HEAPS}


def test_a_named_explicit_solver_is_excused_only_far_from_rest_and_implicit_ones_are_not():
    excused = {r.name for r in rows.ROWS if "energy" in r.reasons("explicit", "leapfrog")}
    assert "one place, springs" in excused and not {"springs 1e3", "walls", "wind", "gravity", "rest", "float"} & excused
    implicit = (("xpbd", "bdf2"), ("implicit", "backward_euler"))
    assert not any("energy" in r.reasons(s, i) for r in rows.ROWS for s, i in implicit)


def test_the_midpoint_is_excused_only_where_its_step_does_not_resolve():
    midpoint = next(s for s in solvers.SOLVERS if s.name == "implicit/implicit_midpoint")
    assert "energy" in solvers.listed(scenes.hung("springs", 1e7), midpoint)
    assert not solvers.listed(scenes.hung("springs", 1.0), midpoint) and not solvers.listed(scenes.hung("springs", 1e7), SWEEPS)


def test_names_of_rows_are_unique_and_wrong_ones_are_refused():
    assert len({r.name for r in table.ROWS}) == len(table.ROWS)
    with pytest.raises(ValueError, match="names no row"):
        chosen(["nothing of that name"], "")
    with pytest.raises(ValueError, match="names none"):
        chosen([], "nobody")


def test_a_hang_is_seen_and_the_next_case_runs():
    worker = run.Worker()
    try:
        assert worker.ask(abs, (-1,), 60.0) == (True, 1)
        done, why = worker.ask(time.sleep, (600.0,), 0.5)
        assert not done and "no answer" in why
        assert worker.ask(abs, (-2,), 60.0) == (True, 2)
    finally:
        worker.end()


def test_a_dead_process_is_seen():
    worker = run.Worker()
    done, why = worker.ask(exit, (3,), 60.0)
    assert not done and "died" in why


@pytest.mark.parametrize("name", ["springs 1e9", "membrane 1e-3", "scrambled, membrane", "shuffled, springs",
                                  "through the sheet", "yanked", "1 km/s", "coincident, rest > 0", "needles 1:100",
                                  "slivers 1:100", "slivers 1:100000", "buttons", "twelve decades"])
def test_the_abuse_ends_finite_and_recovers(name):
    short = replace(row(name), settle=min(row(name).settle, 240))
    found = run.case(short, SWEEPS, "cpu")
    verdict = verdict_of(found, short, SWEEPS)
    assert verdict.held, verdict.text


def test_momentum_stays_in_free_flight():
    found = run.case(replace(row("float"), frames=60, settle=30), SWEEPS, "cpu")
    assert found.momentum and max(found.momentum) < row("float").momentum


def test_an_energy_put_in_behind_the_ledgers_back_is_found():
    """An act that throws the sheet and says that it changed nothing."""
    liar = replace(row("float"), act=lambda r, frame: bool(acts.once(lambda q: acts.thrown(10.0, q), r, frame)) and False,
                   frames=3, settle=3)
    assert "energy" in [kind for kind, _ in judge.faults(run.case(liar, SWEEPS, "cpu"))]


def test_points_joined_at_one_place_part_by_no_more_than_a_rounding():
    places = np.zeros((4, 3))
    places[3] = 1.0
    edges, rest = np.array([[0, 1], [1, 2], [2, 3]]), np.array([0.1, 0.2, 0.3])
    moved = separate_coincident_ends(places, edges, rest)
    assert len(np.unique(moved, axis=0)) == 4 and np.array_equal(moved[3], places[3])
    assert np.abs(moved - places).max() <= 0.5 * NUDGE * 0.2


def test_points_that_need_no_parting_stay_as_they_are():
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert separate_coincident_ends(places, np.array([[0, 1]]), np.array([1.0])) is places
    assert separate_coincident_ends(places, np.array([[0, 2]]), np.array([0.0])) is places


# soft bodies

@pytest.mark.parametrize("model", soft_rows.MODELS)
def test_energies_of_tets_agree_with_the_engine(model):
    simulation = Simulation(replace(soft_rows.bar(model=model), solver="implicit", integrator="backward_euler"), device="cpu",
                            precision="float64")
    simulation.set("/bar", "positions", simulation.positions() + 0.02 * np.random.default_rng(0).normal(size=(45, 3)))
    (_, parts), = energy.elastic_of(simulation.scene)
    found, x = simulation.indicators(), simulation.positions()
    assert parts.stored(x) == pytest.approx(found["elastic_energy"], rel=1e-9)
    assert parts.strain(x).max() == pytest.approx(found["solid_strain"], rel=1e-9)


def test_the_fastest_frequency_of_tets_is_that_of_the_reference():
    pytest.importorskip("scipy")
    from tools.bench.soft.reference import Solid
    scene = soft_rows.bar()
    soft = scene.softs[0]
    solid = Solid(soft.points, soft.tets, scene.pins[0].points)
    free, root = solid.moving(), np.repeat(solid.masses, 3)**-0.5
    K = solid.tangent(solid.points).toarray() * root[:, None] * root
    assert energy.fastest(scene) == pytest.approx(np.linalg.eigvalsh(K[np.ix_(free, free)])[-1]**0.5, rel=1e-5)


def test_leapfrog_may_swing_as_far_as_its_invariant_lets_it():
    """x'' = -x from rest and from the middle, in NumPy."""
    h, most = 1.5, 0.0
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        start = 0.5 * (x * x + v * v)
        for _ in range(200):
            v -= 0.5 * h * x
            x += h * v
            v -= 0.5 * h * x
            most = max(most, 0.5 * (x * x + v * v) / start)
    assert 0.95 * judge.leapfrog_swing(0.5 * h) < most <= judge.leapfrog_swing(0.5 * h) * (1.0 + 1e-12)


@pytest.mark.parametrize("name", ["soft 1e6", "soft inside out, corotational", "soft inside out, neo_hookean"])
def test_a_soft_body_ends_finite_and_recovers(name):
    found = run.case(row(name), AUTO, "cpu")
    verdict = verdict_of(found, row(name), AUTO)
    assert verdict.held, verdict.text


def test_a_body_that_stays_turned_is_strained():
    """Mirrored, every tet is its own mirror image: the stretches are 1, 1, -1."""
    (_, parts), = energy.elastic_of(soft_rows.bar())
    x = soft_rows.bar().softs[0].points.astype(float)
    np.testing.assert_allclose(parts.strain(soft_rows.turned(x, None)), 2.0, rtol=1e-6)
    assert parts.strain(x).max() < 1e-6


@pytest.mark.parametrize("fault, held", [({}, True), ({"energy": [0.0, 0.3, 0.0]}, False), ({"energy": [0.0, 0.02, 0.0]}, True),
                                         ({"energy": [0.0, 0.3, 0.0], "besides": "a pin moves"}, True),
                                         ({"energy": [0.0, 1.0, 0.0], "besides": "a pin moves"}, False),
                                         ({"rms": [0.1, 0.11]}, False), ({"largest": [0.1, np.nan]}, False),
                                         ({"broke": "KeyError"}, False), ({"refusal": "no tetrahedra"}, True)])
def test_an_example_scene_is_held_against_a_converged_run(fault, held):
    """A run that gains energy, ends with ten times the strain, or breaks; one that this solver is not for is listed."""
    right = examples.Example("s", "converged", [0.0, -1.0, -2.0], [0.5, 1.0], [0.01, 0.01], [0.05, 0.05])
    verdict = examples.judge(replace(right, solver="xpbd/bdf2", **fault), right)
    assert verdict.held == held
    assert "tetrahedra" in verdict.text or not fault.get("refusal")


def test_every_solver_and_integrator_of_a_scene_is_asked():
    """A row that only `auto` runs says nothing of the others."""
    asked = {(s.solver, s.integrator) for s in solvers.available()}
    assert asked >= {(solver, integrator.name) for integrator in TABLE.values() for solver in SOLVERS
                     if solver != "auto" and (solver == "explicit") == integrator.explicit}
