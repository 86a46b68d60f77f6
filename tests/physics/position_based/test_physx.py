"""What PhysX says of particles with WsimParticlesAPI: hints where wsim:particles: says nothing, and the rest in a line."""

import numpy as np
import pytest

import wsim
from wsim.physics.position_based.objects import ConstraintFluid, Grains

STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    kilogramsPerUnit = 1
    upAxis = "Y"
    startTimeCode = 0
    endTimeCode = 4
    timeCodesPerSecond = 60
)
def PhysicsScene "physics"
{
}
def PhysxParticleSystem "system"
{
    float particleContactOffset = 1.2
    %(system)s
}
def Material "stuff" (prepend apiSchemas = ["PhysxPBDMaterialAPI"])
{
    float physxPBDMaterial:friction = 0.35
    float physxPBDMaterial:density = 0.0012
    float physxPBDMaterial:viscosity = 0.1
    float physxPBDMaterial:cohesion = 0.01
    float physxPBDMaterial:gravityScale = 1
}
def Points "grains" (prepend apiSchemas = [%(api)s"PhysxParticleSetAPI", "MaterialBindingAPI"])
{
    point3f[] points = [(0, 10, 0), (0, 30, 0)]
    float[] widths = [3]
    rel physxParticle:particleSystem = </system>
    rel material:binding:physics = </stuff>
    %(own)s
}
def Plane "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{
    uniform token axis = "Y"
}
"""


def load(folder, system="", own="", api='"WsimParticlesAPI", '):
    file = folder / "physx.usda"
    file.write_text(STAGE % {"system": system, "own": own, "api": api})
    scene = wsim.load(file)
    return scene, [str(note) for note in scene.notes]


def test_a_set_gives_fluid_radius_density_and_friction(tmp_path):
    """The rest offset counts before widths, which PhysX draws only; numbers without a unit are named."""
    scene, notes = load(tmp_path, "float fluidRestOffset = 0.5")
    thing = scene.things("Particles")[0]
    assert thing.material == ConstraintFluid(density=pytest.approx(1200.0), static_friction=pytest.approx(0.35),
                                             dynamic_friction=pytest.approx(0.35))
    assert np.allclose(thing.radius, 0.005) and not scene.things("MaterialPoints")
    assert len(notes) == 2 and "its widths are 0.03 m" in notes[1] and "0.01 m apart" in notes[1]
    assert "physxPBDMaterial:cohesion, physxPBDMaterial:viscosity are not read" in notes[0]


def test_surface_tension_of_physx_is_that_of_water(tmp_path, monkeypatch):
    """Its unit is 1/m^3: it says that there is one. wsim's own number counts before it."""
    monkeypatch.setitem(globals(), "STAGE", STAGE.replace("    float physxPBDMaterial:gravityScale = 1", "    float "
                        "physxPBDMaterial:surfaceTension = 0.01"))
    scene, notes = load(tmp_path)
    assert scene.things("Particles")[0].material.surface_tension == pytest.approx(0.072)
    assert any("surfaceTension is no force over a length: the fluid has 0.072 N/m" in note for note in notes)
    scene, _ = load(tmp_path, "", "double wsim:particles:surfaceTension = 0.03")
    assert scene.things("Particles")[0].material.surface_tension == pytest.approx(0.03)


def test_solids_are_grains_and_mass_counts_before_density(tmp_path):
    scene, _ = load(tmp_path, "float solidRestOffset = 1.5", "bool physxParticle:fluid = 0\n    float physics:mass = 0.08\n"
                    "    float physics:density = 0.5")
    thing = scene.things("Particles")[0]
    assert isinstance(thing.material, Grains) and np.isclose(thing.material.static_friction, 0.35)
    assert np.isclose(thing.material.density * 2 * 4 / 3 * np.pi * 0.015**3, 0.08)
    assert np.isclose(wsim.Simulation(scene, device="cpu").model.bodies[0].masses.sum(), 0.08)


def test_without_a_rest_offset_widths_count_then_the_contact_offset(tmp_path):
    scene, notes = load(tmp_path)
    assert np.allclose(scene.things("Particles")[0].radius, 0.015) and not any("widths" in note for note in notes)
    file = tmp_path / "physx.usda"
    file.write_text(file.read_text().replace("    float[] widths = [3]\n", ""))
    assert np.allclose(wsim.load(file).things("Particles")[0].radius, 0.594 * 0.012)


def test_own_attributes_count_before_hints(tmp_path):
    scene, _ = load(tmp_path, "float fluidRestOffset = 0.5", 'token wsim:particles:material = "grains"\n'
                    "    double wsim:particles:staticFriction = 0.7\n    double wsim:particles:density = 0.003")
    m = scene.things("Particles")[0].material
    assert isinstance(m, Grains) and np.allclose([m.static_friction, m.dynamic_friction, m.density], [0.7, 0.35, 3000.0])
    file = tmp_path / "physx.usda"
    file.write_text(file.read_text().replace("    float[] widths = [3]\n", "    double wsim:particles:radius = 0.8\n"))
    assert np.allclose(wsim.load(file).things("Particles")[0].radius, 0.008)


def test_what_the_system_says_besides_is_named_once(tmp_path):
    system = "int solverPositionIterationCount = 16\n    float maxVelocity = 3\n    float fluidRestOffset = 1.5"
    _, notes = load(tmp_path, system, "bool physxParticle:selfCollision = 0")
    assert sum("maxVelocity" in note and "solverPositionIterationCount" in note for note in notes) == 1
    assert sum("physxParticle:selfCollision is not read: all particles meet each other" in note for note in notes) == 1
    assert all(len(note) < 300 for note in notes)


def test_a_system_that_is_off_leaves_its_sets_out(tmp_path):
    with pytest.raises(wsim.SceneError, match="switched off: /grains is left out"):
        load(tmp_path, "bool particleSystemEnabled = 0")


def test_places_of_the_simulation_count(tmp_path):
    scene, _ = load(tmp_path, own="point3f[] physxParticle:simulationPoints = [(0, 20, 0), (0, 40, 0)]")
    assert np.allclose(scene.things("Particles")[0].points[:, 1], [0.2, 0.4])


def test_a_set_alone_stays_with_material_points(tmp_path):
    scene, _ = load(tmp_path, "float fluidRestOffset = 0.5", api="")
    assert scene.things("MaterialPoints") and not scene.things("Particles")


def test_grains_are_not_warned_of_what_is_for_fluids(tmp_path):
    """Viscosity and cohesion of the material act on fluids only, in PhysX too."""
    scene, notes = load(tmp_path, "", "bool physxParticle:fluid = 0")
    assert isinstance(scene.things("Particles")[0].material, Grains)
    assert not any("viscosity" in note or "cohesion" in note for note in notes)
