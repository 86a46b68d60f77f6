"""How the passes of rigid contact are launched, by a rule of sizes and devices (RULE), never by timing.

    listed      one thread, manifold by manifold, all substeps in a launch (CPU)
    coloured    one thread, colour by colour: the bits of the forms below (CPU, asked for by name)
    block       a block, colour by colour, whose threads meet after each; all substeps in a launch
    cluster     a cluster of blocks, as a block; beside joints both launch each pass, since one kernel took minutes to compile
    launches    a launch for each pass and colour
"""

from dataclasses import dataclass, field
from typing import Any

import warp as wp

from wsim.kernels.math import block
from wsim.kernels.rigid import launches, passes, soft_step
from wsim.kernels.rigid.graph import colours
from wsim.model.launches import has_large_clusters

RULE = 3                  # of `choose_pass_form`; a change of it changes which form a scene takes
THREADS = 256             # of a block, for which there are 255 registers each
SMALL = 256               # shapes up to which a block has a thread for each manifold of a colour
HUGE = 1536               # shapes from which one cluster is few (H200: 1000 in a pile 7.2 ms a frame against 8.8 by launches;
#                           before passes were joined, 3000 took 14.3 and 11.9, 10 000 in columns 5.1 and 3.8)
WALKERS = {True: 16384, False: 48}               # threads of a launch that walks up to a count: CUDA, CPU
PASSES = "prepare", "warm", "solve"              # as `contact_passes` of kernels/rigid/joint/passes.py numbers them
TITLES = {"listed": "one thread, manifold by manifold", "coloured": "one thread, colour by colour",
          "block": f"a block of {THREADS} threads, colour by colour", "cluster": "", "launches": "a launch for each colour"}


@dataclass
class ContactPassForm:
    """name: of the table above; blocks: of a cluster, else 1. Raises ValueError for another name."""

    name: str
    blocks: int = 1
    kernels: dict[str, Any] = field(default_factory=dict)
    kinds: list = field(default_factory=list)         # `wsim.kernels.rigid.kinds.ConstraintKind`, joints before contacts
    of: list = field(default_factory=list)            # kernels of each, of launches
    model: Any = None
    wide: bool = False                                # blocks of THREADS
    threads: int = 1                                  # that meet
    islands: int = 0                                  # of joints
    meet: Any = None                                  # function that they call
    tolerance: float = 0.0                            # [m/s] of the residual at which sweeps end; 0: their number is given
    module: str = ""                                  # of their kernels
    sizes: dict[str, int] = field(default_factory=dict)
    apart: bool = False                               # each pass beside joints is a launch, as always on a GPU

    def __post_init__(self):
        if self.name not in TITLES:
            raise ValueError(f"form is {self.name!r}; there are {', '.join(TITLES)}")

    @property
    def coloured(self) -> bool:
        return self.name != "listed"

    @property
    def what(self) -> str:
        found = TITLES[self.name] or f"a cluster of {self.blocks} blocks of {THREADS} threads, colour by colour"
        return found + f", until the residual is under {self.tolerance:g} m/s" * (self.tolerance > 0.0)

    def make(self, model, bouncing: bool, linked: int = 0) -> None:
        """Makes its kernels, in the model's modules; linked: number of islands of joints; if any, sweeps are counted."""
        real, self.model, self.islands = model.real, model, linked
        self.tolerance = 0.0 if linked else model.scene.contact_tolerance
        if self.tolerance > 0.0 and self.name == "launches":
            self.name = "cluster" if model.device.is_cuda else "coloured"     # a launch cannot ask whether another is needed
        self.prepare_threads(model)
        meet, sizes = self.meet, self.sizes
        of = self.coloured, self.tolerance > 0.0, bouncing, bool(linked), self.blocks
        self.module = module = model.shared_module("rigid_steps", *of, threads=THREADS * self.wide)
        self.kinds = [soft_step.contact_kind(real, self.coloured, self.tolerance > 0.0)]
        if self.coloured:
            own = model.shared_module("rigid_colours", self.blocks, threads=THREADS * self.wide)
            self.kernels["colours"] = colours.contact_colour_kernel(real, own, meet, **sizes)
        if self.tolerance > 0.0 and model.gradients:
            from wsim.kernels.rigid.complementarity.parts import converged_parts
            self.kernels["parts"] = converged_parts(self.kinds, real, module, meet, bouncing=bouncing, **sizes)
            return
        if self.tolerance > 0.0:
            from wsim.kernels.rigid.complementarity.converged import converged_step_kernel
            self.kernels["converged"] = converged_step_kernel(self.kinds, real, module, meet, bouncing=bouncing, **sizes)
            return
        if linked and bouncing:
            from wsim.kernels.rigid.joint.impacts import linked_thrown
            own = model.shared_module("rigid_impacts", *of, threads=THREADS * self.wide)
            self.kernels["thrown"] = linked_thrown(self.kinds, real, own, meet, **sizes)
        elif bouncing and self.name == "launches":
            self.kernels["thrown"] = launches.impact_kernel(self.kinds, real, module, meet, **sizes)
        if linked and (self.wide or self.apart or self.name == "launches"):
            from wsim.kernels.rigid.joint.passes import MODULES, contact_passes, joint_pass_kernels
            self.kernels |= joint_pass_kernels(real, *map(model.shared_module, MODULES))
            if self.name != "launches":
                self.kernels["contacts"] = contact_passes(self.kinds, real, module, meet, **sizes)
                return
        elif self.name == "launches":
            self.kernels |= dict(zip(("begun", "placed", "ended"), launches.body_pass_kernels(real, model.module), strict=True))
        if self.name != "launches":
            steps = passes.body_substep_kernel
            if linked:
                from wsim.kernels.rigid.joint.passes import linked_substep_kernel as steps
            self.kernels["substeps"] = steps(self.kinds, real, module, meet, bouncing=bouncing, **sizes)
            return
        rest = block.block_barrier if self.wide else block.no_barrier
        self.of = [launches.of_kind(kind, real, model.module, module, rest, sizes["threads"]) for kind in self.kinds]

    def prepare_threads(self, model) -> None:
        """Settles how many threads meet, and how."""
        self.model = model
        self.wide = self.name in ("block", "cluster") or (self.name == "launches" and model.device.is_cuda)
        self.threads = THREADS * self.blocks if self.wide else 1
        self.meet = block.cluster_barrier if self.blocks > 1 else block.block_barrier if self.wide else block.no_barrier
        self.sizes = {"threads": THREADS * self.wide, "cluster": self.blocks if self.blocks > 1 else 0}

    def sleep_form(self) -> "ContactPassForm":
        """The form of the kernels that settle what sleeps."""
        return self

    def parts(self, make, bouncing: bool, **more) -> Any:
        """Kernels of threads that meet of another cut of a substep (`wsim.kernels.rigid.touch.step`), in place of those of a
        whole one, which are not compiled then."""
        self.model.modules.pop(self.module, None)
        meet = block.cluster_barrier if self.blocks > 1 else block.block_barrier if self.wide else block.no_barrier
        what = make.__name__, self.coloured, self.tolerance > 0.0, bouncing, self.blocks, *sorted(more.items())
        module = self.model.shared_module("rigid_parts", *what, threads=THREADS * self.wide)
        return make(self.kinds, self.model.real, module, meet, threads=THREADS * self.wide,
                    cluster=self.blocks if self.blocks > 1 else 0, bouncing=bouncing, **more)

    def launch(self, kernel, inputs: list, outputs: list, blocks: int = 0) -> None:
        """Launches all threads that meet, or so many blocks of them."""
        if self.wide:
            self.model.launch_blocks(kernel, blocks or self.blocks, THREADS, inputs, outputs)
        else:
            self.model.launch(kernel, 1, inputs, outputs)

    def colour(self, rig, serial: wp.array) -> None:
        """Colours of the manifolds that there are; serial: a word, how many found none."""
        if self.coloured:
            self.launch(self.kernels["colours"], [self.threads, rig], [serial])

    def advance(self, steps: tuple[int, int, int], h: float, rig, *joints) -> None:
        """Substeps steps[0] .. steps[1] of h [s], of steps[2] sweeps; joints: their struct, where there are some. Manifolds are
        prepared, unless steps[0] is 0, where a frame begins. With both joints and impacts, one call is one substep."""
        if self.tolerance > 0.0:
            self.launch(self.kernels["converged"], [wp.vec3i(*steps), h, self.threads, self.tolerance, rig], [])
            return
        if "substeps" in self.kernels:
            if "thrown" in self.kernels:
                if steps[0] == 0:
                    self.launch(self.kernels["substeps"], [wp.vec3i(0, 0, steps[2]), h, self.threads, rig, *joints], [])
                self.launch(self.kernels["thrown"], [self.threads, steps[0], h, rig, *joints], [])
            self.launch(self.kernels["substeps"], [wp.vec3i(*steps), h, self.threads, rig, *joints], [])
            return
        if steps[0] == 0:
            self.walk("placed", 0, rig)
            self.link("lined", 0, rig, *joints)
            self.prepare(0, rig)
        for k in range(steps[0], steps[1]):
            if "thrown" in self.kernels:
                self.launch(self.kernels["thrown"], [self.threads, k, h, rig, *joints], [])
            self.walk("begun", h, rig, *joints)
            self.link("reset", k, h, rig, *joints)
            self.sweep("warm", k, h, 1, rig)
            self.link("joined", k, h, rig, *joints)
            for _sweep in range(steps[2]):
                self.sweep("solve", k, h, 1, rig)
                self.link("joined", k, h, rig, *joints)
            self.walk("ended", k, h, rig, *joints)
            self.link("lined", k + 1, rig, *joints)
            self.prepare(k + 1, rig)
            self.link("loosed", k, h, rig, *joints)
            self.sweep("solve", k, h, 0, rig)
            self.link("loosed", k, h, rig, *joints)

    def link(self, name: str, *given) -> None:
        """A pass of the islands of joints, a thread each."""
        if self.islands:
            self.model.launch(self.kernels[name], self.islands, [*given], [])

    @property
    def walker_threads(self) -> int:
        return WALKERS[self.model.device.is_cuda]

    def walk(self, name: str, *given) -> None:
        self.model.launch(self.kernels[name], self.walker_threads, [self.walker_threads, *given], [])

    def prepare(self, k: int, rig) -> None:
        if "contacts" in self.kernels:
            self.launch(self.kernels["contacts"], [PASSES.index("prepare"), self.threads, k, 0.0, 0, rig], [])
        for kernels in self.of:
            self.model.launch(kernels.prepare, self.walker_threads, [self.walker_threads, k, rig], [])

    def sweep(self, name: str, k: int, h: float, biased: int, rig) -> None:
        if "contacts" in self.kernels:
            self.launch(self.kernels["contacts"], [PASSES.index(name), self.threads, k, h, biased, rig], [])
        for kernels in self.of:
            for colour in range(launches.LAUNCHED):
                self.model.launch(getattr(kernels, name), self.walker_threads, [colour, self.walker_threads, k, h, biased, rig],
                                  [])
            self.launch(getattr(kernels, f"rest_{name}"), [self.threads // self.blocks, k, h, biased, rig], [], 1)

    def launches(self, steps: int, sweeps: int) -> int:
        """Number of launches of a frame of so many substeps."""
        thrown = "thrown" in self.kernels
        if "contacts" in self.kernels:
            return 3 + steps * (1 + thrown + 10 + 2 * sweeps)
        if self.name != "launches":
            return (1 + self.coloured + thrown) * steps + thrown
        kinds = len(self.of)
        more = bool(self.islands) * (1 + steps * (5 + sweeps))
        return more + 2 + kinds + steps * (3 + kinds + thrown + kinds * (sweeps + 2) * (launches.LAUNCHED + 1))


def choose_pass_form(device, shapes: int) -> ContactPassForm:
    """Form that the rule chooses."""
    if not device.is_cuda:
        return ContactPassForm("listed")
    if shapes > HUGE:
        return form_by_name("launches", device)
    return form_by_name("block" if shapes <= SMALL or device.arch < block.CLUSTERS else "cluster", device)


def form_by_name(name: str, device) -> ContactPassForm:
    """The form of a name with the blocks that a device has for it."""
    clusters = device.is_cuda and device.arch >= block.CLUSTERS and name in ("cluster", "launches")
    return ContactPassForm(name, (16 if has_large_clusters(device) else 8) if clusters else 1)
