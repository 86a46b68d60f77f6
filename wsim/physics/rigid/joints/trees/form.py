"""How substeps of touching trees are launched (kernels/rigid/joint/tree/contact/touching.py).

A world has one team of threads, which takes manifolds as they are listed. On a GPU that is a warp; where there is one world
with more trees, its teams are the warps of a block, or of a cluster of blocks, and they take manifolds by their colours.
"""

import warp as wp

from wsim.kernels.math import block
from wsim.kernels.rigid.joint.tree.contact.touching import touching_tree_kernel
from wsim.kernels.rigid.joint.tree.lanes import LANES, tree_barrier
from wsim.physics.rigid import forms
from wsim.physics.rigid.joints.trees.contact_tables import tree_contact_needs


class TreeContactForm(forms.ContactPassForm):
    """The form of the contacts of `wsim.physics.rigid.joints.trees.tables.DeviceTrees`."""

    def __init__(self, trees):
        device, found = trees.model.device, forms.ContactPassForm("listed")
        if not device.is_cuda and forms.choose_pass_form(device, 0).coloured:
            found = forms.form_by_name("coloured", device)                     # the bits of a GPU's teams
        per_world = len(trees.links.first_link) - 1
        if device.is_cuda and trees.model.worlds == 1 and per_world > 1:
            few = per_world <= forms.THREADS // LANES
            found = forms.form_by_name("block" if few else "cluster", device)
        super().__init__(found.name, found.blocks)
        self.trees = trees
        self.team = LANES if device.is_cuda else 1

    @property
    def what(self) -> str:
        teams = f"{self.threads // self.team} teams for a world" if self.coloured else "a team for each world"
        return f"reduced coordinates, {teams}, of {self.team} threads each"

    def make(self, model, bouncing: bool, linked: int = 0) -> None:
        self.model, self.islands = model, linked
        self.wide = self.name in ("block", "cluster")
        self.threads = forms.THREADS * self.blocks if self.wide else self.team
        meet = tree_barrier if not self.wide else block.cluster_barrier if self.blocks > 1 else block.block_barrier
        sizes: dict = {"threads": forms.THREADS * self.wide, "cluster": self.blocks if self.blocks > 1 else 0}
        if self.coloured:
            from wsim.kernels.rigid.graph.colours import contact_colour_kernel
            own = model.shared_module("rigid_colours", self.blocks, threads=forms.THREADS * self.wide)
            self.kernels["colours"] = contact_colour_kernel(model.real, own, meet, **sizes)
        block_size = min(forms.THREADS, self.threads)
        needs = tree_contact_needs(self.trees)
        self.tolerance, make, name = model.scene.contact_tolerance, touching_tree_kernel, "trees"
        if self.trees.pushed:
            from wsim.kernels.rigid.joint.tree.contact.pushed import pushed_tree_kernels as make
            name = "pushed"
        if not self.wide:
            sizes = self.trees.launch_bounds
        kind = (self.blocks, self.coloured, *needs.key, "launch_bounds" in sizes)
        module = model.shared_module(f"rigid_touching_{name}", *kind, threads=block_size)
        self.kernels[name] = make(model.real, module, meet, self.coloured, needs, **sizes)

    def sleep_form(self) -> forms.ContactPassForm:
        device = self.model.device
        found = forms.form_by_name("block", device) if device.is_cuda else forms.ContactPassForm("listed")
        found.prepare_threads(self.model)
        return found

    def advance(self, steps: tuple[int, int, int], h: float, rig, *joints) -> None:
        rig.work.strayed.zero_()
        self.launch_teams(self.kernels["trees"], steps, h, rig)

    def launch_teams(self, kernel, steps: tuple[int, int, int], h: float, rig, *more) -> None:
        """Launches the teams of all worlds."""
        trees, model = self.trees, self.model
        given = [wp.vec3i(*steps), h, self.threads // self.team, rig, trees.linked, trees.trees, trees.scratch, *more]
        if self.team > 1:
            model.launch_blocks(kernel, model.worlds * self.blocks, self.threads // self.blocks, given, [])
        else:
            model.launch(kernel, model.worlds, given, [])

    def launches(self, steps: int, sweeps: int) -> int:
        return (2 + self.coloured) * steps
