"""Example scenes of machines: a chain and gears, which touch as the meshes that they are, and an arm that moves a box;
python -m tools.scenes writes them. Grids of the meshes serve tests too (tests/physics/rigid/concave/meshes.py)."""

from math import cos, degrees, pi, radians, sin

import numpy as np

from tools.usda import block, ground, listed, number, said, scene, settings, solid

IRON, BRASS = (0.42, 0.44, 0.48), (0.75, 0.58, 0.28)
BODY = '["PhysicsRigidBodyAPI", "PhysicsMassAPI"]'
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


# joint: axis, distance [m] from the joint before along y; its link's radius and length [m], color
ARM = [("Y", 0.12, 0.075, 0.18, IRON), ("Z", 0.2, 0.06, 0.22, BRASS), ("Y", 0.22, 0.05, 0.18, IRON),
       ("Z", 0.2, 0.048, 0.2, BRASS), ("Y", 0.2, 0.042, 0.16, IRON), ("Z", 0.18, 0.036, 0.08, BRASS),
       ("Y", 0.09, 0.032, 0.05, IRON)]
TOOL, REACH = 0.16, 0.04                 # [m] from the last joint to the middle of the fingers; half the width of the box
POSE = np.radians([-35.0, -20.0, 0.0, -100.0, 0.0, -60.0, 35.0])         # where the search for angles begins
STEPS = 2                                # frames between time samples of a drive


def arm_frames(q: np.ndarray) -> list[np.ndarray]:
    """Frames (4, 4) of the links, each at its joint, at angles q [rad]; the last: that of the tool."""
    M, found = np.eye(4), []
    for (axis, way, *_), angle in zip(ARM, q, strict=True):
        c, s = cos(angle), sin(angle)
        R = {"Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis]
        step = np.eye(4)
        step[:3, :3], step[1, 3] = R, way
        M = M @ step
        found.append(M)
    tool = M.copy()
    tool[:3, 3] += TOOL * M[:3, 1]
    return [*found, tool]


def reaching_angles(at, q: np.ndarray) -> np.ndarray:
    """Angles near q [rad] at which the tool is at a place [m] and points down, its fingers along x: damped least squares
    (Wampler 1986)."""
    goal = np.diag([1.0, -1.0, -1.0])
    for _ in range(200):
        frames = arm_frames(q)
        tool = frames[-1]
        off = np.concatenate([at - tool[:3, 3], 0.5 * np.cross(tool[:3, :3].T, goal.T).sum(axis=0)])
        axes = [M[:3, "XYZ".index(axis)] for M, (axis, *_) in zip(frames, ARM, strict=False)]
        J = np.array([np.concatenate([np.cross(a, tool[:3, 3] - M[:3, 3]), a])
                      for a, M in zip(axes, frames, strict=False)]).T
        q = q + J.T @ np.linalg.solve(J @ J.T + 1e-3 * np.eye(6), off)
    return q


def arm_path(frames: int) -> tuple[np.ndarray, np.ndarray]:
    """(angles of joints (samples, 7) [rad], way of each finger (samples,) [m], from the middle) at every STEPS frames."""
    low, high, top = 0.045, 0.24, 0.045 + 2.0 * REACH + 0.002
    stops = [(0.0, (0.42, high, 0.3), 0.06), (0.7, (0.42, low, 0.3), 0.06), (1.2, (0.42, low, 0.3), 0.06),
             (1.6, (0.42, low, 0.3), 0.025), (2.2, (0.42, high, 0.3), 0.025), (3.4, (0.42, high, -0.25), 0.025),
             (4.0, (0.42, top, -0.25), 0.025), (4.3, (0.42, top, -0.25), 0.025), (4.6, (0.42, top, -0.25), 0.06),
             (5.3, (0.42, high, -0.25), 0.06), (6.0, (0.42, high, -0.1), 0.06)]
    times, places, ways = (np.array(column, float) for column in zip(*stops, strict=True))
    q, found, opened = POSE, [], []
    for t in np.arange(0, frames + 1, STEPS) / 24.0:
        k = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
        s = min((t - times[k]) / (times[k + 1] - times[k]), 1.0)
        s = s * s * (3.0 - 2.0 * s)
        at = (1.0 - s) * places[k] + s * places[k + 1]
        q = reaching_angles(at, q)
        found.append(q)
        opened.append((1.0 - s) * ways[k] + s * ways[k + 1])
    return np.array(found), np.array(opened)


def sampled(name: str, values) -> str:
    """Time samples of a drive's target, one every STEPS frames."""
    rows = [f"{STEPS * k}: {number(round(v, 3))}" for k, v in enumerate(values)]
    lines = [", ".join(rows[k:k + 8]) for k in range(0, len(rows), 8)]
    return f"float {name}:physics:targetPosition.timeSamples = {{\n    " + ",\n    ".join(lines) + "\n}\n"


def framed(M: np.ndarray) -> str:
    """A transform, rows as USD has them."""
    rows = ", ".join("(" + ", ".join(number(v) for v in row) + ")" for row in M.T)
    return f'matrix4d xformOp:transform = ({rows})\nuniform token[] xformOpOrder = ["xformOp:transform"]\n'


def arm_link(k: int, M: np.ndarray, angles: np.ndarray) -> list[str]:
    """Link k at its frame M, and its joint, whose drive follows angles [degrees]."""
    axis, way, radius, length, color = ARM[k]
    shapes = solid("Capsule", "Shell", f'uniform token axis = "Y"\ndouble radius = {number(radius)}\n'
                   f"double height = {number(length)}\n" + turned((0.0, 0.5 * length, 0.0)), color)
    if k == len(ARM) - 1:
        shapes += arm_plate("Palm", (0.17, 0.02, 0.05), (0.0, 0.1, 0.0), IRON)
    base = f"rel physics:body0 = </World/Link{k}>\n" if k else ""
    drive = ("float drive:angular:physics:stiffness = 400    # N m a degree\n"
             "float drive:angular:physics:damping = 6    # N m s a degree\n")
    return [block("Xform", f"Link{k + 1}", framed(M) + "float physics:density = 900\n" + shapes, BODY),
            block("PhysicsRevoluteJoint", f"Joint{k + 1}", f'uniform token physics:axis = "{axis}"\n{base}'
                  f"rel physics:body1 = </World/Link{k + 1}>\npoint3f physics:localPos0 = (0, {number(way)}, 0)\n{drive}"
                  + sampled("drive:angular", angles), '["PhysicsDriveAPI:angular"]',
                  "Without body0 it hangs on the world. Inverse kinematics found the angles." * (k == 0))]


def arm_plate(name: str, size, at, color) -> str:
    return solid("Cube", name, "double size = 1\n" + turned(at).replace(
        "uniform token", f"double3 xformOp:scale = ({', '.join(number(v) for v in size)})\nuniform token").replace(
        '"xformOp:translate"]', '"xformOp:translate", "xformOp:scale"]'), color)


def arm_finger(name: str, side: float, tool: np.ndarray, ways: np.ndarray) -> list[str]:
    """A finger that slides along x of the tool, and the slide, whose spring presses with 25 N."""
    M = tool.copy()
    M[:3, 3] += side * ways[0] * tool[:3, 0]
    return [block("Xform", name, framed(M) + "float physics:density = 2000\nrel material:binding:physics = </World/rubber>\n"
                  + arm_plate("Pad", (0.02, 0.08, 0.04), (0.0, 0.0, 0.0), (0.2, 0.2, 0.22)),
                  BODY.replace("]", ', "MaterialBindingAPI"]')),
            block("PhysicsPrismaticJoint", f"Slide{name}", 'uniform token physics:axis = "X"\n'
                  f"rel physics:body0 = </World/Link{len(ARM)}>\nrel physics:body1 = </World/{name}>\n"
                  f"point3f physics:localPos0 = (0, {number(TOOL)}, 0)\n"
                  "float drive:linear:physics:stiffness = 1000\nfloat drive:linear:physics:damping = 60\n"
                  + sampled("drive:linear", side * ways), '["PhysicsDriveAPI:linear"]')]


def arm() -> str:
    """Seven hinges and two fingers; angles by inverse kinematics."""
    angles, ways = arm_path(144)
    frames = arm_frames(angles[0])
    parts = [part for k in range(len(ARM)) for part in arm_link(k, frames[k], np.degrees(angles[:, k]))]
    hand = [*arm_finger("Left", 1.0, frames[-1], ways), *arm_finger("Right", -1.0, frames[-1], ways)]
    boxes = [block("Xform", name, turned((0.42, REACH, z)) + "float physics:density = 700\n"
                   + arm_plate("Shape", (2 * REACH,) * 3, (0.0, 0.0, 0.0), color), BODY, comment)
             for name, z, color, comment in (("Box", 0.3, (0.75, 0.2, 0.16), "The arm takes this one,"),
                                             ("Under", -0.25, (0.16, 0.30, 0.55), "and puts it on this one."))]
    rubber = block("Material", "rubber", said("Friction", 1.0, static_friction=1.0, dynamic_friction=1.0),
                   '["PhysicsMaterialAPI"]')
    return scene("An arm of seven joints takes a box with two fingers, and puts it on another.", [
        settings(substeps=20, iterations=8), ground(), rubber, *boxes, *parts, *hand], frames=144)


MACHINE_SCENES = {"chain": chain, "gears": gears, "arm": arm}
