"""What exists: plain data in SI units, NumPy only. Its dataclasses are imported when the first is used, so that tables beside
them (time integrators, models of materials) are read without NumPy."""

TYPE_CHECKING = False            # as typing's, without importing typing
if TYPE_CHECKING:
    from wsim.physics.cloth.nets.objects import Springs
    from wsim.physics.cloth.objects import CLOTH_MODELS, Cloth
    from wsim.physics.soft.objects import Skin, Soft
    from wsim.scene.bodies import Deformable
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

# names that a method's folder has, by the class that its row owns
OWNED = {"Cloth": "Cloth", "CLOTH_MODELS": "Cloth", "Springs": "Springs", "Soft": "Soft", "Skin": "Soft"}
__all__ = ["CLOTH_MODELS", "Box", "Capsule", "Cloth", "Collider", "Cone", "Cylinder", "Deformable", "Load", "Motion", "Pin",
           "Plane", "Problem", "Scene", "SceneError", "Shape", "Skin", "Soft", "Sphere", "Springs", "Surface", "Tie", "Varying"]


def __getattr__(name: str):
    if name not in __all__:
        raise AttributeError(f"module 'wsim.scene' has no attribute '{name}'; its names: {', '.join(__all__)}")
    if name in OWNED:
        from wsim.scene.methods import method_file

        globals()[name] = getattr(method_file(OWNED[name], "objects"), name)
    else:
        from wsim.scene import scene

        globals().update({each: getattr(scene, each) for each in __all__ if each not in OWNED})
    return globals()[name]
