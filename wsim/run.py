"""The main job: a scene simulated into a result layer, frame by frame.

    preroll     frames before the first one, simulated and not written, in which cloth settles: every curve is moved
                later, so that the scene's own start stays where it was
    samples     written a frame: the scene is simulated with so many times its frame rate and as many substeps less,
                and every such short frame is written, at a fraction of a time code

An interruption or a failure keeps the frames that were written; Ctrl-C waits while a frame is being written.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING

from wsim.curve import Curve, Motion
from wsim.scene import Collider, Pin, Scene, Surface

if TYPE_CHECKING:
    from wsim.recorder import Recorder
    from wsim.simulation import Simulation


def finer(scene: Scene, samples: int) -> Scene:
    """The scene with `samples` frames for each of its own, and substeps of the same length or a little shorter."""
    if samples == 1:
        return scene
    return replace(scene, fps=scene.fps * samples, frames=scene.frames * samples,
                   substeps=-(-scene.substeps // samples))


def later(scene: Scene, delay: float) -> Scene:
    """The scene with every curve `delay` [s] later, so that simulating begins that long before its start."""
    if delay == 0.0:
        return scene
    return replace(scene, colliders=[_collider_later(c, delay) for c in scene.colliders],
                   pins=[_pin_later(p, delay) for p in scene.pins])


def _motion_later(motion: Motion, delay: float) -> Motion:
    return Motion(motion.times + delay, motion.values)


def _pin_later(pin: Pin, delay: float) -> Pin:
    return replace(pin, motion=_motion_later(pin.motion, delay))


def _collider_later(collider: Collider, delay: float) -> Collider:
    shape = collider.shape
    if isinstance(shape, Surface) and shape.poses is not None:
        shape = replace(shape, poses=Curve(shape.poses.times + delay, shape.poses.values))
    return replace(collider, shape=shape, motion=_motion_later(collider.motion, delay))


@contextmanager
def whole() -> Iterator[None]:
    """Ctrl-C inside takes effect at the end, as KeyboardInterrupt: what is being written is finished first."""
    came = []
    try:
        before = signal.signal(signal.SIGINT, lambda *_: came.append(True))
    except ValueError:                   # not the main thread: Python gives it no signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt


@dataclass
class Run:
    """A simulation and the recorder that its frames go to; `scene` is the one that is written.

    `shown` is called with (frames done) and `each` with (simulation) after each short frame that was committed.
    """

    scene: Scene
    simulation: "Simulation"
    recorder: "Recorder"
    samples: int = 1
    preroll: int = 0
    first: int = 0                                # frames that an earlier run has done
    shown: Callable[[int], None] = lambda done: None
    each: list[Callable] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: {"simulate": 0.0, "write": 0.0})
    written: int = 0                              # frames, the initial one not counted

    def frames(self) -> None:
        """All frames. However it ends, the result holds what was written before."""
        try:
            for k in range(self.preroll * self.samples):
                self._step(k + 1)
            self._write(0)
            for k in range((self.scene.frames - self.first) * self.samples):
                self._step(self.preroll * self.samples + k + 1)
                self._write(k + 1)
        finally:
            with whole():
                began = perf_counter()
                self.recorder.close()
                self.seconds["write"] += perf_counter() - began

    def _step(self, done: int) -> None:
        began = perf_counter()
        self.simulation.step()
        self.seconds["simulate"] += perf_counter() - began
        self.shown(done)

    def _write(self, k: int) -> None:
        """State after k short frames, at its time code."""
        sim = self.simulation
        began = perf_counter()
        paths = [body.path for body in self.scene.bodies()]
        with whole():
            self.recorder.append(self.scene.start + self.first + k / self.samples, {p: sim.positions(p) for p in paths},
                                 {p: sim.velocities(p) for p in paths}, sim.poses())
        self.written = k // self.samples
        self.seconds["write"] += perf_counter() - began
        for call in self.each:
            call(sim)
