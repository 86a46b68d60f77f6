"""A variant set that switches the physics material of a cloth: what is read, what a run chooses, what its result keeps."""

import pytest
from pxr import Usd

from tests.make.usda import APIS, SHEET, Reader, errors, fabric
from wsim.cli import main

SETS = f"""
def Xform "World" (variants = {{ string fabric = "silk" }}
    prepend variantSets = "fabric"
) {{
    def Mesh "shirt" ({APIS}) {{{SHEET}
    }}
    variantSet "fabric" = {{
        "silk" {{
            over "shirt" {{
                rel material:binding:physics = </silk>
            }}
        }}
        "denim" {{
            over "shirt" {{
                rel material:binding:physics = </denim>
                double[] primvars:wsim:bend = [1e-4, 2e-4] (
                    interpolation = "uniform"
                )
            }}
        }}
    }}
}}
"""
TEXT = SETS + "".join(fabric(f"float physics:surfaceStretchStiffness = {k}\nfloat physics:poissonsRatio = 0", name)
                      for name, k in (("silk", 2000), ("denim", 600)))


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def test_the_authored_fabric_counts_until_another_is_chosen(read):
    assert read(TEXT).cloths[0].material.stretch == pytest.approx(2000.0)
    denim = read(TEXT, variants={"/World": {"fabric": "denim"}}).cloths[0]
    assert denim.material.stretch == pytest.approx(600.0) and denim.bends == pytest.approx([1e-4, 2e-4])


def test_a_fabric_that_there_is_not_is_an_error_that_names_those_there_are(read):
    assert "/World: variant set 'fabric' has no 'wool'; it has: " in errors(read, TEXT, variants={"/World": {"fabric": "wool"}})


def test_a_result_keeps_the_fabric_of_its_run(read, tmp_path):
    read(TEXT)
    out = tmp_path / "out.usda"
    assert main(["run", str(read.file), "-o", str(out), "--frames", "1", "--device", "cpu", "--quiet",
                 "--variant", "/World:fabric=denim"]) == 0
    stage = Usd.Stage.Open(str(out))
    prim = stage.GetPrimAtPath("/World")
    assert prim.GetVariantSet("fabric").GetVariantSelection() == "denim"
    assert prim.GetChild("shirt").GetRelationship("material:binding:physics").GetTargets() == ["/denim"]
