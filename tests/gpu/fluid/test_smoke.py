"""Smoke on a GPU: drawn as on a CPU, and the same to the bit from image to image."""

import numpy as np
import pytest
import warp as wp

from tests.make.show.smoke import N, cloud, plate
from wsim.show.camera import Camera
from wsim.show.picture import RayCaster

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


def drawn(device: str) -> np.ndarray:
    density = np.random.default_rng(0).random((N, N, N)) ** 3
    points, look = plate(-1.5, color=(0.6, 0.3, 0.2))
    caster = RayCaster([look], (96, 64), device)
    camera = Camera.look((3.0, 4.0, 9.0), (0, 0, 0), angle=0.4)
    return caster.image([points], camera, "Y", -2.0, None, [cloud(density, depth=5.0)])


def test_an_image_is_that_of_a_cpu():
    """To a step of a byte, but where an edge goes the other way."""
    difference = np.abs(drawn("cuda:0").astype(int) - drawn("cpu"))
    assert np.quantile(difference, 0.995) <= 1


def test_images_are_the_same_to_the_bit():
    assert np.array_equal(drawn("cuda:0"), drawn("cuda:0"))
