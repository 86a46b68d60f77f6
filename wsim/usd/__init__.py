"""Stages <-> scenes. `load` and `save` go through the table of `wsim.usd.names`, without Warp. What writes is imported when
first used."""

from wsim.usd.load import load, read_stage
from wsim.usd.stage import open_stage

TYPE_CHECKING = False            # as typing's, without importing typing
if TYPE_CHECKING:
    from wsim.usd.write import save

__all__ = ["load", "open_stage", "read_stage", "save"]


def __getattr__(name: str):
    if name != "save":
        raise AttributeError(f"module 'wsim.usd' has no attribute '{name}'; its names: {', '.join(__all__)}")
    from wsim.usd.write import save
    globals()["save"] = save
    return save
