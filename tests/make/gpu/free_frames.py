"""What tests/gpu/test_free_frames.py shares with other tests: net."""

from wsim.scene import Scene, shapes
from wsim.scene.curve import Motion


def net(n: int, shape=None, *, at=(0.0, 0.0, -9.0), height=0.0, velocity=(0.0, 0.0, 0.0), pinned=True, motion=None,
        **more) -> Scene:
    scene = Scene(**{"fps": 60.0, "solver": "explicit", "gravity": (0.0, 0.0, -9.81), "up": "Z"} | more)
    body = scene.net("/net", *shapes.spring_sheet(1.0, n, up="Z"), velocities=[velocity] * n**2,
                     motion=Motion.at_place((0.0, 0.0, height)))
    if pinned:
        scene.pin("/pin", body, range(n))
    if shape is not None:
        scene.collider("/wall", shape, **({"motion": motion} if motion else {"at": at}))
    return scene
