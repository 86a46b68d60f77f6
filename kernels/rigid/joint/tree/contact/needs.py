"""What the substeps of touching trees of a scene need beyond contacts: the rest is not compiled."""

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class TreeContactNeeds:
    """moving: what some trees hang from moves; bouncing: something has restitution; exact: sweeps end at a residual; sleeping:
    trees may sleep; soft: contacts are MuJoCo's (soft_model.py); pushed: points or strands push links, which keep momentum
    with them (balance.py); breaking: joints may break (../substep/breaks.py)."""

    moving: bool = False
    bouncing: bool = False
    exact: bool = False
    sleeping: bool = False
    soft: bool = False
    pushed: bool = False
    breaking: bool = False

    @property
    def key(self) -> tuple[bool, ...]:
        return astuple(self)
