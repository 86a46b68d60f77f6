"""Instances of `wp.struct`: groups of arrays and numbers that a launch takes as one argument."""

from typing import Any


def fill_struct(Struct: Any, **values: Any) -> Any:
    """A struct with these values; its other arrays are empty, its other numbers 0."""
    found = Struct()
    for name, value in values.items():
        setattr(found, name, value)
    return found


class PlacedStruct:
    """A struct that kernels read from an array of one on the device, `at`. What its arrays hold may grow: others take their
    place there (`put`), and graphs that hold launches of the kernels stay valid."""

    def __init__(self, Struct: Any, device: Any):
        import warp as wp
        self.struct, self.at = Struct(), wp.zeros(1, dtype=Struct, device=device)

    def put(self, **values: Any) -> None:
        """Gives fields other values; not captured."""
        import warp as wp
        for name, value in values.items():
            setattr(self.struct, name, value)
        self.at.assign(wp.array([self.struct], dtype=self.at.dtype, device="cpu"))


def struct_values(struct: Any) -> dict[str, Any]:
    """Fields of a struct by name."""
    return {name: getattr(struct, name) for name in struct._cls.vars}


def struct_leaves(struct: Any) -> dict[str, tuple[Any, Any]]:
    """(type, value) of the arrays and numbers of a struct by name, "a.b" of those of a struct a within."""
    found = {}
    for name, var in struct._cls.vars.items():
        value = getattr(struct, name)
        if hasattr(value, "_cls"):
            found |= {f"{name}.{path}": leaf for path, leaf in struct_leaves(value).items()}
        else:
            found[name] = var.type, value
    return found
