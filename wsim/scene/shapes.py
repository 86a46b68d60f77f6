"""Points and polygons of simple shapes, for scenes, colliders, tests and benchmarks. NumPy only, metres.

    sheet           a rectangle of cells, vertical or horizontal; row 0 is its top (or far) edge
    spring_sheet    a square net of springs: structural, both diagonals, weak cross springs over one point
    sphere, box, capsule, cylinder, cone, torso     closed surfaces, wound outward (counter-clockwise from outside)
    read_obj        the surface of an OBJ file
    grow_strands    strands that stand on a surface, as `Scene.hair` makes them
    block           a solid box of tetrahedra, as `Scene.soft` takes it, as in `shapes.block((1.0, 0.2, 0.2), 4)`

A surface is (points (n, 3) float64 [m], counts (faces,) int32, indices (sum of counts,) int32), in the order that
`Scene.cloth` and `scene.Surface` take. Solids of revolution run along z, as `wsim.scene` has them. Everything raises
ValueError naming the argument, what was found and what is allowed.
"""

import numpy as np

from wsim.geometry import primitives
from wsim.geometry.tetra import lattice
from wsim.geometry.triangulate import triangulate_polygons

CUTS = ("alternating", "diagonal", "quads")


def _require_positive_sizes(**sizes) -> None:
    for name, value in sizes.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value:g}; it must be finite and > 0")


def _require_whole_counts(least: int, **counts) -> None:
    for name, value in counts.items():
        if int(value) != value or value < least:
            raise ValueError(f"{name} is {value}; it must be a whole number >= {least}")


def _orient_sheet(points: np.ndarray, horizontal: bool, up: str) -> np.ndarray:
    """Turns a sheet in the x-y plane (normal +z, row 0 at +y) to where it is wanted."""
    if up not in ("Y", "Z"):
        raise ValueError(f'up is {up!r}; allowed is "Y" or "Z"')
    x, y, z = points.T
    if horizontal:                                   # a quarter turn about x: normal +z becomes +y
        x, y, z = x, z, -y
    return np.stack([x, y, z] if up == "Y" else [x, -z, y], axis=1)


def _centred_grid_points(width: float, height: float, columns: int, rows: int) -> np.ndarray:
    """Points of a centred grid in the x-y plane, row by row from +y to -y, (rows * columns, 3)."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, columns) * width, np.linspace(0.5, -0.5, rows) * height)
    return np.stack([x.ravel(), y.ravel(), np.zeros(rows * columns)], axis=1)


def sheet(width: float, height: float, nx: int, ny: int, *, horizontal: bool = False, up: str = "Y",
          cut: str = "alternating", at=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A rectangle of nx by ny cells, centred at `at` [m]: points ((nx+1) (ny+1), 3), counts, indices.

    Points run row by row, left to right; row 0 (points 0 .. nx) is the top edge of a vertical sheet, the far edge
    (-z, or +y where z is up) of a horizontal one. A vertical sheet faces +z (-y where z is up), a horizontal one up.
    cut: "quads"; "diagonal" triangles, all cut the same way; "alternating" triangles, every second diagonal turned,
    which has no preferred direction.
    """
    _require_positive_sizes(width=width, height=height)
    _require_whole_counts(1, nx=nx, ny=ny)
    if cut not in CUTS:
        raise ValueError(f"cut is {cut!r}; allowed is one of {', '.join(CUTS)}")
    points = _orient_sheet(_centred_grid_points(width, height, nx + 1, ny + 1), horizontal, up) + np.asarray(at, np.float64)
    row, column = (index.ravel() for index in np.divmod(np.arange(nx * ny), nx))
    a = row * (nx + 1) + column                      # a d   corners of a cell, counter-clockwise from the front
    b, c, d = a + nx + 1, a + nx + 2, a + 1          # b c
    if cut == "quads":
        faces = np.stack([a, b, c, d], axis=1)
    else:
        turned = (row + column) % 2 == 1 if cut == "alternating" else np.zeros(nx * ny, bool)
        first = np.where(turned, [a, b, d], [a, b, c])
        second = np.where(turned, [b, c, d], [a, c, d])
        faces = np.stack([first, second]).transpose(2, 0, 1).reshape(-1, 3)
    return points, np.full(len(faces), faces.shape[1], np.int32), faces.astype(np.int32).ravel()


def spring_sheet(side: float, n: int, *, stretch: float = 1.0e3, diagonal: float = 1.0e3, cross: float = 1.0e1,
                 density: float = 0.2, up: str = "Y") -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A horizontal square net of n by n points: points, edges (m, 2), stiffness [N/m] (m,), masses [kg] (n^2,).

    Edges in this order: 2 n (n-1) structural (along a row, then along a column) of stiffness `stretch`,
    2 (n-1)^2 diagonals of `diagonal`, 2 n (n-2) over one point (they resist bending) of `cross`, all in [N/m].
    density [kg/m^2] of the sheet, shared equally by its points. Points 0 .. n-1 are one edge (to be pinned).
    """
    _require_positive_sizes(side=side, stretch=stretch, density=density)
    _require_whole_counts(2, n=n)
    for name, value in (("diagonal", diagonal), ("cross", cross)):
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is {value:g}; it must be finite and >= 0")
    grid = np.arange(n * n).reshape(n, n)
    groups = [(stretch, grid[:, :-1], grid[:, 1:]), (stretch, grid[:-1], grid[1:]),
              (diagonal, grid[:-1, :-1], grid[1:, 1:]), (diagonal, grid[:-1, 1:], grid[1:, :-1]),
              (cross, grid[:, :-2], grid[:, 2:]), (cross, grid[:-2], grid[2:])]
    edges = np.concatenate([np.stack([i.ravel(), j.ravel()], axis=1) for _, i, j in groups]).astype(np.int32)
    stiffness = np.concatenate([np.full(i.size, k) for k, i, _ in groups])
    points = _orient_sheet(_centred_grid_points(side, side, n, n), True, up)
    return points, edges, stiffness, np.full(n * n, density * side * side / (n * n))


def _surface_of_revolution(profile, bottom: float, top: float, segments: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surface of revolution about z of the (radius, z) pairs [m], closed by axis points at heights bottom and top."""
    _require_whole_counts(3, segments=segments)
    points, triangles = primitives.surface_of_revolution([(0.0, bottom), *profile, (0.0, top)], segments)
    return points, np.full(len(triangles), 3, np.int32), triangles.ravel()


def sphere(radius: float, segments: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sphere about the origin, points on it; `segments` around, half as many from pole to pole."""
    _require_positive_sizes(radius=radius)
    _require_whole_counts(4, segments=segments)
    theta = np.pi * np.arange(1, segments // 2) / (segments // 2)
    return _surface_of_revolution(radius * np.stack([np.sin(theta), -np.cos(theta)], axis=1), -radius, radius, segments)


def capsule(radius: float, half_height: float, segments: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Capsule along z; half_height [m] of the straight part."""
    _require_positive_sizes(radius=radius, half_height=half_height)
    _require_whole_counts(4, segments=segments)
    theta = 0.5 * np.pi * np.arange(1, segments // 4 + 1) / (segments // 4)
    low = np.stack([radius * np.sin(theta), -half_height - radius * np.cos(theta)], axis=1)
    profile = np.concatenate([low, low[::-1] * (1.0, -1.0)])
    return _surface_of_revolution(profile, -half_height - radius, half_height + radius, segments)


def cylinder(radius: float, half_height: float, segments: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cylinder along z between -half_height and +half_height [m]."""
    _require_positive_sizes(radius=radius, half_height=half_height)
    return _surface_of_revolution([(radius, -half_height), (radius, half_height)], -half_height, half_height, segments)


def cone(radius: float, half_height: float, segments: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cone along z: base of `radius` at -half_height, apex at +half_height [m]."""
    _require_positive_sizes(radius=radius, half_height=half_height)
    return _surface_of_revolution([(radius, -half_height)], -half_height, half_height, segments)


def box(half, divisions: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Box about the origin with half edges `half` (three lengths [m]); `divisions` cells along every edge. Quads."""
    _require_positive_sizes(**dict(zip(("half x", "half y", "half z"), half, strict=True)))
    _require_whole_counts(1, divisions=divisions)
    m = divisions + 1
    i, j = (index.ravel() for index in np.meshgrid(np.arange(divisions), np.arange(divisions), indexing="ij"))
    corners = np.stack([np.stack([i, j]), np.stack([i + 1, j]), np.stack([i + 1, j + 1]), np.stack([i, j + 1])])
    lattice = []
    for axis in range(3):                            # the two other axes in cyclic order: u x v = axis
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, divisions):
            faces = np.zeros((divisions * divisions, 4, 3), int)
            faces[:, :, axis] = end
            faces[:, :, u], faces[:, :, v] = corners[:, 0].T, corners[:, 1].T
            lattice.append(faces if end else faces[:, ::-1])
    ids, indices = np.unique(np.concatenate(lattice).reshape(-1, 3) @ (m * m, m, 1), return_inverse=True)
    steps = np.stack([ids // (m * m), ids // m % m, ids % m], axis=1)
    points = (2.0 * steps / divisions - 1.0) * np.asarray(half, np.float64)
    return points, np.full(6 * divisions * divisions, 4, np.int32), indices.astype(np.int32).ravel()


def torso(height: float = 0.85, segments: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tailor's dummy along z, wide in x, from the hips (z = 0) over shoulders and neck to a top at `height` [m].

    Elliptic sections of fixed proportions, joined by cubics that are flat at the sections, so that nothing bulges;
    at 0.85 m it has a chest of 75 cm and fits a small adult's shirt.
    """
    _require_positive_sizes(height=height)
    _require_whole_counts(8, segments=segments)
    sections = np.array([   # height, half width, half depth over the total height
        (0.00, 0.165, 0.118), (0.12, 0.172, 0.125), (0.30, 0.148, 0.105), (0.50, 0.155, 0.125), (0.62, 0.165, 0.118),
        (0.72, 0.190, 0.095), (0.77, 0.198, 0.075), (0.81, 0.178, 0.064), (0.84, 0.125, 0.056), (0.865, 0.075, 0.050),
        (0.895, 0.056, 0.046), (0.96, 0.050, 0.042), (0.99, 0.030, 0.028)])
    z = np.unique(np.round(np.concatenate([np.linspace(0.0, 0.66, 12), np.linspace(0.68, 0.90, 12), sections[:, 0]]), 9))
    k = np.clip(np.searchsorted(sections[:, 0], z, side="right") - 1, 0, len(sections) - 2)
    s = ((z - sections[k, 0]) / (sections[k + 1, 0] - sections[k, 0]))[:, None]
    half = sections[k, 1:] + s * s * (3.0 - 2.0 * s) * (sections[k + 1, 1:] - sections[k, 1:])
    points, counts, indices = _surface_of_revolution([(1.0, each) for each in z], 0.0, 1.0, segments)
    points[1:-1, :2] *= np.repeat(half, segments, axis=0)            # circles become ellipses
    return points * height, counts, indices


def block(size, cells, kind: str = "five", *, at=(0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """A solid box of sides `size` (three [m]) about `at` [m], cut into `cells` (one number or three) along its sides:
    points (n, 3) float64 [m] and tets (t, 4) int32 of positive volume, for `Scene.soft`.

    The first (cx + 1)(cy + 1)(cz + 1) points are the corners of the cells, z fastest, then y: those of the side at the least
    x come first. kind: "five" tets a cell, or "bcc", of better shape, which adds the centres of the cells.
    """
    points, tets = lattice.tet_box(size, cells, kind)
    at = np.asarray(at, np.float64)
    if at.shape != (3,) or not np.all(np.isfinite(at)):
        raise ValueError(f"at is {at.tolist()}; it must be three finite coordinates [m]")
    return points + at, tets


def read_obj(path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All faces of an OBJ file (Wavefront) as one surface, in the file's unit; scale its points to metres, as in
    `points, counts, indices = shapes.read_obj("cloth.obj"); scene.cloth("/cloth", 0.01 * points, counts, indices)`.

    Points that no face has are left out. Lines other than v and f are not read. Raises ValueError naming the line that is
    wrong, and OSError for a file that cannot be read.
    """
    points: list[list[float]] = []
    counts, indices = [], []
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            key, *words = line.split() or [""]
            if key not in ("v", "f"):
                continue
            try:
                if key == "v":
                    points.append([float(word) for word in words[:3]])
                else:
                    corners = [int(word.split("/")[0]) for word in words]
                    found = [k - 1 if k > 0 else len(points) + k for k in corners]
            except ValueError:
                raise ValueError(f"{path}: line {number}: {line.strip()[:60]!r} has no numbers where they should be") from None
            if key == "v" and len(points[-1]) < 3:
                raise ValueError(f"{path}: line {number}: a point has {len(words)} coordinates; it must have 3")
            if key == "f" and (len(found) < 3 or min(found) < 0 or max(found) >= len(points)):
                raise ValueError(f"{path}: line {number}: {line.strip()[:60]!r} names {len(found)} points of the {len(points)} "
                                 "before it; it must name 3 or more that are there")
            if key == "f":
                counts.append(len(found))
                indices += found
    if not counts:
        raise ValueError(f"{path}: has no faces; it must have lines that begin with f")
    used, corner = np.unique(indices, return_inverse=True)
    return np.array(points, np.float64)[used], np.array(counts, np.int32), corner.astype(np.int32).reshape(-1)


def grow_strands(points, counts, indices, number: int, length: float, segments: int = 8, where=None
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Strands that stand on a surface, for `Scene.rods`: points (number (segments + 1), 3) float64 [m], strand behind strand,
    root first, and the count of points of each. Roots are spread evenly over the area, the same in each call.

    points (n, 3) [m], counts, indices: polygons, as of `Cloth`; length of a strand [m]; where: takes the middles of triangles
    (t, 3) [m] and says which have hair, (t,) bool. Strands stand along normals, out of a closed surface. Raises ValueError
    where a number is wrong, or no triangle has hair.
    """
    _require_positive_sizes(length=length)
    _require_whole_counts(1, number=number, segments=segments)
    x = np.asarray(points, np.float64)
    X = x[triangulate_polygons(x, counts, indices)[0]]
    N = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    if np.einsum("ij,ij", X[:, 0] - x.mean(axis=0), N) < 0.0:              # six times the volume, of faces wound inward
        N = -N
    size = np.linalg.norm(N, axis=1)
    here = np.ones(len(X), bool) if where is None else np.asarray(where(X.mean(axis=1)), bool)
    if here.shape != size.shape or not here.any():
        raise ValueError(f"where is true of {np.count_nonzero(here)} of {len(X)} triangles; it must say so of each, and of one "
                         f"or more; their middles lie between {X.mean(axis=1).min(0).round(3).tolist()} and "
                         f"{X.mean(axis=1).max(0).round(3).tolist()}")
    k = np.arange(number)
    total = np.cumsum(size * here)
    t = np.searchsorted(total, (k + 0.5) / number * total[-1])
    u, v = (np.mod(0.5 + k * step, 1.0)[:, None] for step in (0.7548776662466927, 0.5698402909980532))    # Roberts 2018, R2
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    root = X[t, 0] + u * (X[t, 1] - X[t, 0]) + v * (X[t, 2] - X[t, 0])
    s = np.linspace(0.0, length, segments + 1)
    strands = root[:, None] + s[:, None] * (N[t] / size[t, None])[:, None]
    return strands.reshape(-1, 3), np.full(number, segments + 1, np.int32)
