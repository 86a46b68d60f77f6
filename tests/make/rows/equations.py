"""Equations of every kind of constraint, which tests of formulas and of the kernels made of them run over: those of the table,
and one that is a file of tests (tests/make/rows/area.py)."""

from tests.make.rows.area import KIND
from wsim.physics.cloth.kind import TABLE, kind_row

EQUATIONS = {name: kind_row(name).equation for name in TABLE} | {KIND.name: KIND.equation}
