"""Small scenes without a mesh, to begin from: `wsim new rigid`, `wsim new hair`, `wsim new smoke` and `wsim new sand`.

    rigid    a wall of bricks that a heavy ball rolls into
    hair     hair on a head that turns to and fro
    smoke    hot smoke from a ball that moves below another
    sand     sand that pours into a pile
"""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from wsim.scene import Box, Plane, Problem, Scene, Sphere
from wsim.scene.curve import Motion
from wsim.scene.methods import method_file
from wsim.usd.load import read_stage
from wsim.usd.stage import collect_warnings
from wsim.usd.write import save

BRICK = np.array([0.1, 0.05, 0.05])                    # half edges [m]
LAYERS, ROW = 6, 4                                     # of the wall, and bricks of a layer
CLAY, STEEL, EMBER = (0.50, 0.14, 0.07), (0.20, 0.24, 0.30), (0.60, 0.12, 0.03)       # linear colours
SKIN, BROWN, SAND = (0.82, 0.66, 0.54), (0.13, 0.06, 0.03), (0.62, 0.42, 0.20)
HEAD, STRANDS, POINTS, LENGTH = 0.1, 140, 14, 0.22      # radius [m], strands, points of each, length [m]
GOLDEN = np.pi * (1.0 + 5.0**0.5)                      # [rad] from strand to strand: they are spread evenly


def author_starter(kind: str, out, frames: int | None = None) -> list[Problem]:
    """Writes the scene `out` (.usda, .usdc, .usd) of a kind, a key of STARTERS; frames: of the run. Returns warnings.

    Raises SceneError where the file cannot be written."""
    scene, colours = STARTERS[kind]()
    if frames is not None:
        scene.frames = frames
    with collect_warnings([]):
        save(scene, out)
        stage = Usd.Stage.Open(str(out))
        for path, colour in colours.items():
            primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path))
            primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray).Set([Gf.Vec3f(*colour)])
        stage.GetRootLayer().documentation = f"A small scene to begin from, made by `wsim new {kind}`"
        stage.GetRootLayer().Save()
        return list(read_stage(stage).notes)


def build_wall() -> tuple[Scene, dict[str, tuple]]:
    """Bricks in layers, each shifted by a third of a brick, and a ball that rolls along z; the colour of each prim."""
    scene, colours = Scene(frames=60), {}
    scene.collider("/World/floor", Plane(), static_friction=0.6, dynamic_friction=0.5)
    for layer in range(LAYERS):
        for k in range(ROW):
            x = 2.0 * BRICK[0] * (k - 0.5 * (ROW - 1) + 0.15 * (-1) ** layer)
            path = f"/World/brick_{layer}_{k}"
            scene.body(path, Box(tuple(BRICK)), at=(x, BRICK[1] * (2 * layer + 1), 0.0), density=1800.0, static_friction=0.6,
                       dynamic_friction=0.5)
            colours[path] = tuple(np.array(CLAY) * (0.75 + 0.5 * ((3 * layer + 5 * k) % 7) / 6.0))
    scene.body("/World/ball", Sphere(0.14), at=(0.05, 0.14, 1.0), density=5000.0, velocity=(0.0, 0.0, -3.5),
               spin=(-25.0, 0.0, 0.0))
    return scene, {**colours, "/World/ball": STEEL}


def build_hair() -> tuple[Scene, dict[str, tuple]]:
    """Strands combed down on a ball that turns about the vertical; the colour of each prim."""
    scene, times = Scene(frames=72), np.arange(0.0, 3.01, 0.125)
    angles = 1.0 * np.sin(2.0 * np.pi * times / 1.25) * np.clip(np.minimum(times, 2.25 - times) / 0.4, 0.0, 1.0)
    turns = np.stack([0.0 * angles, np.sin(0.5 * angles), 0.0 * angles, np.cos(0.5 * angles)], axis=1)
    motion = Motion.through(times, np.tile((0.0, 0.3, 0.0), (len(times), 1)), turns)
    scene.collider("/World/head", Sphere(HEAD), motion=motion, static_friction=0.3, dynamic_friction=0.3)
    k, s = np.arange(STRANDS) + 0.5, np.linspace(0.0, 1.0, POINTS)[None, :, None]
    y = 1.0 - 0.9 * k / STRANDS
    level = np.stack([np.cos(GOLDEN * k), 0.0 * k, np.sin(GOLDEN * k)], axis=1)
    out = np.sqrt(1.0 - y * y)[:, None] * level + y[:, None] * (0.0, 1.0, 0.0)
    down = (0.25 * level - (0.0, 1.0, 0.0))[:, None]
    points = (0.0, 0.3, 0.0) + out[:, None] * (HEAD - 0.004 + 0.5 * LENGTH * s * (2.0 - s)) + 0.5 * LENGTH * s**2 * down
    hair = scene.rods("/World/hair", points.reshape(-1, 3), np.full(STRANDS, POINTS), diameters=0.002, young=5e7,
                      density=1300.0, damping=0.002, static_friction=0.3, dynamic_friction=0.3)
    first = POINTS * np.arange(STRANDS)
    hair.pin("/World/roots", np.sort(np.concatenate([first, first + 1])), target="/World/head", motion=motion)
    return scene, {"/World/head": SKIN, "/World/hair": BROWN}


def build_smoke() -> tuple[Scene, dict[str, tuple]]:
    """A box of air, a ball that lets hot smoke out on its way to and fro, and one that the smoke meets; the colours."""
    scene, times = Scene(frames=72), np.arange(0.0, 3.01, 0.25)
    x = 0.3 * np.sin(2.0 * np.pi * times / 3.0)
    motion = Motion.through(times, np.stack([x, 0.2 + 0.0 * x, 0.0 * x], axis=1))
    air = scene.smoke("/World/air", low=(-0.6, 0.0, -0.4), high=(0.6, 1.6, 0.4), cell=0.04, smoke_decay=0.2)
    scene.smoke_source("/World/burner", air, Sphere(0.09), motion=motion, smoke=1.0, temperature=120.0, hold=True)
    scene.collider("/World/ball", Sphere(0.15), at=(0.0, 0.8, 0.0))
    return scene, {"/World/ball": STEEL, "/World/burner": EMBER}


def build_sand() -> tuple[Scene, dict[str, tuple]]:
    """A ball that pours 6 kg of sand a second on a rough floor, and stops; the colours."""
    scene, grains = Scene(frames=60), method_file("MaterialPoints", "objects")
    scene.collider("/World/floor", Plane(), static_friction=0.7, dynamic_friction=0.6)
    scene.mpm("/World/sand", Sphere(0.05), at=(0.0, 0.4, 0.0), cell=0.03, velocity=(0.0, -1.0, 0.0),
              material=grains.Granular(young=1e5, friction_angle=0.6), pour=grains.Pour(end=1.8, rate=6.0))
    return scene, {"/World/sand": SAND}


STARTERS = {"rigid": build_wall, "hair": build_hair, "smoke": build_smoke, "sand": build_sand}
