"""The tool of tools/stress/fluid: some rows, and a judge that can fail."""

from dataclasses import replace

import pytest

from tools.stress.fluid.__main__ import case, line
from tools.stress.fluid.rows import ROWS

HERE = [("smoke at CFL 20", "reflection/direct"), ("piston without outlet", "linear/multigrid"), ("dam, dt 1", "apic")]


@pytest.mark.parametrize(("name", "scheme"), HERE)
def test_rows_hold(name, scheme):
    row = next(r for r in ROWS if r.name == name)
    assert scheme in row.schemes
    record = case(row, scheme, "cpu")
    assert record.verdict.startswith("held") and "FAILS" not in line(record) and record.frames >= 8


def test_what_gains_energy_or_smoke_fails():
    row = next(r for r in ROWS if r.name == "dam, dt 1")
    assert "FAILS: energy of" in line(case(replace(row, gives=0.0), "apic", "cpu"))
    row = next(r for r in ROWS if r.name == "piston without outlet")
    assert "FAILS: smoke of 0 to 1" in line(case(replace(row, smoke=0.5), "linear/multigrid", "cpu"))
