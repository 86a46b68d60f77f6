"""Pieces of usda text for the example scenes: prims, arrays, attributes with their units, pins, colliders.

Attribute names and units are from the table of `wsim.usd.names`. Every piece is text that ends in a line break, not indented.
"""

import textwrap

import numpy as np

from wsim.usd.names import UNITS, attribute_entry

HEADER = """#usda 1.0
(
    doc = "{doc}"
    defaultPrim = "World"
    metersPerUnit = {metres:g}
    kilogramsPerUnit = 1
    upAxis = "Y"
    timeCodesPerSecond = {fps}
    framesPerSecond = {fps}
    startTimeCode = 0
    endTimeCode = {frames}
)

def Xform "World"
{{
"""


def number(value: float) -> str:
    """Six digits, no negative zero."""
    return f"{round(float(value), 6) + 0.0:.6g}"


def listed(values) -> str:
    """An array in brackets, wrapped; rows of an (n, 3) array are tuples."""
    rows = np.asarray(values)
    if rows.ndim == 2:
        items = ["(" + ", ".join(number(v) for v in r) + ")" for r in rows]
    else:
        items = [str(v) if np.issubdtype(rows.dtype, np.integer) else number(v) for v in rows]
    lines = [""]
    for item in items:
        if len(lines[-1]) + len(item) > 116:
            lines.append("")
        lines[-1] += item + ", "
    lines = [line.rstrip() for line in lines]
    lines[-1] = lines[-1].rstrip(",")
    return f"[{lines[0]}]" if len(lines) == 1 else "\n".join(["[", *lines, "]"])


def said(owner: str, metres: float, **values) -> str:
    """Lines `type name = value  # SI unit` of fields of the table, converted from SI to a stage of that unit."""
    lines = []
    for field, value in values.items():
        r = attribute_entry(owner, field)
        length, mass = UNITS[r.unit]
        kind = ("uniform " if r.uniform else "") + r.type
        if isinstance(value, (str, bool)):
            text = f'"{value}"' if isinstance(value, str) else str(value).lower()
        elif np.ndim(value):
            text = "(" + ", ".join(f"{v / metres ** length:.6g}" for v in value) + ")"
        else:
            text = f"{value / metres ** length:.6g}"
        unit = "" if r.unit == "1" or not (length or mass or r.unit.endswith("s")) else f"    # {r.unit}"
        unit = f"    # {value:.6g} {r.unit}" if unit and metres != 1.0 and length and not np.ndim(value) else unit
        lines.append(f"{kind} {r.attribute} = {text}{unit}")
    return "\n".join(lines)


def block(kind: str, name: str, body: str, apis: str = "", comment: str = "") -> str:
    """A prim with its body indented by one level."""
    note = "".join(f"# {line}\n" for line in textwrap.wrap(comment, 112))
    head = f'{note}def {kind} "{name}"' + (f" (\n    prepend apiSchemas = {apis}\n)" if apis else "")
    return head + "\n{\n" + indented(body.rstrip("\n")) + "\n}\n"


def indented(text: str) -> str:
    """One level deeper, but for the lines of long arrays: it would be a tenth of the file."""
    return textwrap.indent(text, "    ", lambda line: line[:1] not in "([]-0123456789\n")


def settings(metres: float = 1.0, comment: str = "", **values) -> str:
    return block("PhysicsScene", "Physics", said("Scene", metres, **values), '["WsimSceneAPI"]',
                 "Gravity is 9.81 m/s^2 down, as USD has it by default. " + comment)


def pin(name: str, body: str, points, target: str, comment: str) -> str:
    """Holds points of a cloth to an Xform, where they are at the start."""
    lines = [f"rel physics:src0 = <{body}>", f"int[] physics:indices0 = {listed(np.asarray(points, int))}",
             'uniform token physics:type0 = "point"', f"rel physics:src1 = <{target}>",
             'uniform token physics:type1 = "xform"']
    return block("PhysicsAttachment", name, "\n".join(lines), comment=comment)


def solid(kind: str, name: str, body: str, color=(0.55, 0.56, 0.6), comment: str = "", apis: str = "",
          keep: float = 0.0, metres: float = 1.0) -> str:
    """A collider; `keep` [m] is kept free around it. Without a physics material its friction is 0.5."""
    if keep:
        apis, body = apis + ', "WsimColliderAPI"', body + "\n" + said("Collider", metres, thickness=keep)
    color_line = f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]"
    return block(kind, name, body + "\n" + color_line, f'["PhysicsCollisionAPI"{apis}]', comment)


def moved(x: float, y: float, z: float, more: str = "") -> str:
    names = '"xformOp:translate"' + (f', "{more}"' if more else "")
    return (f"double3 xformOp:translate = ({number(x)}, {number(y)}, {number(z)})\n"
            f"uniform token[] xformOpOrder = [{names}]")


def ground(y: float = 0.0) -> str:
    return solid("Plane", "Ground", 'uniform token axis = "Y"\ndouble width = 8\ndouble length = 8\n' + moved(0, y, 0),
                 (0.8, 0.8, 0.78), "A plane collides without end; width and length are what is drawn.")


def scene(doc: str, parts: list[str], frames: int, fps: int = 24, metres: float = 1.0) -> str:
    body = "\n".join(indented(part) for part in parts)
    return HEADER.format(doc=doc, metres=metres, fps=fps, frames=frames) + body + "}\n"
