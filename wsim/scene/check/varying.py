"""What can be wrong with a live value that varies in time. NumPy only."""

from collections.abc import Iterator
from math import isfinite

import numpy as np

from wsim.scene import Cloth, Collider, Problem, Scene, Soft, Springs, Varying
from wsim.scene.check.objects import error
from wsim.scene.fabric import Fabric
from wsim.scene.masses import density_of
from wsim.scene.solid import Bulk

RUBS = ("static_friction", "dynamic_friction")
LIVE: dict[type, tuple[str, ...]] = {                # of what may vary; the names are those of `Simulation.set`
    Scene: ("gravity", "wind", "air_drag"),
    Cloth: ("stretch", "weft", "shear", "bend", "poisson", "damping", "strain_limit", "density", *RUBS),
    Springs: ("stiffness", "damping", *RUBS),
    Soft: ("young", "poisson", "damping", "yield_strain", "density", "pressure", *RUBS),
    Collider: (*RUBS, "thickness", "restitution"),
}


def painted(cloth: Cloth, name: str) -> bool:
    """Whether the faces of a cloth have their own values of a stiffness, so that the material's does not count."""
    return (cloth.bends if name == "bend" else cloth.stretches if name in ("stretch", "shear", "weft") else None) is not None


def fixed(path: str, name: str, scene: Scene) -> str:
    """Why a value cannot vary while the scene runs, in words; "" where it can."""
    thing = _thing(path, scene)
    if thing is None:
        return "nothing of that path is simulated"
    if name not in LIVE[type(thing)]:
        return f"it is fixed while a scene runs (what may vary there: {', '.join(LIVE[type(thing)])})"
    if isinstance(thing, Scene):
        return _air(name, scene)
    if name in RUBS and not scene.colliders:
        return "there is no collider, so that friction does nothing"
    if isinstance(thing, Collider):
        return "no collider throws back at the start" if name == "restitution" and not any(
            c.restitution for c in scene.colliders) else ""
    if name == "density" and (density_of(thing) is None or scene.ties):
        return "the masses do not follow it: they are authored, or materials differ, or points are shared"
    if isinstance(thing, Cloth) and painted(thing, name):
        return "its faces have values of their own"
    material = getattr(thing, "material", thing)
    if name in ("damping", "pressure") and not getattr(thing if name == "pressure" else material, name):
        return "it is 0 at the start, so that nothing of it runs"
    if name in ("strain_limit", "yield_strain") and not isfinite(getattr(material, name)):
        return "it is infinite at the start, so that nothing of it runs"
    return _cloth(name, thing) if isinstance(thing, Cloth) else "it has more than one material" if isinstance(
        thing, Soft) and thing.others and name != "pressure" else ""


def _air(name: str, scene: Scene) -> str:
    blown = any(c.drag or c.lift for c in scene.cloths)
    return "" if name != "wind" or blown else "no cloth has drag or lift (wsim:drag, wsim:lift), so that wind does nothing"


def _cloth(name: str, cloth: Cloth) -> str:
    springs = cloth.model == "springs"
    if springs and name in ("weft", "poisson"):
        return "the model 'springs' has none"
    if springs and name == "shear" and not (cloth.material.shear > 0.0 and (cloth.counts > 3).any()):
        return "the model 'springs' has shear in quads alone, and where it is not 0 at the start"
    return "it is 0 at the start, so that nothing bends against it" if name == "bend" and cloth.material.bend == 0.0 else ""


def varying(thing: Varying, scene: Scene) -> Iterator[Problem]:
    """Everything found."""
    if reason := fixed(thing.path, thing.name, scene):
        yield error(thing.path, f"{thing.name} varies in time, and {reason}", "a value that is live", "author one value")
        return
    values, owner = np.asarray(thing.curve.values), _thing(thing.path, scene)
    shape = {"gravity": (3,), "wind": (3,)}.get(thing.name, ())
    if thing.name == "stiffness" and isinstance(owner, Springs):
        shape = values.shape[1:] if values.shape[1:] in ((1,), (len(owner.edges),)) else shape
    if values.shape[1:] != shape or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        yield error(thing.path, f"{thing.name} has keys of shape {values.shape[1:]}"
                    + ("" if values.dtype.kind in "fiu" and np.isfinite(values).all() else " that are not all finite"),
                    f"finite numbers of shape {shape}", "author its samples again")
    elif not np.isfinite(thing.curve.times).all():
        yield error(thing.path, f"{thing.name} has times that are not finite", "finite ones", "author its samples again")
    elif wrong := _out_of_range(thing.name, values, owner):
        yield error(thing.path, wrong, "that range at every key", "author that sample again")


def unfit(scene: Scene, what: str, path: str) -> list[Problem]:
    """Why a parameter of a fit, of one object or of all (""), cannot be one number."""
    names = {"stretch": ("stretch", "weft"), "stretch_warp": ("stretch",), "stretch_weft": ("weft",)}.get(what, (what,))
    return [Problem(v.path, f"{v.name} varies in time, and a fit finds one value; author one value, or leave {what} out")
            for v in scene.varying if v.name in names and path in ("", v.path)]


def _out_of_range(name: str, values: np.ndarray, owner) -> str:
    """Of which key, and what is allowed; ""."""
    kind = {Cloth: Fabric, Soft: Bulk}.get(type(owner))
    for value in values.reshape(len(values), -1):
        try:
            if kind and name != "pressure":
                kind(**{name: float(value[0])})
            elif name not in ("gravity", "wind", "pressure") and (value < 0.0).any():
                return f"{name} is {value.min():g}; allowed is >= 0"
            elif (name, float(value.max()) > 1.0) == ("restitution", True) or name == "stiffness" and not (value > 0.0).all():
                return f"{name} is {value.max():g}; allowed is {'0 to 1' if name == 'restitution' else '> 0'}"
        except ValueError as wrong:
            return str(wrong)
    return ""


def _thing(path: str, scene: Scene) -> Scene | Cloth | Springs | Soft | Collider | None:
    return scene if path == "/" else next((t for t in (*scene.bodies(), *scene.colliders) if t.path == path), None)
