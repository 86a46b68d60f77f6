"""The material point method against conservation laws and closed forms."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly, Snow, Water


def make_scene(**more):
    return wsim.Scene(fps=60, **more)


def on_floor(at=(0, 0, 0), **friction):
    """A scene with a floor, and a jelly and some sand that are out of the way: tests that have both share compiled kernels."""
    scene = make_scene()
    scene.collider("/floor", wsim.Box((5, 0.5, 5)), at=np.array(at) - [0, 0.5, 0], **friction)
    return scene


def add_specks(scene, cell, at=(3, 0.02, 3)):
    for k, material in enumerate(("jelly", "sand")):
        scene.mpm(f"/speck{k}", points=[np.array(at) + [0, 0, k]], volumes=(cell / 2)**3, cell=cell, material=material)


def find_method(simulation):
    return next(m for m in simulation.plan.methods if m.name == "mpm")


def total_momentum(simulation):
    """Momentum [kg m/s], and angular momentum [kg m^2/s] with that of the particles' gradients (Jiang et al. 2015, eq. 12)."""
    m = find_method(simulation)
    p, spin = np.zeros(3), np.zeros(3)
    for k, thing in enumerate(m.things):
        now = m.read_particles(k)
        C = m.part.arrays["C"].numpy()[m.part.rows[thing.path, 0]] * m.cell**2 / 4
        own = np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], axis=1)
        p += now["m"] @ now["v"]
        spin += (now["m"][:, None] * (np.cross(now["x"], now["v"]) + own)).sum(axis=0)
    return p, spin


def test_free_fall_is_that_of_symplectic_euler():
    """All steps have one length: the place is g t (t + h) / 2 below."""
    scene = make_scene()
    scene.mpm("/a", wsim.Box((0.1, 0.1, 0.1)), at=(0, 3, 0), cell=0.05, velocity=(0.3, 0, 0), material=Jelly(1e4))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    x = simulation.samples()[0].positions
    simulation.run(1)
    h = 1 / 60 / int(find_method(simulation).status.said("mpm: grid")[3])
    way = simulation.samples()[0].positions - x
    assert np.allclose(way, [0.3 / 60, -9.81 / 60 * (1 / 60 + h) / 2, 0], rtol=1e-9, atol=1e-13)


def test_an_affine_velocity_strains_all_alike():
    """Patch test: v = A x within a body far from its faces gives F' = (1 + h A) F, whatever the places of particles."""
    scene = make_scene(gravity=(0, 0, 0))
    A = np.array([[0.3, 0.1, 0], [-0.2, 0.1, 0.4], [0.1, 0, -0.2]])
    x = np.random.default_rng(0).uniform(-0.3, 0.3, (20000, 3))
    scene.mpm("/a", points=x, volumes=1e-5, cell=0.1, velocity=x @ A.T, material=Jelly(young=1e-3, viscosity=0.0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    m = find_method(simulation)
    m.part.arrays["C"].assign(np.broadcast_to(A, (len(x), 3, 3)))
    simulation.run(1)
    steps = int(m.status.said("mpm: grid")[3])
    F = np.linalg.matrix_power(np.eye(3) + A / 60 / steps, steps)
    B = F @ F.T - np.eye(3)
    inner = np.abs(x[m.order]).max(axis=1) < 0.1
    b = m.part.arrays["b"].numpy()[inner]
    s = m.part.arrays["s"].numpy()[inner]
    assert steps < 3 and inner.sum() > 100
    assert np.allclose(b, np.diag(B), atol=1e-9) and np.allclose(s, [B[1, 2], B[2, 0], B[0, 1]], atol=1e-9)


def test_a_kilometre_away_all_goes_the_same_way():
    """Float32: the places relative to the shift have the same bits but for those of the sum."""
    found = []
    for shift in (0.0, 1000.0):
        scene = on_floor((shift, shift, -shift), dynamic_friction=0.3)
        scene.mpm("/a", wsim.Sphere(0.15), at=(shift, shift + 0.17, -shift), cell=0.0625, material="sand")
        add_specks(scene, 0.0625, (shift + 3, shift + 0.02, -shift))
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(6)
        found.append(simulation.samples()[0].positions - [shift, shift, -shift])
    assert np.abs(found[0] - found[1]).max() < 1e-6 and np.ptp(found[0][:, 1]) < 0.3


def test_nothing_passes_a_thin_wall():
    """Jelly and sand thrown at a moving plate of a tenth of a cell, at 3 cells a frame, stay in front of it."""
    scene = make_scene(gravity=(0, 0, 0))
    motion = wsim.Motion.through([0.0, 1.0], [(0.3, 0, 0), (-0.7, 0, 0)])
    scene.collider("/plate", wsim.Box((0.0025, 1.5, 1.5)), motion=motion)
    for k, material in enumerate((Jelly(young=1e4), Granular(young=1e4))):
        scene.mpm(f"/m{k}", wsim.Sphere(0.12), at=(0, 0.5 * k, 0), cell=0.05, velocity=(10, 0, 0), material=material)
    simulation = wsim.Simulation(scene, device="cpu")
    for frame in range(1, 5):
        simulation.step()
        for sample in simulation.samples():
            assert sample.positions[:, 0].max() < 0.3 - frame / 60 - 0.0025
    assert find_method(simulation).indicators(None, None)["mpm_penetration"] == 0.0


def test_a_block_slides_as_coulomb_says():
    """On a floor with friction 0.3 a stiff block loses mu g t of its speed; layers of nodes and waves make 5 % of it."""
    scene = on_floor(static_friction=0.3, dynamic_friction=0.3)
    add_specks(scene, 0.05)
    scene.mpm("/a", wsim.Box((0.2, 0.1, 0.2)), at=(0, 0.1, 0), cell=0.05, velocity=(1.5, 0, 0), material=Jelly(2e5))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(20)
    speed = find_method(simulation).read_particles(2)["v"][:, 0].mean()
    assert abs((1.5 - speed) / (0.3 * 9.81 * 20 / 60) - 1) < 0.05


def test_worlds_are_copies_and_runs_have_the_same_bits():
    def run(worlds):
        scene = on_floor(dynamic_friction=0.4)
        scene.mpm("/a", wsim.Box((0.1, 0.1, 0.1)), at=(0, 0.1, 0), cell=0.05, material="sand")
        scene.mpm("/b", wsim.Sphere(0.08), at=(0, 0.3, 0), cell=0.05, velocity=(0, -2, 0))
        simulation = wsim.Simulation(scene, device="cpu", worlds=worlds)
        simulation.run(8)
        return [np.concatenate([s.positions for s in simulation.samples(world)]) for world in range(worlds)]
    one, two = run(1), run(2)
    assert np.array_equal(one[0], two[0]) and np.array_equal(two[0], two[1]) and np.array_equal(one[0], run(1)[0])


def test_nodes_gather_what_particles_add(monkeypatch):
    """Sums by cell, of devices whose threads run side by side, against particles that add in turn: other roundings, float64."""
    found = []
    for gathers in (False, True):
        monkeypatch.setattr("wsim.physics.mpm.grid.gathers", lambda device, gathers=gathers: gathers)
        scene = make_scene(gravity=(0, 0, 0))
        scene.mpm("/a", wsim.Box((0.1, 0.1, 0.1)), cell=0.05, velocity=(1, 0.2, 0), spin=(0, 3, 5), material=Jelly(2e4))
        scene.mpm("/b", wsim.Sphere(0.12), at=(0.24, 0.06, 0.01), cell=0.05, velocity=(-1, 0, 0.3), material=Jelly(1e4))
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.run(4)
        found.append(np.concatenate([sample.positions for sample in simulation.samples()]))
    assert 0 < np.abs(found[0] - found[1]).max() < 1e-12


def test_a_grid_grows_where_matter_spreads():
    """Points that fly apart need more blocks than there is room for: the frame is repeated, and none is lost."""
    scene = on_floor((0, -5, 0))
    x = np.random.default_rng(0).uniform(-0.1, 0.1, (400, 3))
    scene.mpm("/a", points=x, volumes=1e-6, cell=0.02, velocity=400 * x, material=Granular(young=10.0))
    add_specks(scene, 0.02)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(3)
    found = simulation.samples()[0]
    assert any("blocks of cells" in text for text in simulation.repeats)
    assert np.isfinite(found.positions).all() and np.abs(found.positions).max() > 1.5


@pytest.mark.parametrize("more, text", [
    ({"points": np.zeros((3, 3)), "volumes": None}, "its points have no volume"),
    ({"points": np.eye(3), "volumes": 1.0, "cell": 0.01}, "would come apart"),
    ({"shape": wsim.Sphere(0.1), "material": Jelly(density=0.0)}, "density is 0"),
    ({"shape": wsim.Sphere(0.1), "material": Jelly(young=1e19), "integrator": "explicit"},
     r"a frame would take .* steps of .* s, the longest that hold it.*cells of .* m, .* fps"),
    ({"shape": wsim.Sphere(1e-3), "cell": 0.1}, "holds no particle"),
    ({"shape": wsim.Sphere(0.1), "material": "stone"}, "material is 'stone'"),
    ({}, "neither a shape nor points"),
])
def test_bad_input_gets_one_line(more, text):
    scene = make_scene()
    scene.mpm("/a", **more)
    with pytest.raises(wsim.SceneError, match=text) as caught:
        wsim.Simulation(scene, device="cpu")
    assert len(caught.value.problems) == 1 and caught.value.problems[0].path == "/a"


def test_a_body_goes_to_a_file_and_a_run_restarts_to_the_bit(tmp_path):
    """Shapes and materials are the same after a file, points to float32; a run in two parts has the state of a run in one."""
    from dataclasses import replace

    from pxr import Usd, UsdGeom

    from wsim.cli.run import prepare_recorded_run

    scene = on_floor(dynamic_friction=0.4)
    scene.mpm("/a", wsim.Sphere(0.1), at=(0, 0.12, 0), cell=0.05, spin=(1, 0, 2), material=Granular(cohesion=10.0))
    scene.mpm("/b", points=np.random.default_rng(0).uniform(-0.1, 0.1, (60, 3)) + [0.05, 0.3, 0], volumes=2e-5, cell=0.05,
              velocity=(0, -1, 0), material=Jelly(young=2e4, viscosity=1.0))
    wsim.save(scene, str(tmp_path / "s.usda"))
    loaded = wsim.load(str(tmp_path / "s.usda"))
    one, two = (s.things("MaterialPoints") for s in (scene, loaded))
    assert one[0] == two[0] and one[1].material == two[1].material and np.allclose(one[1].points, two[1].points, atol=1e-7)
    assert one[1].volumes == two[1].volumes and np.array_equal(two[1].velocity, [0, -1, 0]) and not loaded.notes

    def run(output, frames, restart=None):
        job = prepare_recorded_run(replace(wsim.load(str(tmp_path / "s.usda")), frames=frames), str(tmp_path / output),
                      lambda s: wsim.Simulation(s, device="cpu"), restart=restart and str(tmp_path / restart))
        job.frames()
        return job.simulation

    whole, _ = run("o.usdc", 4), run("half.usdc", 2)
    rest = run("rest.usdc", 4, "half.usdc")
    assert not rest.warnings
    for field in find_method(whole).part.kept:
        a, b = (find_method(s).part.arrays[field.name].numpy() for s in (whole, rest))
        assert np.array_equal(a, b), field.name
    stage = Usd.Stage.Open(str(tmp_path / "rest.usdc"))
    drops = UsdGeom.Points(stage.GetPrimAtPath("/a_drops"))
    sample = whole.samples()[0]
    assert np.allclose(drops.GetPointsAttr().Get(4), sample.positions, atol=1e-6)
    assert np.allclose(drops.GetVelocitiesAttr().Get(4), sample.velocities, atol=1e-5)
    assert np.array_equal(drops.GetIdsAttr().Get(4), sample.ids) and len(drops.GetWidthsAttr().Get(4)) == len(sample.ids)


def test_one_cell_size_for_all():
    scene = make_scene()
    scene.mpm("/a", wsim.Sphere(0.1), cell=0.05)
    scene.mpm("/b", wsim.Sphere(0.1), at=(1, 0, 0), cell=0.025)
    with pytest.raises(wsim.SceneError, match="give it cell=0.05"):
        wsim.Simulation(scene, device="cpu")


def test_what_hits_far_faster_than_its_waves_is_finite_and_steps_grow_again():
    """At 300 m/s onto a floor, 20 to 1000 times the speed of waves, all is pressed flat. Behind that no strain rate is left
    that nothing resists: steps are as long as waves and speeds allow, within a factor."""
    scene = on_floor()
    materials = Jelly(5e3), Jelly(5e3, model="corotational"), Granular(1e2), Snow(5e3), Water(1e3)
    for k, material in enumerate(materials):
        scene.mpm(f"/m{k}", wsim.Box((0.05, 0.05, 0.05)), at=(k - 2, 0.3, 0), cell=0.05, velocity=(0, -300, 0),
                  material=material)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(8)
    m = find_method(simulation)
    v, stiff = (np.abs(m.part.arrays[name].numpy()) for name in "va")
    needed = (np.sqrt(stiff.max() / 400.0) + np.linalg.norm(v, axis=1).max()) / (0.5 * m.cell) / 60
    assert np.isfinite(m.read_particles(4)["x"]).all() and m.indicators(None, None)["mpm_penetration"] == 0.0
    assert int(m.status.said("mpm: grid")[3]) < 2.0 * needed + 4


def test_a_frame_that_is_given_up_names_the_particle_and_the_fix():
    """More in one cell than a node can count: one line, and the simulation stands where the frame began."""
    scene = on_floor()
    x = np.random.default_rng(0).uniform(-0.005, 0.005, (4200, 3))
    scene.mpm("/heap", points=x + [0.05, 0.5, 0], volumes=1e-6, cell=0.05, material="sand")
    add_specks(scene, 0.05)
    simulation = wsim.Simulation(scene, device="cpu")
    with pytest.raises(wsim.SceneError, match=r"/heap: point \d+ at \(0.05.* shares its cell .* fix: .*frame 1 was given up"):
        simulation.step()
    assert np.allclose(simulation.samples()[0].positions, x + [0.05, 0.5, 0], atol=1e-6)


def test_points_piled_in_one_cell_stay_finite_with_the_same_bits():
    def run():
        scene = on_floor()
        x = np.random.default_rng(0).uniform(-0.005, 0.005, (3000, 3))
        scene.mpm("/heap", points=x + [0, 0.3, 0], volumes=1e-6, cell=0.05, material="sand")
        add_specks(scene, 0.05)
        simulation = wsim.Simulation(scene, device="cpu")
        simulation.run(8)
        return find_method(simulation).indicators(None, None)["mpm_cell_particles"], simulation.samples()[0].positions

    (most, one), (_, two) = run(), run()
    assert most >= 1000 and np.isfinite(one).all() and np.array_equal(one, two) and one[:, 1].min() >= 0.0


def test_a_long_thin_box_is_filled_without_its_bounding_ball():
    """10 m of a layer 5 cm deep: 1600 particles, of the 6e7 lattice points of a cube about it."""
    import tracemalloc

    from wsim.physics.mpm.objects import MaterialPoints
    from wsim.physics.mpm.seeding import place_particles
    tracemalloc.start()
    x = place_particles(MaterialPoints("/a", wsim.Box((5.0, 0.025, 0.025)), cell=0.05)).x
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(x) == 400 * 2 * 2 and peak < 1e8


def test_a_point_beyond_the_range_of_the_grid_is_refused_by_name():
    scene = on_floor()
    scene.mpm("/far", points=[[240000.0, 1, 0]], volumes=1e-6, cell=0.05, material="sand")
    add_specks(scene, 0.05)
    with pytest.raises(wsim.SceneError, match=r"/far: .*left the range of the grid; fix: give a floor"):
        wsim.Simulation(scene, device="cpu").step()


def test_a_value_that_a_material_does_not_have_is_refused_while_it_runs():
    scene = on_floor()
    add_specks(scene, 0.05)
    simulation = wsim.Simulation(scene, device="cpu")
    with pytest.raises(wsim.SceneError, match="/speck0: has no live parameter 'cohesion': Jelly has none; there are"):
        simulation.set("/speck0", "cohesion", 1.0)


def test_a_lattice_that_was_kept_is_that_of_what_the_shape_is_now():
    """Corners of a mesh that move in place, a size, a place and a cell; and who gets places may change them."""
    from wsim.physics.mpm.objects import MaterialPoints
    from wsim.physics.mpm.seeding import fill_shape

    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * np.float32(0.1)
    mesh = wsim.Surface(corners.copy(), [4] * 6, [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3])
    for k, (size, at, cell) in enumerate(((1.0, 0.0, 0.05), (2.0, 0.0, 0.05), (2.0, 0.1, 0.05), (2.0, 0.1, 0.1))):
        mesh.points[:] = corners * np.float32(size * (1.0 - 1e-5))
        for shape in (mesh, wsim.Box((0.1 * size,) * 3)):
            for _ in range(2):
                x = fill_shape(MaterialPoints("/a", shape, cell=cell, motion=wsim.Motion.at_place((at, 0, 0))))
                assert len(x) == round(0.4 * size / cell) ** 3, (k, shape)
                assert np.abs(x - [at, 0, 0]).max() == pytest.approx(0.1 * size - 0.25 * cell)
                x += 1.0
