"""Sorted cells, Warp's hash grid and Warp's tree: python -m tools.bench.contact.neighbours [--count 20000] [--device cpu]

Who is within R_i + R_j + s, of particles of radius 4 mm and a skin s of 0.3 diameters, in five scenes. make: lists of
neighbours are made anew. use: a pass over all pairs, as an iteration makes it (the sum of overlaps): from lists, or straight
from the grid without lists. missed: pairs that a k-d tree in float64 finds and the list lacks (both ways are counted; above
100 000 particles compare the numbers of pairs). Least of several runs, processor time on a CPU.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

import argparse
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import warp as wp

from wsim.physics.position_based.neighbours import BLOCK, NeighbourSearch, ParticleLaunches, SearchedPoints

RADIUS, SKIN = 0.004, 0.3 * 0.008
ROOM = 40
MOST = 100_000             # particles of which all pairs are compared


def scenes(n: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Places [m] (n, 3) and radii [m] (n,) by name."""
    rng, side = np.random.default_rng(0), round(n ** (1.0 / 3.0))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3) * 2.2 * RADIUS
    n = len(lattice)
    loose = lattice + rng.uniform(-0.6, 0.6, lattice.shape) * RADIUS
    half, even = n // 2, np.full(n, RADIUS)
    mixed = RADIUS * 10.0 ** rng.uniform(-1.0, 0.0, n)
    dense = np.r_[lattice[:-1], [[1000.0, 1000.0, 1000.0]]]
    return {"lattice": (lattice, even), "loose": (loose, even), "one cluster in 1 km": (dense, even),
            "two clusters, 100 m apart": (np.r_[loose[:half], loose[half:] + [100.0, 0.0, 0.0]], even),
            "radii 1 : 10": (loose, mixed)}


@wp.kernel
def list_from_grid(grid: wp.uint64, x: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float), most: float, room: int,
                   count: wp.array(dtype=int), other: wp.array(dtype=int)):
    k = wp.tid()
    p = wp.hash_grid_point_id(grid, k)
    m = int(0)
    for o in wp.hash_grid_query(grid, x[p], reach[p] + most):
        far = reach[p] + reach[o] + float(SKIN)
        if o != p and wp.length_sq(x[p] - x[o]) < far * far:
            if m < room:
                other[m * x.shape[0] + k] = o
            m += 1
    count[k] = m


@wp.kernel
def name_points(grid: wp.uint64, out: wp.array(dtype=int)):
    out[wp.tid()] = wp.hash_grid_point_id(grid, wp.tid())


def points_of_grid(grid: wp.HashGrid, n: int, device: wp.Device) -> np.ndarray:
    """Number of the particle at each place of a grid, (n,)."""
    out = wp.zeros(n, dtype=int, device=device)
    wp.launch(name_points, n, [grid.id], [out], device=device)
    return out.numpy()


@wp.kernel
def list_from_tree(tree: wp.uint64, x: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float), most: float, room: int,
                   count: wp.array(dtype=int), other: wp.array(dtype=int)):
    p = wp.tid()
    m = int(0)
    o = int(0)
    half = wp.vec3(reach[p] + float(SKIN))
    query = wp.bvh_query_aabb(tree, x[p] - half, x[p] + half)
    while wp.bvh_query_next(query, o):
        far = reach[p] + reach[o] + float(SKIN)
        if o != p and wp.length_sq(x[p] - x[o]) < far * far:
            if m < room:
                other[m * x.shape[0] + p] = o
            m += 1
    count[p] = m


@wp.kernel
def boxes(x: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float), low: wp.array(dtype=wp.vec3),
          high: wp.array(dtype=wp.vec3)):
    p = wp.tid()
    low[p] = x[p] - wp.vec3(reach[p])
    high[p] = x[p] + wp.vec3(reach[p])


@wp.kernel
def use_grid(grid: wp.uint64, x: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float), most: float,
             out: wp.array(dtype=float)):
    p = wp.hash_grid_point_id(grid, wp.tid())
    total = float(0.0)
    for o in wp.hash_grid_query(grid, x[p], reach[p] + most):
        if o != p:
            total += wp.max(reach[p] + reach[o] - wp.length(x[p] - x[o]), 0.0)
    out[p] = total


@wp.kernel
def use_lists(x: wp.array(dtype=wp.vec3), reach: wp.array(dtype=float), count: wp.array(dtype=int), other: wp.array(dtype=int),
              out: wp.array(dtype=float)):
    k = wp.tid()
    total = float(0.0)
    for s in range(count[k]):
        o = other[s * x.shape[0] + k]
        total += wp.max(reach[k] + reach[o] - wp.length(x[k] - x[o]), 0.0)
    out[k] = total


def spent_on(run: Callable[[], None], device: wp.Device) -> float:
    """Least time of a run [ms]: processor time on a CPU, of a captured graph on a GPU."""
    run()
    if not device.is_cuda:
        found = []
        for _ in range(7):
            start = time.process_time()
            run()
            found.append(time.process_time() - start)
        return 1e3 * min(found)
    with wp.ScopedCapture(device) as capture:
        for _ in range(10):
            run()
    found = []
    for _ in range(4):
        wp.synchronize_device(device)
        start = time.perf_counter()
        wp.capture_launch(capture.graph)
        wp.synchronize_device(device)
        found.append(time.perf_counter() - start)
    return 1e2 * min(found)


def missed_pairs(x: np.ndarray, reach: np.ndarray, count: np.ndarray, other: np.ndarray, order: np.ndarray) -> int:
    """Pairs, both ways, that float64 finds a rounding nearer than the list's distance, and that a list lacks. other: numbers
    of particles, (ROOM, n); order: whose list each is, (n,)."""
    from scipy.spatial import cKDTree
    n, x = len(x), x.astype(np.float32).astype(np.float64)
    i, j = cKDTree(x).query_pairs(2.0 * reach.max() + SKIN, output_type="ndarray").T
    near = np.linalg.norm(x[i] - x[j], axis=1) < (reach[i] + reach[j] + SKIN) * (1.0 - 1e-5)
    wanted = np.r_[i[near] * n + j[near], j[near] * n + i[near]]
    slots = np.arange(other.shape[0])[:, None] < count[None, :]
    k = np.broadcast_to(np.arange(n), slots.shape)[slots]
    return len(np.setdiff1d(wanted, order[k].astype(np.int64) * n + other[slots]))


def stand_in(device: wp.Device, x: np.ndarray) -> SimpleNamespace:
    """What a search asks of a model."""
    return SimpleNamespace(device=device, real=wp.float32, dtype=np.float32, worlds=1, points=len(x),
                           upload=lambda rows, dtype: wp.array(rows, dtype=dtype, device=device),
                           shared_module=lambda part, *what, threads=0: f"bench_{part}")


def compare(name: str, x: np.ndarray, reach: np.ndarray, device: wp.Device) -> None:
    """Prints the rows of a scene."""
    n, none = len(x), np.zeros(len(x), np.int32)
    y, R = wp.array(x, dtype=wp.vec3, device=device), wp.array(reach, dtype=float, device=device)
    out, count, other = (wp.zeros(m, dtype=kind, device=device) for m, kind in ((n, float), (n, int), (n * ROOM, int)))
    how = {"device": device, "block_dim": BLOCK if device.is_cuda else 256}

    points = SearchedPoints(np.arange(n), reach, none, none - 1, np.zeros((n, 3)), x)
    search = NeighbourSearch(ParticleLaunches(stand_in(device, x), "neighbours"), points, SKIN, ROOM)  # type: ignore[arg-type]
    still = wp.zeros(n, dtype=wp.vec3, device=device)
    make = spent_on(lambda: search.update(y, still, True), device)
    kept = spent_on(lambda: search.update(y, still), device)
    cells, lists = search.cells, search.lists
    use = spent_on(lambda: wp.launch(use_lists, n, [cells.near, cells.reach, lists.count, lists.other], [out], **how), device)
    pairs = int(lists.count.numpy().sum())
    order = cells.order.numpy()
    lost = str(missed_pairs(x, reach, lists.count.numpy(), order[lists.other.numpy()].reshape(ROOM, n), order)
               if n <= MOST else "")
    print(f"{name:26} {n:8} sorted cells  make {make:8.2f}  kept {kept:5.2f}  use {use:7.3f} ms  pairs {pairs:9}  missed "
          f"{lost}")

    most, wide = float(reach.max()), 2.0 * float(reach.max()) + SKIN
    dim = 128 if n > MOST else 64
    grid = wp.HashGrid(dim, dim, dim, device=device)

    def from_grid() -> None:
        grid.build(y, wide)
        wp.launch(list_from_grid, n, [grid.id, y, R, most + SKIN, ROOM], [count, other], **how)

    def straight() -> None:
        wp.launch(use_grid, n, [grid.id, y, R, most], [out], **how)
    build = spent_on(lambda: grid.build(y, wide), device)
    make, use = spent_on(from_grid, device), spent_on(straight, device)
    found = int(count.numpy().sum())
    lost = ""
    if n <= MOST:
        order = points_of_grid(grid, n, device)
        lost = str(missed_pairs(x, reach, count.numpy(), other.numpy().reshape(ROOM, n), order))
    print(f"{'':35} hash grid     make {make:8.2f}  build {build:5.2f}  use {use:7.3f} ms  pairs {found:9}  missed {lost}")

    if not device.is_cuda or n <= MOST:
        low, high = (wp.zeros(n, dtype=wp.vec3, device=device) for _ in range(2))
        wp.launch(boxes, n, [y, R], [low, high], **how)
        tree = wp.Bvh(low, high)

        def from_tree() -> None:
            wp.launch(boxes, n, [y, R], [low, high], **how)
            tree.rebuild()
            wp.launch(list_from_tree, n, [tree.id, y, R, most, ROOM], [count, other], **how)
        make = spent_on(from_tree, device)
        print(f"{'':35} tree          make {make:8.2f}  {'':12} {'':15} pairs {int(count.numpy().sum()):9}")


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--count", type=int, default=20_000)
    arguments.add_argument("--device", default="cpu")
    given = arguments.parse_args()
    wp.config.quiet = True
    for label, (places, radii) in scenes(given.count).items():
        compare(label, places, radii, wp.get_device(given.device))
