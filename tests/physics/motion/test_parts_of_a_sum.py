"""The sum of a point's forces in parts: the same bits, however many threads share them."""

import numpy as np
import pytest
import warp as wp

from wsim.geometry.topology import incident_rows
from wsim.kernels.cloth.spring import spring_gather_function, spring_nets
from wsim.kernels.math.real import types

REAL, POINTS = wp.float32, 9


@pytest.fixture(scope="module")
def case() -> tuple:
    """A net in which points have four to eight springs, and four forces of corners at each, all of any size."""
    rng = np.random.default_rng(3)
    ends = np.array([(i, (i + k) % POINTS) for i in range(POINTS) for k in (1, 2, 4)] + [(0, 3), (0, 6)])
    start, spring = incident_rows(ends, POINTS)
    own = np.repeat(np.arange(POINTS), np.diff(start))
    table = spring_nets(REAL)()
    for name, values in {"start": start, "other": ends[spring].sum(1) - own, "first": np.arange(POINTS + 1) * 4,
                         "item": rng.permutation(4 * POINTS)}.items():
        setattr(table, name, wp.array(values.astype(np.int32), dtype=int, device="cpu"))
    for name, values in {"rest": rng.uniform(0.5, 2.0, len(ends)), "k": 10.0**rng.uniform(-2, 4, len(ends))}.items():
        setattr(table, name, wp.array(values[spring], dtype=REAL, device="cpu"))
    forces, x, pair = (wp.array(rng.normal(size=(n * POINTS, 3)), dtype=wp.vec3, device="cpu") for n in (4, 1, 4))
    return table, forces, x, pair


def gathered(case: tuple, lanes: int, sums: int) -> np.ndarray:
    """What each lane has of each point, (points, lanes, 3)."""
    vec3, Net = types(REAL).vec3, spring_nets(REAL)
    one = spring_gather_function(REAL, springs=True, corners=True, damped=False, lanes=lanes, sums=sums)

    def each(net: Net, f: wp.array(dtype=vec3), x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), out: wp.array2d(dtype=vec3)):
        i, lane = wp.tid()
        out[i, lane] = one(net, f, x, d, i, lane, 0)

    out = wp.zeros((POINTS, lanes), dtype=vec3, device="cpu")
    kernel = wp.kernel(each, module=f"test_parts_{lanes}_{sums}", enable_backward=False)
    wp.launch(kernel, (POINTS, lanes), [*case], [out], device="cpu")
    return out.numpy()


@pytest.mark.parametrize("sums", [2, 8])
def test_parts_are_added_as_lanes_that_have_one_each_would_add_them(case, sums):
    """The butterfly of `sums` lanes, in float32, by NumPy."""
    parts = gathered(case, sums, sums)
    half = sums // 2
    while half:
        parts = parts + parts[:, np.arange(sums) ^ half]
        half //= 2
    assert np.all(parts == parts[:, :1])
    for lanes in (1, sums // 2):
        few = gathered(case, lanes, sums)
        if lanes == 4:
            few = few + few[:, [2, 3, 0, 1]]
            few = few + few[:, [1, 0, 3, 2]]
        assert np.array_equal(few[:, 0], parts[:, 0])
    assert not np.array_equal(gathered(case, 1, 1)[:, 0], parts[:, 0])       # another order has other bits
