"""What a scene holds, in words."""

import re

from wsim.scene import Scene


def count(n: int, noun: str) -> str:
    """1 pin, 2 pins; 1 body, 2 bodies"""
    return f"{n} {noun}" if n == 1 else f"{n} {noun[:-1]}ies" if noun.endswith("y") else f"{n} {noun}s"


def _noun(name: str) -> str:
    """Of a class of things, each of which may be many: body, fluid domain; rod prim."""
    words = re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()
    return f"{words[:-1]} prim" if words.endswith("s") else words


def inventory(scene: Scene) -> str:
    """Text that counts what a scene holds."""
    kinds: dict[str, list] = {"cloth": scene.cloths, "spring net": scene.springs, "soft body": scene.softs,
                              "skin": [skin for soft in scene.softs for skin in soft.skins],
                              "collider": scene.colliders, "pin": scene.pins, "load": scene.loads,
                              **{_noun(name): found for name, found in scene.others.items()}}
    things = ", ".join(count(len(found), noun) for noun, found in kinds.items() if found)
    sizes = {"point": sum(len(body.points) for body in scene.bodies()), "tet": sum(len(soft.tets) for soft in scene.softs)}
    size = ", ".join(count(n, noun) for noun, n in sizes.items() if n)
    return (f"{things}; {f'{size}; ' if size else ''}{count(scene.frames, 'frame')} of 1/{scene.fps:g} s, "
            f"{count(scene.substeps, 'substep')}, {count(scene.iterations, 'iteration')}, "
            f"solver {scene.solver}, integrator {scene.integrator}")
