"""UsdVol.Volume prims as densities over time, read by pxr and `wsim.usd.result.kinds.vdb_read`. No Warp."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from pxr import Usd, UsdGeom, UsdVol

from wsim.usd.result.kinds import vdb_read

NAMES = ("density", "smoke")          # fields that may be the density, in this order
ALBEDO = (0.80, 0.81, 0.83)           # of smoke without a display colour, linear
MOST_BEADS, SEEN = 20000, 0.01        # of a viewer; part of the densest that a bead must hold
DENSE = 25.0                          # optical depth of smoke of 1 along the longest edge of its volume


@dataclass(frozen=True)
class SmokeDensity:
    """values (nx, ny, nz) float32; world (4, 4) from the index of a voxel [m]."""

    values: np.ndarray
    world: np.ndarray


@dataclass
class SmokeVolume:
    """A volume of a stage. at(time code) is its density, or None where there is none to draw: no file, no smoke."""

    path: str
    albedo: np.ndarray
    at: Callable[[float], SmokeDensity | None]
    corners: Callable[[float], np.ndarray]        # (8, 3) of its box, world [m]
    times: list[float]                            # of its samples

    def filled(self, t: float) -> np.ndarray | None:
        """Corners (8, 3) of the box that holds what is seen of the smoke at a time code, world [m]; None: there is none."""
        density = self.at(t)
        if density is None:
            return None
        index = np.argwhere(density.values > SEEN * density.values.max())
        ends = np.array([index.min(axis=0) - 0.5, index.max(axis=0) + 0.5])
        box = np.array(np.meshgrid(*ends.T, indexing="ij")).reshape(3, -1)
        return (density.world[:3, :3] @ box + density.world[:3, 3:]).T

    @cached_property
    def extinction(self) -> float:
        """[1/m] of smoke of 1."""
        edges = np.ptp(self.corners(self.times[0] if self.times else 0.0), axis=0)
        return DENSE / max(float(edges.max()), 1e-9)


def read_smoke_volume(prim: Usd.Prim, folder: str, meters: float, notes: list[str]) -> SmokeVolume | None:
    """The smoke of a Volume prim, or None with a note. folder: of the stage's file, to which paths are relative that the
    layer of a run that goes on does not resolve."""
    volume = UsdVol.Volume(prim)
    paths = {name: prim.GetStage().GetPrimAtPath(path) for name, path in volume.GetFieldPaths().items()}
    fields = {name: UsdVol.OpenVDBAsset(each) for name, each in paths.items() if each and each.IsA(UsdVol.OpenVDBAsset)}
    field = next((fields[name] for name in NAMES if name in fields), None)
    if field is None:
        notes.append(f"{prim.GetPath()}: has no field density of an OpenVDB file and is not drawn")
        return None
    colors = volume.GetDisplayColorAttr().Get()
    files = field.GetFilePathAttr()
    name = field.GetFieldNameAttr().Get() or "density"

    def smoke_density_at(t: float) -> SmokeDensity | None:
        asset = files.Get(t)
        path = asset and (asset.resolvedPath or os.path.normpath(os.path.join(folder, asset.path)))
        if not path:
            return None
        try:
            found = _read_density_grid(path, name)
        except (OSError, ValueError) as error:
            if (note := f"{prim.GetPath()}: is not drawn at time code {t:g}: {error}") not in notes:
                notes.append(note)
            return None
        if found is None or not found[0].any():
            return None
        values, local = found
        return SmokeDensity(values, _scaling_to_meters(meters) @ _volume_to_world_matrix(field.GetPrim(), t) @ local)

    def smoke_box_corners_at(t: float) -> np.ndarray:
        extent = volume.GetExtentAttr().Get(t)
        if extent is None or len(extent) != 2:
            density = smoke_density_at(t)
            if density is None:
                return np.zeros((8, 3))
            ends, M = np.array([np.full(3, -0.5), np.array(density.values.shape) - 0.5]), density.world
        else:
            ends, M = np.array(extent, np.float64), _scaling_to_meters(meters) @ _volume_to_world_matrix(prim, t)
        box = np.array(np.meshgrid(*ends.T, indexing="ij")).reshape(3, -1)
        return (M[:3, :3] @ box + M[:3, 3:]).T

    albedo = np.array(colors[0] if colors else ALBEDO, np.float64)
    return SmokeVolume(str(prim.GetPath()), albedo, smoke_density_at, smoke_box_corners_at, list(files.GetTimeSamples()))


def _volume_to_world_matrix(prim: Usd.Prim, t: float) -> np.ndarray:
    return np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(t)).T


def _scaling_to_meters(meters: float) -> np.ndarray:
    return np.diag([meters, meters, meters, 1.0])


@lru_cache(maxsize=2)
def _read_density_grid(path: str, name: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Density and the matrix from index to the volume's frame; None where the file has no such field."""
    grid = vdb_read.read_vdb(path, (name,)).get(name)
    if grid is None or grid.components != 1:
        return None
    M = np.diag([*grid.voxel, 1.0])
    M[:3, 3] = grid.place + grid.voxel * grid.first
    return np.maximum(np.nan_to_num(grid.values.astype(np.float32)), 0.0), M


def smoke_beads(density: SmokeDensity, extinction: float) -> tuple[np.ndarray, np.ndarray]:
    """Smoke as spheres, for viewers that draw no volume: places (n, 3) and radii (n,) [m], of blocks of voxels, as few as
    `MOST_BEADS`; as large as what they hold keeps light back, up to the block."""
    values = density.values
    n = 1
    while np.count_nonzero(values) > MOST_BEADS:
        n += 1
        shape = -(-np.array(density.values.shape) // n)
        padded = np.zeros(n * shape, np.float32)
        padded[tuple(slice(k) for k in density.values.shape)] = density.values
        x, y, z = shape
        values = padded.reshape(x, n, y, n, z, n).mean(axis=(1, 3, 5))
        values = np.where(values > SEEN * values.max(), values, 0.0)
    index = np.argwhere(values)
    edge = n * float(np.abs(np.linalg.det(density.world[:3, :3]))) ** (1.0 / 3.0)
    held = 1.0 - np.exp(-extinction * edge * values[tuple(index.T)])
    return (n * index + 0.5 * (n - 1)) @ density.world[:3, :3].T + density.world[:3, 3], 0.5 * edge * np.cbrt(held)
