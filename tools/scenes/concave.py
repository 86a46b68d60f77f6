"""Example scenes of concave bodies, which touch as the meshes that they are; python -m tools.scenes writes them. Grids of their
meshes serve tests too (tests/physics/rigid/concave/meshes.py)."""

from math import cos, degrees, pi, radians, sin

import numpy as np

from tools.usda import block, listed, number, said, scene, settings, solid

IRON, BRASS = (0.42, 0.44, 0.48), (0.75, 0.58, 0.28)
MESH = '["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "PhysicsMassAPI"]'


def torus_grid(R: float, r: float, n: int, m: int) -> np.ndarray:
    """Places (n, m, 3) [m] of a torus about z."""
    u, v = 2 * pi * np.arange(n)[:, None] / n, 2 * pi * np.arange(m)[None] / m
    w = R + r * np.cos(v)
    return np.stack(np.broadcast_arrays(np.cos(u) * w, np.sin(u) * w, r * np.sin(v)), axis=-1)


def gear_grid(teeth: int, module: float, width: float, backlash: float) -> np.ndarray:
    """Places (points of the outline, 4, 3) [m] of a spur gear about z with involute flanks of 20 degrees, its first tooth along
    x, and a bore."""
    pitch, alpha = 0.5 * module * teeth, radians(20.0)
    base, top, root = pitch * cos(alpha), pitch + module, pitch - 1.25 * module

    def involute(a):
        return np.tan(a) - a
    half = pi / (2 * teeth) - 0.5 * backlash * module / pitch + involute(alpha)
    r = np.linspace(max(base, root), top, 4)
    turn = half - involute(np.arccos(np.minimum(1.0, base / r)))
    foot = [root] if root < base else []
    radius = np.concatenate([foot, r, r[::-1], foot])
    angle = np.concatenate([[-half] * len(foot), -turn, turn[::-1], [half] * len(foot)])
    angle = (angle + 2 * pi * np.arange(teeth)[:, None] / teeth).ravel()
    radius = np.tile(radius, teeth)
    inner, even = np.full(len(radius), 0.3 * root), angle[0] + 2 * pi * np.arange(len(radius)) / len(radius)
    section = [(radius, angle, -0.5), (radius, angle, 0.5), (inner, even, 0.5), (inner, even, -0.5)]
    return np.stack([np.stack([s * np.cos(a), s * np.sin(a), np.full(len(s), z * width)], axis=-1) for s, a, z in section],
                    axis=1)


def loop_faces(n: int, m: int) -> np.ndarray:
    """Quads (n m, 4) of a grid that closes both ways."""
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    return np.stack([(i + a) % n * m + (j + b) % m for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=-1).reshape(-1, 4)


def looped_mesh(grid: np.ndarray) -> str:
    quads = loop_faces(*grid.shape[:2])
    return (f"point3f[] points = {listed(grid.reshape(-1, 3))}\nint[] faceVertexCounts = {listed(np.full(len(quads), 4))}\n"
            f'int[] faceVertexIndices = {listed(quads.ravel())}\nuniform token subdivisionScheme = "none"\n')


def turned(at, **turns: float) -> str:
    """A place [m] and turns [degrees] about axes, the last first."""
    ops = "".join(f"double xformOp:rotate{axis} = {number(turn)}\n" for axis, turn in turns.items())
    names = ", ".join(f'"xformOp:{op}"' for op in ("translate", *(f"rotate{axis}" for axis in turns)))
    return f"double3 xformOp:translate = ({', '.join(number(v) for v in at)})\n{ops}uniform token[] xformOpOrder = [{names}]\n"


def coloured(color) -> str:
    return f"color3f[] primvars:displayColor = [({', '.join(number(c) for c in color)})]\n"


def chain() -> str:
    """Twelve links of a mesh that is written once, at 55 degrees from where they will hang."""
    R, r, links, tilt = 0.1, 0.025, 12, radians(55.0)
    pitch, along = 2.0 * (R - r) - 2e-4, np.array([sin(tilt), -cos(tilt), 0.0])
    form = block("Mesh", "Link", looped_mesh(torus_grid(R, r, 24, 12))).replace('def Mesh', "class Mesh", 1)

    def link(k: int) -> str:
        place = turned(k * pitch * along, Z=degrees(tilt), **({"Y": 90.0} if k % 2 else {}))
        hook = k == 0
        text = block("Mesh", "Hook" if hook else f"Link{k:02d}", place + ("" if hook else "float physics:density = 7800\n")
                     + coloured(BRASS if hook else IRON), MESH if not hook else
                     '["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]',
                     "A collider stays where it is; bodies meet it as the mesh that it is." if hook else
                     "Each link is a body. Without an approximation it touches as a mesh, hole included." * (k == 1))
        return text.replace("prepend apiSchemas", "prepend references = </World/Forms/Link>\n    prepend apiSchemas", 1)
    eye = block("Mesh", "Eye", coloured(BRASS), '["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]').replace(
        "prepend apiSchemas", "prepend references = </World/Forms/Link>\n    prepend apiSchemas", 1)
    bob = solid("Sphere", "Bob", "double radius = 0.14\n" + turned((0.0, -R - 0.13, 0.0)), BRASS)
    place = turned((links + 1) * pitch * along, Z=degrees(tilt), **({"Y": 90.0} if links % 2 == 0 else {}))
    weight = block("Xform", "Weight", place + "float physics:density = 7800\n" + eye + bob,
                   '["PhysicsRigidBodyAPI", "PhysicsMassAPI"]', "A ring and a ball are one body, which weighs ten links.")
    return scene("A chain of twelve links swings from a hook, and carries a weight.", [
        settings(substeps=24, iterations=4, comment="Links sink into each other by g h^2 times the weight that they carry."),
        block("Scope", "Forms", form, comment="A class is not simulated: links refer to it."),
        *[link(k) for k in range(links + 1)], weight], frames=96)


def gears() -> str:
    """Twelve teeth drive twenty, and these twelve others."""
    module, width, speed = 0.04, 0.08, 100.0
    teeth, color = [12, 20, 12], [BRASS, IRON, (0.55, 0.32, 0.22)]
    pitches = [0.5 * module * t for t in teeth]
    at = [np.zeros(3), np.array([pitches[0] + pitches[1], 0.0, 0.0])]
    rise = radians(50.0)
    at.append(at[1] + (pitches[1] + pitches[2]) * np.array([cos(rise), sin(rise), 0.0]))
    turn = [0.0, 180.0 + 180.0 / teeth[1]]
    turn.append(degrees(rise) + 180.0 + 180.0 / teeth[2] - (turn[1] - degrees(rise)) * teeth[1] / teeth[2])
    parts = []
    for k, name in enumerate(("Driver", "Wheel", "Pinion")):
        mesh = looped_mesh(gear_grid(teeth[k], module, width, 0.06)) + turned(at[k], Z=turn[k]) + coloured(color[k])
        parts.append(block("Mesh", name, mesh + "rel material:binding:physics = </World/greased>\n"
                           "float physics:density = 7800\n", MESH.replace("]", ', "MaterialBindingAPI"]', 1),
                           "Teeth touch as they are: closed meshes with involute flanks." if k == 0 else ""))
        drive = (f"float drive:angular:physics:targetVelocity = {number(speed)}    # degrees a second\n"
                 "float drive:angular:physics:damping = 3    # N m s a degree\n" if k == 0 else "")
        parts.append(block("PhysicsRevoluteJoint", f"Axle{name}", f'uniform token physics:axis = "Z"\n{drive}'
                           f"rel physics:body1 = </World/{name}>\n"
                           f"point3f physics:localPos0 = ({', '.join(number(v) for v in at[k])})\n"
                           "point3f physics:localPos1 = (0, 0, 0)\n"
                           f"quatf physics:localRot1 = ({number(cos(radians(-0.5 * turn[k])))}, 0, 0, "
                           f"{number(sin(radians(-0.5 * turn[k])))})\n",
                           *(('["PhysicsDriveAPI:angular"]', "The first is driven, the others are turned by teeth.")
                             if k == 0 else ("", ""))))
    grease = block("Material", "greased", said("Friction", 1.0, static_friction=0.05, dynamic_friction=0.05),
                   '["PhysicsMaterialAPI"]')
    return scene("Twelve teeth drive twenty, and these drive twelve more.", [
        settings(substeps=20, iterations=8), grease, *parts], frames=96)


CONCAVE_SCENES = {"chain": chain, "gears": gears}
