"""Stages <-> scenes. `load` and `save` go through the table of `wsim.usd.names`; no Warp is needed."""

from wsim.usd.load import load, read_stage
from wsim.usd.save import save
from wsim.usd.stage import open_stage

__all__ = ["load", "open_stage", "read_stage", "save"]
