"""GIF and MP4: every frame in its colours, in time; and what is said where the libraries are not installed."""

import sys
from io import BytesIO

import numpy as np
import pytest

from wsim.scene import SceneError
from wsim.show.image import animation
from wsim.show.picture import picture
from wsim.usd import save

FPS = 24.0


def frames(count: int = 13) -> list[np.ndarray]:
    """A smooth slope, over which a red square moves."""
    y, x = np.mgrid[:60, :80]
    smooth = np.stack([40 + 2 * x, 60 + 2 * y, 200 - x], axis=-1).astype(np.uint8)
    found = []
    for k in range(count):
        frame = smooth.copy()
        frame[20:30, 5 * k:5 * k + 12] = (200, 30, 20)
        found.append(frame)
    return found


def test_delays_keep_time():
    """Whole hundredths, whose sum is that of the frames; none is shorter than readers bear."""
    assert sum(animation.gif_frame_delays(48, FPS)) == 2000 and set(animation.gif_frame_delays(48, FPS)) == {40, 50}
    assert set(animation.gif_frame_delays(10, 1000.0)) == {20}


def test_a_gif_shows_every_frame_in_its_colours_and_keeps_time():
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed: extra picture")
    given = frames()
    with image.open(BytesIO(animation.encode_gif(given, FPS))) as read:
        assert read.n_frames == 13 and read.info["loop"] == 0
        delays = []
        for k, frame in enumerate(given):
            read.seek(k)
            delays.append(read.info["duration"])
            # 255 colours over a patch of 160 x 120 levels: a spacing of sqrt(160 * 120 / 255) = 9, half of it each way
            assert np.abs(np.asarray(read.convert("RGB")).astype(int) - frame).mean() < 4.5
    assert delays == animation.gif_frame_delays(13, FPS)


def test_few_colours_are_held_and_what_stands_still_costs_nothing():
    pytest.importorskip("PIL", reason="Pillow is not installed: extra picture")
    still = frames(1) * 20
    assert len(animation.encode_gif(still, FPS)) < 1.5 * len(animation.encode_gif(still[:1], FPS))


def test_a_film_has_every_frame_and_its_rate(tmp_path):
    imageio = pytest.importorskip("imageio.v2", reason="imageio is not installed: extra picture")
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed: extra picture")
    animation.write_animation(tmp_path / "a.mp4", [np.pad(f, ((0, 1), (0, 1), (0, 0))) for f in frames()], FPS)  # odd: 61 x 81
    with imageio.get_reader(tmp_path / "a.mp4", format="FFMPEG") as read:
        shown = [np.asarray(f) for f in read]
        assert read.get_meta_data()["fps"] == FPS and len(shown) == 13 and shown[0].shape == (60, 80, 3)
    off = [np.abs(a.astype(int) - b).mean() for a, b in zip(shown, frames(), strict=True)]
    assert max(off) < 6.0                                   # chroma of half the size
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


@pytest.mark.parametrize("ending, missing", [(".gif", "PIL"), (".mp4", "imageio_ffmpeg")])
def test_what_is_not_installed_is_said_before_anything_is_drawn(tmp_path, monkeypatch, scene, ending, missing):
    monkeypatch.setattr(animation, "find_spec", lambda name: None if name == missing else sys)
    save(scene, tmp_path / "s.usda")
    with pytest.raises(SceneError, match=rf"{missing} not installed; install by: pip install -e ...picture.., or write .png"):
        picture(tmp_path / "s.usda", tmp_path / f"a{ending}", size=(16, 9), device="cpu")
    animation.require_image_writer(".png")
