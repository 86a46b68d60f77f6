"""OpenVDB files: what is written is read back to the bit, by the reader of wsim, by OpenVDB's own Python module and by tinyvdb
where they are; and a file that OpenVDB 10 wrote is read."""

import base64
import struct
import subprocess
import sys
import zlib
from time import process_time

import numpy as np
import pytest

from wsim.usd.result.kinds import vdb, vdb_read

# By OpenVDB 10.0.1 (zip, active mask): voxels of `made`, scaled by 1/4 and moved by (1, 2, 3), with eight tiles of 1.5 at
# (16..31, 0..15, 0..15); and a grid of vectors.
THEIRS = (
    b"c-rmSzi-n(6bJANp%4&1f&ht1h<HMv616mLNQ6pE0Wl#(qGdH_=iC_iM`Sxzf*1lbL+6SC#6Va60SF@lKSss^5)%V|0pc!pNYXZ~P$E@D-%tDWp0Drht"
    b"1DF*p0sfD9^uw`943*3A<J^!V3n*+i-oLA3zxG6Z8o3H7j-r}r)jcWoDq%tcpT(WVUBMG%``6;J;qeSa%rH>sj`|AZI9yn{yrb&R~Mr!wx@VZ@X#&l`v"
    b"-X82cGFHi=!CsvJ|>j-DXF{m1!|m)7*w?(}vg)GCgM=;YEhW@i;bgn$AFHg7l=jow{q+Jm&kR>-3&4?nCv!44D*CtIqrr-S!HzXp>b`{wr2Qm)czs3#T"
    b"_cgiOWxSa-Y4Y*lLp%ohhUoggoZH?Z=0|KOoQx4|raw7L@vG_Izj`-ygk+N^itzQ4m6UM@MN;d=I6omy<sqmFOUfZd_BX#1~Hd@dzQsW^Ww{aa2eTj!Y"
    b"}nQY4aZ)@PqZE+0%000000000000000004Us1^{3bN&Yp;&tccKOWQ|e{_2(K48OY8DF`Wb3PLiSf{^J>G5jeb>~Fp0Ar7MOZyqg0oEqy`ALqK5{R^4p"
    b">iuJuVy@Bejahz=$0~1>qx`<y{Vx|yX>LD7Infv6nxZ_(tA}Pynv%vbOL;5KJIqo(zkX=&XhUZy<NIx%rR;y(dv%y{*k>qwrUC!}000000000000000_"
    b">W)^0092lwIRy+I5(c@_p4t%wcEAU;}`GFJ()baQoRt8Z%O6Sdg^PgRlU9TCRwh({PA=(_u%7Nu~Yo~kRX#w3#a}7Xy=Ck"
)


def made() -> np.ndarray:
    values = (np.arange(216).reshape(6, 6, 6) % 7).astype(np.float32) - 2.0
    values[0] = 0.0
    return values


def several(seed: int = 0) -> list[vdb.VdbGrid]:
    """More than one lower node, leaves that are full, cut off, empty and mixed; vectors; no active voxel; halves."""
    rng, shape = np.random.default_rng(seed), (20, 33, 150)
    density, velocity = np.zeros(shape, np.float32), rng.normal(size=(*shape, 3)).astype(np.float32)
    density[3:15, 5:30, 10:140] = rng.normal(size=(12, 25, 130))
    density[4, 6, 11], velocity[:10] = 0.0, 0.0
    return [vdb.VdbGrid("density", density, np.array([0.5, 0.25, 0.1]), np.full(3, 0.5)),
            vdb.VdbGrid("velocity", velocity, np.zeros(3), np.array([1.0, 2.0, 3.0]), kind="unknown",
                        metadata={"vector_type": "contravariant relative"}),
            vdb.VdbGrid("nothing", np.zeros((5, 6, 7), np.float32)), vdb.VdbGrid("half", density.astype(np.float16))]


def written(path, grids) -> str:
    with open(path, "wb") as file:
        vdb.write_vdb(file, grids)
    return str(path)


def whole(grid: vdb.VdbGrid, shape) -> np.ndarray:
    """What was read in a grid of that shape, of which leaves may stick out."""
    found = np.zeros((*(-(-np.array(shape[:3]) // 8) * 8), *shape[3:]), grid.values.dtype)
    found[tuple(slice(a, a + n) for a, n in zip(grid.first, grid.values.shape, strict=False))] = grid.values
    inside = found[tuple(slice(n) for n in shape[:3])]
    assert np.count_nonzero(found) == np.count_nonzero(inside)
    return inside


def test_grids_come_back_to_the_bit(tmp_path):
    given = several()
    found = vdb_read.read_vdb(written(tmp_path / "a.vdb", given))
    assert list(found) == [g.name for g in given]
    for g in given:
        f = found[g.name]
        assert np.array_equal(whole(f, g.values.shape), g.values) and f.values.dtype == g.values.dtype
        assert np.array_equal(f.place, g.place) and np.array_equal(f.voxel, g.voxel) and f.kind == g.kind
        assert f.metadata.items() >= g.metadata.items()
    assert list(vdb_read.read_vdb(tmp_path / "a.vdb", ("half",))) == ["half"]
    assert written(tmp_path / "b.vdb", given) and (tmp_path / "a.vdb").read_bytes() == (tmp_path / "b.vdb").read_bytes()


def test_a_file_of_openvdb_is_read(tmp_path):
    (tmp_path / "theirs.vdb").write_bytes(zlib.decompress(base64.b85decode(THEIRS)))
    found = vdb_read.read_vdb(tmp_path / "theirs.vdb")
    density, velocity, a = found["density"], found["velocity"], made()
    wanted = np.zeros((32, 16, 16), np.float32)
    wanted[:6, :6, :6], wanted[16:] = a, 1.5
    assert np.array_equal(density.values, wanted) and not density.first.any() and density.kind == "fog volume"
    assert np.array_equal(whole(velocity, (6, 6, 6, 3)), np.stack([a, 2 * a, a * a], -1))
    assert all(np.array_equal(g.place, [1, 2, 3]) and np.array_equal(g.voxel, [0.25] * 3) for g in found.values())


def python_with(*modules: str) -> tuple[str, str] | None:
    """(interpreter, module) of the first that is there: OpenVDB's module comes with a system's own Python."""
    for python in (sys.executable, "/usr/bin/python3"):
        for module in modules:
            try:
                if not subprocess.run([python, "-c", f"import numpy, {module}"], capture_output=True).returncode:
                    return python, module
            except OSError:
                break
    return None


def test_openvdb_reads_the_files(tmp_path):
    """And says of them what was meant: values, active voxels, class, transform, box."""
    if (found := python_with("openvdb", "pyopenvdb")) is None:
        pytest.skip("OpenVDB's Python module is not installed (Debian: python3-openvdb)")
    given = several()
    written(tmp_path / "a.vdb", given)
    np.savez(tmp_path / "a.npz", **{g.name: g.values.astype(np.float32) for g in given})
    subprocess.run([found[0], "-c", f"""
import numpy as np, {found[1]} as vdb
given = np.load("a.npz")
grids, _ = vdb.readAll("a.vdb")
assert {{g.name for g in grids}} == set(given)
for g in grids:
    a = given[g.name]
    b = np.full(a.shape, 7.0, np.float32)
    g.copyToArray(b)
    active = (a != 0) if a.ndim == 3 else (a != 0).any(-1)
    assert np.array_equal(a, b) and g.activeVoxelCount() == active.sum(), g.name
    if active.any():
        index = np.argwhere(active)
        assert g.evalActiveVoxelBoundingBox() == (tuple(index.min(0)), tuple(index.max(0)))
        assert g.metadata["file_bbox_min"] == tuple(index.min(0)) and g.metadata["file_bbox_max"] == tuple(index.max(0))
density, velocity = (next(g for g in grids if g.name == name) for name in ("density", "velocity"))
assert density.gridClass == "fog volume" and velocity.gridClass == "unknown"
assert density.transform.indexToWorld((2, 0, 0)) == (1.5, 0.25, 0.1)
assert velocity.transform.indexToWorld((1, 1, 1)) == (1.0, 2.0, 3.0)
"""], cwd=tmp_path, check=True)


def test_tinyvdb_reads_the_files(tmp_path):
    """Leaf for leaf. (Its list of active voxels, in 0.9.0, ends early for larger trees, of OpenVDB's own files too.)"""
    tinyvdb = pytest.importorskip("tinyvdb", reason="tinyvdb is not installed (pip install tinyvdb)")
    small = several()[0].values[:16, :16, :16]
    file = tinyvdb.open(written(tmp_path / "a.vdb", [*several()[:2], vdb.VdbGrid("small", np.ascontiguousarray(small))]))
    file.read_grids()
    grids = {file.grid(k).name: file.grid(k) for k in range(file.grid_count)}
    sparse = grids["small"].to_sparse()
    ijk, values = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3), np.frombuffer(sparse["values"], np.float32)
    assert len(values) == np.count_nonzero(small) and np.array_equal(small[tuple(ijk.T)], values)
    assert grids["density"].transform["translation"] == (0.5, 0.25, 0.1)
    for grid in several()[:2]:
        tree = grids[grid.name].tree
        nodes = [tree.node(k) for k in range(tree.num_nodes)]
        leaves = np.concatenate([np.frombuffer(n.data, np.float32) for n in nodes if n.type == "leaf"])
        assert np.array_equal(np.sort(leaves[leaves != 0]), np.sort(grid.values[grid.values != 0]))


def test_empty_space_takes_no_room_and_a_million_voxels_little_time(tmp_path):
    """4 bytes a voxel, 65 a leaf, 1025 a lower node, 8193 the upper one."""
    values = np.zeros((128, 128, 128), np.float32)
    values[40:48, 40:48, 40:48] = 1.0
    names = 400                                               # header, names, metadata, transform
    written(tmp_path / "a.vdb", [vdb.VdbGrid("density", values)])
    assert (tmp_path / "a.vdb").stat().st_size < 8193 + 1025 + 64 + 65 + 4 * 512 + 2 * names
    values[...] = 1.0
    best = np.inf
    for _ in range(3):
        began = process_time()
        written(tmp_path / "a.vdb", [vdb.VdbGrid("density", values)])
        best = min(best, process_time() - began)
    assert (tmp_path / "a.vdb").stat().st_size < 4 * 128**3 + 4096 * (64 + 65) + 8193 + 1025 + 2 * names
    assert best < 1.0


@pytest.mark.parametrize("values, said", [
    (np.zeros((2, 2)), "shape"), (np.zeros((2, 2, 2, 2), np.float32), "shape"), (np.zeros((0, 2, 2), np.float32), "shape"),
    (np.zeros((1, 1, 4097), np.float32), "4097 voxels"), (np.zeros((2, 2, 2)), "float64")])
def test_what_no_file_holds_is_refused(tmp_path, values, said):
    with open(tmp_path / "a.vdb", "wb") as file, pytest.raises(ValueError, match=said):
        vdb.write_vdb(file, [vdb.VdbGrid("density", values)])
    assert not (tmp_path / "a.vdb").stat().st_size


def test_a_file_that_is_cut_or_something_else_is_named(tmp_path):
    path = tmp_path / "a.vdb"
    written(path, several()[:1])
    data = path.read_bytes()
    blosc = data.replace(struct.pack("<I", vdb.ACTIVE_MASK) + data[data.index(b"class") - 8:][:4], struct.pack("<I", 6)
                         + data[data.index(b"class") - 8:][:4], 1)
    for wrong, said in ((b"PNG" + data[3:], "is no OpenVDB file"), (data[:-100], "ends early"), (data[:20], "ends early"),
                        (b"", "no whole OpenVDB file"), (data[:8] + struct.pack("<I", 210) + data[12:], "version 210"),
                        (blosc, "packed by Blosc"), (data.replace(b"Tree_float", b"Tree_int32"), "Tree_int32_5_4_3")):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=f"{path} .*{said}"):
            vdb_read.read_vdb(path)
