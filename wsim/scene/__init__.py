"""What exists: plain data in SI units, NumPy only. Its dataclasses are imported when the first is used, so that tables beside
them (time integrators, models of materials) are read without NumPy."""

TYPE_CHECKING = False            # as typing's, without importing typing
if TYPE_CHECKING:
    from wsim.scene.bodies import CLOTH_MODELS, Cloth, Skin, Soft, Springs
    from wsim.scene.curve import Motion
    from wsim.scene.scene import (
        Box,
        Capsule,
        Collider,
        Cone,
        Cylinder,
        Load,
        Pin,
        Plane,
        Problem,
        Scene,
        SceneError,
        Shape,
        Sphere,
        Surface,
        Tie,
        Varying,
    )

__all__ = ["CLOTH_MODELS", "Box", "Capsule", "Cloth", "Collider", "Cone", "Cylinder", "Load", "Motion", "Pin", "Plane",
           "Problem", "Scene", "SceneError", "Shape", "Skin", "Soft", "Sphere", "Springs", "Surface", "Tie", "Varying"]


def __getattr__(name: str):
    if name not in __all__:
        raise AttributeError(f"module 'wsim.scene' has no attribute '{name}'; its names: {', '.join(__all__)}")
    from wsim.scene import scene

    globals().update({each: getattr(scene, each) for each in __all__})
    return globals()[name]
