"""What tests/bench/test_bench.py shares with other tests: report, row."""

from wsim.bench import Report
from wsim.bench.front import MeasuredSetting
from wsim.bench.setting import Setting


def row(ms, largest, precision="float32", **more) -> MeasuredSetting:
    return MeasuredSetting(Setting("xpbd", "bdf2", max(1, round(ms)), 4, precision), ms, largest, largest, **more)


def report(rows, error=0.0, **more) -> Report:
    known = {"setting": "explicit rk4 64 x 1 float64", "error": error, "ratio": 16.0, "seconds": 1.0, "notes": []}
    return Report("a.usda", 16, 1.0, 24.0, 2, "cpu", "cpu", "CPU seconds of all threads", {"wsim": "1"}, known, [1.0, 2.0],
                  [1, 2], more.pop("refused", ""), rows, **more)
