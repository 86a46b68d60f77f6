"""Textures of preview materials: PNG files as they were written, and their colours at corners."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade

from wsim.show.image import png
from wsim.show.image.texture import read_png, unfilter_rows
from wsim.show.visible import read_visible_stage


def test_a_png_is_read_as_it_was_written(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (9, 13, 3), np.uint8)
    (tmp_path / "a.png").write_bytes(png.encode_png(image))
    assert np.array_equal(read_png(str(tmp_path / "a.png")), image)
    (tmp_path / "b.png").write_bytes(b"no")
    with pytest.raises(ValueError, match="is no PNG file"):
        read_png(str(tmp_path / "b.png"))


def paeth(a: int, b: int, c: int) -> int:
    """As the standard has it (PNG, 9.4)."""
    p = a + b - c
    pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
    return a if pa <= pb and pa <= pc else b if pb <= pc else c


@pytest.mark.parametrize("kind", range(5))
def test_every_filter_is_undone(kind):
    image, n = np.random.default_rng(1).integers(0, 256, (4, 15)).astype(int), 3
    rows = np.zeros((4, 16), np.uint8)
    rows[:, 0] = kind
    for y in range(4):
        for x in range(15):
            a, b = image[y, x - n] if x >= n else 0, image[y - 1, x] if y else 0
            c = image[y - 1, x - n] if y and x >= n else 0
            rows[y, x + 1] = (image[y, x] - (0, a, b, (a + b) // 2, paeth(a, b, c))[kind]) % 256
    assert np.array_equal(unfilter_rows(rows, n), image)


def test_corners_have_the_colours_of_the_texture(tmp_path):
    """A square whose corners lie in the four quarters of an image: red, green above, blue, white above."""
    quarters = np.array([[(0, 255, 0), (255, 255, 255)], [(255, 0, 0), (0, 0, 255)]], np.uint8)
    (tmp_path / "a.png").write_bytes(png.encode_png(quarters.repeat(8, axis=0).repeat(8, axis=1)))
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8)])
    material = UsdShade.Material.Define(stage, "/m")
    surface, texture, reader = (UsdShade.Shader.Define(stage, f"/m/{name}") for name in ("surface", "texture", "reader"))
    surface.CreateIdAttr("UsdPreviewSurface")
    texture.CreateIdAttr("UsdUVTexture")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./a.png")
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(texture.ConnectableAPI(), "rgb")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    stage.Save()
    (drawn,) = read_visible_stage(tmp_path / "a.usda").drawn
    colors = {int(point): drawn.look.colors[k].tolist() for point, k in
              zip(drawn.look.triangles.ravel(), drawn.look.color_of.ravel(), strict=True)}
    assert colors == {0: [1, 0, 0], 1: [0, 0, 1], 2: [1, 1, 1], 3: [0, 1, 0]}
