"""Pieces of usda text for tests: a cloth of two triangles, a material, an attachment; and how to load them."""

from pathlib import Path

import pytest

from wsim.scene import Scene, SceneError
from wsim.usd import load

SHEET = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]"""
APIS = 'prepend apiSchemas = ["PhysicsDeformableBodyAPI", "PhysicsSurfaceDeformableSimAPI", "MaterialBindingAPI"]'


def cloth(extra: str = "", name: str = "cloth", geometry: str = SHEET) -> str:
    return f'def Mesh "{name}" ({APIS}) {{{geometry}\n{extra}\n}}\n'


def fabric(values: str, name: str = "mat", apis: str = '"PhysicsSurfaceDeformableMaterialAPI"') -> str:
    return f'def Material "{name}" (prepend apiSchemas = [{apis}]) {{\n{values}\n}}\n'


BIND = "rel material:binding:physics = </mat>"


class Reader:
    """Loads usda text as a file of a folder; header: root metadata."""

    def __init__(self, folder: Path):
        self.file = folder / "scene.usda"

    def __call__(self, text: str, header: str = 'metersPerUnit = 1\nupAxis = "Y"', **more) -> Scene:
        self.file.write_text(f"#usda 1.0\n(\n{header}\n)\n{text}")
        return load(self.file, **more)


def errors(read, text: str, **more) -> str:
    with pytest.raises(SceneError) as error:
        read(text, **more)
    return str(error.value)


def notes(scene: Scene) -> str:
    return "\n".join(map(str, scene.notes))
