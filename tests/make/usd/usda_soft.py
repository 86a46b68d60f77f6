"""Pieces of usda text for tests of soft bodies: two tets, their material, subsets and skins."""

from wsim.usd import names

TWO = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 4)]"""
SIM = '"PhysicsVolumeDeformableSimAPI", "PhysicsCollisionAPI", "MaterialBindingAPI", "WsimSoftAPI"'
SOLID = "rel material:binding:physics = </jelly>"
FACES = """
    point3f[] points = [(0.1, 0.1, 0.1), (0.3, 0.1, 0.1), (0.1, 0.3, 0.1)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]"""


def volume(extra: str = SOLID, name: str = "ball", geometry: str = TWO, apis: str = f'"{names.BODY}", {SIM}') -> str:
    return f'def TetMesh "{name}" (prepend apiSchemas = [{apis}]) {{{geometry}\n{extra}\n}}\n'


def solid(values: str = "float physics:youngsModulus = 1e5", name: str = "jelly") -> str:
    return (f'def Material "{name}" (prepend apiSchemas = ["PhysicsVolumeDeformableMaterialAPI", "WsimMaterialAPI"]) {{\n'
            f"{values}\n}}\n")


def body(inner: str, extra: str = "") -> str:
    """A body above its TetMesh /body/sim."""
    return (f'def Xform "body" (prepend apiSchemas = ["PhysicsDeformableBodyAPI"]) {{\n{extra}\n{volume(name="sim", apis=SIM)}'
            f"{inner}}}\n{solid()}")


def skin(name: str = "look", extra: str = "", apis: str = "") -> str:
    return f'def Mesh "{name}" ({apis}) {{{FACES}\n{extra}\n}}\n'


def place(op: str, value: str) -> str:
    return f'{op} = {value}\nuniform token[] xformOpOrder = ["{op.split()[1]}"]'


def part(indices: str, name: str = "part", kind: str = "tetrahedron", material: str = "bone",
         binding: str = "material:binding:physics") -> str:
    return (f'\ndef GeomSubset "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{\n'
            f'uniform token elementType = "{kind}"\nuniform token familyName = "materialBind"\n'
            f"int[] indices = [{indices}]\nrel {binding} = </{material}>\n}}\n")


LOOK = 'def Material "paint" {}\n'
BONE = solid("float physics:youngsModulus = 1e9\nfloat physics:density = 1900", "bone")
