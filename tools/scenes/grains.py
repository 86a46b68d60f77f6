"""The example scenes of material points, grains and fluids by constraints; python -m tools.scenes writes them."""

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
                 f"double3 xformOp:translate = ({', '.join(number(v) for v in at)})\nfloat3 xformOp:rotateXYZ = "
                 f"({number(tilt)}, {number(turn)}, 0)\n"
                 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]')


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


# grains and fluids by constraints

BEADS = (("Blue", (0.06, 0.2, 0.5), (0.07, 0.36, 0.04), 0.011, 1.0),
         ("Gold", (0.8, 0.5, 0.08), (-0.07, 0.36, 0.04), 0.009, 0.6),
         ("White", (0.85, 0.85, 0.8), (0.0, 0.36, -0.08), 0.013, 1.4))      # name, colour, place, radius [m], rate [kg/s]


def particles(kind: str, name: str, lines: str, color, comment: str = "", **values) -> str:
    """A shape that particles fill or come from."""
    text = (f'uniform token purpose = "guide"\n{lines}\ncolor3f[] primvars:displayColor = '
            f"[({', '.join(number(c) for c in color)})]\n{said('Particles', 1.0, **values)}")
    return block(kind, name, text, '["WsimParticlesAPI"]', comment)


def cells_surface(breaks, solid_cells) -> str:
    """Points and faces of the closed Mesh about cells of a grid. breaks: three lists of places [m]; solid_cells: a mask."""
    full, faces, number_of = np.pad(np.asarray(solid_cells, bool), 1), [], {}
    for cell in np.argwhere(full):
        for axis in range(3):
            for side in (0, 1):
                beyond = cell + np.eye(3, dtype=int)[axis] * (2 * side - 1)
                if not full[tuple(beyond)]:
                    a, b = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
                    first = cell - 1 + np.eye(3, dtype=int)[axis] * side
                    ring = [first, first + a, first + a + b, first + b]
                    faces.append([number_of.setdefault(tuple(p), len(number_of)) for p in (ring if side else ring[::-1])])
    points = np.array([[breaks[k][p[k]] for k in range(3)] for p in number_of])
    return (f"point3f[] points = {listed(points)}\nint[] faceVertexCounts = {listed(np.full(len(faces), 4))}\n"
            f'int[] faceVertexIndices = {listed(np.concatenate(faces))}\nuniform token subdivisionScheme = "none"')


def keyed(frames: int, place, tilt) -> str:
    """A motion sampled each frame. place, tilt: functions of the time [s] -> (x, y, z) [m], angle about z [degrees]."""
    moves = ",\n".join(f"    {k}: ({', '.join(number(v) for v in place(k / 24))})" for k in range(frames + 1))
    turns = ",\n".join(f"    {k}: {number(tilt(k / 24))}" for k in range(frames + 1))
    return (f"double3 xformOp:translate.timeSamples = {{\n{moves}\n}}\nfloat xformOp:rotateZ.timeSamples = {{\n{turns}\n}}\n"
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]')


def eased(time: float, begin: float, end: float) -> float:
    """0 before, 1 behind, and a smooth step between two times [s]."""
    s = min(max((time - begin) / (end - begin), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


def sand_shovel() -> str:
    """2000 grains of 18 mm; the shovel takes some 300 of them."""
    t, length, wide, high = 0.004, 0.16, 0.09, 0.05
    mask = np.ones((2, 2, 3), bool)
    mask[1, 1, 1] = False
    scoop = cells_surface(([-t, 0.0, length], [-t, 0.0, high], [-wide - t, -wide, wide, wide + t]), mask)
    path = keyed(96, lambda s: (-0.42 + 0.27 * eased(s, 0.0, 2.2) - 0.04 * eased(s, 2.3, 4.0),
                                t + 0.002 + 0.22 * eased(s, 2.1, 4.0), 0.0), lambda s: 18.0 * eased(s, 2.1, 3.5))
    pile = particles("Cube", "Pile", placed((-0.14, 0.0, -0.18), (0.22, 0.14, 0.18)), (0.66, 0.48, 0.26), "Grains that fill a "
                     "block, and slump. They are coarse: one sees each.", material="grains", radius=0.009,
                     static_friction=0.45, dynamic_friction=0.45, rolling_friction=0.1)
    shovel = solid("Mesh", "Shovel", f"{scoop}\n{path}", (0.2, 0.26, 0.34), "A closed mesh with a floor and three walls, which "
                   "keys move: it goes into the pile, tilts, and lifts what lies on it.")
    return scene("A shovel goes into a pile of coarse sand, and lifts some of it.", [
        settings(solver="xpbd", substeps=100, iterations=7, comment="Grains move in the sweeps of XPBD. The shovel presses "
                 "them: few substeps would let them overlap."),
        pile, shovel, solid("Cube", "Wall", placed((0.22, 0.0, -0.26), (0.25, 0.16, 0.26)), (0.5, 0.3, 0.24),
                            "What the heap leans against."),
        ground(), camera((0.48, 0.79, 0.88), 34.0, -36.0)], frames=96)


def beads_in_bowl() -> str:
    """Some 480 beads; all that falls stays in the bowl."""
    bowl = lathe([(0.07, 0.0), (0.13, 0.02), (0.2, 0.09), (0.225, 0.17), (0.21, 0.175), (0.185, 0.1), (0.12, 0.035),
                  (0.06, 0.016)], 40, closed=True)
    pours = [particles("Sphere", name, "double radius = 0.05\n" + moved(*at), color, "" if k else "A ball from which beads "
                       "come for two seconds. A result has them as Points beside it: Blue_drops.", material="grains",
                       radius=radius, density=2500.0, static_friction=0.3, dynamic_friction=0.3, velocity=(0.0, -0.6, 0.0),
                       pour_start=0.0, pour_end=48.0, pour_rate=rate)
             for k, (name, color, at, radius, rate) in enumerate(BEADS)]
    return scene("Beads of three sizes pour into a bowl, and stay in it.", [
        settings(solver="xpbd", substeps=60, iterations=6, comment="Beads come down at 2.6 m/s: in a substep of 1/1440 s they "
                 "go 2 mm, a fifth of a radius."),
        *pours, solid("Mesh", "Bowl", bowl, (0.32, 0.36, 0.4), "A closed mesh, concave: beads lie within its hollow."),
        ground(), camera((0.3, 0.66, 0.56), 28.2, -44.0)], frames=72)


def two_waters() -> str:
    """Columns of 0.3 x 0.4 x 0.16 m: particles of 2 cm by constraints, and a liquid of 4 cm cells with 8 in each."""
    low, high, near = (-0.5, 0.0, -0.28), (0.5, 0.6, -0.12), (-0.5, 0.0, 0.08)
    box = block("Cube", "Tank", f'uniform token purpose = "guide"\n{placed(low, high)}\n' + said("Liquid", 1.0, cell=0.04),
                '["WsimLiquidDomainAPI"]', "Behind: a liquid on a grid.")
    water = block("Cube", "Liquid", 'uniform token purpose = "guide"\n' + placed(low, (-0.2, 0.4, -0.12)),
                  '["WsimLiquidSourceAPI"]', "What is full of it at the start.")
    drops = block("Points", "Tank_drops", "color3f[] primvars:displayColor = [(0.1, 0.32, 0.6)]")
    fluid = particles("Cube", "Fluid", placed(near, (-0.2, 0.4, 0.24)), (0.1, 0.45, 0.5), "In front: the same column as "
                      "particles whose density constraints keep.", material="fluid", radius=0.01, viscosity=1e-3)
    walls = [solid("Cube", name, 'uniform token purpose = "guide"\n' + placed(*ends)
                   + "\nrel material:binding:physics = </World/Smooth>",
                   comment="The tank of the particles." * (name == "Left"), apis=', "MaterialBindingAPI"')
             for name, ends in (("Left", ((-0.6, -0.1, 0.0), (-0.5, 0.8, 0.32))),
                                ("Right", ((0.5, -0.1, 0.0), (0.6, 0.8, 0.32))),
                                ("Back", ((-0.6, -0.1, 0.0), (0.6, 0.8, 0.08))),
                                ("Front", ((-0.6, -0.1, 0.24), (0.6, 0.8, 0.32))),
                                ("Floor", ((-0.6, -0.1, 0.0), (0.6, 0.0, 0.32))))]
    smooth = block("Material", "Smooth", "float physics:staticFriction = 0\nfloat physics:dynamicFriction = 0",
                   '["PhysicsMaterialAPI"]')
    return scene("Two columns of water break: one by constraints, one as a liquid on a grid.", [
        settings(solver="xpbd", substeps=16, iterations=4, comment="Sixteen substeps of 1/24 s for the particles; the liquid "
                 "chooses its own."), box, water, drops, fluid, smooth, *walls,
        camera((0.3, 0.75, 1.5), 11.0, -19.0)], frames=36)


GRAIN_SCENES = {"snowball": snowball, "jelly_cubes": jelly_cubes, "hourglass": hourglass,
                "sand_castle": sand_castle, "sand_on_cloth": sand_on_cloth, "sand_shovel": sand_shovel,
                "beads_in_bowl": beads_in_bowl, "two_waters": two_waters}
