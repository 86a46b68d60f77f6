"""Costs that methods state of themselves: data of a row of `wsim.scene.methods.METHODS`."""

from dataclasses import dataclass
from importlib import import_module


@dataclass(frozen=True, eq=False)
class MethodCost:
    """Seconds of what a method does in a frame, by name, on a GPU and on a CPU; of things without it each counts as a body.

    count   "module:function": how often a frame does each. Where the row owns things, of (scene, substeps, whether on a GPU)
            and one world; where it is a solver, of (model, `wsim.simulation.choice.SchemeChoice`)
    """

    cuda: dict[str, float]
    cpu: dict[str, float]
    count: str = ""

    def counts(self, *given) -> dict[str, float]:
        """How often a frame does what it costs, by name."""
        module, _, function = self.count.partition(":")
        return getattr(import_module(module), function)(*given)
