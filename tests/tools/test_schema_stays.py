"""The USD schema keeps what released files say: names and types of attributes (CONTRIBUTING.md, Versions)."""

from pathlib import Path

from pxr import Sdf

from wsim.cli.schema import schema_folder


def test_no_attribute_goes_or_changes_its_type():
    """`schema.txt` has a line for each: schema, attribute, type. What is new is added to it; no line is taken away."""
    layer = Sdf.Layer.FindOrOpen(f"{schema_folder()}/generatedSchema.usda")
    there = {f"{prim.name} {a.name} {getattr(a, 'typeName', 'rel')}" for prim in layer.rootPrims for a in prim.properties}
    listed = set(Path(__file__).with_name("schema.txt").read_text().splitlines())
    assert sorted(listed - there) == [], "an attribute of earlier files is gone, or has another type"
    assert sorted(there - listed) == [], "add these lines to tests/tools/schema.txt"
