"""A USD scene in, a simulated USD layer out.

    import wsim
    simulation = wsim.Simulation("flag.usda")           # a path, a Usd.Stage or a wsim.Scene
    with simulation.record("out.usdc"):                 # a layer over the scene
        for frame in simulation.frames(24):
            simulation.positions("/flag")               # [m], world, (n, 3)

Names are imported when first used, so that `import wsim` costs about a millisecond and reading or writing scenes
never starts Warp.
"""

TYPE_CHECKING = False            # as typing's, without importing typing
if TYPE_CHECKING:
    from wsim.fitting.fit import fit
    from wsim.fitting.joints.goals import Goal
    from wsim.fitting.joints.joint_tree import JointTree
    from wsim.fitting.observations.observe import Track
    from wsim.gradient.recording import Recording
    from wsim.physics.animation.objects import Skeleton
    from wsim.physics.contact.collider.point_cloud import PointCloud
    from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
    from wsim.physics.fluid.objects import Fluid, Source
    from wsim.physics.rigid.joints.actuators.actuator import Actuator
    from wsim.physics.rigid.joints.joint import Joint
    from wsim.physics.rigid.objects import Body
    from wsim.physics.rods.objects import Rods
    from wsim.scene import (
        Box,
        Capsule,
        Cloth,
        Collider,
        Cone,
        Cylinder,
        Load,
        Pin,
        Plane,
        Problem,
        Scene,
        SceneError,
        Skin,
        Soft,
        Sphere,
        Springs,
        Surface,
        Tie,
        shapes,
    )
    from wsim.scene.curve import Curve, Motion
    from wsim.scene.fabric import Fabric, fabric
    from wsim.scene.solid import Bulk
    from wsim.simulation.simulation import Simulation
    from wsim.sweep.sweep import sweep  # type: ignore[no-redef]  # noqa: F401
    from wsim.usd import load, save  # type: ignore[no-redef]  # wsim.usd.load is a module too
    from wsim.usd.result.recorder import Recorder

__version__ = "0.1.0"

_HOME = {
    **dict.fromkeys(("Scene", "Cloth", "Springs", "Collider", "Pin", "Plane", "Sphere", "Box", "Capsule", "Cylinder", "Cone",
                     "Surface", "Soft", "Skin", "Problem", "SceneError", "Load", "Tie"), "wsim.scene"),
    "Curve": "wsim.scene.curve", "Motion": "wsim.scene.curve", "Bulk": "wsim.scene.solid",
    "Fabric": "wsim.scene.fabric", "fabric": "wsim.scene.fabric", "shapes": "wsim.scene.shapes",
    "Actuator": "wsim.physics.rigid.joints.actuators.actuator",
    "Body": "wsim.physics.rigid.objects", "Joint": "wsim.physics.rigid.joints.joint", "Rods": "wsim.physics.rods.objects",
    "Goal": "wsim.fitting.joints.goals", "JointTree": "wsim.fitting.joints.joint_tree",
    "Fluid": "wsim.physics.fluid.objects", "Source": "wsim.physics.fluid.objects",
    "Liquid": "wsim.physics.fluid.liquid.objects", "LiquidSource": "wsim.physics.fluid.liquid.objects",
    "PointCloud": "wsim.physics.contact.collider.point_cloud",
    "Skeleton": "wsim.physics.animation.objects", "Track": "wsim.fitting.observations.observe",
    "Recording": "wsim.gradient.recording",
    "load": "wsim.usd", "save": "wsim.usd", "Simulation": "wsim.simulation.simulation", "fit": "wsim.fitting.fit",
    "Recorder": "wsim.usd.result.recorder", "sweep": "wsim.sweep",
}
__all__ = [  # noqa: F822  (names of __getattr__)
    "Actuator", "Body", "Box", "Bulk", "Capsule", "Cloth", "Collider", "Cone", "Curve", "Cylinder", "Fabric", "Fluid", "Goal",
    "Joint", "JointTree", "Liquid", "LiquidSource", "Load", "Motion", "Pin", "Plane", "PointCloud", "Problem", "Recorder",
    "Recording", "Rods", "Scene", "SceneError", "Simulation", "Skeleton", "Skin", "Soft", "Source", "Sphere", "Springs",
    "Surface", "Tie", "Track", "fabric", "fit", "load", "save", "shapes",
]


def _repr_html_(self) -> str:
    """How a notebook shows a Scene or a Simulation."""
    from wsim.show.notebook import describe_html

    return describe_html(self)


def __getattr__(name: str):
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'wsim' has no attribute '{name}'; its names: {', '.join(__all__)}")
    from importlib import import_module

    module = import_module(home)
    value = module if name in ("shapes", "sweep") else getattr(module, name)
    globals()[name] = value
    if name in ("Scene", "load", "Simulation"):
        from wsim.scene import Scene

        for each in (Scene, value) if name == "Simulation" else (Scene,):
            type.__setattr__(each, "_repr_html_", _repr_html_)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
