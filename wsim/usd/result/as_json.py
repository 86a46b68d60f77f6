"""Numbers of a run as JSON, which knows no infinity."""

import json
from math import isfinite


def as_json(report: dict) -> str:
    """One line of JSON; NumPy numbers become numbers, and what is not finite becomes null."""
    return json.dumps(_to_json_value(report))


def _to_json_value(value):
    if isinstance(value, dict):
        return {str(k): _to_json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_to_json_value(v) for v in value]
    if hasattr(value, "item"):
        value = value.item() if getattr(value, "size", 1) == 1 else value.tolist()
        return _to_json_value(value)
    return None if isinstance(value, float) and not isfinite(value) else value
