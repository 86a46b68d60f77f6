"""Skinning of many vertices beside a copy of the bytes that it must move, and a character under a cloth. Run:

    python -m tools.bench.contact.skinning [--device cuda:0] [--vertices 1000000] [--joints 200] [--frames 60]

The first prints microseconds a pose for linear blend and dual quaternions, in the order of the joints (as meshes are exported)
and at random; the copy that it is held against moves the same bytes: bound points, joints (16 bits), weights, skinned points.
The second prints milliseconds a frame and the greatest depth of a point in the body. Rows are printed as JSON.
"""

import argparse
import json
import time

import numpy as np
import warp as wp

from wsim.physics.animation import skinning
from wsim.physics.animation.objects import DUAL, LINEAR, Skeleton, Skinned
from wsim.physics.animation.skin import SkinnedMeshTables
from wsim.physics.animation.tables import JointSampling, JointTables
from wsim.scene import Scene, Surface, shapes
from wsim.simulation.simulation import Simulation

REPEATS = 20


def tree(joints: int, rng) -> Skeleton:
    """A tree of joints, each below one of those before it, that turn a little from key to key."""
    parents = np.array([-1, *(rng.integers(max(0, j - 20), j) for j in range(1, joints))], np.int32)
    Q = np.concatenate([0.05 * rng.normal(size=(3, joints, 3)), np.ones((3, joints, 1))], axis=-1)
    T = np.tile([0.0, 0.05, 0.0], (3, joints, 1))
    bones = Skeleton("/s/bones", tuple(map(str, range(joints))), np.tile(np.eye(4), (joints, 1, 1)), parents=parents,
                     times=[0.0, 0.5, 1.0], translations=T, rotations=Q / np.linalg.norm(Q, axis=-1, keepdims=True))
    bones.bind = skinning.skeleton_space_transforms(parents, skinning.local_joint_transforms(bones, np.zeros(1)))[0]
    return bones


def seconds(run, device) -> float:
    """Least time of a launch, of a graph that repeats it."""
    run()
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(REPEATS):
            run()
    best = np.inf
    for _ in range(7):
        wp.synchronize_device(device)
        begin = time.perf_counter()
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
        best = min(best, (time.perf_counter() - begin) / REPEATS)
    return best


def speed(device, n: int, joints: int, m: int = 4) -> list[dict]:
    """Rows of linear blend and dual quaternions, joints in order and at random."""
    rng = np.random.default_rng(0)
    bones, rows = tree(joints, rng), []
    tables = JointTables([bones], device, wp.float32)
    sampling = JointSampling(tables, np.zeros(1))
    weights = rng.uniform(0.1, 1.0, (n, m))
    weights /= weights.sum(axis=1, keepdims=True)
    points = rng.normal(size=(n, 3)).astype(np.float32)
    moved = n * (2 * 12 + m * (2 + 4))
    words = wp.zeros(moved // 8, dtype=float, device=device)                   # a copy reads half of the bytes and writes half
    other = wp.zeros_like(words)
    copy = seconds(lambda: wp.copy(other, words), device)
    for order in ("in order", "at random"):
        first = np.sort(rng.integers(0, joints, n)) if order == "in order" else rng.integers(0, joints, n)
        index = (first[:, None] + rng.integers(0, 4, (n, m))) % joints
        for way in (LINEAR, DUAL):
            skin = SkinnedMeshTables(tables, Skinned(bones, points, index, weights, method=way))
            out = wp.zeros((1, n), dtype=wp.vec3, device=device)
            sampling.begin(0.3)
            launches = [*sampling.launches(), *skin.launches(sampling, out)]
            for launch in launches:                                            # compiles, and evaluates the joints
                wp.launch(*launch, device=device)
            took = seconds(lambda: wp.launch(*launches[-1], device=device), device)  # noqa: B023
            want = skin.skin.only(np.arange(0, n, max(n // 1000, 1))).at(0.3)
            error = float(np.abs(out.numpy()[0, ::max(n // 1000, 1)] - want).max())
            rows.append({"what": "skinning", "method": way, "joints": joints, "order": order, "vertices": n, "influences": m,
                         "us": 1e6 * took, "copy_us": 1e6 * copy, "times_copy": took / copy, "error": error})
    return rows


def character(device, frames: int, vertices: int = 30000, points: int = 10000) -> dict:
    """A body that bends in its middle, under a cloth that falls on it."""
    rings = int(np.sqrt(vertices / 2.0))
    body, counts, indices = shapes.capsule(0.25, 0.6, 2 * rings)
    while len(body) < vertices:
        rings = int(rings * 1.05) + 1
        body, counts, indices = shapes.capsule(0.25, 0.6, 2 * rings)
    body = body[:, [2, 1, 0]] * (1.0, 1.0, -1.0)                              # along x
    part = np.clip((body[:, 0] + 0.3) / 0.6, 0.0, 1.0)
    turn = np.array([[[0.0, 0.0, 0.0, 1.0]] * 2, [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sin(0.25), np.cos(0.25)]]])
    bones = Skeleton("/s/bones", ("a", "a/b"), np.tile(np.eye(4), (2, 1, 1)), times=[0.0, 1.0],
                     translations=np.zeros((2, 2, 3)), rotations=turn)
    skin = Skinned(bones, body, np.tile([0, 1, 0, 1], (len(body), 1)), np.stack([1 - part, part, 0 * part, 0 * part], axis=1))
    scene = Scene(fps=60.0, frames=frames, substeps=10, iterations=4, solver="xpbd")
    scene.add(bones)
    scene.collider("/s/body", Surface(skin.at(0.0), counts, indices, poses=skin))
    side = round(np.sqrt(points)) - 1
    scene.cloth("/cloth", *shapes.sheet(1.6, 1.2, side, side, horizontal=True, at=(0.0, 0.26, 0.0)))
    sim = Simulation(scene, device=device)
    sim.run(3)
    begin = time.perf_counter()
    sim.run(frames)
    took = (time.perf_counter() - begin) / frames
    found = sim.indicators()
    return {"what": "character", "vertices": len(body), "points": (side + 1) ** 2, "frames": frames, "ms_a_frame": 1e3 * took,
            "frames_a_second": 1.0 / took, "penetration": found.get("penetration"), "contacts": found.get("contacts"),
            "max_strain": found.get("max_strain")}


def main(given=None) -> list[dict]:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--device", default=None)
    parser.add_argument("--vertices", type=int, default=1_000_000)
    parser.add_argument("--joints", type=int, default=200)
    parser.add_argument("--frames", type=int, default=60)
    a = parser.parse_args(given)
    device = wp.get_device(a.device)
    rows = [*speed(device, a.vertices, a.joints), character(device, a.frames)]
    for row in rows:
        print(json.dumps({"device": device.name, **row}))
    return rows


if __name__ == "__main__":
    main()
