"""Gradients of recordings. What has some is one table (`wsim.scene.values.coverage`), which refusals and tests read; what is
not in it raises, and never gives a zero. In brackets stand the solvers by which a row is tested.
"""

from wsim.scene.values.coverage import coverage_text

__doc__ = f"{__doc__}\n{coverage_text()}\n"
