"""Grains: contacts against closed forms, conservation, piles at rest, lists of neighbours, and what goes wrong in plain
words."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from wsim.physics.position_based.objects import Grains
from wsim.scene import Scene, SceneError
from wsim.scene.methods import describe_scene_contents

G = 9.81
STILL = Grains(rolling_friction=np.inf)          # grains that do not turn


def grains_on_floor(points, radius=0.005, mu=0.5, floor=True, precision="float32", **more):
    """A simulation of grains above a floor."""
    scene = Scene(**{"fps": 60, "substeps": 8, "iterations": 4} | more)
    if floor:
        scene.collider("/floor", wsim.Plane(), static_friction=mu, dynamic_friction=mu)
    scene.particles("/grains", points=points, radius=radius, material=replace(STILL, static_friction=mu, dynamic_friction=mu))
    return wsim.Simulation(scene, device="cpu", precision=precision)


def cube(n, radius, low=0.0):
    k = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return 2.0 * radius * k + [0.0, radius + low, 0.0]


def grain_method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "grains")


@pytest.mark.parametrize(("steps", "deep", "share"), [((3, 1), True, 0.0), ((8, 1), True, 1.0), ((8, 8), False, 0.0)])
def test_grains_of_a_column_bear_the_weight_above_them_and_the_floor_all_of_it(steps, deep, share):
    """By few iterations for five layers what stands on others is carried, as loads; by more, it comes to be felt; by many,
    contacts bear it from the start."""
    r = 0.004
    simulation = grains_on_floor([[0, r + 2 * r * i, 0] for i in range(5)], r, substeps=steps[0], iterations=steps[1])
    simulation.run(180)
    method, weight = grain_method(simulation), 2600 * 4 / 3 * np.pi * r**3 * G
    assert method.deep == deep and method.most_share == share
    rows = method.support_part.rows["/grains", 0]
    load = method.support.load.numpy()[rows]
    if share == 1.0:
        assert np.abs(load).max() < 2e-3 * weight and method.support.share.numpy()[rows].min() == 1.0
    if share == 1.0 or not deep:
        id, f = (method.part.arrays[name].numpy()[method.part.rows["/grains", 0]].reshape(5, -1, *more)
                 for name, more in (("id", ()), ("f", (3,))))
        first = np.cumsum(id < 0, axis=1) == 0                                  # entries behind the last are old
        load = np.where(first[..., None], np.minimum(f, 0.0), 0.0).sum(axis=1)     # by what lies above
    bound = 1e-4 if share == 0.0 else 2e-3
    assert np.allclose(load[:, 1], -weight * np.arange(4, -1, -1), rtol=bound, atol=bound * weight)
    assert np.abs(load[:, [0, 2]]).max() < 1e-4 * weight
    contacts, h = simulation.plan.method("contact").contacts, 1 / 60 / steps[0]
    assert np.isclose(contacts.impulses(h)["/floor"][1], -5 * weight * h, rtol=bound)
    assert np.abs(simulation.velocities()).max() < 1e-5


@pytest.mark.parametrize(("substeps", "iterations"), [(8, 2), (4, 4)])
def test_thirty_layers_rest_without_overlaps_by_few_iterations(substeps, iterations):
    """A narrow column between walls of no friction; before grains held each other, it lost half of its height."""
    r, n = 0.004, 30
    k = np.stack(np.meshgrid(np.arange(4), np.arange(n), np.arange(4), indexing="ij"), -1).reshape(-1, 3)
    points = (2 * k + [-3, 1, -3]) * 1.1 * r + 0.1 * r * np.random.default_rng(0).uniform(-1, 1, k.shape)
    scene = Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", wsim.Plane())
    for i, normal in enumerate(([1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1])):
        M, x = np.eye(4), np.cross([0, 1, 0], normal)
        M[:3, :3], M[:3, 3] = np.stack([x, np.cross(normal, x), normal], axis=1), -4.4 * r * np.array(normal)
        scene.collider(f"/wall_{i}", wsim.Plane(), motion=wsim.Motion.still(M), static_friction=0.0, dynamic_friction=0.0)
    scene.particles("/grains", points=points, radius=r, material=STILL)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(60)
    x, v = simulation.positions(), np.linalg.norm(simulation.velocities(), axis=1)
    near = np.linalg.norm(x[:, None] - x[None], axis=-1) + np.eye(len(x))
    assert near.min() > 2 * r * (1 - 0.06) and np.quantile(near.min(axis=1), 0.1) > 2 * r * (1 - 0.01)
    assert x[:, 1].max() > 0.85 * 2 * r * n and np.sqrt((v**2).mean()) < 0.02


@pytest.mark.parametrize(("substeps", "iterations", "deep"), [(16, 4, False), (8, 2, True)])
def test_a_pile_that_is_pushed_and_squeezed_throws_nothing(substeps, iterations, deep):
    """A box at 0.4 m/s pushes a pile against a wall, whether grains carry others or not. No bound follows from theory: the box
    does any work, and a wedge of grains multiplies speeds. Measured: 2.5 and 1.4 m/s. Loads that took blows for weight threw
    some at 300 m/s."""
    r, speed = 0.005, 0.4
    scene = Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", wsim.Plane())
    wall = np.array([[0, 0, -1, 0.075], [0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]], float)
    scene.collider("/wall", wsim.Plane(), motion=wsim.Motion.still(wall))
    times = np.linspace(0.0, 0.5, 31)
    poses = np.tile(np.eye(4), (31, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = -0.1 + speed * times, 0.06
    scene.collider("/box", wsim.Box((0.03, 0.055, 0.06)), motion=wsim.Motion(times, poses))
    points = cube(10, r)[:, [0, 1, 2]] * [1.05, 1.0, 1.05] + [-0.035, 0.0, -0.047]
    scene.particles("/grains", points=points, radius=r, material=STILL)
    simulation, fastest = wsim.Simulation(scene, device="cpu"), 0.0
    assert grain_method(simulation).deep == deep
    for _ in range(20):
        simulation.run(1)
        fastest = max(fastest, np.linalg.norm(simulation.velocities(), axis=1).max())
    assert speed < fastest < 10 * speed


@pytest.mark.parametrize("ratio", [1.0, 10.0])                      # of radii: masses differ by its cube
def test_a_collision_keeps_momentum_and_what_touches_does_not_close(ratio):
    r = np.array([0.01, 0.01 / ratio])
    scene = Scene(fps=60, substeps=4, iterations=40, gravity=(0, 0, 0))
    scene.particles("/grains", points=[[-0.02, 0, 0], [0.02, 0.3 * r[1], 0]], radius=r, velocities=[[1.0, 0, 0], [-2.0, 0, 0]],
                    material=replace(STILL, static_friction=0.0, dynamic_friction=0.0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    m, v0 = 2600 * 4 / 3 * np.pi * r**3, np.array([[1.0, 0, 0], [-2.0, 0, 0]])
    simulation.run(6)
    v, x = simulation.velocities(), simulation.positions()
    assert np.abs(m @ v - m @ v0).max() < 1e-6 * (m @ np.abs(v0)).max()
    assert np.abs(v - v0).max() > 0.5                               # they met
    assert np.linalg.norm(x[1] - x[0]) >= r.sum() * (1 - 1e-9)


def test_a_pile_comes_to_rest_and_does_not_creep():
    scene = Scene(fps=60, substeps=8, iterations=4)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/grains", wsim.Box((0.02, 0.02, 0.02)), at=(0, 0.025, 0), radius=0.004)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(150)
    x = simulation.positions().copy()
    assert np.abs(simulation.velocities()).max() < 1e-3
    simulation.run(60)
    assert np.abs(simulation.positions() - x).max() < 1e-4
    near = np.linalg.norm(x[:, None] - x[None], axis=-1) + np.eye(len(x))
    assert near.min() > 2 * 0.004 * (1 - 5e-3) and x[:, 1].min() > 0.004 * (1 - 1e-3)


@pytest.mark.parametrize(("beyond", "moves"), [(-1.0, False), (1.0, True)])
def test_a_block_on_a_tilted_plate_slips_at_the_angle_of_friction(beyond, moves):
    """A degree below atan(mu) it stays; a degree above it gains speed as the closed form says, once it has come to lie."""
    mu, r = 0.4, 0.005
    a = np.arctan(mu) + np.radians(beyond)
    simulation = grains_on_floor(cube(3, r), r, mu, gravity=(G * np.sin(a), -G * np.cos(a), 0))
    simulation.run(20)
    before = simulation.velocities()[:, 0].mean()
    simulation.run(40)
    speed = simulation.velocities()[:, 0].mean()
    if moves:
        gained = (speed - before) / (G * (np.sin(a) - mu * np.cos(a)) * 40 / 60)
        assert abs(gained - 1.0) < 1e-3
    else:
        assert abs(speed) < 1e-3


def test_a_hundred_grains_in_one_place_come_apart_and_are_told_of():
    simulation = grains_on_floor(np.tile([0.0, 0.1, 0.0], (100, 1)), gravity=(0, 0, 0), floor=False)
    simulation.step()
    warned = " ".join(str(w) for w in simulation.report()["warnings"])
    assert "grains overlap by 100 %" in warned
    simulation.run(30)
    x = simulation.positions()
    near = np.linalg.norm(x[:, None] - x[None], axis=-1) + np.eye(len(x))
    assert np.isfinite(x).all() and near.min() > 0.5 * 0.01 and np.abs(simulation.velocities()).max() < 1.0


def test_grains_of_a_hundred_diameters_a_substep_stay_finite_and_are_counted():
    v = 100 * 0.01 * 60 * 8
    scene = Scene(fps=60, substeps=8, iterations=4, gravity=(0, 0, 0))
    speeds = np.where(np.arange(64)[:, None] % 2, v, -v) * [1, 0, 0]
    scene.particles("/grains", points=cube(4, 0.005), radius=0.005, velocities=speeds)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(3)
    assert np.isfinite(simulation.positions()).all() and np.isfinite(simulation.velocities()).all()
    assert any("moved more than two diameters in a substep" in str(w) for w in simulation.report()["warnings"])


def test_lists_of_neighbours_are_those_of_all_pairs():
    rng = np.random.default_rng(1)
    x = rng.uniform(-0.05, 0.05, (300, 3))
    simulation = grains_on_floor(x, rng.uniform(0.002, 0.005, 300), gravity=(0, 0, 0), floor=False)
    simulation.step()
    search = grain_method(simulation).search
    y, reach = search.cells.y0.numpy().astype(float), search.rows.reach.numpy().astype(float)
    order, count = search.cells.order.numpy(), search.lists.count.numpy()
    other = search.lists.other.numpy().reshape(-1, 300)
    found = {(int(order[k]), int(order[other[s, k]])) for k in range(300) for s in range(count[k])}
    gap = np.linalg.norm(y[:, None] - y[None], axis=-1) - reach[:, None] - reach[None] - search.skin
    i, j = np.nonzero((gap < 0.0) & ~np.eye(300, dtype=bool))
    assert found == set(zip(i.tolist(), j.tolist(), strict=True))


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_pile_of_millimetres_is_the_same_a_kilometre_away(precision):
    """float32 has steps of 6e-5 m there, an eighth of a radius: neither places nor the floor may feel them."""
    near = cube(4, 0.0005, 0.0004) + np.random.default_rng(0).uniform(-2e-5, 2e-5, (64, 3))
    near = np.round(near * 2.0**24) / 2.0**24                                  # of which sums are exact
    far, found = np.array([1000.0, 0.0, -333.0]), []
    for shift in (0.0 * far, far):
        scene, motion = Scene(fps=240, substeps=8, iterations=4), np.eye(4)
        scene.collider("/floor", wsim.Plane())
        motion[:3, 3] = shift                                                  # authored points are float32
        scene.particles("/grains", points=near, radius=0.0005, motion=wsim.Motion.still(motion))
        simulation = wsim.Simulation(scene, device="cpu", precision=precision)
        simulation.run(24)
        found.append(simulation.positions() - shift)
        search = grain_method(simulation).search
        pairs = np.linalg.norm(found[-1][:, None] - found[-1][None], axis=-1) < 0.001
        assert search.lists.count.numpy().sum() >= pairs.sum() - len(near)
    assert np.abs(found[1] - found[0]).max() < 1e-9


def test_clusters_far_apart_share_few_cells():
    """Cells follow the layers that hold particles, not the way between them: else all are along one axis."""
    near = cube(8, 0.004)
    simulation = grains_on_floor(np.concatenate([near, near + [300.0, 0.0, 0.0]]), 0.004)
    simulation.run(1)
    cells = grain_method(simulation).search.cells
    assert cells.count.numpy()[:-1].max() <= 2 * 8                             # of a cell's edge of 1.3 diameters


def test_lists_last_where_nothing_moves():
    simulation = grains_on_floor(cube(3, 0.005))
    simulation.run(30)
    y0 = grain_method(simulation).search.cells.y0.numpy()
    simulation.run(10)
    assert np.array_equal(grain_method(simulation).search.cells.y0.numpy(), y0)


def test_two_runs_and_a_restart_have_the_same_bits(tmp_path):
    scene = Scene(fps=60, substeps=8, iterations=4, frames=24)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/grains", wsim.Box((0.02, 0.02, 0.02)), at=(0, 0.03, 0), radius=0.005)
    first, second = (wsim.Simulation(replace(scene), device="cpu") for _ in range(2))
    first.run(24)
    second.run(12)
    fields = {"/grains": second.fields("/grains")}
    third = wsim.Simulation(replace(scene), device="cpu")
    third.restart(12, fields)
    for each in (second, third):
        each.run(12)
        assert np.array_equal(first.positions(), each.positions())
        assert np.array_equal(first.velocities(), each.velocities())


def test_worlds_do_not_see_each_other():
    scene = Scene(fps=60, substeps=8, iterations=4)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/grains", wsim.Box((0.02, 0.02, 0.02)), at=(0, 0.03, 0), radius=0.005)
    one, two = (wsim.Simulation(scene, device="cpu", worlds=n) for n in (1, 2))
    one.run(12)
    two.run(12)
    assert np.array_equal(one.positions("/grains"), two.positions("/grains", world=1))


def test_grains_pile_on_a_pinned_cloth_and_are_written_and_read(tmp_path):
    scene = Scene(fps=60, substeps=8, iterations=4, frames=3)
    scene.collider("/floor", wsim.Plane())
    scene.particles("/grains", wsim.Sphere(0.02), at=(0, 0.03, 0), radius=0.004, colors=(0.5, 0.25, 0.125),
                    material=Grains(2000.0, 0.75, 0.5))
    wsim.save(scene, tmp_path / "grains.usda")
    read = wsim.load(tmp_path / "grains.usda")
    assert read.things("Particles") == scene.things("Particles") and not read.notes
    simulation = wsim.Simulation(read, device="cpu")
    with simulation.record(tmp_path / "out.usdc"):
        simulation.run(3)
    again = wsim.load(tmp_path / "out.usdc")
    assert len(again.things("Particles")[0].points) == len(scene.things("Particles")[0].points)


@pytest.mark.parametrize(("more", "said"), [
    ({"radius": -0.01, "points": np.zeros((2, 3))}, "radii are too small"),
    ({"radius": [0.01, 0.02, 0.03], "points": np.zeros((2, 3))}, "3 radii; allowed: 2 or 1"),
    ({"radius": 0.01, "points": [[0, 0, np.nan]]}, "NaN or infinite"),
    ({"radius": 0.01, "points": np.zeros((0, 3))}, "no particles"),
    ({"radius": [1e-4, 1e-2], "points": np.zeros((2, 3))}, "a ratio of 50 at most"),
    ({"radius": 0.01, "points": np.zeros((1, 3)), "material": "gravel"}, "allowed: one of grains"),
    ({"radius": 0.01, "points": np.zeros((1, 3)), "material": Grains(static_friction=-1.0)}, "static_friction is -1"),
])
def test_bad_input_is_one_line(more, said):
    scene = Scene()
    scene.particles("/grains", **more)
    with pytest.raises(SceneError, match=said) as error:
        wsim.Simulation(scene, device="cpu")
    assert "/grains" in str(error.value)


@pytest.mark.parametrize("more", [{"solver": "explicit"}, {"integrator": "bdf2"},
                                  {"contact_width": 1e-3}])
def test_other_solvers_are_refused(more):
    scene = Scene(**more)
    scene.particles("/grains", points=[[0, 0, 0]], radius=0.01)
    with pytest.raises(SceneError, match="/grains"):
        wsim.Simulation(scene, device="cpu")


def test_gradients_are_refused_by_name():
    scene = Scene()
    scene.particles("/grains", points=[[0, 0, 0]], radius=0.01)
    with pytest.raises(SceneError, match="/grains"):
        wsim.Simulation(scene, device="cpu", gradients=True)


@pytest.mark.parametrize("other", ["body", "cloth", "net"])
def test_others_take_the_momentum_that_grains_lose(other):
    """A grain hits a free body, cloth or net without gravity: the sum of momentum stays to 1e-6 of what was there."""
    scene = Scene(fps=60, substeps=8, iterations=8, gravity=(0, 0, 0))
    v = np.array([[0.0, -1.0, 0.1]])
    scene.particles("/grains", points=[[0.004, 0.05, 0.002]], radius=0.01, velocities=v)
    if other == "body":
        scene.body("/other", wsim.Sphere(0.02), mass=0.02)
    elif other == "cloth":
        scene.cloth("/other", *wsim.shapes.sheet(0.08, 0.08, 8, 8, horizontal=True),
                    material=wsim.Fabric(stretch=500.0, density=500.0))
    else:
        scene.net("/other", [[x, 0, 0] for x in (-0.03, -0.015, 0.0, 0.015, 0.03)], [[0, 1], [1, 2], [2, 3], [3, 4]], [50.0],
                  [1e-3], radius=0.004)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(6)
    m = 2600 * 4 / 3 * np.pi * 0.01**3
    after = m * simulation.velocities("/grains").sum(axis=0)
    assert np.abs(simulation.velocities("/grains") - v).max() > 0.1
    if other == "body":
        state = simulation.links(["/other"]) if hasattr(simulation, "links") else None
        after = after + 0.02 * np.asarray(state.velocity, float)[0, 0]
    else:
        body = simulation.model.body("/other")
        after = after + body.point_masses @ simulation.velocities("/other")
    assert np.abs(after - m * v[0]).max() < 1e-6 * m


@pytest.mark.parametrize("given, said", [
    ({"radius": "1cm"}, "radius is '1cm'; allowed is one length > 0"),
    ({"radius": 1e-5}, "allowed are 3e[+]07; fix: give a radius of"),
    ({"shape": wsim.Plane()}, "a Plane has no end to fill"),
    ({"shape": None}, "has neither a shape nor points"),
    ({"points": np.zeros((1, 3))}, "has a shape and points"),
    ({"dynamic_friction": 0.3}, r"fix: give material=Grains\(dynamic_friction=0.3\)"),
    ({"viscosity": 0.3}, r"fix: give material=ConstraintFluid\(viscosity=0.3\)")])
def test_wrong_arguments_of_particles_are_one_line(given, said):
    with pytest.raises(SceneError, match=f"^/grains: .*{said}") as error:
        Scene().particles("/grains", **{"shape": wsim.Box((0.05, 0.05, 0.05))} | given)
    assert len(str(error.value).splitlines()) == 1


def test_a_scene_counts_particles_by_the_prim():
    scene = Scene()
    for k in range(2):
        scene.particles(f"/grains{k}", points=[[0.0, k, 0.0]], radius=0.1)
    assert describe_scene_contents(scene).startswith("2 particle prims; 2 points")


@pytest.mark.parametrize(("substeps", "iterations", "frames"), [(8, 4, 150), (16, 2, 150), (8, 2, 300)])
def test_a_heap_comes_to_rest_and_does_not_creep(substeps, iterations, frames):
    """A loose column collapses. Contacts in which both sides answer end at Coulomb's law, which a heap at rest fulfils. Grains
    that felt their own weight alone went on at 1e-3 m/s. At 8 x 2 one leaves a saddle after four seconds; then all rest."""
    r = 0.004
    i = np.stack(np.meshgrid(np.arange(-4, 5), np.arange(12), np.arange(-4, 5), indexing="ij"), -1).reshape(-1, 3).astype(float)
    i[:, [0, 2]] += 0.5 * (i[:, 1:2] % 2)
    points = i * [2.3 * r, 1.6 * r, 2.3 * r] + [0.0, 1.2 * r, 0.0]
    points = points[np.hypot(points[:, 0], points[:, 2]) < 7.0 * r]
    points += 0.1 * r * np.random.default_rng(0).uniform(-1, 1, points.shape)
    simulation = grains_on_floor(points, r, substeps=substeps, iterations=iterations)
    simulation.run(frames)
    before = simulation.positions().astype(float)
    assert np.abs(simulation.velocities()).max() < 1e-3
    simulation.run(60)
    assert np.linalg.norm(simulation.positions() - before, axis=1).max() < 1e-2 * r
