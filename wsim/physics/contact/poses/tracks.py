"""Motions of any kind as tables of the device: channels, parts and turns of kernels/animation/track.py."""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.animation import track
from wsim.kernels.animation.channel import BEZIER, ChannelTable
from wsim.kernels.animation.outside import LINEAR
from wsim.model import kernel_cache
from wsim.scene.curve import Curve, Motion, Part, Stack
from wsim.scene.curve.easing import BY_CODE
from wsim.scene.curve.stack import ELEMENTS, SCALE, SHIFT

COLUMNS = ("time", "code", "x", "part")                 # of channels, a row a key
ENDS = ("mode", "end", "slope", "growth")               # a row a channel


def curve_channels(curve: Curve, modes: tuple[int, int] | None = None) -> list[dict[str, np.ndarray]]:
    """A channel for each component of a curve. modes: outside of the keys, where the curve itself is held there."""
    n, values, until = len(curve.times), curve.values.reshape(len(curve.times), -1), curve.until.reshape(len(curve.times), -1)
    own = tuple(curve.mode(side) for side in (curve.before, curve.after))
    ends = np.stack([until[0], values[-1]], 1)
    growth = np.stack([until[-1] - until[0], values[-1] - values[0]], 1)
    slope = np.zeros((values.shape[1], 2))
    for side in (0, 1):
        if own[side] == LINEAR:
            slope[:, side] = np.ravel(curve.slope(side))
    code, x, part = np.zeros(n, np.int32), np.zeros((n, 2)), np.zeros((n, values.shape[1], 4))
    part[-1, :, 0] = values[-1]
    if n > 1:
        of = curve.pieces
        code[:-1], x[:-1] = of.code, of.x
        part[:-1] = np.stack([p.reshape(n - 1, -1) for p in of.part], -1)
    if modes:
        growth = np.zeros_like(growth)
    return [{"time": curve.times, "code": code, "x": x, "part": part[:, k], "mode": np.array([modes or own], np.int32),
             "end": ends[k:k + 1], "slope": slope[k:k + 1], "growth": growth[k:k + 1]} for k in range(values.shape[1])]


def rotation_track(motion: Motion) -> dict[str, np.ndarray]:
    """Rotations and stretches at the keys of a motion, and what lies between them."""
    of, n = motion.turns, len(motion.times)
    a, b, w = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 3))
    if n > 1:
        (a[:-1], b[:-1]), w[:-1] = of.inner, of.turn
    onward = [n > 1 and motion.path.mode(side) == LINEAR for side in (motion.before, motion.after)]
    ends = np.array([of.end(k) if on else np.zeros(3) for k, on in enumerate(onward)])
    whole = of.whole if n > 1 else np.zeros(3)
    return {"q": of.q, "a": a, "b": b, "w": w, "S": of.S, "smooth": np.array([not of.slerps], np.int32), "end": ends[None],
            "whole": whole[None]}


class MotionTracks:
    """Tables of motions, and the kernel that samples them, which has what these motions use."""

    def __init__(self, device):
        self.device = device
        self.sample: Any = None
        self.known: dict[int, tuple[Motion, tuple]] = {}

    def take(self, motions: list[Motion]) -> None:
        """Uploads them. A motion that was there before is not packed again."""
        found = []
        for k, motion in enumerate(motions):
            if k not in self.known or self.known[k][0] is not motion:
                self.known[k] = motion, pack_motion(motion)
            found.append(self.known[k][1])
        parts, channels, turns = ([one for own in found for one in own[j]] for j in range(3))
        self._parts(parts, np.cumsum([0, *(len(own[0]) for own in found)]))
        self._upload_channels(channels)
        self._turns(turns)
        codes = np.unique([*np.unique(np.concatenate([c["code"] for c in channels] or [np.zeros(0, int)])), 0]).tolist()
        whats = tuple(sorted({p["what"] for p in parts}))
        names = tuple(BY_CODE[c] for c in codes if c > BEZIER)
        self.form = tuple(codes), names, whats
        module = f"wsim_tracks_{'_'.join(map(str, (*codes, 'of', *whats)))}"
        self.sample = track.track_sample_kernel(*self.form, module)
        kernel_cache.load_kernel_module(module, self.device)

    def _array(self, values, dtype) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _parts(self, parts: list[dict], first: np.ndarray) -> None:
        """Parts know their channels and motions by keys by numbers of their own motion; here they get those of all."""
        table = self.parts = track.StackParts()
        table.first = self._array(first.astype(np.int32), int)
        widths = np.array([p["channels"] for p in parts], np.int64)
        channel = np.cumsum(widths) - widths
        by_keys = np.array([p["what"] == track.KEYED for p in parts], np.int64)
        for name, values in (("what", [p["what"] for p in parts]), ("axis", [p["axis"] for p in parts]), ("channel", channel),
                             ("keyed", np.cumsum(by_keys) - by_keys)):
            setattr(table, name, self._array(np.array(values, np.int32), int))
        M = np.array([p["matrix"] for p in parts]).reshape(-1, 4, 4)
        table.linear, table.offset = self._array(M[:, :3, :3], wp.mat33d), self._array(M[:, :3, 3], wp.vec3d)

    def _upload_channels(self, channels: list[dict]) -> None:
        table = self.channels = ChannelTable()
        table.first = self._array(np.cumsum([0, *(len(c["time"]) for c in channels)]).astype(np.int32), int)
        types = {"time": (wp.float64, ()), "code": (int, ()), "x": (wp.vec2d, (2,)), "part": (wp.vec4d, (4,)),
                 "mode": (wp.vec2i, (2,)), "end": (wp.vec2d, (2,)), "slope": (wp.vec2d, (2,)), "growth": (wp.vec2d, (2,))}
        for name in (*COLUMNS, *ENDS):
            dtype, shape = types[name]
            whole = np.concatenate([c[name] for c in channels]) if channels else np.zeros((0, *shape))
            setattr(table, name, self._array(whole, dtype))

    def _turns(self, turns: list[dict]) -> None:
        table = self.turns = track.RotationKeys()
        table.first = self._array(np.cumsum([0, *(len(t["q"]) for t in turns)]).astype(np.int32), int)
        types = {"q": wp.quatd, "a": wp.quatd, "b": wp.quatd, "w": wp.vec3d, "S": wp.mat33d, "smooth": int, "end": wp.vec3d,
                 "whole": wp.vec3d}
        empty = rotation_track(Motion.still())
        for name, dtype in types.items():
            whole = np.concatenate([t[name] for t in turns or [empty]])
            setattr(table, name, self._array(whole, dtype))

    def tables(self) -> list:
        return [self.parts, self.channels, self.turns]

    def rates(self) -> Any:
        """Kernel of how fast they go."""
        from wsim.kernels.animation import track_rate
        codes, _, whats = self.form
        module = f"wsim_track_rates_{'_'.join(map(str, (*codes, 'of', *whats)))}"
        kernel = track_rate.track_rate_kernel(*self.form, module)
        kernel_cache.load_kernel_module(module, self.device)
        return kernel


def pack_motion(motion: Motion) -> tuple[list, list, list]:
    """(parts, channels, turns) of one motion."""
    parts: list[dict] = []
    channels: list[dict] = []
    turns: list[dict] = []
    for A in motion.inner if isinstance(motion, Stack) else [motion]:
        own: list[dict] = []
        what, axis, M = track.CONSTANT, 0, np.eye(4)
        if isinstance(A, Part):
            what = {SHIFT: track.SHIFT, SCALE: track.SCALE, ELEMENTS: track.ELEMENTS}.get(A.what, track.TURN)
            axis, own = A.axis, curve_channels(A.curve)
            own = own[:12] if what == track.ELEMENTS else own
        elif isinstance(A, Motion):
            what = track.KEYED
            own = curve_channels(A.path)
            own += curve_channels(A.turns.pace, tuple(A.path.mode(side) for side in (A.before, A.after)))  # type: ignore[arg-type]
            turns.append(rotation_track(A))
        else:
            M = A
        parts.append({"what": what, "axis": axis, "channels": len(own), "matrix": M})
        channels += own
    return parts, channels, turns
