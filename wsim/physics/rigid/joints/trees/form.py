"""How substeps of touching trees are launched: a thread for each world (kernels/rigid/joint/tree/touching.py)."""

import warp as wp

from wsim.kernels.rigid.joint.tree.touching import touching_tree_kernel
from wsim.physics.rigid.forms import ContactPassForm


class TreeContactForm(ContactPassForm):
    """The form of the contacts of `wsim.physics.rigid.joints.trees.tables.DeviceTrees`."""

    def __init__(self, trees):
        super().__init__("listed")
        self.trees = trees

    @property
    def what(self) -> str:
        return "reduced coordinates, a thread for each world"

    def make(self, model, bouncing: bool, linked: int = 0) -> None:
        self.model, self.islands = model, linked
        module = model.shared_module("rigid_touching_trees")
        self.kernels["trees"] = touching_tree_kernel(model.real, module)

    def advance(self, steps: tuple[int, int, int], h: float, rig, *joints) -> None:
        rig.work.strayed.zero_()
        trees = self.trees
        self.model.launch(self.kernels["trees"], self.model.worlds,
                          [wp.vec3i(*steps), h, rig, trees.linked, trees.trees, trees.scratch], [])

    def launches(self, steps: int, sweeps: int) -> int:
        return 2 * steps
