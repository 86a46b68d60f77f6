"""Launches of a stretch of substeps, each into arrays of its own, and their adjoints in reverse.

A method launches as ever, on the arrays of its state. While a tape records, what a launch writes goes into a new version of the
array, and what it reads comes from the latest: Warp's adjoints then find every value that a nonlinear operation has read (an
array written in place gives wrong gradients without a word). Arrays in structs are read so too; written are only arguments. A
version that nobody has read yet may be written once more: the adjoint of a write takes its gradient away. Kernels that write
a part of an array after others have read it start from a copy, but for those marked `whole` (kernels/math/marks.py).

    roots     arrays that a method writes; a stretch begins with a copy (`Tape.entries`) and leaves the latest (`Tape.ends`)
    slots     memory of the versions and of their gradients, in order; stretches share it unless all of them are kept

Integers are flags and lists, quaternions start an iteration (kernels/math/rotation.py): neither has a gradient, both stay in
place.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import warp as wp

from wsim.kernels.solver import newton_adjoint
from wsim.model import kernel_cache
from wsim.model.arena import ArraySlots
from wsim.model.compiler import recorded
from wsim.model.structs import fill_struct, struct_values

KEPT = (wp.int32, wp.quatf, wp.quatd, wp.vec2i, wp.vec4i, wp.uint64)      # flags, lists, starts of iterations


@dataclass
class RecordedArray:
    """An array that changes. base: where the method has it; carried: the gradient of its value between two stretches; plain: it
    has none."""

    base: wp.array
    carried: wp.array
    plain: bool = False
    latest: wp.array | None = None
    work: wp.array | None = None       # where what was done in place is undone
    fresh: bool = False                # nobody has read `latest` yet
    written: bool = False


def add_and_clear_gradient(grad: wp.array, into: wp.array) -> None:
    """Adds a gradient to another and clears it."""
    wp.launch(newton_adjoint.gradient_transfer_kernel(grad.dtype), grad.size, [grad], [into], device=grad.device)


def _view_of_version(version: wp.array, root: wp.array, view: wp.array) -> wp.array:
    """What `view` is of `root`, of another version of it."""
    if view.ptr == root.ptr and view.shape == root.shape:
        return version
    assert version.ptr is not None and view.ptr is not None and root.ptr is not None

    def same_view_of(array: wp.array) -> wp.array:
        return wp.array(ptr=array.ptr + (view.ptr - root.ptr), dtype=view.dtype, shape=view.shape, strides=view.strides,
                        device=view.device, requires_grad=False)
    found = same_view_of(version)
    found.grad = same_view_of(version.grad)
    return found


@dataclass
class Tape:
    """Records the launches of one stretch. `roots` are shared by the stretches of a recording."""

    slots: ArraySlots
    roots: list[RecordedArray]
    plain: set[int] = field(default_factory=set)                            # addresses, see `wsim.model.model`
    vjp: dict = field(default_factory=dict)                                 # see `wsim.model.vjp`
    steps: list[Callable[[], None]] = field(default_factory=list)           # what was launched, in order
    adjoints: list[Callable[[], None]] = field(default_factory=list)        # their adjoints, in the same order
    entries: list[tuple[RecordedArray, wp.array]] = field(default_factory=list)
    ends: list[tuple[RecordedArray, wp.array]] = field(default_factory=list)
    within_of: dict[int, int] = field(default_factory=dict)                 # launches in place of a version, by its address
    puts: dict[str, Callable[[], None]] = field(default_factory=dict)       # what wrote constants last, by its owner
    first: tuple[int, int] = (0, 0)
    end: tuple[int, int] = (0, 0)
    eager: bool = False                                                     # a step of the host is among them
    host: list[dict] = field(default_factory=list)                          # what steps of the host keep for their adjoints

    # while a method launches

    def begin(self) -> None:
        for root in self.roots:
            root.latest = None
            root.fresh = root.written = False
        self.first = self.slots.at

    def launch(self, kernel, dim: int, inputs: list, outputs: list, **how) -> None:
        """Launches a kernel, each output into a version of its own. Raises ValueError for a kernel without an adjoint."""
        backward = self.vjp[kernel](inputs) if kernel in self.vjp else None
        read = [self.read(a) for a in inputs]
        wrote = [self.write(a, getattr(kernel, "whole", False)) for a in outputs]
        self.do(lambda: recorded.launch(kernel, dim, read, wrote, **how))
        if backward:
            self.adjoints.append(partial(backward, read, wrote))
        elif any(isinstance(a, wp.array) and a.grad is not None for a in wrote):
            if not kernel.options.get("enable_backward"):
                raise ValueError(f"kernel {kernel.key} has no adjoint")
            there, back = [adjoint_of(a) for a in read], [adjoint_of(a) for a in wrote]
            self.adjoints.append(lambda: recorded.launch(kernel, dim, read, wrote, adj_inputs=there, adj_outputs=back,
                                                         adjoint=True, **how))

    def copy(self, into: wp.array, source: wp.array, into_first: int = 0, first: int = 0, count: int = 0) -> None:
        """Copies vectors, as `wp.copy` does."""
        count = count or source.size - first
        there, back = self.read(source[first:first + count]), self.write(into[into_first:into_first + count], True)
        self.do(lambda: wp.copy(back, without_gradient(there)))  # with gradients a copy would take those along
        self.hand(back.grad, there.grad)

    def within(self, array: wp.array, forward: Callable, backward: Callable) -> None:
        """Launches that change a version in place and can be undone: forward(version); backward(work, grad) finds in `work`
        what they left, and leaves there what they found."""
        root = self.root_of(array, True)
        assert root is not None
        self.write(root.base, False)
        version, before = root.latest, self.within_of
        assert version is not None and version.ptr is not None
        number = before[version.ptr] = before.get(version.ptr, 0) + 1
        if root.work is None:
            root.work = wp.empty_like(root.base, requires_grad=False)
        work = root.work
        self.do(lambda: forward(version))

        def undo_launch_in_place() -> None:
            if before[version.ptr] == number:            # the last of them is the first to be undone
                wp.copy(work, without_gradient(version))
            backward(work, version.grad)
        self.adjoints.append(undo_launch_in_place)

    def put(self, owner: str, put: Callable[[], None], take: Callable[[], None]) -> None:
        """Launches that write arrays in structs, all of them anew: constants until the next time. take: their adjoint. Going
        back, adjoints of what has read them find the values that it read."""
        before = self.puts.get(owner)
        self.puts[owner] = put
        self.do(put)

        def undo_constants() -> None:
            take()
            if before:
                before()
        self.adjoints.append(undo_constants)

    def zero(self, array: wp.array) -> None:
        """Sets an array to zero, as `array.zero_()` does."""
        version = self.write(array, True)
        self.do(lambda: version.zero_())
        self.adjoints.append(lambda: version.grad.zero_())

    def solve(self, solver, clock) -> None:
        """The implicit solve of a substep (`wsim.physics.solver.newton_adjoint`), with its own adjoint; what it launches is not
        recorded."""
        s, anchor, model, now = solver.assembly.state, solver.assembly.points.anchor, solver.model, replace(clock)
        a, x, b, contacts = self.read(anchor), self.read(s.x), self.read(s.d), solver.contacts
        shapes = [(p, self.read(p.F)) for p in solver.plastic]
        self.write(s.d, True)
        d = self.read(s.d)                                             # it is kept for the adjoint
        if contacts:
            pushes, ready = contacts.contacts.push, contacts.contacts.adjoint.reader()
            self.write(pushes, True)
            push = self.read(pushes)                                   # so is this

        def replay_implicit_solve() -> None:
            before, model.tape = model.tape, None
            for base, version in ((anchor, a), (s.x, x), (s.d, b)):
                wp.copy(base, version)
            for p, F in shapes:
                wp.copy(p.F, without_gradient(F))
                p.shape_from_flow(F)
            solver.solve(now)
            wp.copy(d, s.d)
            if contacts:
                wp.copy(push, pushes)
            model.tape = before
        self.do(replay_implicit_solve)

        def adjoint_of_implicit_solve() -> None:
            for p, F in shapes:
                p.shape_from_flow(F)
            if contacts:
                ready()
                contacts.by_push = push.grad
                wp.copy(contacts.found, without_gradient(push))
            solver.back(now, d, b, x, a)
            for p, F in shapes:
                p.adjoint.shape(F)
        self.adjoints.append(adjoint_of_implicit_solve)

    def do(self, step: Callable[[], None]) -> None:
        step()
        self.steps.append(step)

    def hand(self, grad: wp.array, into: wp.array) -> None:
        """Adjoint of a copy."""
        # a capture cannot
        kernel_cache.load_kernel_module(newton_adjoint.gradient_transfer_kernel(grad.dtype).module, grad.device)
        self.adjoints.append(lambda: add_and_clear_gradient(grad, into))

    def root_of(self, array: wp.array, wanted: bool) -> RecordedArray | None:
        for root in self.roots:
            if root.base.ptr <= array.ptr < root.base.ptr + max(root.base.capacity, 1):
                return root
        if not wanted:
            return None
        self.roots.append(RecordedArray(array, wp.zeros_like(array, requires_grad=False), array.ptr in self.plain))
        return self.roots[-1]

    def version(self, root: RecordedArray) -> wp.array:
        return (self.slots.plain if root.plain else self.slots).take(root.base.dtype, root.base.shape)

    def read(self, a: Any) -> Any:
        """The latest version of an argument, or a struct of those of its arrays."""
        if hasattr(a, "_cls"):
            return self.together(a)
        root = self.root_of(a, False) if _is_differentiable(a) else None
        if root is None:
            return a
        if root.latest is None:
            root.latest = self.version(root)
            self.do(partial(wp.copy, root.latest, root.base))
            self.entries.append((root, root.latest))
        root.fresh = False
        return _view_of_version(root.latest, root.base, a)

    def together(self, struct: Any) -> Any:
        """The latest versions of a struct's arrays; the struct itself where none has any."""
        before = struct_values(struct)
        read = {name: self.read(value) for name, value in before.items()}
        return struct if all(read[name] is before[name] for name in read) else fill_struct(struct._cls, **read)

    def write(self, a: Any, whole: bool) -> Any:
        """The version that a launch writes."""
        root = self.root_of(a, True) if _is_differentiable(a) else None
        if root is None:
            return a
        if not root.fresh:
            if not whole:
                self.read(root.base)
            before, root.latest = root.latest, self.version(root)
            if not whole:
                assert before is not None
                self.follow(before, root.latest)
        root.fresh = root.written = True
        assert root.latest is not None
        return _view_of_version(root.latest, root.base, a)

    def follow(self, before: wp.array, after: wp.array) -> None:
        self.do(lambda: wp.copy(after, without_gradient(before)))
        self.hand(after.grad, before.grad)

    def finish(self) -> None:
        """Puts what was written back to where the methods have it."""
        for root in self.roots:
            if root.written and root.latest is not None:
                self.ends.append((root, root.latest))
                self.do(partial(wp.copy, root.base, root.latest))
        self.end = self.slots.at
        for root in self.roots:
            kernel_cache.load_kernel_module(newton_adjoint.gradient_transfer_kernel(root.base.dtype).module, root.base.device)

    def forward(self) -> None:
        for step in self.steps:
            step()

    def backward(self) -> None:
        """Passes gradients of the values at the end to those at the start (`RecordedArray.carried`); adds to constants'."""
        self.slots.clear(self.first, self.end)
        for root, version in self.ends:
            if root.plain:
                continue
            wp.copy(version.grad, root.carried)
            root.carried.zero_()
        for put in self.puts.values():
            put()
        for step in reversed(self.adjoints):
            step()
        for root, version in self.entries:
            add_and_clear_gradient(version.grad, root.carried)


def _is_differentiable(a: Any) -> bool:
    """Whether an argument is an array of real numbers that may change. Quaternions only start an iteration."""
    return isinstance(a, wp.array) and a.ptr is not None and a.dtype not in KEPT


def without_gradient(a: wp.array) -> wp.array:
    """The same memory without a gradient."""
    return wp.array(ptr=a.ptr, dtype=a.dtype, shape=a.shape, strides=a.strides, device=a.device)


def adjoint_of(a: Any) -> Any:
    """Adjoint of an argument as Warp wants it: gradients of an array, or of those in a struct."""
    if isinstance(a, wp.array):
        return a.grad
    if not hasattr(a, "_cls"):
        return None
    return fill_struct(a._cls, **{name: v.grad if isinstance(v, wp.array) else v for name, v in struct_values(a).items()})
