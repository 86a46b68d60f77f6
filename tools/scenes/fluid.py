"""The example scenes of fluids; python -m tools.scenes writes them."""

from tools.usda import block, moved, number, scene, settings, solid

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


FLUID_SCENES = {"plume": plume, "smoke_rings": smoke_rings}
