"""What tests/usd/prims/test_skeleton.py shares with other tests: BOUND, COLLIDES, RISES, character, mesh."""

from tests.make.usda import SHEET

BOUND = """
    rel skel:skeleton = </char/bones>
    int[] primvars:skel:jointIndices = [0] (elementSize = 1
        interpolation = "constant")
    float[] primvars:skel:jointWeights = [1] (elementSize = 1
        interpolation = "constant")"""
COLLIDES = 'prepend apiSchemas = ["PhysicsCollisionAPI", "SkelBindingAPI"]'
RISES = "float3[] translations.timeSamples = {0: [(0, 0, 0)], 12: [(0, 0.5, 0)]}"


def character(mesh: str, moves: str = RISES, root: str = "", rest: str = "(0, 0, 0, 1)", kind: str = "SkelRoot") -> str:
    """A SkelRoot with a skeleton of one joint, what moves it, and meshes."""
    one = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), {} )"
    return f"""
def {kind} "char" (prepend apiSchemas = ["SkelBindingAPI"]) {{
    {root}
    def Skeleton "bones" (prepend apiSchemas = ["SkelBindingAPI"]) {{
        uniform token[] joints = ["hip"]
        uniform matrix4d[] bindTransforms = [{one.format("(0, 0, 0, 1)")}]
        uniform matrix4d[] restTransforms = [{one.format(rest)}]
        rel skel:animationSource = </char/walk>
    }}
    def SkelAnimation "walk" {{
        uniform token[] joints = ["hip"]
        {moves}
        quatf[] rotations = [(1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1)]
    }}
    {mesh}
}}
"""


def mesh(apis: str, extra: str = BOUND, name: str = "skin") -> str:
    return f'def Mesh "{name}" ({apis}) {{{SHEET}\n{extra}\n}}\n'
