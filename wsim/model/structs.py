"""Instances of `wp.struct`: groups of arrays and numbers that a launch takes as one argument."""

from typing import Any


def filled(Struct: Any, **values: Any) -> Any:
    """A struct with these values; its other arrays are empty, its other numbers 0."""
    found = Struct()
    for name, value in values.items():
        setattr(found, name, value)
    return found


def values(struct: Any) -> dict[str, Any]:
    """Fields of a struct by name."""
    return {name: getattr(struct, name) for name in struct._cls.vars}
