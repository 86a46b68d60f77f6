"""What the substeps of touching trees of a scene need beyond contacts: the rest is not compiled."""

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class TreeContactNeeds:
    """moving: what some trees hang from moves; bouncing: something has restitution; exact: sweeps end at a residual; sleeping:
    trees may sleep; soft: contacts are MuJoCo's (soft_model.py); pushed: points or strands push links, which keep momentum
    with them (balance.py); breaking: joints may break (../substep/breaks.py); strings: some distances stay within a range
    (../loops/strings.py)."""

    moving: bool = False
    bouncing: bool = False
    exact: bool = False
    sleeping: bool = False
    soft: bool = False
    pushed: bool = False
    breaking: bool = False
    strings: bool = False

    @property
    def key(self) -> tuple[bool, ...]:
        return astuple(self)

    @property
    def of_step(self) -> tuple[bool, bool, bool]:
        """What a step of a tree needs (../steps.py)."""
        return self.moving, self.breaking, self.strings
