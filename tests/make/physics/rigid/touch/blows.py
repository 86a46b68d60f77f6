"""What tests/physics/rigid/touch/test_blows.py shares with other tests: FREE, by."""


FREE = (0.0, 0.0, 0.0)
WAYS = {"xpbd": ("xpbd", "backward_euler", 10, 8), "xpbd bdf2": ("xpbd", "bdf2", 10, 8),
        "leapfrog": ("explicit", "leapfrog", 40, 1), "rk4": ("explicit", "rk4", 40, 1),
        "newton": ("implicit", "backward_euler", 10, 3), "newton bdf2": ("implicit", "bdf2", 10, 3)}


def by(way: str) -> dict:
    return dict(zip(("solver", "integrator", "substeps", "iterations"), WAYS[way], strict=True))
