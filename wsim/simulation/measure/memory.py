"""Memory that worlds of a scene take, known before they are made: so many times what one holds on its device.

What one holds is counted in a simulation of it. Little of that is shared by all, so that many take a little less.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType, MethodType
from typing import Any

import warp as wp

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.methods import other_objects

LARGE = 200_000        # points, cells and particles of all worlds, from which it is counted before they are made


def format_bytes(count: float) -> str:
    """Bytes in words."""
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if count < 1024.0 or unit == "GiB":
            break
        count /= 1024.0
    return f"{count:.4g} {unit}"


def bytes_held_by(root: Any) -> int:
    """Bytes of the arrays that an object of wsim holds: in its attributes, their tables, structs and functions."""
    seen: dict[int, Any] = {}
    sizes: dict[int, int] = {}
    left = [root]
    while left:
        thing = left.pop()
        if id(thing) in seen:
            continue
        seen[id(thing)] = thing                          # kept, so that no other has its id
        if isinstance(thing, wp.array):
            while isinstance(getattr(thing, "_ref", None), wp.array):        # a part of another
                thing = thing._ref
            sizes[thing.ptr or 0] = thing.capacity
        else:
            left += _members_of_object(thing)
    return sum(sizes.values())


def _members_of_object(thing: Any) -> list:
    if isinstance(thing, dict):
        return list(thing.values())
    if isinstance(thing, (list, tuple, set)):
        return list(thing)
    if isinstance(thing, MethodType):
        return [thing.__self__]
    if isinstance(thing, FunctionType):
        return [cell.cell_contents for cell in thing.__closure__ or ()]
    if hasattr(thing, "_cls") and hasattr(thing._cls, "vars"):               # a struct of kernels
        return [getattr(thing, name) for name in thing._cls.vars]
    return list(getattr(thing, "__dict__", {}).values()) if type(thing).__module__.startswith("wsim.") else []


@dataclass
class MemoryForWorlds:
    """Memory for `count` worlds at once. each: bytes of one; free: bytes that are there; where: the device's name."""

    count: int
    each: int
    free: float
    where: str

    @staticmethod
    def of(one, count: int) -> "MemoryForWorlds":
        """So many worlds as a simulation of one, and what is free where it stands, without it."""
        each = bytes_held_by(one)
        return MemoryForWorlds(count, each, free_bytes(one.device) + each, str(one.device))

    @property
    def fit(self) -> int:
        """Worlds for which there is room."""
        return int(min(self.free // max(self.each, 1), self.count))

    def check(self) -> None:
        """Raises SceneError where there is too little."""
        if self.count * self.each > self.free:
            need = format_bytes(self.count * self.each)
            raise SceneError(Problem("worlds", f"{self.count} of {format_bytes(self.each)} each take {need}, and "
                                               f"{format_bytes(self.free)} are "
                                     f"free on {self.where}: {self.fit} fit"))


def worlds_need_memory_check(scene: Scene, worlds: int) -> bool:
    """True if worlds of a scene are so much that their memory is counted first."""
    one = sum(len(b.points) for b in scene.bodies()) + sum(getattr(thing, "elements", 1) for thing in other_objects(scene))
    return worlds > 1 and worlds * one > LARGE


def require_memory(scene: Scene, worlds: int, one: Callable[[], Any]) -> None:
    """Raises SceneError where so many worlds of a scene would take more memory than is free, told from one of them."""
    if worlds_need_memory_check(scene, worlds):
        MemoryForWorlds.of(one(), worlds).check()


def require_free_memory(scene: Scene, need: float, device: Any) -> None:
    """Raises SceneError where a scene's particles need more bytes than are free on a device."""
    free, body = free_bytes(device), max(scene.bodies(), key=lambda each: each.run_bytes())
    if need > free:
        raise SceneError(Problem(body.path, f"has {len(body.points):.3g} particles, with which the scene takes some "
                                 f"{format_bytes(need)}; allowed: {format_bytes(free)}, which are free on {device}; fix: give "
                                 f"particles {1.1 * (need / free) ** (1.0 / 3.0):.2g} times as large, or a smaller shape"))


def allocation_failure(error: Exception, device) -> SceneError:
    """A failed allocation in words; anything else as it is, an allocation where a graph allows none among them."""
    text = str(error).lower()
    if ("alloc" in text or "memory" in text) and "unsupported" not in text:
        return SceneError(Problem(str(device), f"out of memory ({error}); use a smaller scene, fewer worlds, "
                                  "float32 or another device"))
    raise error


def free_bytes(device) -> float:
    """Bytes that are free on a device; inf where nobody knows."""
    if device.is_cuda:
        return float(device.free_memory)
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            return 1024.0 * next(float(line.split()[1]) for line in file if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError):
        pages = getattr(os, "sysconf", lambda name: -1)("SC_AVPHYS_PAGES") if os.name == "posix" else -1
        return float("inf") if pages < 0 else float(pages * os.sysconf("SC_PAGE_SIZE"))
