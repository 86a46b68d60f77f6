"""Fabric: what is allowed, and presets that follow from their sources."""

from math import inf

import pytest

from wsim.scene.fabric import FABRICS, Fabric, bend_of_fibres, fabric, isotropic_fabric

GRAVITY = 9.81


def area_density(f: Fabric) -> float:
    return f.density * f.thickness


@pytest.mark.parametrize("field, value, words", [
    ("stretch", 0.0, "> 0"), ("stretch", -1.0, "> 0"), ("stretch", inf, "finite"), ("shear", -1.0, ">= 0"),
    ("bend", float("nan"), "finite"), ("thickness", 0.0, "> 0"), ("density", -5.0, "> 0"), ("poisson", 0.5, "< 0.5"),
    ("poisson", -1.0, "> -1"), ("damping", -1e-9, ">= 0"), ("strain_limit", -0.1, ">= 0")])
def test_a_value_out_of_range_is_named_with_what_is_allowed(field, value, words):
    with pytest.raises(ValueError, match=f"{field} is .*{words}"):
        Fabric(**{field: value})


def test_the_edges_of_the_ranges_are_allowed():
    assert Fabric(shear=0.0, bend=0.0, poisson=0.49, strain_limit=inf).bend == 0.0


def test_an_unknown_fabric_is_answered_with_the_known_ones():
    with pytest.raises(ValueError, match="no fabric 'velvet'; allowed is one of silk, cotton, denim, leather, rubber"):
        fabric("velvet")
    assert fabric("Cotton") is FABRICS["cotton"]


@pytest.mark.parametrize("name", ["leather", "rubber"])
def test_isotropic_presets_are_one_material_of_one_thickness(name):
    """Three stiffnesses of two moduli: S = E t, 2 (1 + nu) shear = S, 12 (1 - nu^2) bend = S t^2; leather, which has layers,
    bends more easily than a plate."""
    f = FABRICS[name]
    assert 2.0 * (1.0 + f.poisson) * f.shear == pytest.approx(f.stretch, rel=1e-14)
    plate = f.stretch * f.thickness ** 2 / (12.0 * (1.0 - f.poisson ** 2))
    assert f.bend < 0.1 * plate if name == "leather" else f.bend == pytest.approx(plate, rel=1e-14)


def test_isotropic_sheet_of_round_figures():
    f = isotropic_fabric(12.0e6, 0.0, 1.0e-3, 1000.0)
    assert (f.stretch, f.shear) == (pytest.approx(12.0e3), pytest.approx(6.0e3)) and f.bend == pytest.approx(1.0e-3)


def test_bending_of_free_fibres_is_that_of_their_sections():
    """n fibres per metre of modulus E and section I resist with n E I."""
    from math import pi
    modulus, density, d, mass = 9.0e9, 1500.0, 12e-6, 0.1
    fibres = 0.5 * mass / (density * pi / 4 * d ** 2)
    assert bend_of_fibres(mass, modulus / density, d) == pytest.approx(fibres * modulus * pi / 64 * d ** 4, rel=1e-12)


def test_presets_order_as_the_hand_feels_them():
    order = ["silk", "cotton", "denim", "leather", "rubber"]
    masses = [area_density(FABRICS[name]) for name in order]
    assert masses == sorted(masses) and masses[0] == pytest.approx(0.0694, abs=1e-4)
    bends = [FABRICS[name].bend for name in ("silk", "cotton", "denim", "leather", "rubber")]
    assert bends == sorted(bends)
    youngs = {name: f.stretch / f.thickness for name, f in FABRICS.items()}     # as a material, rubber is softer than
    assert youngs["rubber"] < min(youngs["leather"], youngs["cotton"], youngs["silk"])   # leather and tight weaves


@pytest.mark.parametrize("name", FABRICS)
def test_presets_lie_in_the_range_of_real_sheets(name):
    """Garment sheets weigh 0.05 to 1 kg/m^2, are 0.1 to 1.5 mm thick; Peirce's bending length (B / w)^(1/3), w the
    weight per area, is 1 to 7 cm from silk to hard leather; 1 m of it stretches by under 2 % of its own weight."""
    f = FABRICS[name]
    weight = area_density(f) * GRAVITY
    assert 0.05 < area_density(f) < 1.0 and 1e-4 < f.thickness < 1.5e-3
    assert 0.01 < (f.bend / weight) ** (1 / 3) < 0.07
    assert weight * 1.0 / f.stretch < 0.02
    assert 0 < f.shear < f.stretch and f.dynamic_friction <= f.static_friction


def test_cotton_bends_between_free_fibres_and_the_cloth_measured():
    """The hinge coefficient of Wang, O'Brien, Ramamoorthi 2011 is four times the bending stiffness: 108 to 125 uN m."""
    assert bend_of_fibres(0.220, 5.0e6, 14e-6) < FABRICS["cotton"].bend < 108e-6 / 4.0


def test_denim_bends_between_the_limits_measured():
    """KES-F, six denims: 0.144 to 0.227 gf cm^2/cm; 1 gf cm = 9.80665e-5 N m. Free fibres are a lower bound."""
    denim = FABRICS["denim"]
    assert 0.144 * 9.80665e-5 < denim.bend < 0.227 * 9.80665e-5
    assert bend_of_fibres(area_density(denim), 5.0e6, 14e-6) < denim.bend
