"""Pairs of features in contact, on a device: one list with keys, their order, colours and the exchange of impulses.

    pairs = Pairs(model, status, [(a, b), ...])        a, b: carriers (wsim/physics/carrier/carriers.py)
    in phase collide      pairs.begin()                a search of one's own then appends to pairs.found
                                                       (`wsim.kernels.carrier.pairs.appending`)
                          pairs.order(clock)           by keys, then by colours
    in each iteration     pairs.project(clock)         one sweep
    after the last        pairs.settle(clock)          velocities
    after the frame       pairs.retry(status)          room for what was wanted: the frame is repeated, nothing is dropped

All of it launches and may be captured. With `warm`, pairs begin a substep with the impulse that the pair of the same keys ended
the last one with (kernels/carrier/warm.py); that list is a part of the state, so that a repeated frame has it as it was. It
belongs to no prim: a restart begins without.
"""

from collections.abc import Callable
from functools import partial

import warp as wp

from wsim.kernels.carrier import colour, exchange
from wsim.kernels.carrier import pairs as kernels
from wsim.kernels.math.real import types
from wsim.model.stage import Clock, Remedy, Stage
from wsim.model.state import State
from wsim.model.status import Status
from wsim.model.structs import filled
from wsim.physics.carrier.carriers import Carrier

COLOURS = 32           # at most 62; a launch each for every combination and sweep
ROUNDS = 8             # sweeps of a substep where no iterations are
THREADS = 65_536       # that walk a group on a GPU: pairs of a group in a round
RECOVERY = 0.5         # [m/s] at which features leave an overlap, as wsim.physics.contact.contacts.RECOVERY
SLOW = 0.05            # [m/s] of approach below which pairs do not throw back: what gravity adds in a substep of 5 ms
COLUMNS = {"kind": int, "sticks": int, "key_a": wp.int64, "key_b": wp.int64, "id_a": wp.vec4i, "id_b": wp.vec4i}
REALS = {"at_a": "vec3", "at_b": "vec3", "n": "vec3", "gap": "scalar", "friction": "vec2", "bounce": "vec2",
         "push": "vec3", "aim": "vec3", "left": "scalar", "total": "vec3"}
class Pairs:
    """found: what a search appends to; list: in order. combinations: two carriers for each `kind` of pair."""

    def __init__(self, model, status: Status, combinations: list[tuple[Carrier, Carrier]], *, name: str = "pairs",
                 capacity: int = 1024, colours: int = COLOURS, sweeps: int = 4, warm: State | None = None):
        """name: of this list among those of a plan. sweeps: of `settle`. warm: the state that the last list is kept in."""
        self.model, self.real, self.device = model, model.real, model.device
        self.combinations, self.colours, self.sweeps, self.word = combinations, colours, sweeps, f"{name}: pairs wanted"
        self.status = status
        status.reserve(self.word)
        every: dict[int, Carrier] = {id(c): c for both in combinations for c in both}
        self.bases, count = {}, 0
        for number, carrier in every.items():
            self.bases[number], count = count, count + carrier.vertices
        self.vertices, self.last = max(count, 1), None
        self._kernels()
        if warm is not None:
            from wsim.physics.carrier.warm import Warm
            self.last = Warm(self, warm, name, capacity)
        self.room(capacity)

    def _kernels(self) -> None:
        real, module = self.real, self.model.module
        each = [(a.formulas, b.formulas) for a, b in self.combinations]
        self.project_kernels, self.aim_kernels, self.settle_kernels, self.remember_kernels, self.vertex_kernels = (
            [make(*both, real, module) for both in each]
            for make in (exchange.project, exchange.aim, exchange.settle, exchange.remember, colour.vertices))
        self.tally, self.rank, self.permute = kernels.tally(module), kernels.rank(module), kernels.permute(real, module)
        self.claim, self.pick, self.proceed = colour.claim(module), colour.pick(module), colour.proceed(module)
        self.number, self.bounds = colour.number(module), colour.bounds(module)

    @property
    def groups(self) -> int:
        return (self.colours + 1) * len(self.combinations)

    def room(self, capacity: int) -> None:
        """Arrays for so many pairs; what was in them is lost."""
        t, device = types(self.real), self.device
        array = partial(wp.zeros, device=device)
        self.capacity = capacity
        self.found, self.list = (filled(
            kernels.lists(self.real), capacity=capacity, recovery=RECOVERY, slow=SLOW, count=array(1, dtype=int),
            **{name: array(capacity, dtype=dtype) for name, dtype in COLUMNS.items()},
            **{name: array(capacity, dtype=getattr(t, dtype)) for name, dtype in REALS.items()}) for _ in range(2))
        self.list.first, self.list.order = array(self.groups + 1, dtype=int), array(2 * capacity, dtype=int)
        self.keys, self.rows = array(2 * capacity, dtype=wp.int64), array(2 * capacity, dtype=int)
        self.numbers = array(2 * capacity, dtype=int)
        self.coloring = filled(
            colour.sides(), a=array(capacity, dtype=wp.vec4i), b=array(capacity, dtype=wp.vec4i),
            claim=array(self.vertices, dtype=wp.uint32), taken=array(self.vertices, dtype=wp.int64),
            colour=array(capacity, dtype=int), left=array(1, dtype=int), going=array(1, dtype=int))
        self.sort(self.keys, self.rows)                  # takes the memory of a sort, which a capture cannot
        self.sort(self.numbers, self.list.order)

    def sort(self, keys: wp.array, rows: wp.array) -> None:
        wp.utils.radix_sort_pairs(keys, rows, self.capacity)

    def launch(self, kernel, dim: int, inputs: list, outputs: list) -> None:
        self.model.launch(kernel, dim, inputs, outputs)

    def sides(self, clock: Clock, which: int) -> tuple[list, list]:
        """Data and Pushed of the two carriers of a combination."""
        each = [c.at(clock, self.bases[id(c)]) for c in self.combinations[which]]
        return [data for data, _ in each], [pushed for _, pushed in each]

    def stages(self, search: Callable[[Clock], None], within: bool) -> list[Stage]:
        """Stages of a method that has these pairs. search: launches what appends to `found`. within: a sweep in each iteration
        of the other constraints (XPBD); else ROUNDS behind them, which is how impulses meet forces that were solved for."""
        kinds, rounds = len(self.combinations), 1 if within else ROUNDS

        def find(clock: Clock) -> None:
            self.begin()
            search(clock)
            self.order(clock)

        def sweep(clock: Clock) -> None:
            for _ in range(rounds):
                self.project(clock)
        what = f"{' and '.join(f'{a.formulas.__name__} with {b.formulas.__name__}' for a, b in self.combinations)}"
        return [Stage("find pairs", "collide", find, 12 + kinds, self.capacity * 120, what=what),
                Stage("pairs", "solve", sweep, rounds * self.groups, self.capacity * 120,
                      "iteration" if within else "substep", f"room for {self.capacity} in {self.colours} colours"),
                Stage("pairs: velocities", "solve", self.settle, (2 + self.sweeps) * self.groups, self.capacity * 120,
                      what="those that push")]

    # phase collide

    def begin(self) -> None:
        """The list of the search is empty."""
        self.found.count.zero_()

    def order(self, clock: Clock) -> None:
        """Orders what was found into groups."""
        found, pairs, room = self.found, self.list, self.capacity
        found.h = pairs.h = clock.h
        self.launch(self.tally, 1, [room], [found.count, self.status.word(self.word)])
        for again, keys in enumerate((found.key_b, found.key_a)):
            self.launch(self.rank, room, [found.count, keys, again], [self.keys, self.rows])
            self.sort(self.keys, self.rows)
        self.launch(self.permute, room, [found, self.rows], [pairs])
        self.color(clock)
        if self.last:
            self.last.recall(clock)

    def color(self, clock: Clock) -> None:
        c, pairs, room = self.coloring, self.list, self.capacity
        for kind, kernel in enumerate(self.vertex_kernels):
            data, _ = self.sides(clock, kind)
            self.launch(kernel, room, [pairs, kind, *data], [c])
        c.claim.fill_(int(colour.FREE))
        c.taken.zero_()
        c.going.fill_(1)

        def some() -> None:
            self.launch(self.claim, room, [pairs.count], [c])
            self.launch(self.pick, room, [pairs.count, self.colours], [c])
            self.launch(self.proceed, 1, [], [c])
        wp.capture_while(c.going, some)
        self.launch(self.number, room, [pairs.count, c.colour, pairs.kind, len(self.combinations), self.groups],
                    [self.numbers, pairs.order])
        self.sort(self.numbers, pairs.order)
        self.launch(self.bounds, self.groups + 1, [self.numbers, room], [pairs.first])

    # phase solve

    def walk(self, clock: Clock, kernels_: list, *outputs, moves: bool = True) -> None:
        """Every group in turn: threads that walk it; the remainder, and all on a CPU, by one. moves: what pairs push."""
        pairs, combinations = self.list, len(self.combinations)
        pairs.h = clock.h
        sides = [self.sides(clock, kind) for kind in range(combinations)]
        for group in range(self.groups):
            data, pushed = sides[group % combinations]
            alone = self.device.is_cpu or group >= self.colours * combinations
            threads = 1 if alone else min(THREADS, self.capacity)
            self.launch(kernels_[group % combinations], threads, [*data, pairs, wp.vec2i(group, threads)],
                        [*(pushed if moves else []), *outputs])

    def project(self, clock: Clock) -> None:
        """One sweep."""
        self.walk(clock, self.project_kernels, self.list.push)

    def settle(self, clock: Clock) -> None:
        """Settles the pairs after the last sweep, and before velocities are made."""
        pairs = self.list
        self.walk(clock, self.aim_kernels, pairs.aim, pairs.sticks, pairs.total, pairs.left, moves=False)
        for _ in range(self.sweeps):
            self.walk(clock, self.settle_kernels, pairs.total)
        if any(c.remembers(clock) for both in self.combinations for c in both):
            self.walk(clock, self.remember_kernels)
        if self.last:
            self.last.keep()

    # around a frame

    def indicators(self) -> dict[str, float]:
        """pairs: in the last substep; pair_residual: the largest |min(C, lam n.Kn)| [m] that its sweeps left: a gap that is not
        kept, or an impulse across one."""
        count = int(self.list.count.numpy()[0])
        return {"pairs": count, "pair_residual": float(self.list.left.numpy()[:count].max(initial=0.0))}

    def retry(self, status: Status) -> list[Remedy]:
        wanted = int(status.said(self.word)[0])

        def grow() -> str:
            if wanted <= self.capacity:
                return ""
            before = self.capacity
            self.room(wanted + wanted // 4)
            if self.last:
                self.last.grow()
            return f"{wanted} pairs were in contact, and there was room for {before}"
        return [Remedy("grow", grow)] if wanted else []
