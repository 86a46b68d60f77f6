"""Options of `wsim new`."""

from wsim.cli.arguments import parse_height, parse_length, parse_nonempty_name, parse_positive_count, parse_positive_number
from wsim.scene.solid import MODELS

STARTERS = {"rigid": "a wall of bricks that a heavy ball rolls into", "hair": "hair on a head that turns to and fro",
            "smoke": "hot smoke from a ball that moves below another",
            "sand": "sand that pours into a pile"}                            # scenes of their own


def add_new_command(commands) -> None:
    new = commands.add_parser("new", help="make a scene of a bare mesh, or a small one to begin from")
    new = new.add_subparsers(dest="kind", required=True)
    _new_cloth(new)
    _new_softbody(new)
    for name, told in (("fluid", "smokes, in a box of air around it"),
                       ("liquid", "is full of water at the start, in a tank around it")):
        fluid = new.add_parser(name, help=f"a scene in which a closed mesh, a shape or points {told}")
        fluid.add_argument("mesh", help="USD or OBJ file")
        fluid.add_argument("--cells", type=parse_positive_count, default=64, metavar="N",
                           help="along the longest edge of the box (default: 64)")
    for kind in new.choices.values():
        kind.add_argument("--prim", type=parse_nonempty_name, metavar="PATH",
                          help="which mesh, by path or name (default: the only one)")
        kind.add_argument("--pin", type=parse_nonempty_name, action="append", default=[], metavar="POINTS",
                          help="hold points: top, bottom, 0.9..1@z (part of the bounds), 0,5,20..25 (numbers) or a GeomSubset; "
                               "may be repeated")
        kind.add_argument("--collider", type=parse_nonempty_name, action="append", default=[], metavar="FILE_OR_PRIM",
                          help="make a USD file, or a prim of the mesh's file, collide; may be repeated")
        kind.add_argument("--material", type=parse_nonempty_name, metavar="PATH",
                          help="a physics material of the mesh's file (default: the "
                                                                         "one it is bound to, if any)")
        kind.add_argument("--meters-per-unit", type=parse_positive_number, metavar="X",
                          help="unit of the mesh (default: its file's)")
    robot = new.add_parser("robot", help="a scene of a robot, converted to USD by a tool of the Newton project")
    robot.add_argument("file", help="URDF file, or MuJoCo's XML file")
    meshes = list(new.choices.values())
    for name, told in STARTERS.items():
        new.add_parser(name, help=f"a small scene that needs no mesh: {told}" + "; or, with --on, your own" * (name == "hair"))
    _add_hair_options(new.choices["hair"])
    for kind in new.choices.values():
        kind.add_argument("-o", "--output", type=parse_nonempty_name, required=True, metavar="SCENE")
        kind.add_argument("--force", action="store_true", help="replace SCENE if it is there")
        kind.add_argument("--frames", type=parse_positive_count, metavar="N",
                          help="frames to simulate (default: those of the file, else " "what the scene needs)")
        kind.add_argument("--debug", action="store_true", help="show where an error came from")
    for kind in meshes:
        kind.add_argument("--ground", type=parse_height, metavar="HEIGHT",
                          help="a ground plane at this height along the up axis, in metres: 0 is that of the origin "
                               "(default: none)")


def _add_hair_options(hair) -> None:
    hair.add_argument("--on", type=parse_nonempty_name, metavar="MESH", dest="mesh",
                      help="USD or OBJ file: hair grows on its mesh, and goes with its animation (default: a head that turns)")
    hair.add_argument("--prim", type=parse_nonempty_name, metavar="PATH",
                      help="with --on: which mesh, by path or name (default: the only one)")
    hair.add_argument("--where", type=parse_nonempty_name, metavar="PART",
                      help="with --on: part of the bounds of the mesh that has hair, such as 0.6..1@y (default: all)")
    hair.add_argument("--strands", type=parse_positive_count, metavar="N", help="with --on: how many (default: 400)")
    hair.add_argument("--length", type=parse_positive_number, metavar="METRES",
                      help="with --on: of a strand (default: half of the size of the mesh)")
    hair.add_argument("--meters-per-unit", type=parse_positive_number, metavar="X",
                      help="with --on: unit of the mesh (default: its file's)")
    hair.add_argument("--collider", type=parse_nonempty_name, action="append", default=[], metavar="FILE_OR_PRIM",
                      help="with --on: make a USD file, or a prim of the mesh's file, collide; may be repeated")
    hair.add_argument("--ground", type=parse_height, metavar="HEIGHT",
                      help="with --on: a ground plane at this height along the up axis, in metres (default: none)")


def _new_cloth(new) -> None:
    cloth = new.add_parser("cloth", help="a scene in which a mesh is cloth; the mesh is referred to and stays as it is")
    cloth.add_argument("mesh", help="USD or OBJ file")
    cloth.add_argument("--fabric", metavar="NAME", help="silk, cotton, denim, leather or rubber (default: the physics material "
                                                        "of the mesh, else cotton)")
    cloth.add_argument("--weld", type=parse_length, metavar="METRES", help="sew points closer than this (seams)")
    cloth.add_argument("--self-collision", action="store_true", help="the cloth touches itself (slower; default: it passes "
                                                                     "through itself)")


def _new_softbody(new) -> None:
    soft = new.add_parser("softbody", help="a scene in which a TetMesh, or a closed mesh in a cage of tets, is a soft body; "
                                           "the mesh is referred to and stays as it is")
    soft.add_argument("mesh", help="USD or OBJ file")
    soft.add_argument("--cells", type=parse_positive_count, default=10, metavar="N",
                      help="cells of the cage along the longest side; 4 and more across it bend as they should (default: 10)")
    soft.add_argument("--young", type=parse_positive_number, metavar="PA", help="Young's modulus [Pa] (default: 1e6, rubber)")
    soft.add_argument("--poisson", type=float, metavar="NU", help="Poisson's ratio, below 0.5 (default: 0.3)")
    soft.add_argument("--density", type=parse_positive_number, metavar="RHO", help="kg/m^3 (default: 1000, water)")
    soft.add_argument("--model", choices=MODELS,
                      help="elastic energy (default: corotational; neo_hookean for large strain)")
