"""Drag of the air through USD: that of a fabric, a cloth's own, and an authored 0."""

import pytest

from tests.make.usda import BIND, Reader, cloth, fabric
from wsim import Scene, load, save, shapes
from wsim.scene.fabric import fabric as preset

MADE = fabric("float physics:density = 300\ndouble wsim:normalDrag = 0.5")


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


@pytest.mark.parametrize("authored, drag, counts", [("", None, 0.5), ("double wsim:drag = 0", 0.0, 0.0),
                                                    ("double wsim:drag = 1.2", 1.2, 0.0)])
def test_the_drag_of_a_material_counts_where_the_cloth_authors_none(read, authored, drag, counts):
    made = read(cloth(f"{BIND}\n{authored}") + MADE).cloths[0]
    assert made.drag == drag and made.material.normal_drag == 0.5
    assert made.air == {"drag": drag or 0.0, "lift": 0.0, "normal_drag": counts}


@pytest.mark.parametrize("drag", [None, 0.0, 1.2])
def test_a_preset_comes_back_from_a_file_with_its_drag(tmp_path, drag):
    scene = Scene()
    scene.cloth("/cloth", *shapes.sheet(1.0, 1.0, 2, 2), material=preset("denim"), drag=drag)
    save(scene, tmp_path / "made.usda")
    again = load(tmp_path / "made.usda")
    assert again.cloths[0].drag == drag and again.air_drag == 0.0
    assert again.cloths[0].air == scene.cloths[0].air


def test_a_stage_in_centimetres_and_grams_says_it_in_its_units(read):
    """0.5 g/(cm^2 s) is 5 kg/(m^2 s)."""
    text = cloth(BIND) + MADE
    assert read(text, header='metersPerUnit = 0.01\nkilogramsPerUnit = 0.001\nupAxis = "Y"').cloths[0].air["normal_drag"] == \
        pytest.approx(5.0, rel=1e-12)


def test_a_drag_below_0_is_one_clear_error(read):
    from tests.make.usda import errors
    text = cloth(BIND) + fabric("float physics:density = 300\ndouble wsim:normalDrag = -1")
    assert "wsim:normalDrag: normal_drag is -1; allowed is a finite number >= 0" in str(errors(read, text))
