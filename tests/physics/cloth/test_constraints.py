"""How stiff the constraints of a cloth are together: closed forms of sheets, strips, cylinders and cantilevers."""

from dataclasses import replace
from math import isfinite

import numpy as np
import pytest

from tools.bench.bending.strips import strip
from tools.bench.nets import reference
from wsim.model.model import make_body
from wsim.physics.cloth.constraints import constraints_of_body
from wsim.physics.cloth.kinds.tether import tether_constraints
from wsim.scene import Cloth, Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}
FABRIC = Fabric(stretch=1000.0, shear=400.0, bend=2e-4, poisson=0.3)


def body(points, counts, indices, **more):
    return make_body(Cloth("/cloth", points, counts, indices, **more), 0, 0, 0)


def energy(F, model: str = "membrane", cut: str = "alternating", fabric: Fabric = FABRIC, size=(0.7, 0.5)) -> float:
    """Elastic energy per area [J/m^2] of a flat sheet under the deformation F of its plane (2 x 2)."""
    points, counts, indices = shapes.sheet(*size, 5, 5, cut=cut)
    scene = Scene(solver="xpbd")
    scene.cloth("/cloth", points, counts, indices, material=fabric, model=model)
    sim = Simulation(scene, **DOUBLE)
    start = sim.positions()
    start[:, :2] = start[:, :2] @ np.asarray(F, float).T
    sim.set("/cloth", "positions", start)
    return sim.indicators()["elastic_energy"] / (size[0] * size[1])


# the membrane against psi of wsim.scene.fabric; rest points are float32: right to 1e-6

@pytest.mark.parametrize("cut", ["alternating", "quads"])
def test_a_strip_that_contracts_freely_has_the_stiffness_e_t(cut):
    """e_v = -nu e_u: psi = 1/2 E t e^2, and psi is least there."""
    e, nu = 0.02, FABRIC.poisson
    at = {d: energy(np.diag([1 + e, 1 - nu * e + d]), cut=cut) for d in (-1e-3, 0.0, 1e-3)}
    assert at[0.0] == pytest.approx(0.5 * FABRIC.stretch * e**2, rel=1e-4)
    curvature = FABRIC.stretch / (1.0 - nu**2)
    assert at[1e-3] - at[-1e-3] == pytest.approx(0.0, abs=1e-4 * curvature * e * 1e-3)
    assert at[1e-3] + at[-1e-3] - 2 * at[0.0] == pytest.approx(curvature * 1e-6, rel=1e-3)


def test_a_weft_of_its_own_counts_across_the_warp():
    """Along x a strip of `stretch`, along y one of `weft`, each free to contract; both stretched are coupled by their root."""
    fabric, e = replace(FABRIC, weft=4.0 * FABRIC.stretch), 0.02
    nu, s2 = fabric.poisson, 4.0
    along = energy(np.diag([1 + e, 1 - nu * e / s2**0.5]), fabric=fabric)
    across = energy(np.diag([1 - nu * e * s2**0.5, 1 + e]), fabric=fabric)
    assert along == pytest.approx(0.5 * fabric.stretch * e**2, rel=1e-4)
    assert across == pytest.approx(0.5 * fabric.weft * e**2, rel=1e-4)
    both = energy(np.diag([1 + e, 1 + e]), fabric=fabric)
    assert both == pytest.approx(0.5 * fabric.stretch * (1 + s2 + 2 * nu * s2**0.5) / (1 - nu**2) * e**2, rel=1e-4)


def test_warp_and_weft_stretched_together_are_coupled_by_poisson():
    """psi = E t e^2 / (1 - nu)."""
    assert energy(np.diag([1.01, 1.01])) == pytest.approx(FABRIC.stretch * 1e-4 / 0.7, rel=1e-4)


@pytest.mark.parametrize("size", [(0.7, 0.5), (0.5, 0.5)])
def test_shear_has_the_stiffness_g_t(size):
    g = 0.03
    assert energy([[1.0, g / 2], [g / 2, 1.0]], size=size) == pytest.approx(0.5 * FABRIC.shear * g**2, rel=1e-4)


def test_a_turned_sheet_stores_nothing():
    c, s = np.cos(0.6), np.sin(0.6)
    assert energy([[c, -s], [s, c]]) < 1e-9 * FABRIC.stretch


def strip_under_load(poisson: float):
    """A strip of 0.2 m x 1 m hanging by its top edge with 2 N on its bottom edge, at rest: (x, y) of points by row."""
    points, counts, indices = shapes.sheet(0.2, 1.0, 4, 20)
    rows = np.arange(21 * 5).reshape(21, 5)
    share, masses = np.array([0.125, 0.25, 0.25, 0.25, 0.125]), np.full(105, 2e-4)
    masses[rows[-1]] = share * 2.0 / 9.81
    scene = Scene(fps=60.0, substeps=50, iterations=12, air_drag=50.0)
    cloth = scene.cloth("/cloth", points, counts, indices, masses=masses,
                        material=Fabric(stretch=1000.0, shear=500.0 / (1.0 + poisson), bend=0.0, poisson=poisson))
    scene.pin("/pin", cloth, rows[0])
    sim = Simulation(scene, **DOUBLE)
    sim.run(90)
    return sim.positions()[rows]


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_a_hanging_strip_gives_by_its_load_over_e_t_and_contracts_by_poisson(poisson):
    """In the middle half, two widths from the clamp (Saint-Venant: exp(-4 pi) of the clamp's effect). Its own weight,
    2e-4 kg a point, is counted. Fifty substeps: of 10 x 40 sweeps the strip is 3 % too short."""
    x = strip_under_load(poisson)
    rows = np.arange(21)
    strain = (x[6, 2, 1] - x[15, 2, 1]) / (9 * 0.05) - 1.0
    below = np.mean([2.0 + 9.81 * 2e-4 * 5 * (20 - r - 1) for r in rows[6:15]])        # held by the gap under row r
    assert strain == pytest.approx(below / 0.2 / 1000.0, rel=1e-3)
    width = (x[8:13, -1, 0] - x[8:13, 0, 0]).mean() / 0.2 - 1.0
    assert width == pytest.approx(-poisson * strain, abs=5e-3 * strain)


# the springs model

def test_springs_of_quads_stretch_as_they_say():
    """Along warp: edges 1/2 stretch e^2; both diagonals of a square are strained by e/2: with shear 0 there are none."""
    e = 0.01
    fabric = Fabric(stretch=1000.0, shear=0.0, bend=0.0)
    for F in (np.diag([1 + e, 1]), np.diag([1, 1 + e])):
        assert energy(F, "springs", "quads", fabric) == pytest.approx(0.5 * 1000.0 * e**2, rel=1e-4)
    assert energy(np.diag([1 + e, 1 + e]), "springs", "quads", fabric) == pytest.approx(1000.0 * e**2, rel=1e-4)


def test_springs_without_diagonals_do_not_resist_shear():
    g, fabric = 1e-3, Fabric(stretch=1000.0, shear=0.0, bend=0.0)
    stored = energy([[1.0, g / 2], [g / 2, 1.0]], "springs", "quads", fabric)
    assert stored == pytest.approx(1000.0 * (g * g / 8.0) ** 2, rel=0.3)             # edges lengthen by g^2 / 8 only


def test_diagonals_of_squares_give_the_shear_stiffness():
    """Each of the two is strained by g / 2: 2 k (l g / 2)^2 / 2 = 1/2 shear g^2 A."""
    g, fabric = 0.01, Fabric(stretch=1000.0, shear=400.0, bend=0.0)
    stored = energy([[1.0, g / 2], [g / 2, 1.0]], "springs", "quads", fabric, size=(0.5, 0.5))
    assert stored == pytest.approx(0.5 * 400.0 * g**2, rel=1e-2)


def test_springs_of_quads_are_edges_and_both_diagonals():
    b = body(*shapes.sheet(1.0, 1.0, 3, 4, cut="quads"), model="springs", material=Fabric(bend=0.0))
    stretch, shear = constraints_of_body(b)
    assert (len(stretch.ids), len(shear.ids)) == (3 * 5 + 4 * 4, 2 * 12)
    np.testing.assert_allclose(shear.rest, np.hypot(1 / 3, 1 / 4), rtol=1e-6)
    np.testing.assert_allclose(1.0 / stretch.shape * stretch.rest**2, [
        (1 / 12) * (0.5 if edge else 1.0) for edge in border(b, stretch.ids)], rtol=1e-6)


def border(b, ids) -> np.ndarray:
    """Whether both ends lie on one side of the sheet."""
    p = b.rest[ids - b.first]
    return np.any([(np.abs(np.abs(p[:, :, k]) - 0.5) < 1e-6).all(1) & (np.ptp(p[:, :, k], axis=1) < 1e-6) for k in (0, 1)],
                  axis=0)


# hinges

def angles(x, ids) -> np.ndarray:
    """Angle between the normals on both sides of each hinge."""
    p = x[ids]
    n2 = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    n3 = np.cross(p[:, 3] - p[:, 0], p[:, 1] - p[:, 0])
    return np.arctan2(np.linalg.norm(np.cross(n2, n3), axis=1), (n2 * n3).sum(1))


def on_cylinder(rest, kappa: float, along=(1.0, 0.0)) -> np.ndarray:
    """The plane rolled up along a direction, without stretch."""
    u = np.asarray(along) / np.linalg.norm(along)
    s, t = rest[:, :2] @ u, rest[:, :2] @ np.array([-u[1], u[0]])
    flat = np.sin(kappa * s)[:, None] / kappa * u + t[:, None] * np.array([-u[1], u[0]])
    return np.concatenate([flat, (1.0 - np.cos(kappa * s))[:, None] / kappa], axis=1)


def test_rest_angles_are_flat_or_those_of_the_rest_shape():
    points, counts, indices = shapes.sheet(1.0, 0.6, 10, 4)
    rolled = on_cylinder(points, 2.0)
    for flat in (True, False):
        b = body(rolled, counts, indices, material=FABRIC, flat=flat)
        (hinges,) = [r for r in constraints_of_body(b) if r.kind == "dihedral"]
        wanted = np.zeros(len(hinges.ids)) if flat else angles(b.rest, hinges.ids)
        np.testing.assert_allclose(np.abs(hinges.rest), wanted, atol=1e-5)


def clamped_strip(mesh: str, cells: int = 10) -> tuple[float, float, float, float]:
    """Bend [N m], length [m] from the clamp, reach and drop [m] of a strip clamped at one end, at rest; 2 N/m^2. Two columns
    are pinned, and the strip begins at the second."""
    weight, length = 2.0, 0.2
    bend = weight * length**3 / 2.0
    points, triangles, pinned = strip(mesh, cells)
    points = length * points[:, [0, 2, 1]] * (1.0, 1.0, -1.0)
    scene = Scene(fps=60.0, substeps=100, iterations=6, air_drag=30.0)
    cloth = scene.cloth("/cloth", points, np.full(len(triangles), 3), triangles.ravel(), material=Fabric(
        stretch=2e3, shear=8e2, bend=bend, thickness=1e-3, density=weight / 9.81 / 1e-3))
    scene.pin("/pin", cloth, np.flatnonzero(pinned))
    sim = Simulation(scene, **DOUBLE)
    sim.run(90)
    tip = sim.positions()[points[:, 0] > length - 1e-6].mean(axis=0)
    return bend, length, tip[0], -tip[1]


@pytest.mark.slow
@pytest.mark.parametrize("mesh", ["alternating", "irregular"])
def test_a_strip_clamped_at_one_end_hangs_as_the_elastica(mesh):
    """Far beyond small angles, on meshes whose hinges alone made plates of their own: ten cells leave up to 1.3 %."""
    bend, length, reach, drop = clamped_strip(mesh)
    wanted = reference.cantilever(bend, 2.0, length)
    assert (reach, drop) == (pytest.approx(wanted[0], rel=0.013), pytest.approx(wanted[1], rel=0.013))


# limits, tethers, live parameters

def test_a_strain_limit_holds_every_edge():
    b = body(*shapes.sheet(1.0, 1.0, 4, 4), material=Fabric(strain_limit=0.05))
    (limit,) = [r for r in constraints_of_body(b) if r.kind == "limit"]
    assert len(limit.ids) == len(b.edges) and not limit.alpha.any()
    p = b.rest[limit.ids]
    np.testing.assert_allclose(limit.rest, 1.05 * np.linalg.norm(p[:, 1] - p[:, 0], axis=1), rtol=1e-12)


def test_tethers_are_the_shortest_ways_along_rest_edges():
    graph = pytest.importorskip("scipy.sparse.csgraph")
    from scipy.sparse import coo_matrix
    points, counts, indices = shapes.sheet(1.0, 1.5, 6, 9)
    b = body(points, counts, indices, tethers=True)
    pinned = b.index[[0, 6]]
    (rows,) = tether_constraints(b, pinned)
    p = b.rest[b.edges]
    i, j = b.edges.T
    way = graph.dijkstra(coo_matrix((np.linalg.norm(p[:, 1] - p[:, 0], axis=1), (i, j)), (b.count, b.count)).tocsr(),
                         directed=False, indices=pinned)
    assert np.array_equal(np.sort(rows.ids[:, 1]), np.setdiff1d(np.arange(b.count), pinned))
    np.testing.assert_allclose(rows.rest, way.min(axis=0)[rows.ids[:, 1]], rtol=1e-12)
    which = np.where(rows.ids[:, 0] == pinned[0], 0, 1)
    assert np.isin(rows.ids[:, 0], pinned).all()
    np.testing.assert_allclose(way[which, rows.ids[:, 1]], rows.rest, rtol=1e-12)     # the pin that is named is that far


def test_no_tethers_without_a_pin_or_a_wish():
    points, counts, indices = shapes.sheet(1.0, 1.0, 2, 2)
    assert tether_constraints(body(points, counts, indices, tethers=True), np.zeros(0, np.int64)) == []
    assert not any(r.kind == "tether" for r in constraints_of_body(body(points, counts, indices), np.array([0])))


@pytest.mark.parametrize("model, name, kind", [("membrane", "stretch", "membrane"), ("membrane", "shear", "membrane"),
                                               ("springs", "stretch", "distance"), ("springs", "shear", "distance"),
                                               ("membrane", "bend", "dihedral")])
def test_a_live_stiffness_scales_just_its_energy(model, name, kind):
    points, counts, indices = shapes.sheet(1.0, 1.0, 4, 4, cut="quads")
    scene = Scene(solver="xpbd")
    cloth = scene.cloth("/cloth", points, counts, indices, model=model, material=Fabric(bend=1.0))
    sim = Simulation(scene, **DOUBLE)
    start = sim.positions()
    bent = {"stretch": start * (1.02, 0.97, 1.0), "shear": start[:, [0, 1, 2]] + start[:, [1, 0, 2]] * (0.01, 0.01, 0.0),
            "bend": on_cylinder(start, 0.5)}[name]
    sim.set("/cloth", "positions", bent)

    def stored():
        method = sim.plan.method("xpbd")
        return {b.kind: b.energy(sim.state, "live_report") for b in method.batches}
    before = stored()
    sim.set("/cloth", name, 3.0 * getattr(cloth.material, name))
    after = stored()
    others = {k: v for k, v in before.items() if k != kind}
    assert {k: v for k, v in after.items() if k != kind} == others
    if model == "membrane":                                  # of a spring net shear is in stretch's batch, and stretched too
        assert after[kind] == pytest.approx(3.0 * before[kind], rel=1e-3)
    else:
        assert before[kind] < after[kind] <= 3.0 * before[kind] * (1.0 + 1e-9)
    assert all(isfinite(v) for v in after.values())


def test_the_first_axis_of_a_membrane_is_x_of_the_rest_shape():
    """Stretched along x: warp; a sheet that stands across x takes y. Different shear shows nothing, C does."""
    points, counts, indices = shapes.sheet(1.0, 1.0, 2, 2)
    upright = points[:, [2, 1, 0]]                                      # in the plane of y and z
    for p, axis in ((points, 0), (upright, 1)):
        b = body(p, counts, indices, material=FABRIC)
        (rows,) = [r for r in constraints_of_body(b) if r.kind == "membrane"]
        x = b.rest.copy()
        x[:, axis] *= 1.1
        corners = x[rows.ids]
        D = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], 2)
        F = D @ rows.rest
        np.testing.assert_allclose(np.linalg.norm(F, axis=1), np.tile([1.1, 1.0], (len(F), 1)), rtol=1e-6)
