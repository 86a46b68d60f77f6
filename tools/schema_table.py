"""The tables of wsim's USD attributes in wsim/docs/schema.md, from the schema. It writes them: python -m tools.schema_table

tests/tools/test_readme.py fails where the table and wsim/usd/schema/generatedSchema.usda differ.
"""

from pathlib import Path

from pxr import Sdf

ROOT = Path(__file__).resolve().parents[1]
SCHEMA, PAGE = ROOT / "wsim/usd/schema/generatedSchema.usda", ROOT / "wsim/docs/schema.md"
HEAD = "| attribute | type | fallback | meaning |\n|---|---|---|---|"
BEGIN, END = "<!-- schema: python -m tools.schema_table -->", "<!-- end of schema -->"


def table() -> str:
    """A heading and a table for each API schema: attribute, type, fallback, meaning."""
    layer, parts = Sdf.Layer.FindOrOpen(str(SCHEMA)), []
    for prim in layer.rootPrims:
        rows = [row(spec) for spec in prim.properties]
        parts.append(f"**{prim.name}**: {line(prim.documentation)}" + ("" if rows else " It has no attributes."))
        parts += ["", HEAD, *rows] if rows else []
        parts.append("")
    return "\n".join(parts)


def row(spec) -> str:
    if isinstance(spec, Sdf.RelationshipSpec):
        kind, fallback = "rel", ""
    else:
        kind = str(spec.typeName)
        fallback = "" if spec.default is None else f"`{spec.default}`"
        tokens = spec.GetInfo("allowedTokens") if spec.HasInfo("allowedTokens") else ()
        kind += f": {', '.join(tokens)}" if tokens else ""
    return f"| `{spec.name}` | {kind} | {fallback} | {line(spec.documentation)} |"


def line(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def written(text: str) -> str:
    """The page with the table of now between its marks."""
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{table()}\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
