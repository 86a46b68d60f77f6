"""How blocks share sheets: every list, put together again, is what the whole sheet has."""

import numpy as np
import pytest

from tests.make.physics.motion.fused.kernel_fusion import sheet
from wsim.kernels.cloth.curvature import SLOTS
from wsim.model.model import build_model
from wsim.physics.cloth.constraints import fill_constraints
from wsim.physics.motion.fused.domain_decomposition import NONE, Domains, halved_points
from wsim.physics.motion.fused.plan import BlockPlan
from wsim.scene import shapes

wp = pytest.importorskip("warp")
SIZES = [1, 4, 16]


@pytest.fixture(scope="module")
def parts():
    """Places at rest, triangles, hinges, and tables of curvatures of a small sheet."""
    model = build_model(sheet(), 1, wp.get_device("cpu"), wp.float32)
    fill_constraints(model)
    from wsim.physics.cloth.elements import CornerElements
    rows = {kind: [r for r in model.constraints if r.kind == kind] for kind in ("membrane", "dihedral")}
    flat, bent = (CornerElements(model, kind, each) for kind, each in rows.items())
    return model.stack("rest"), flat.ids, bent.ids, bent.curvature.tables()


def test_halves_are_equal_and_near_each_other():
    x = np.stack(np.meshgrid(np.arange(8.0), np.arange(4.0), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    found = halved_points(x, np.arange(32), 4)
    assert np.array_equal(np.sort(np.concatenate(found)), np.arange(32))
    assert [len(p) for p in found] == [8] * 4 and all((np.ptp(x[p], axis=0) <= [1.0, 3.0, 0.0]).all() for p in found)


@pytest.mark.parametrize("size", SIZES)
def test_blocks_gather_the_forces_of_the_whole(parts, size):
    """Forces of hinges by way of angles and curvatures, of random numbers in the place of formulas."""
    x, triangles, hinges, c = parts
    z, at = np.random.default_rng(0).normal(size=len(hinges)), np.random.default_rng(1).normal(size=(len(triangles), 3, 3))
    G, value = np.random.default_rng(2).normal(size=(len(hinges), 4, 3)), c["value"].reshape(-1, SLOTS, 3)
    used = np.arange(SLOTS) < c["count"][:, None]
    C = np.einsum("ts,tsk->tk", np.where(used, z[c["slot"].reshape(-1, SLOTS)], 0.0), value)
    u = [sum(c["value"][s] @ C[s // SLOTS] for s in c["item"][a:b]) for a, b in zip(c["begin"], c["end"], strict=True)]
    whole = np.zeros_like(x)
    np.add.at(whole, triangles, at)
    np.add.at(whole, hinges, np.array(u)[:, None, None] * G)
    found, mine = np.full_like(x, np.nan), Domains(x, triangles, hinges, c, size, False)
    for d, own in zip(mine.blocks, mine.own, strict=True):
        slot = d["slot"].reshape(-1, SLOTS)
        values = c["value"][d["value"]].reshape(-1, SLOTS, 3)
        C = np.einsum("ts,tsk->tk", np.where(slot >= 0, z[d["hinge"]][slot], 0.0), values)
        begin = d["moment_begin"]
        u = [sum(values.reshape(-1, 3)[s] @ C[s // SLOTS] for s in d["moment"][a:b])
             for a, b in zip(begin[:-1], begin[1:], strict=True)]
        bent = len(begin) - 1
        forces = np.concatenate([np.pad(at[d["triangle"]], ((0, 0), (0, 1), (0, 0))),
                                 np.array(u).reshape(-1, 1, 1) * G[d["hinge"][:bent]]])
        for i, a, b in zip(own, d["force_begin"][:-1], d["force_begin"][1:], strict=True):
            found[i] = sum(forces[word >> 2, word & 3] for word in d["force"][a:b])
    assert np.allclose(found, whole, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("size", SIZES)
def test_blocks_gather_the_forces_of_tets_beside_sheets(parts, size):
    """Forces of random numbers at the corners of triangles and tets."""
    x, triangles, _, _ = parts
    points, tets = shapes.block((0.4, 0.2, 0.2), (6, 3, 3))
    x, tets = np.concatenate([x, points]), tets + len(x)
    at = [np.random.default_rng(k).normal(size=(len(ids), 4, 3)) for k, ids in enumerate((triangles, tets))]
    at[0][:, 3] = 0.0
    whole = np.zeros_like(x)
    np.add.at(whole, triangles, at[0][:, :3])
    np.add.at(whole, tets, at[1])
    found, mine = np.full_like(x, np.nan), Domains(x, triangles, NONE, {}, size, True, tets)
    for d, own in zip(mine.blocks, mine.own, strict=True):
        words = d["tet_corner"].reshape(-1, 2)
        corners = np.stack([words & 0xffff, words >> 16], axis=2).reshape(-1, 4)
        assert np.array_equal(d["point"][corners], tets[d["tet"]])
        forces, begin = np.concatenate([at[0][d["triangle"]], at[1][d["tet"]]]), d["force_begin"]
        for i, a, b in zip(own, begin[:-1], begin[1:], strict=True):
            found[i] = sum(forces[word >> 2, word & 3] for word in d["force"][a:b])
    assert np.allclose(found, whole, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("size", SIZES)
def test_corners_are_places_of_what_a_block_keeps_and_is_sent(parts, size):
    x, triangles, hinges, c = parts
    mine = Domains(x, triangles, hinges, c, size, False)
    kept = [np.full(len(d["point"]), -1) for d in mine.blocks]
    for d, own, held in zip(mine.blocks, mine.own, kept, strict=True):
        held[:len(own)] = own
        for name, ids in (("triangle", triangles), ("hinge", hinges)):
            words = d["corner" if name == "triangle" else "hinge_corner"].reshape(-1, 2)
            corners = np.stack([words & 0xffff, words >> 16], axis=2).reshape(-1, 4)[:, :ids.shape[1]]
            assert np.array_equal(d["point"][corners], ids[d[name]])
    for d, own in zip(mine.blocks, mine.own, strict=True):
        for i, a, b in zip(own, d["push_begin"][:-1], d["push_begin"][1:], strict=True):
            for word in d["push"][a:b]:
                kept[word >> 16][word & 0xffff] = i
    assert all(np.array_equal(held, d["point"]) for held, d in zip(kept, mine.blocks, strict=True))
    assert all(b in mine.blocks[other]["near"] for b, d in enumerate(mine.blocks) for other in d["near"])


def test_what_does_not_fit_has_no_plan(parts, monkeypatch):
    from wsim.physics.motion.fused import plan
    assert isinstance(Domains(*parts, 8, True).plan, BlockPlan)
    monkeypatch.setattr(plan, "ROOM", 4096)
    assert Domains(*parts, 8, True).plan is None
