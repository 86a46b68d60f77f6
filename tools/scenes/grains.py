"""The example scenes of material points; python -m tools.scenes writes them."""

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.scenes.fluid import placed
from tools.usda import block, ground, listed, moved, number, pin, said, scene, settings, solid
from wsim import shapes

API = '["WsimMaterialPointsAPI"]'
# name, colour, place [m], Young's modulus [Pa], spin [rad/s]
CUBES = (("Green", (0.1, 0.42, 0.12), (0.0, 0.2, 0.0), 1.2e4, None),
         ("Orange", (0.8, 0.3, 0.04), (0.1, 0.56, 0.05), 2.5e4, None),
         ("Red", (0.62, 0.05, 0.06), (-0.06, 0.95, -0.04), 5e4, (2.0, 1.0, 3.0)))


def body(name: str, shape: tuple[str, str], color, cell: float, comment: str = "", **values) -> str:
    """A shape full of particles. shape: its type and what it has."""
    kind, lines = shape
    text = (f'uniform token purpose = "guide"\n{lines}\ncolor3f[] primvars:displayColor = '
            f"[({', '.join(number(c) for c in color)})]\n{said('MaterialPoints', 1.0, cell=cell, **values)}")
    return block(kind, name, text, API, comment)


def lathe(profile, sides: int = 32, closed: bool = False, turn: float = 2.0 * np.pi) -> str:
    """Points and faces of a Mesh that a profile (r, y) makes around the y axis; closed: with a lid at both ends; turn [rad]."""
    r, y = np.asarray(profile, float).T
    whole = turn > 6.28
    angle = np.linspace(0.0, turn, sides + 1)[:sides + (not whole)] + np.pi * (not whole)
    points = np.stack([np.outer(r, np.cos(angle)), np.repeat(y[:, None], len(angle), 1), np.outer(r, np.sin(angle))], -1)
    n, faces = len(angle), []
    for k in range(len(r) - 1):
        for a in range(n if whole else n - 1):
            b = (a + 1) % n
            faces.append([k * n + a, (k + 1) * n + a, (k + 1) * n + b, k * n + b])
    counts = [4] * len(faces)
    if closed:
        faces += [list(range(n)), list(range(len(r) * n - 1, (len(r) - 1) * n - 1, -1))]
        counts += [n, n]
    corners = np.concatenate([np.asarray(face) for face in faces])
    return (f"point3f[] points = {listed(points.reshape(-1, 3))}\nint[] faceVertexCounts = {listed(np.asarray(counts))}\n"
            f'int[] faceVertexIndices = {listed(corners)}\nuniform token subdivisionScheme = "none"')


def camera(at, turn: float, tilt: float) -> str:
    """A camera at a place [m], turned to the left and tilted [degrees] from looking along -z."""
    return block("Camera", "View", f"float focalLength = 35\nfloat horizontalAperture = 36\nfloat verticalAperture = 20.25\n"
                 f"double3 xformOp:translate = ({', '.join(number(v) for v in at)})\nfloat3 xformOp:rotateYXZ = "
                 f"({number(tilt)}, {number(turn)}, 0)\n"
                 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateYXZ"]')


def snowball() -> str:
    ball = body("Ball", ("Sphere", "double radius = 0.14\n" + moved(0.3, 0.62, 0.05)), (0.86, 0.9, 0.94), 0.035,
                "A ball of snow, full of particles, 8 in each cell of the grid. A result has them as Points beside it: "
                "Ball_drops.",
                material="snow", velocity=(-11.0, 1.0, 0.0), tension_limit=0.0025)
    wall = solid("Cube", "Wall", placed((-0.5, 0.0, -0.45), (-0.4, 1.1, 0.5)), (0.5, 0.3, 0.24),
                 "Snow that is pressed too far stays pressed, and what is pulled apart breaks.")
    return scene("A snowball bursts on a wall, and what does not stick falls.", [
        settings(comment="It pulls the ball down on its way."), ball, wall, ground(),
        camera((1.75, 1.05, 2.3), 38.0, -16.0)], frames=16)


def jelly_cubes() -> str:
    """Stiffer from below to above; the first lands on an edge."""
    parts = []
    for name, color, at, young, spin in CUBES:
        more = {"spin": spin} if spin else {}
        parts.append(body(name, ("Cube", "double size = 0.24\n" + moved(*at)), color, 0.04,
                          "" if parts else "Cubes of jelly, each stiffer than that below.", material="jelly", young=young,
                          viscosity=20.0, **more))
    return scene("Three cubes of jelly fall on each other, and wobble.", [
        settings(comment="All bodies of particles meet on one grid, of one cell size."), *parts, ground(),
        camera((1.15, 0.95, 1.85), 31.0, -16.0)], frames=24)


def hourglass() -> str:
    """The neck is five cells wide. Sand is the upper half's inside, a cell off the glass."""
    glass = [(0.2, 0.98), (0.2, 0.86), (0.07, 0.54), (0.07, 0.5), (0.2, 0.18), (0.2, 0.02)]
    sand = [(0.065, 0.57), (0.17, 0.83)]
    upper = block("Mesh", "Sand", 'uniform token purpose = "guide"\n' + lathe(sand, closed=True)
                  + "\ncolor3f[] primvars:displayColor = [(0.62, 0.42, 0.2)]\n"
                  + said("MaterialPoints", 1.0, material="sand", cell=0.028, young=1.5e5, friction_angle=0.6), API,
                  "A closed mesh full of sand, by 8 particles a cell. Its slopes stand at 34 degrees.")
    wall = block("Mesh", "Glass", 'uniform token purpose = "guide"\n' + lathe(glass, 40)
                 + "\nrel material:binding:physics = </World/Smooth>", '["PhysicsCollisionAPI", "MaterialBindingAPI"]',
                 "What keeps the sand in: an open mesh collides from both sides. It is not drawn.")
    seen = block("Mesh", "Back", lathe(glass, 20, turn=np.pi) + "\ncolor3f[] primvars:displayColor = [(0.56, 0.62, 0.66)]",
                 comment="The half of the glass that is behind the sand, to be seen.")
    smooth = block("Material", "Smooth", "float physics:staticFriction = 0.2\nfloat physics:dynamicFriction = 0.2",
                   '["PhysicsMaterialAPI"]')
    lid = "double height = 0.02\ndouble radius = 0.24\nuniform token axis = \"Y\"\n"
    wood = (0.3, 0.17, 0.08)
    top = block("Cylinder", "Top", lid + moved(0.0, 0.99, 0.0)
                + f"\ncolor3f[] primvars:displayColor = [({', '.join(number(c) for c in wood)})]")
    return scene("Sand runs through an hourglass, at a rate that does not depend on how much is left.", [
        settings(comment="It is all that drives the sand."), upper, wall, seen, smooth, top,
        solid("Cylinder", "Bottom", lid + moved(0.0, 0.01, 0.0), wood), ground()], frames=36)


def sand_castle() -> str:
    """Damp sand: it stands by its cohesion. The ball has 7 times its density."""
    parts = []
    towers = (("Keep", "Cylinder", "double radius = 0.13\ndouble height = 0.34\n" + upright(0.0, 0.17, 0.0)),
              *((f"Tower{k}", "Cylinder", "double radius = 0.075\ndouble height = 0.22\n" + upright(x, 0.11, z))
                for k, (x, z) in enumerate(((0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.25, -0.2)))),
              *((f"Wall{k}", "Cube", placed((x - a, 0.0, z - b), (x + a, 0.12, z + b)))
                for k, (x, z, a, b) in enumerate(((0.0, 0.2, 0.18, 0.04), (0.0, -0.2, 0.18, 0.04), (0.25, 0.0, 0.04, 0.13),
                                                  (-0.25, 0.0, 0.04, 0.13)))))
    for name, kind, lines in towers:
        parts.append(body(name, (kind, lines), (0.66, 0.48, 0.26), 0.04,
                          "" if parts else "Damp sand: its cohesion lets it stand upright.", material="sand", young=2e5,
                          friction_angle=0.6, cohesion=1500.0))
    ball = block("Sphere", "Ball", "double radius = 0.1\n" + moved(0.12, 0.62, 0.06)
                 + "\ncolor3f[] primvars:displayColor = [(0.5, 0.06, 0.05)]\nvector3f physics:velocity = (-1, -3, -0.4)\n"
                 "float physics:density = 11000", '["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI"]',
                 "A ball that the sand stops, by as much momentum as the sand gets.")
    return scene("A heavy ball falls on a sand castle.", [
        settings(comment="Sand and ball push each other."), *parts, ball, ground(),
        camera((0.82, 0.72, 1.14), 35.7, -26.0)], frames=24)


def sand_on_cloth() -> str:
    """The cloth weighs 0.1 kg, the sand 11 kg."""
    points, counts, indices = shapes.sheet(0.8, 0.8, 16, 16, horizontal=True)
    points = points - points.mean(axis=0) + np.array([0.0, 0.62, 0.0])
    corners = [0, 16, 16 * 17, 16 * 17 + 16]
    sand = body("Sand", ("Sphere", "double radius = 0.12\n" + moved(0.02, 0.77, 0.0)), (0.66, 0.48, 0.26), 0.05,
                "A ball of dry sand: it falls apart on the cloth.", material="sand", young=1e5, friction_angle=0.55)
    sheet = cloth("Cloth", (points, counts, indices), "sailcloth", (0.16, 0.26, 0.42),
                  "A cloth of a hundredth of the sand's mass. It sags by the weight that lies on it.")
    return scene("Sand falls into a cloth that hangs by its corners, and weighs it down.", [
        settings(solver="implicit", substeps=4, iterations=8, comment="Newton steps: sweeps would leave threads loose that "
                 "bear a hundred times the cloth's weight."),
        sand, material("sailcloth", damping=0.016), sheet, block("Xform", "Posts", ""),
        pin("Corners", "/World/Cloth", corners, "/World/Posts", "Its corners stay where they are."),
        ground(), camera((0.85, 1.5, 1.25), 34.0, -36.0)], frames=60, fps=60)


def upright(x: float, y: float, z: float) -> str:
    """A cylinder's axis, and its place [m]."""
    return 'uniform token axis = "Y"\n' + moved(x, y, z)


GRAIN_SCENES = {"snowball": snowball, "jelly_cubes": jelly_cubes, "hourglass": hourglass,
                "sand_castle": sand_castle, "sand_on_cloth": sand_on_cloth}
