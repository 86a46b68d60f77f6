"""Substeps of trees in reduced coordinates that points and strands push. Equations: kernels/rigid/joint/tree/contact/pushed.py,
link_star.py and link_rounds.py beside it."""

import warp as wp

from wsim.kernels.rigid.joint.tree.contact.link_rounds import link_round_kernel
from wsim.kernels.rigid.joint.tree.contact.link_star import link_recall_kernel, link_star_kernel
from wsim.model.stage import Clock
from wsim.physics.rigid.touch.worlds import WorldBlocks


class PushedTrees:
    """rigid: the method, whose joints are `wsim.physics.rigid.joints.trees.tables.DeviceTrees`, with its `contacts`."""

    def __init__(self, rigid):
        self.rigid, self.trees, self.form = rigid, rigid.joints, rigid.contacts.form

    def run(self, name: str, clock: Clock) -> None:
        own, kernel = self.rigid.contacts, getattr(self.form.kernels["pushed"], name)
        self.form.launch_teams(kernel, (clock.k, clock.k + 1, own.sweeps), clock.h, own.rig())

    def begin(self, clock: Clock) -> None:
        """Predictions, and momenta with which links go on."""
        self.rigid.contacts.work.strayed.zero_()
        self.run("begin", clock)

    def sweep(self, clock: Clock) -> None:
        """What others have changed of momenta, and sweeps."""
        self.run("sweep", clock)

    def end(self, clock: Clock) -> None:
        """Places and velocities."""
        self.run("end", clock)

    def make_stars(self, touch) -> "TreeStars":
        """What solves links and points. touch: `wsim.physics.rigid.touch.points.BodyPointContacts`."""
        return TreeStars(touch)


class TreeStars(WorldBlocks):
    """Links and points, a block of threads a world."""

    def make_rounds(self, form) -> None:
        """Their kernels."""
        real, self.trees = self.touch.real, self.touch.trees.trees
        moves = bool(self.trees.trees.moves)
        own = self.model.shared_module("link_rounds", moves, *["rolling"] * self.touch.rolling,
                                       threads=self.threads if self.model.device.is_cuda else 0)
        self.rounds_kernel = link_round_kernel(real, self.threads, own, moves, self.touch.rolling)
        module = self.trees._tree_module("link_stars", moves)
        self.kernel, self.recall_kernel = (make(real, module, moves) for make in (link_star_kernel, link_recall_kernel))

    @property
    def launches(self) -> tuple[int, int]:
        return 1 + (self.model.worlds > 1), 2 * self.touch.rounds

    def solve_stars(self, given: float, k: float, g: float) -> None:
        """V of bodies."""
        t = self.touch
        self.trees.launch_trees(self.kernel, [t.rows, t.found, wp.vec3d(k, g, given), self.trees.trees], [t.V, t.left])

    def recall(self, J: wp.array, M: wp.array) -> None:
        """V of the impulses of the substep before."""
        t = self.touch
        self.trees.launch_trees(self.recall_kernel, [t.rows, t.found, J, M, self.trees.trees], [t.V])

    def solve(self, clock: Clock) -> None:
        """All rounds of an iteration, with sweeps behind each."""
        t = self.touch
        for k in range(t.rounds):
            given = [t.contacts.table, t.contacts.points, t.contacts.slots, t.points(clock), self.table, int(k == 0),
                     t.rigid.contacts.rig(), self.trees.trees]
            t.blocks(self.rounds_kernel, given, [], self.model.worlds, self.threads)
            t.sweep(clock)
