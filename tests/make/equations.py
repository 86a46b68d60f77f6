"""Equations of every constraint kind: those of the table, which tests of formulas and of kernels made of them run over."""

from wsim.physics.cloth.kind import TABLE, row

EQUATIONS = {name: row(name).equation for name in TABLE}
