"""Bending is a property of the material, not of the mesh: strips, modes, gradients of `wsim.physics.cloth.bending`; sheets that
are run."""

from types import SimpleNamespace

import numpy as np
import pytest

from tools.bench.bending.cantilever import drop, stiffness
from tools.bench.bending.strips import LENGTH, MESHES, WIDTH, strip
from wsim.fitting import Settings, Track, fit
from wsim.geometry import topology
from wsim.model.model import make_body
from wsim.physics.cloth import bending
from wsim.physics.cloth.constraints import constraints_of_body
from wsim.physics.cloth.kind import kind_row
from wsim.physics.motion import frequency
from wsim.scene import Cloth, Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

meshes = pytest.mark.parametrize("mesh", MESHES)
DOUBLE = {"device": "cpu", "precision": "float64"}


@meshes
def test_a_strip_bends_alike_on_every_mesh_with_order_two(mesh):
    """Within 1.3 % at ten cells, and a quarter of that with each halving. Hinges, each by itself, are off by 6 to 50 % at forty
    (tools/results/data/bending.json)."""
    for cells in (10, 20, 40):
        assert drop(mesh, cells) == pytest.approx(1.0, abs=1.3e-2 * (10.0 / cells)**2)


def test_the_way_that_triangles_are_wound_does_not_matter():
    assert drop("irregular", 10, flip=True) == pytest.approx(drop("irregular", 10), rel=1e-9)


@meshes
def test_nothing_but_a_plane_has_no_energy(mesh):
    """Three modes of a free sheet; the fourth bends it, with at least a quarter of what a free plate's lowest mode has (13.5 B:
    Leissa 1969, table 4.1, of a square) for its narrow width."""
    points, triangles, _ = strip(mesh, 8)
    values = np.linalg.eigvalsh(stiffness(points, triangles, np.zeros(len(points), bool)))
    assert np.abs(values[:3]).max() < 1e-10 * values[-1] and values[3] > 1e-6 * values[-1]


def curved(points: np.ndarray, S: np.ndarray) -> np.ndarray:
    """w = x S x / 2."""
    return 0.5 * np.einsum("ni,ij,nj->n", points[:, :2], S, points[:, :2])


@meshes
def test_the_curvature_of_a_quadratic_surface_is_exact(mesh):
    """Of triangles whose hinges are all there: within what SHARP leaves, 1e-3."""
    points, triangles, _ = strip(mesh, 20)
    ids = topology.hinges_of_triangles(triangles)
    found = bending.sheet_patches(points, triangles, ids, np.zeros(len(points), bool))
    coupling, inverse = bending.hinge_coupling(points, found)
    S = np.array([[0.7, -0.4], [-0.4, 1.9]])
    rows, body = SimpleNamespace(ids=ids), SimpleNamespace(rest=points, first=0)
    G = kind_row("dihedral").slopes(rows, body)[:, 0, :, 2]
    z = (G * curved(points, S)[ids]).sum(axis=1) / np.sqrt(inverse)
    slot = np.maximum(coupling.slot, 0)
    C = (np.where(coupling.slot >= 0, z[slot], 0.0)[..., None] * coupling.value).sum(axis=1)
    inside = (coupling.slot >= 0).all(axis=1)
    area = topology.triangle_areas(points, triangles)
    assert inside.sum() > 10
    np.testing.assert_allclose((C**2).sum(axis=1)[inside] / area[inside], (S**2).sum(), rtol=2e-3)


@meshes
def test_hinges_alone_of_these_compliances_are_at_least_as_stiff(mesh):
    """What XPBD's stability and its bound rest on: sum |C_t|^2 <= sum z^2, and not by a factor of more than 1.2 anywhere."""
    points, triangles, pinned = strip(mesh, 8)
    found = bending.sheet_patches(points, triangles, topology.hinges_of_triangles(triangles), pinned)
    coupling, _ = bending.hinge_coupling(points, found)
    V = np.zeros((3 * len(coupling.slot), len(found.ids)))
    for s in range(bending.SLOTS):
        at = np.flatnonzero(coupling.slot[:, s] >= 0)
        for r in range(3):
            V[3 * at + r, coupling.slot[at, s]] += coupling.value[at, s, r]
    top = float(np.linalg.norm(V, 2)**2)
    assert 0.8 < top <= 1.0 + 1e-12


def test_gradients_by_points_at_rest_are_those_of_differences():
    """At 1 m and at 1 cm, of a curved sheet with a clamp, an edge of three triangles, and one that is wound the other way."""
    rng = np.random.default_rng(1)
    points, triangles, pinned = strip("irregular", 5)
    triangles[7] = triangles[7][[0, 2, 1]]
    triangles = np.concatenate([triangles, [[triangles[9, 0], triangles[9, 1], len(points)]]]).astype(np.int32)
    points = np.concatenate([points, [[0.4, 0.1, 0.5]]])
    points[:, 2] += 0.1 * np.sin(3.0 * points[:, 0]) + 0.01 * rng.normal(size=len(points))
    ids = topology.hinges_of_triangles(triangles)
    for size in (1.0, 0.01):
        p = size * points
        found = bending.sheet_patches(p, triangles, ids, np.append(pinned, False))
        assert len(found.alone) == 2 and not found.bends.all()
        coupling, inverse = bending.hinge_coupling(p, found)
        by_value, by_inverse = rng.normal(size=coupling.value.shape), rng.normal(size=inverse.shape)

        def loss(p, by_value=by_value, by_inverse=by_inverse, found=found):
            c, inverse = bending.hinge_coupling(p, found)
            return (c.value * by_value).sum() + (inverse * by_inverse).sum()
        way, h = rng.normal(size=p.shape), 3e-5 * size
        slope = sum(w * (loss(p + k * h * way) - loss(p - k * h * way))
                    for k, w in enumerate((4 / 5, -1 / 5, 4 / 105, -1 / 280), 1)) / h
        assert (bending.rest_point_gradient(p, found, by_value, by_inverse) * way).sum() == pytest.approx(slope, rel=1e-7)


def sheet(mesh: str = "irregular", cells: int = 6, curved: float = 0.0, clamped: bool = True, **more) -> Scene:
    """A strip that leaves a wall, if clamped; curved: curvature of its rest shape, about y."""
    points, triangles, pinned = strip(mesh, cells)
    if curved:
        x = points[:, 0]
        points = np.stack([np.sin(curved * x) / curved, points[:, 1], (1.0 - np.cos(curved * x)) / curved], axis=1)
    fabric = {"stretch": 500.0, "shear": 200.0, "bend": 2.0, "thickness": 1e-3, "density": 100.0} | more.pop("fabric", {})
    scene = Scene(up="Z", gravity=(0.0, 0.0, -9.81), **more)
    cloth = scene.cloth("/strip", points, np.full(len(triangles), 3), triangles.ravel(), material=Fabric(**fabric),
                        flat=not curved)
    if clamped:
        scene.pin("/wall", cloth, np.flatnonzero(pinned))
    return scene


def rolled(points: np.ndarray, kappa: float) -> np.ndarray:
    x = points[:, 0]
    return np.stack([np.sin(kappa * x) / kappa, points[:, 1], (1.0 - np.cos(kappa * x)) / kappa], axis=1)


@pytest.mark.parametrize("mesh", ["alternating", "irregular"])
@pytest.mark.parametrize("solver", ["explicit", "xpbd", "implicit"])
def test_a_rolled_up_sheet_stores_half_bend_curvature_squared(mesh, solver):
    """A quarter of a turn, reported alike whatever solves; a rolled-up rest shape stores nothing. Chords leave 1 %,
    and free ends, which bear no moment, half a cell each."""
    kappa = np.pi / 2.0
    scene = sheet(mesh, 16, clamped=False, fabric={"stretch": 1e-6, "shear": 0.0}, solver=solver, substeps=4)
    sim = Simulation(scene, **DOUBLE)
    assert sim.indicators()["elastic_energy"] < 1e-20
    sim.set("/strip", "positions", rolled(scene.cloths[0].points, kappa))
    assert sim.indicators()["elastic_energy"] == pytest.approx(0.5 * 2.0 * kappa**2 * LENGTH * WIDTH, rel=1e-2)
    if solver == "explicit":
        still = Simulation(sheet(mesh, 16, curved=kappa, solver=solver, substeps=40), **DOUBLE)
        assert still.indicators()["elastic_energy"] < 1e-12


def test_energy_is_kept_where_nothing_damps():
    """Leapfrog, order 2 in the step: a strip let go, whose bending takes up what it falls."""
    kept = []
    for substeps in (60, 120):
        sim = Simulation(sheet(solver="explicit", integrator="leapfrog", substeps=substeps), **DOUBLE)
        sim.run(12)
        found = sim.indicators()
        kept.append(abs(found["energy"]) / found["elastic_energy"])
    assert kept[0] < 1e-4 and kept[1] < 0.3 * kept[0]


def test_the_bound_of_the_frequency_holds_and_is_near():
    for mesh in MESHES:
        points, triangles, _ = strip(mesh, 8)
        sim = Simulation(sheet(mesh, 8, fabric={"stretch": 1e-6, "shear": 0.0}, solver="xpbd", substeps=1), **DOUBLE)
        bound, low = frequency.frequency_bound(sim.model)[0], frequency.frequency_estimate(sim.model, 200)
        pinned = sim.scene.pins[0].points
        K, free = stiffness(points, triangles, np.isin(np.arange(len(points)), pinned)), np.ones(len(points), bool)
        free[pinned] = False
        root = 1.0 / np.sqrt(sim.model.body(None).masses[sim.model.body(None).index])[free]
        true = np.sqrt(2.0 * np.linalg.eigvalsh(root[:, None] * K[np.ix_(free, free)] * root)[-1])
        assert 0.9 * true < low < (1.0 + 1e-9) * true < bound < 2.0 * true


@pytest.mark.parametrize("solver, integrator, iterations", [("implicit", "backward_euler", 4), ("xpbd", "backward_euler", 8)])
def test_solvers_come_to_rest_where_the_beam_does(solver, integrator, iterations):
    """Newton's method in some large steps; sweeps, which shift angles at rest by what neighbours have, in smaller ones."""
    newton = solver == "implicit"
    scene = sheet("irregular", 8, fabric={"density": 20.0, "stretch": 5e4, "shear": 2e4}, solver=solver, integrator=integrator,
                  iterations=iterations, substeps=1 if newton else 120, fps=2.0 if newton else 60.0,
                  air_drag=0.0 if newton else 10.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(12 if newton else 60)
    x, at = sim.positions(), scene.cloths[0].points[:, 0] > LENGTH - 1e-6
    assert -x[at, 2].mean() == pytest.approx(20e-3 * 9.81 * LENGTH**4 / (8.0 * 2.0), rel=0.025)


def test_bend_of_one_motion_is_the_same_fitted_on_another_mesh():
    """Diagonals the other way: hinges alone differed by a fifth and more."""
    def scene(mesh: str) -> Scene:
        return sheet(mesh, 12, solver="explicit", integrator="leapfrog", substeps=220, fps=24.0, frames=6)
    sim = Simulation(scene("alternating"), **DOUBLE)
    seen = []
    for _ in range(6):
        sim.run(1)
        seen.append(sim.positions())
    found = fit(scene("diagonal"), [Track("/strip", np.arange(1, 7), np.array(seen))], "bend", start={"bend": 4.0},
                settings=Settings(device="cpu", accuracy=0.003))
    assert found.values["bend"] == pytest.approx(2.0, rel=0.02)


def test_a_live_rest_shape_gives_other_curvatures():
    """As if the scene had been made with it."""
    points = sheet().cloths[0].points
    new = points + 0.02 * np.random.default_rng(2).normal(size=points.shape)
    sims = [Simulation(sheet(substeps=200, integrator="leapfrog"), **DOUBLE) for _ in range(2)]
    cloth = sims[1].scene.cloths[0]
    sims[0].set("/strip", "rest_shape", new)
    cloth.rest_points = new
    other = Simulation(sims[1].scene, **DOUBLE)
    for sim in (sims[0], other):
        sim.run(2)
    np.testing.assert_allclose(sims[0].positions(), other.positions(), atol=1e-12)


def test_a_fan_of_three_triangles_and_a_sliver_bend_as_hinges():
    """Three on an edge, one of no height: numbers, and a hinge by itself bend l^2 / A."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 1], [0.2, -1, 0], [0.35, -1, 0]], float)
    triangles = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [0, 5, 3], [5, 6, 3]], np.int32)
    ids = topology.hinges_of_triangles(triangles)
    found = bending.sheet_patches(points, triangles, ids, np.zeros(7, bool))
    coupling, inverse = bending.hinge_coupling(points, found)
    assert np.isfinite(coupling.value).all() and np.isfinite(inverse).all() and len(found.alone) == 3
    edge = [k for k in range(len(ids)) if set(ids[k, :2]) == {0, 1}]
    np.testing.assert_allclose(1.0 / inverse[edge], 1.0, rtol=1e-12)                 # l = 1, A = 1/2 + 1/2


def test_triangles_without_a_height_divide_nothing_and_leave_gradients_alone():
    """One of three points in a row, one of an edge without length, and then all in one place: they have no curvature."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.2, -1, 0], [0.35, -1, 0], [0.35, -1, 0]], float)
    triangles = np.array([[0, 1, 2], [1, 0, 3], [0, 4, 3], [4, 5, 3], [3, 5, 6]], np.int32)
    ids, whole = topology.hinges_of_triangles(triangles), topology.hinges_of_triangles(triangles[:3])
    good = np.array([(row == whole).all(axis=1).any() for row in ids])
    with np.errstate(divide="raise", invalid="raise"):
        both = [bending.sheet_patches(points, triangles, ids[good], np.zeros(7, bool)),
                bending.sheet_patches(points, triangles[:3], whole, np.zeros(7, bool))]
        (one, inverse), (other, less) = (bending.hinge_coupling(points, found) for found in both)
        assert (one.value[3:] == 0.0).all() and (one.value[:3] == other.value).all() and (inverse == less).all()
        by = [bending.rest_point_gradient(points, found, np.ones_like(c.value), np.ones_like(inverse))
              for found, c in zip(both, (one, other), strict=True)]
        assert (by[0] == by[1]).all() and np.abs(by[0]).max() > 0.1
        nothing = bending.sheet_patches(0.0 * points, triangles, ids[:0], np.zeros(7, bool))
        assert (bending.hinge_coupling(0.0 * points, nothing)[0].value == 0.0).all()


def test_a_sheet_of_shapes_has_hinges_of_every_kind_of_cut():
    """Quads, as an author has them, bend as their triangles do."""
    found = []
    for cut in ("quads", "diagonal"):
        cloth = Cloth("/c", *shapes.sheet(1.0, 0.6, 6, 4, cut=cut), material=Fabric(bend=1.0))
        (hinges,) = [r for r in constraints_of_body(make_body(cloth, 0, 0, 0)) if r.kind == "dihedral"]
        found.append(np.sort(hinges.alpha))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
