"""Numbers of a run as JSON, which knows no infinity."""

import json
from math import isfinite


def as_json(report: dict) -> str:
    """One line of JSON; NumPy numbers become numbers, and what is not finite becomes null."""
    return json.dumps(_plain(report))


def _plain(value):
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item() if getattr(value, "size", 1) == 1 else value.tolist()
        return _plain(value)
    return None if isinstance(value, float) and not isfinite(value) else value
