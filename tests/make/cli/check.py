"""What tests/cli/test_check.py shares with other tests: AIR, HEAD, WATER, instances, stage."""


HEAD = '''#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
    startTimeCode = 0
    endTimeCode = 4
    timeCodesPerSecond = 24
)
def PhysicsScene "Scene" {}
'''


def stage(tmp_path, text: str, head: str = HEAD) -> str:
    """A file of a text in which a line may end in "; " and a block in " }"."""
    (tmp_path / "s.usda").write_text(head + text.replace("{ ", "{\n").replace("; ", "\n").replace(" }", "\n}\n"))
    return str(tmp_path / "s.usda")


AIR = '''def Cube "Air" (prepend apiSchemas = ["WsimFluidDomainAPI"])
{
    double size = 1
    double wsim:fluid:cellSize = 0.125
}
def Sphere "Smoke" (prepend apiSchemas = ["WsimFluidSourceAPI"])
{
    double radius = 0.2
    double wsim:fluid:smoke = 1
}
'''
WATER = '''def Cube "Water" (prepend apiSchemas = ["WsimLiquidDomainAPI"])
{
    double size = 1
    double wsim:liquid:cellSize = 0.125
}
def Cube "Pool" (prepend apiSchemas = ["WsimLiquidSourceAPI"])
{
    double size = 0.5
}
'''
INSTANCES = '''def PointInstancer "Rocks"
{{
    rel prototypes = </Rocks/Rock>
    int[] protoIndices = [{index}]
    point3f[] positions = [{places}]
    {more}
    def Cube "Rock" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
    {{
        double size = 1
    }}
}}
def Plane "Ground" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{{
    uniform token axis = "Z"
}}
'''


def instances(index="0, 0, 0", places="(0, 0, 1), (2, 0, 1), (4, 0, 1)", more="") -> str:
    return INSTANCES.format(index=index, places=places, more=more)
