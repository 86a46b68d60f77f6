"""Run time against error for one scene, and the settings that follow from it.

    from wsim.bench import bench
    print(bench(wsim.load("flag.usda")).text())
"""

from wsim.bench.report import Report
from wsim.bench.study import bench

__all__ = ["Report", "bench"]
