"""Sweeps: one scene in many variations, a row of a table for each run, here or on many machines.

`wsim.sweep(scene, vary, folder)` is `wsim.sweep.sweep.sweep`: the package may be called, whichever of its modules was imported
first. wsim/docs/sweeps.md shows how it is used.
"""

import sys
from types import ModuleType


class _CallableModule(ModuleType):
    """A package that stands for the function of its name."""

    def __call__(self, *args, **more):
        from wsim.sweep.sweep import sweep
        return sweep(*args, **more)


sys.modules[__name__].__class__ = _CallableModule
