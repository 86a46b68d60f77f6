"""What a recording keeps, what it says where there is no room, and what it takes then."""

import os
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.make.gradient.gradients import net
from wsim.gradient import checkpoints
from wsim.gradient.checkpoints import CheckpointCosts
from wsim.gradient.recording import Recording
from wsim.model import arena
from wsim.model.arena import ArraySlots
from wsim.scene import SceneError, Springs
from wsim.simulation.simulation import Simulation


def recording(keep="auto", frames=6, substeps=40) -> Recording:
    sim = Simulation(net(integrator="leapfrog", substeps=substeps), device="cpu", precision="float64", gradients=True)
    return Recording(sim, frames, keep)


@pytest.mark.parametrize("frames, substeps, each, point", [(6, 40, 1e6, 2e4), (400, 2, 1e5, 3e5), (1, 1, 10.0, 10)])
def test_the_longest_segment_that_fits_is_the_longest(frames, substeps, each, point):
    least = CheckpointCosts(frames, substeps, each, 100.0, point, 1000, np.inf, "cpu")
    for room in (1.2 * least.bytes(least.best), 3.0 * least.bytes(least.best)):
        cost = CheckpointCosts(frames, substeps, each, 100.0, point, 1000, room, "cpu")
        fits = [n for n in range(1, cost.total + 1) if cost.bytes(n) <= room]
        assert abs(cost.longest() - max(fits)) <= max(1, 0.1 * max(fits)) and cost.bytes(cost.longest()) <= room
    assert CheckpointCosts(frames, substeps, each, 100.0, point, 1000, 900.0, "cpu").longest() == 0


@pytest.mark.parametrize("keep", ["all", "checkpoints"])
def test_what_is_kept_was_foreseen(keep):
    found = recording(keep)
    foreseen = found.cost.bytes(found.cost.best) if found.checkpoints else found.cost.full
    assert found.bytes + found.cost.fixed <= foreseen <= 1.1 * (found.bytes + found.cost.fixed)
    assert len(found.slots.chunks) <= 2 and found.slots.chunks[0][0].size >= 0.95 * found.slots.used[0]


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc of Linux")
@pytest.mark.parametrize("springs, frames", [(11, 150), (3000, 40)])
def test_resident_memory_grows_by_no_more_than_is_said(springs, frames):
    """Arrays of many springs, and launches on few. Graphs that keep the memory around what they clear take 20 times as much."""
    points = np.array([[0.1 * i, 0.0, 0.003 * (i % 3)] for i in range(springs + 1)])
    edges = np.stack([np.arange(springs), np.arange(1, springs + 1)], axis=1)
    chain = Springs("/chain", points, edges, masses=0.01, stiffness=np.array([40.0]), damping=1e-3)
    scene = net(objects={"Springs": [chain]}, integrator="leapfrog", substeps=2)
    sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
    for count in (2, frames):                     # the first compiles
        before, found = resident(), Recording(sim, count, "all")
        found.run()
        found.backward({count: np.ones((springs + 1, 3))})
        grown = resident() - before
    assert grown < 1.5 * (found.bytes + found.cost.fixed) + (4 << 20)              # pieces of the heap


def resident() -> int:
    """Bytes of this process in memory."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_where_all_does_not_fit_the_bytes_and_the_segment_that_would_are_said(monkeypatch):
    whole = recording("all")
    need = whole.cost.full
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 0.5 * need)
    with pytest.raises(SceneError, match="memory: recording 6 frames of 40 substeps keeps .* segments of up to") as said:
        recording("all")
    assert float(str(said.value).split("keeps ")[1].split()[0]) == pytest.approx(need, rel=0.1)        # by two substeps
    longest = int(str(said.value).split("segments of up to ")[1].split()[0])
    assert whole.cost.bytes(longest) == pytest.approx(0.5 * need, rel=0.1)
    found = recording("auto")
    assert found.checkpoints and found.bytes < 0.5 * need


def test_steps_of_sdirk3_are_counted_and_not_their_stages(monkeypatch):
    scene = net(solver="implicit", integrator="sdirk3", substeps=4, iterations=2)
    sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
    whole = Recording(sim, 6, "all").cost
    assert whole.substeps == 8
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 0.5 * whole.full)
    with pytest.raises(SceneError, match="recording 6 frames of 4 substeps keeps .* in segments of up to") as said:
        Recording(sim, 6, "all")
    longest = int(str(said.value).split("segments of up to ")[1].split()[0])
    assert whole.bytes(2 * longest) == pytest.approx(0.5 * whole.full, rel=0.1)


def test_where_nothing_fits_the_frames_that_would_are_said(monkeypatch):
    cost = recording("checkpoints", 40, 2).cost
    few = replace(cost, frames=1)
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 0.5 * (few.bytes(few.best) + cost.bytes(cost.best)))
    with pytest.raises(SceneError, match="record [0-9]+ frames at most") as said:
        recording("auto", 40, 2)
    frames = int(str(said.value).split("record ")[1].split()[0])
    assert recording("auto", frames, 2).frames == frames and 10 < frames < 30
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 1000.0)
    with pytest.raises(SceneError, match="not even one frame fits"):
        recording("auto", 40, 2)


@pytest.mark.parametrize("pieces, words", [(0, "memory: cpu has too little for a recording of one frame"),
                                           (4, r"keeps [0-9]+ bytes .* are free on cpu")])
def test_an_allocation_that_fails_is_said_in_words(pieces, words, monkeypatch):
    """After so many pieces of memory there is none."""
    add, made = ArraySlots.add, []

    def fails(self, size):
        if len(made) >= pieces:
            raise RuntimeError(f"Failed to allocate {size} bytes on device 'cpu'")
        made.append(size)
        add(self, size)
    monkeypatch.setattr(ArraySlots, "add", fails)
    monkeypatch.setattr(arena, "CHUNK", 1 << 20)
    with pytest.raises(SceneError, match=words):
        recording("all")


def test_what_is_too_large_for_an_array_is_reserved_in_pieces(monkeypatch):
    monkeypatch.setattr(arena, "PIECE", 12)
    own = ArraySlots(wp.get_device("cpu"), wp.float64)
    own.reserve((30, 0))
    assert [c[0].size for c in own.chunks] == [12, 12, 6]
    assert len({own.take(wp.vec3d, (2,)).ptr for _ in range(5)}) == 5 and len(own.chunks) == 3


def test_slots_hand_out_the_same_again():
    own = ArraySlots(wp.get_device("cpu"), wp.float64)
    own.reserve((30, 5))
    first = own.take(wp.vec3d, (4,))
    plain = own.plain.take(wp.float64, (5,))
    other = own.take(wp.vec3d, (2, 3))
    assert own.used == (30, 5) and own.bytes == 8 * 65 and len(own.chunks) == 1 and other.shape == (2, 3)
    own.rewind()
    assert own.take(wp.vec3d, (4,)).ptr == first.ptr and own.plain.take(wp.float64, (5,)).ptr == plain.ptr
    assert own.take(wp.vec3d, (6,)).grad is not None and first.grad is not None and plain.grad is None


def test_everything_is_kept_where_a_quarter_of_what_is_free_on_a_gpu_holds_it():
    """A host shares its memory with others: 1 GiB there."""
    rows = [(8 << 20, "cuda:0", True), (8 << 20, "cpu", False), (1 << 10, "cpu", True), (1 << 28, "cuda:0", False)]
    for each, where, whole in rows:
        assert (CheckpointCosts(10, 100, each, 0.0, 1000, 0, 64 << 30, where).choose("auto") == 0) is whole
