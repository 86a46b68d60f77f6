"""What tests/physics/animation/test_usd.py shares with other tests: ATTACHED."""


ATTACHED = """
def PhysicsAttachment "held" {{
    rel physics:src0 = </cloth>
    rel physics:src1 = </char/skin>
    uniform token physics:type0 = "point"
    uniform token physics:type1 = "{}"
    int[] physics:indices0 = [0, 3]
    int[] physics:indices1 = {}
    {}
}}
"""
