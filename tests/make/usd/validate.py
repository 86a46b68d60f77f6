"""The validators of usd-core on a stage."""

from wsim.usd.stage import open_stage


def validate(path) -> list[str]:
    """What the validators of usd-core find wrong with a stage: one line each, with the prim path."""
    from pxr import UsdValidation

    registry = UsdValidation.ValidationRegistry()
    errors = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators()).Validate(open_stage(path))
    return [f"{', '.join(str(s.GetPrim().GetPath()) for s in e.GetSites() if s.IsPrim()) or path}: {e.GetName()}: "
            f"{e.GetMessage()}" for e in errors]
