"""The example scenes of fluids; python -m tools.scenes writes them."""

from math import pi, sin

import numpy as np

from tools.scenes.cloth import cloth, material
from tools.scenes.rigid import body
from tools.usda import block, ground, moved, number, pin, scene, settings, solid
from wsim.scene import shapes

AIR = ("A box of air on a grid of cubes. Its smoke, temperature and velocity are written as a Volume beside the layer, an "
       "OpenVDB file a frame.")


def domain(low, high, cell: float, lines: str, comment: str = AIR) -> str:
    """A domain from corner to corner [m]: a Cube of size 1 that is scaled."""
    size = [b - a for a, b in zip(low, high, strict=True)]
    middle = [0.5 * (a + b) for a, b in zip(low, high, strict=True)]
    place = (f"double3 xformOp:translate = ({', '.join(number(v) for v in middle)})\n"
             f"float3 xformOp:scale = ({', '.join(number(v) for v in size)})\n"
             'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]')
    return block("Cube", "Air", f'uniform token purpose = "guide"\ndouble size = 1\n{place}\ndouble wsim:fluid:cellSize = '
                 f"{number(cell)}\n{lines}", '["WsimFluidDomainAPI"]', comment)


def source(name: str, shape: tuple[str, str], at, lines: str, comment: str = "") -> str:
    """shape: its type and sizes."""
    kind, sizes = shape
    said = f'uniform token purpose = "guide"\n{sizes}\n{lines}\n{moved(*at)}'
    return block(kind, name, said, '["WsimFluidSourceAPI"]', comment)


def sides(*kinds: str) -> str:
    named = ", ".join(f'"{kind}"' for kind in kinds)
    return f"uniform token[] wsim:fluid:sides = [{named}]"


def plume() -> str:
    ball = solid("Sphere", "Ball", "double radius = 0.15\n" + moved(0.03, 0.75, 0.0),
                 comment="An obstacle, to a part of a cell.")
    fire = source("Fire", ("Sphere", "double radius = 0.1"), (0, 0.15, 0),
                  "double wsim:fluid:smoke = 3\ndouble wsim:fluid:temperature = 200",
                  "Adds smoke of 3 and 200 K a second; heat rises.")
    air = domain((-0.4, 0.0, -0.4), (0.4, 1.4, 0.4), 0.04, sides("open", "open", "closed", "open", "open", "open")
                 + "\ndouble wsim:fluid:cooling = 0.2")
    return scene("Warm smoke rises from the floor, and past a ball.", [
        settings(comment="It pulls at cold air more than at warm air, which rises."), air, fire, ball], frames=72)


def smoke_rings() -> str:
    """Puffs of 0.12 s from two sides."""
    puff = ("double wsim:fluid:strength.timeSamples = {{ 0: 1, 3: 1, 3.01: 0 }}\nuniform bool wsim:fluid:hold = true\n"
            "double wsim:fluid:smoke = 1\nvector3d wsim:fluid:velocity = ({}, 0, 0)")
    disk = ("Cylinder", 'uniform token axis = "X"\ndouble radius = 0.12\ndouble height = 0.08')
    air = domain((-0.7, 0.0, -0.4), (0.7, 0.8, 0.4), 0.04, sides(*["open"] * 6))
    return scene("Two smoke rings are blown at each other, and spread where they meet.", [
        settings(comment="Nothing here is warm or heavy."), air,
        source("Left", disk, (-0.6, 0.4, 0), puff.format("2"), "Air of 2 m/s and smoke of 1 within, for three frames: its rim "
               "rolls up into a ring."),
        source("Right", disk, (0.6, 0.4, 0), puff.format("-2"))], frames=72)


def view(x: float, y: float, away: float) -> str:
    """A camera in front of a flat fluid."""
    return block("Camera", "View", f"float focalLength = 50\n{moved(x, y, away)}", comment="From in front.")


def shown(name: str, size, at, comment: str) -> str:
    """A box that is only there to be seen: no collider."""
    scale = ", ".join(number(v) for v in size)
    place = ", ".join(number(v) for v in at)
    return block("Cube", name, f"double size = 1\ndouble3 xformOp:translate = ({place})\nfloat3 xformOp:scale = ({scale})\n"
                 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]', comment=comment)


def waved_flag() -> str:
    """To and fro in smoke, 50 degrees to each side in 1.6 s; a bar above holds it out, as it would hang else."""
    nx, ny = 18, 12
    surface = shapes.sheet(0.6, 0.4, nx, ny, at=(0.3, 0.6, 0.0))
    keys = ", ".join(f"{f}: {number(50.0 * sin(2.0 * pi * f / 38.4))}" for f in range(0, 97, 2))
    wood = "\ncolor3f[] primvars:displayColor = [(0.45, 0.4, 0.35)]"
    pole = block("Cylinder", "Pole", 'uniform token axis = "Y"\ndouble radius = 0.012\ndouble height = 1\n'
                 + moved(-0.012, 0.5, 0.0) + wood, comment="To be seen only.")
    bar = block("Cylinder", "Bar", 'uniform token axis = "X"\ndouble radius = 0.008\ndouble height = 0.62\n'
                + moved(0.31, 0.808, 0.0) + wood)
    mast = block("Xform", "Mast", f"double xformOp:rotateY.timeSamples = {{ {keys} }}\n"
                 f'uniform token[] xformOpOrder = ["xformOp:rotateY"]\n{pole}\n{bar}', comment="What the flag hangs on.")
    held = [*range(nx + 1), *(np.arange(1, ny + 1) * (nx + 1))]
    air = domain((-0.4, 0.0, -0.8), (0.9, 1.2, 0.8), 0.05, sides("open", "open", "closed", "open", "open", "open"))
    fire = source("Fire", ("Sphere", "double radius = 0.1"), (0.35, 0.05, 0), "uniform bool wsim:fluid:hold = true\n"
                  "double wsim:fluid:smoke = 3\ndouble wsim:fluid:temperature = 60", "Smoke that is 60 K warm rises from the "
                  "floor.")
    return scene("A flag is waved to and fro in rising smoke, which the wind that it makes stirs.", [
        settings(comment="There is no other wind: the flag feels air at rest, by its drag and lift.", substeps=40, iterations=2,
                 air_density=1.2),
        material("cotton"), air, fire,
        cloth("Flag", surface, "cotton", (0.1, 0.3, 0.65), "A wall that moves, for the air: it takes it along, and none goes "
              "through.", drag=0.6, lift=0.6),
        mast, pin("Rope", "/World/Flag", held, "/World/Mast", "The edges along the pole and its bar."),
        view(0.3, 0.55, 3.4)], frames=96)


def vortex_pair() -> str:
    """A flat fluid: what a puff is in three dimensions, a ring, is a pair of vortices in two."""
    cell = 0.0125
    air = domain((-0.8, -0.4, -0.5 * cell), (0.8, 0.4, 0.5 * cell), cell, sides(*["open"] * 4, "closed", "closed")
                 + "\ndouble wsim:fluid:cfl = 1", AIR + " One cell thick: it is flat, and costs no third axis.")
    puff = ("double wsim:fluid:strength.timeSamples = { 0: 1, 4: 1, 4.01: 0 }\nuniform bool wsim:fluid:hold = true\n"
            "double wsim:fluid:smoke = 40\nvector3d wsim:fluid:velocity = (1.5, 0, 0)")
    return scene("A puff in flat air rolls up into two vortices, which carry each other along.", [
        settings(comment="Nothing here is warm or heavy."), air,
        source("Puff", ("Sphere", "double radius = 0.1"), (-0.6, 0, 0), puff,
               "Air of 1.5 m/s for four frames, and smoke that is seen through one cell."),
        shown("Nozzle", (0.04, 0.24, 0.02), (-0.76, 0.0, 0.0), "Where it comes from: only to be seen."), view(0.0, 0.0, 4.2)],
        frames=72)


def cavity() -> str:
    """The flow that grids are measured by: a lid that slides over a box of air, which sticks to its walls."""
    cell = 1.0 / 64.0
    walls = ("uniform bool wsim:fluid:slip = 0\nuniform bool wsim:fluid:layers = 1\n"
             "uniform vector3d[] wsim:fluid:sideVelocities = [(0, 0, 0), (0, 0, 0), "
             "(0, 0, 0), (1, 0, 0), (0, 0, 0), (0, 0, 0)]\ndouble wsim:fluid:viscosity = 0.0025\ndouble wsim:fluid:cfl = 1")
    air = domain((0.0, 0.0, -0.5 * cell), (1.0, 1.0, 0.5 * cell), cell, sides(*["closed"] * 6) + "\n" + walls,
                 AIR + " Its upper side slides to +x at 1 m/s and takes the air along: Reynolds number 400.")
    puff = "uniform bool wsim:fluid:hold = true\ndouble wsim:fluid:smoke = 30"
    return scene("A lid slides over a flat box of air; smoke from its corner shows how that turns.", [
        settings(comment="Nothing here is warm or heavy."), air,
        source("Smoke", ("Sphere", "double radius = 0.06"), (0.12, 0.9, 0), puff, "Smoke that is seen through one cell."),
        shown("Lid", (1.0, 0.02, 0.05), (0.5, 1.01, 0.0), "The lid, only to be seen."), view(0.5, 0.5, 5.0)], frames=144)


def placed(low, high) -> str:
    """Transform of a Cube of size 1 that is a box from corner to corner [m]."""
    middle, size = ([number(f(a, b)) for a, b in zip(low, high, strict=True)]
                    for f in (lambda a, b: 0.5 * (a + b), lambda a, b: b - a))
    return (f"double size = 1\ndouble3 xformOp:translate = ({', '.join(middle)})\nfloat3 xformOp:scale = ({', '.join(size)})\n"
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]')


def dam_break() -> str:
    low, high = (-0.6, 0.0, -0.18), (0.6, 0.72, 0.18)
    water = block("Cube", "Water", 'uniform token purpose = "guide"\n' + placed(low, (-0.24, 0.48, 0.18)),
                  '["WsimLiquidSourceAPI"]', "What is full of water when the scene starts. wsim:liquid:role = \"source\" would "
                  "keep it full.")
    pillar = solid("Cube", "Pillar", placed((0.13, 0.0, -0.05), (0.23, 0.4, 0.05)), comment="An obstacle, to a part of a cell.")
    box = block("Cube", "Tank", f'uniform token purpose = "guide"\n{placed(low, high)}\ndouble wsim:liquid:cellSize = 0.04',
                '["WsimLiquidDomainAPI"]', "The box in which water moves, on a grid of cubes, between walls. Its particles are "
                "written as Points beside it.")
    drops = block("Points", "Tank_drops", "color3f[] primvars:displayColor = [(0.1, 0.32, 0.6)]", comment="What a result "
                  "puts its particles into: it is made where there is none. Its colour is theirs.")
    return scene("A column of water collapses, and runs against a pillar and up the wall.", [
        settings(comment="Nothing holds the water from the start."), box, water, drops, pillar], frames=72)


def floating_boxes() -> str:
    """Half of what is in it is lighter than water; walls and floor are planes too, for bodies know no sides of a liquid."""
    low, high = (-0.6, 0.0, -0.2), (0.6, 0.72, 0.2)
    water = block("Cube", "Water", 'uniform token purpose = "guide"\n' + placed(low, (-0.24, 0.48, 0.2)),
                  '["WsimLiquidSourceAPI"]', "What is full of water when the scene starts.")
    box = block("Cube", "Tank", f'uniform token purpose = "guide"\n{placed(low, high)}\ndouble wsim:liquid:cellSize = 0.04',
                '["WsimLiquidDomainAPI"]', "The box in which water moves. It pushes rigid bodies, and they push it.")
    drops = block("Points", "Tank_drops", "color3f[] primvars:displayColor = [(0.1, 0.32, 0.6)]", comment="The particles of a "
                  "result.")
    said = "Bodies know no sides of a liquid: these walls and the floor keep them in."
    walls = [solid("Cube", name, 'uniform token purpose = "guide"\n' + placed(*ends), comment=said * (name == "Left"))
             for name, ends in (("Left", ((-0.7, 0, -0.3), (-0.6, 1, 0.3))), ("Right", ((0.6, 0, -0.3), (0.7, 1, 0.3))),
                                ("Back", ((-0.7, 0, -0.3), (0.7, 1, -0.2))), ("Front", ((-0.7, 0, 0.2), (0.7, 1, 0.3))))]
    crate = body(("Cube", "Crate", "double size = 0.2"), (-0.02, 0.1, 0.06), (0.78, 0.55, 0.3), 20.0, known=(3.2, 0.0),
                 comment="Two fifths as heavy as water, which runs against it and lifts it.")
    stone = body(("Cube", "Stone", "double size = 0.16"), (0.34, 0.08, -0.1), (0.45, 0.45, 0.5), 5.0, known=(10.24, 0.0),
                 comment="Two and a half times as heavy as water.")
    buoy = body(("Sphere", "Buoy", "double radius = 0.1"), (0.32, 0.62, 0.06), (0.75, 0.2, 0.16), known=(0.84, 0.0),
                comment="A fifth as heavy as water; it falls into it.")
    return scene("A column of water collapses and takes a crate and a ball along; a stone stays.", [
        settings(comment="Nothing holds the water from the start."), box, water, drops, ground(), *walls, crate, stone, buoy],
        frames=96)


FLUID_SCENES = {"plume": plume, "smoke_rings": smoke_rings, "waved_flag": waved_flag, "vortex_pair": vortex_pair,
                "cavity": cavity, "dam_break": dam_break, "floating_boxes": floating_boxes}
