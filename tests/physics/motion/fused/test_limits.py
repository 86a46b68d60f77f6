"""Sweeps over strain limits by the blocks that share a sheet: as lists and letters have it, run here block by block in any
order that letters allow."""

import numpy as np
import pytest

from tests.make.physics.motion.fused.kernel_fusion import CLOTH
from wsim.kernels.motion.fused.limits import BLOCK, LISTS, SLOT
from wsim.model.model import build_model
from wsim.physics.cloth.constraints import fill_constraints
from wsim.physics.motion.fused.domain_decomposition import NONE, Domains
from wsim.physics.motion.fused.limits import BlockLimits, edges_of
from wsim.scene import Scene, shapes
from wsim.scene.fabric import Fabric

wp = pytest.importorskip("warp")
SWEEPS = 3


@pytest.fixture(scope="module")
def sheet():
    """Places at rest, triangles, edges and colours of a sheet."""
    scene = Scene(solver="explicit")
    scene.cloth("/cloth", *shapes.sheet(0.4, 0.4, 11, 9), material=Fabric(**{**CLOTH.__dict__, "strain_limit": 0.02}))
    model = build_model(scene, 1, wp.get_device("cpu"), wp.float64)
    fill_constraints(model)
    return model.stack("rest"), model.bodies[0].triangles, *edges_of(model)


def projected(a: np.ndarray, b: np.ndarray, w: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends of an edge behind its turn."""
    far = np.sqrt(((b - a)**2).sum())
    if far <= most or w.sum() == 0.0:
        return a, b
    share = (far - most) / (far * w.sum()) * (b - a)
    return a + w[0] * share, b - w[1] * share


class Block:
    """A block as its threads see it: its memory, and lists by name."""

    def __init__(self, number: int, found: BlockLimits, domains: Domains, place: np.ndarray):
        head, every = found.lists(place)
        head = head.reshape(-1, len(LISTS), 2)[number]
        self.lists = {name: every[first:first + size] for name, (first, size) in zip(LISTS, head, strict=True)}
        self.point, self.own, self.plan = domains.blocks[number]["point"], domains.own[number], found.plan
        self.places = np.full((self.plan.points + self.plan.inbox + 2 * self.plan.guests, 3), np.nan)
        self.letters = dict[int, int]()                    # turn of what stands in a place behind its own

    def write(self, word: int, turn: int, a: np.ndarray, blocks: list, shift: int = 0) -> None:
        """A letter, which must not be there in the place of one that was not read."""
        other, slot = blocks[word >> BLOCK & 0x3ff], (word >> SLOT) + shift
        assert slot not in other.letters, "a letter is written over another that was not read"
        other.letters[slot] = turn
        other.places[other.plan.points + slot] = a

    def wait(self, begin: int, end: int, turn: int):
        """Until all letters of these places are there; they are read then."""
        while not all(self.letters.get(k) == turn for k in range(begin, end)):
            yield
        for k in range(begin, end):
            del self.letters[k]

    def sweeps(self, x: np.ndarray, w: np.ndarray, longest: np.ndarray, blocks: list):
        """A few sweeps; stops wherever other blocks may go on."""
        lists, plan, places = self.lists, self.plan, self.places
        places[:len(self.own)] = x[self.own]
        joint, source = (np.stack([lists[name] & 0xffff, lists[name] >> 16], 1) for name in ("joint", "source"))
        for turn in range(SWEEPS):
            part = turn % 2 * plan.guests
            for p, (i, j) in enumerate(zip(lists["first_begin"][:-1], lists["first_begin"][1:], strict=True)):
                for word in lists["first"][i:j]:
                    self.write(word, turn, places[p], blocks, part)
            yield from self.wait(plan.inbox + part, plan.inbox + part + lists["guest"][0], turn)
            for k in range(plan.colours):
                for e in range(lists["colour"][k], lists["colour"][k + 1]):
                    from_where = source[e] + np.where(source[e] >= plan.points + plan.inbox, part, 0)
                    ends = projected(*places[from_where], w[self.point[joint[e]]], longest[lists["edge"][e]])
                    places[joint[e]] = ends
                    for word in lists["letter"][lists["letter_begin"][e]:lists["letter_begin"][e + 1]]:
                        self.write(word, turn, ends[word & 1], blocks)
                    yield
                yield from self.wait(lists["arrive"][k], lists["arrive"][k + 1], turn)


def swept(x: np.ndarray, w: np.ndarray, edges: np.ndarray, colours: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """One after the other, as launches take them."""
    x = x.copy()
    for _ in range(SWEEPS):
        for e in np.argsort(colours, kind="stable"):
            x[edges[e]] = projected(*x[edges[e]], w[edges[e]], longest[e])
    return x


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [1, 2, 8, 16])
def test_blocks_that_write_letters_leave_the_bits_of_one_sweep(sheet, size, seed):
    """Each in turn is one that may go on, drawn at random."""
    rest, triangles, edges, colours = sheet
    random = np.random.default_rng(seed)
    x = rest + random.normal(scale=0.004, size=rest.shape)
    w = random.uniform(1.0, 3.0, len(x)) * (random.uniform(size=len(x)) > 0.1)           # some are pinned
    longest = random.uniform(0.98, 1.05, len(edges)) * np.linalg.norm(rest[edges[:, 1]] - rest[edges[:, 0]], axis=1)
    domains = Domains(rest, triangles, NONE, {}, size, False)
    found = BlockLimits(domains, edges, colours)
    place = random.permutation(len(edges))                  # of edges in a table of another order
    table = np.empty(len(edges))
    table[place] = longest
    blocks = [Block(b, found, domains, place) for b in range(size)]
    running = {b: block.sweeps(x, w, table, blocks) for b, block in enumerate(blocks)}
    for _ in range(100_000):
        if not running:
            break
        b = random.choice(list(running))
        if next(running[b], "done") == "done":
            del running[b]
    assert not running, "blocks wait for each other"
    mine = np.empty_like(x)
    for block in blocks:
        mine[block.own] = block.places[:len(block.own)]
    want = swept(x, w, edges, colours, longest)
    assert np.array_equal(mine, want) and np.abs(want - x).max() > 1e-3
