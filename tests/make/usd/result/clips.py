"""What tests/usd/result/test_clips.py shares with other tests: record."""

from tests.make.usd.result.recorder import world
from wsim.usd.result.recorder import Recorder


def record(scene, path, frames: int = 3, clip: bool = True, interrupted: bool = False, **more):
    recorder = Recorder(scene, path, **more)
    recorder.clips = clip
    for k in range(frames):
        recorder.append(recorder.time_code(k), *world(frame=k))
    return recorder.close(interrupted)
