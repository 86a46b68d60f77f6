"""What many lanes of a tree do in another way than one: factors by levels, systems by the inverse of the factor, responses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import wsim
from tests.physics.joints.trees.chains import trees_of
from wsim.kernels.rigid.joint.tree import joint_forces, mass_matrix
from wsim.kernels.rigid.joint.tree.contact import responses
from wsim.kernels.rigid.joint.tree.kinematics import place_tree
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.joint.tree.wide_factor import factor_by_levels, invert_tree_factor, solve_by_inverse_factor

HUMANOID = Path(__file__).resolve().parents[4] / "scenes/humanoid.usda"


@wp.kernel(enable_backward=False)
def place_and_assemble(T: Trees):
    place_tree(wp.tid(), T)
    assemble_tree_matrix(wp.tid(), T)


@wp.kernel(enable_backward=False)
def factor_and_solve(T: Trees, x: wp.array(dtype=wp.float64)):
    factor_by_levels(wp.tid(), T)
    invert_tree_factor(wp.tid(), T)
    solve_by_inverse_factor(wp.tid(), x, T)


@wp.func_native("\n    return true;\n")
def always_many() -> bool: ...


def branched_scene() -> wsim.Scene:
    """A free body with three chains of two, the middle one branched again."""
    scene = wsim.Scene(coordinates="reduced", fps=60)
    root = scene.body("/root", wsim.Box((0.3, 0.1, 0.2)))
    for side in range(3):
        first = scene.body(f"/a{side}", wsim.Box((0.2, 0.05, 0.04)), at=(0.5, 0.0, 0.4 * side))
        scene.joint("spherical", f"/ja{side}", root, first, at=(0.3, 0.0, 0.4 * side))
        for end in range(2 if side == 1 else 1):
            last = scene.body(f"/b{side}{end}", wsim.Box((0.2, 0.03, 0.02)), at=(0.9, 0.3 * end, 0.4 * side))
            scene.joint("revolute", f"/jb{side}{end}", first, last, at=(0.7, 0.15 * end, 0.4 * side), axis=(0, 0.6, 0.8))
    for body in scene.things("Body"):
        body.colliders[0].meets = False
    return scene


def dense(entries: np.ndarray, links) -> np.ndarray:
    """Lower triangle of the rows of H, or of its factors."""
    found = np.zeros((len(links.dof_link),) * 2)
    for row in range(len(found)):
        for e in range(links.first_entry[row], links.first_entry[row + 1]):
            found[row, links.entry_dof[e]] = entries[e]
    return found


def test_factors_by_levels_and_products_with_the_inverse_are_those_of_the_matrix():
    simulation = wsim.Simulation(branched_scene(), device="cpu", precision="float64")
    trees = trees_of(simulation)[1]
    T, n = trees.trees, len(trees.links.dof_link)
    wp.launch(place_and_assemble, 1, [T], device="cpu")
    lower = dense(T.H.numpy(), trees.links)
    H = lower + np.tril(lower, -1).T
    b = np.random.default_rng(0).normal(size=n)
    x = wp.array(b, dtype=wp.float64, device="cpu")
    wp.launch(factor_and_solve, 1, [T, x], device="cpu")
    factors, M = dense(T.H.numpy(), trees.links), dense(T.M.numpy(), trees.links)
    L = np.tril(factors, -1) + np.eye(n)
    assert n == 6 + 9 + 4 and (lower == 0.0).sum() > n * (n - 1) / 2              # branches fill nothing in
    assert L.T @ np.diag(np.diag(factors)) @ L == pytest.approx(H, rel=1e-12, abs=1e-12 * np.abs(H).max())
    assert np.abs(M @ L - np.eye(n)).max() < 1e-12
    assert H @ x.numpy() == pytest.approx(b, abs=1e-11)


@pytest.mark.slow
def test_a_humanoid_lands_alike_by_many_lanes_and_by_one(monkeypatch):
    """One lane takes the way of many: the same places to rounding, which grows by blows."""
    found = []
    for many in (False, True):
        if many:
            for module in (mass_matrix, joint_forces, responses):
                monkeypatch.setattr(module, "has_many_lanes", always_many)
        simulation = wsim.Simulation(replace(wsim.load(HUMANOID), coordinates="reduced"), device="cpu", precision="float64")
        for _ in range(10):
            simulation.step()
        found.append(simulation.plan.method("rigid").get("x"))
    assert np.abs(found[0] - found[1]).max() < 1e-10
    assert not np.array_equal(*found)
