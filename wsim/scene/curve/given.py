"""What a kind of curve is given beside its keys, completed and checked. NumPy only."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.scene.curve import easing as easing_of
from wsim.scene.curve import pieces, slopes

if TYPE_CHECKING:
    from wsim.scene.curve.curve import Curve

HANDLED = ("leave", "arrive", "form", "until")
KINDS: dict[str, tuple[str, ...]] = {
    "linear": (), "hold": (), "catmull_rom": ("alpha",), "kochanek_bartels": ("tension", "bias", "continuity"), "monotone": (),
    "hermite": HANDLED, "bezier": (*HANDLED, "leave_width", "arrive_width"), "eased": ("easing",)}
FORMS = ("curve", "linear", "hold")


def complete_curve_fields(curve: Curve) -> dict:
    """Fields that the kind is given (`how`), with what follows from the rest. Raises ValueError where something cannot be."""
    if curve.kind not in KINDS:
        raise ValueError(f"no kind of curve is called {curve.kind!r}; there are {', '.join(KINDS)}")
    if extra := [name for name in curve.how if name not in KINDS[curve.kind]]:
        raise ValueError(f"a curve of kind {curve.kind} has no {', '.join(extra)}; it takes "
                         f"{', '.join(KINDS[curve.kind]) or 'nothing'}")
    if not (np.isfinite(curve.times).all() and np.isfinite(curve.values).all()):
        raise ValueError("the keys of a curve must be finite numbers")
    for side in (curve.before, curve.after):
        curve.mode(side)
    return _fill_kind_fields(curve)


def _fill_kind_fields(curve: Curve) -> dict:
    how, n, kind = dict(curve.how), len(curve.times), curve.kind
    if kind == "eased":
        easing = how.setdefault("easing", "linear")
        one = isinstance(easing, str) or len(easing) == 4 and all(np.isscalar(v) and not isinstance(v, str) for v in easing)
        each = [easing] * (n - 1) if one else list(easing)
        if len(each) != n - 1:
            raise ValueError(f"{len(each)} easings for {n - 1} pieces between {n} keys; give one, or one a piece")
        pieces.eased_curve_pieces(np.arange(n, dtype=float), np.zeros(n - 1), np.zeros(n - 1), each)
        return how | {"easing": [e if isinstance(e, str) else easing_of.easing_handles(e) for e in each]}
    if kind in slopes.RULES and n > 1:
        curve.slopes()
    if kind not in ("hermite", "bezier"):
        return how
    if how.get("leave") is None:
        raise ValueError(f"a curve of kind {kind} needs leave, its slopes at the keys [unit/s]")
    how["leave"] = np.asarray(how["leave"], np.float64)
    how["arrive"] = how["leave"] if how.get("arrive") is None else np.asarray(how["arrive"], np.float64)
    for name in ("leave", "arrive"):
        if how[name].shape != curve.values.shape or not np.isfinite(how[name]).all():
            raise ValueError(f"{name}: one finite slope a value: values {curve.values.shape}, slopes {how[name].shape}")
    if "form" in how and (len(how["form"]) != n - 1 or not set(how["form"]) <= set(FORMS)):
        raise ValueError(f"form has one of {', '.join(FORMS)} for each of {n - 1} pieces, not {how['form']}")
    if "until" in how:
        how["until"] = np.asarray(how["until"], np.float64)
        if how["until"].shape != curve.values.shape or not np.isfinite(how["until"]).all():
            raise ValueError(f"until: one finite value right before each key: {curve.values.shape}, not {how['until'].shape}")
    return _complete_handle_widths(curve, how) if kind == "bezier" else how


def _complete_handle_widths(curve: Curve, how: dict) -> dict:
    span = np.diff(curve.times)
    for name, whole in (("leave_width", np.append(span, 0.0)), ("arrive_width", np.append(0.0, span))):
        width = np.asarray(how[name], np.float64) if how.get(name) is not None else whole / 3.0
        how[name] = width
        if width.shape != curve.times.shape or not np.all((width >= 0.0) & (width <= whole + 1e-9 * whole) | (whole == 0.0)):
            raise ValueError(f"{name}: a handle a key, within 0 .. {whole} s so that time does not run back, not {width}")
        how[name] = np.where(whole == 0.0, width, np.minimum(width, whole))
    return how
