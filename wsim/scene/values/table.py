"""The values of wsim: a row each. A new parameter is a row here, its field in the scene, and its use in the method that reads
it; `Simulation.set`, checks, values that vary in time, fits, inputs of gradients and names of attributes read this table.

    find(owner, name)      the row, or None
    of(owner)              all rows of a class, by name
"""

from collections.abc import Iterator
from math import inf

from wsim.scene.values.value import LARGE, Each, Range, Theta, Usd, Value

ANY, POSITIVE, LIMIT = Range(-inf), Range(strict=True), Range(endless=True)
LOG, PLAIN, HALF, RATIO = Theta("log"), Theta("plain", high=LARGE), Theta("bounded", 0.0, 0.5), Range(-1.0, True, 0.5)
BODIES = ("Cloth", "Springs", "Soft")

SHEET, SOLID, RUB = "PhysicsSurfaceDeformableMaterialAPI", "PhysicsVolumeDeformableMaterialAPI", "PhysicsMaterialAPI"
OWN, AIR, FLAT = "WsimMaterialAPI", "WsimSceneAPI", "WsimClothAPI"
DOMAIN, SOURCE = "WsimFluidDomainAPI", "WsimFluidSourceAPI"
LIQUID, POUR = "WsimLiquidDomainAPI", "WsimLiquidSourceAPI"
MATERIALS = (SHEET, SOLID, RUB, OWN)                 # schemas of materials: what they say is no attribute of the prim itself
DAMPING = {"Cloth": OWN, "Springs": "WsimSpringsAPI", "Soft": OWN}
FRICTION = ("static_friction", "dynamic_friction")
FIXED, AIRY = "fixed while a scene runs", "it says how a fluid is solved, or what its pressures are"
PARTS = {"stretch": ("stretch", "weft"), "stretch_warp": ("stretch",), "stretch_weft": ("weft",)}    # values of a parameter

VALUES: list[Value] = [
    Value("Cloth", "stretch", "N/m", POSITIVE, varies=True, stiffens=True, fit=LOG, each=Each("edges", LOG),
          usd=Usd(SHEET, "physics:surfaceStretchStiffness", "float"), gradient="material"),
    Value("Cloth", "weft", "N/m", varies=True, stiffens=True, needs=("membrane",), each=Each("triangles", LOG),
          usd=Usd(OWN, "wsim:weftStretch"), gradient="material"),
    Value("Cloth", "shear", "N/m", varies=True, stiffens=True, needs=("shear",), fit=LOG, each=Each("diagonals", LOG),
          usd=Usd(SHEET, "physics:surfaceShearStiffness", "float"), gradient="material"),
    Value("Cloth", "bend", "N m", varies=True, stiffens=True, needs=("bend",), fit=LOG, each=Each("hinges", LOG),
          usd=Usd(SHEET, "physics:surfaceBendStiffness", "float"), gradient="material"),
    Value("Cloth", "poisson", "1", RATIO, varies=True, stiffens=True, needs=("membrane",), fit=Theta("bounded", -1.0, 0.5),
          usd=Usd(SHEET, "physics:poissonsRatio", "float"), gradient="material"),
    Value("Cloth", "strain_limit", "1", LIMIT, varies=True, needs=("finite",), fit=LOG, usd=Usd(OWN, "wsim:strainLimit"),
          gradient="material"),
    Value("Soft", "young", "Pa", POSITIVE, tets=True, varies=True, stiffens=True, needs=("alone",), fit=LOG,
          each=Each("tets", LOG), usd=Usd(SOLID, "physics:youngsModulus", "float"), gradient="material"),
    Value("Soft", "poisson", "1", RATIO, tets=True, varies=True, stiffens=True, needs=("alone",), fit=HALF,
          each=Each("tets", HALF), usd=Usd(SOLID, "physics:poissonsRatio", "float"), gradient="material"),
    Value("Soft", "yield_strain", "1", Range(strict=True, endless=True), varies=True, needs=("finite", "alone"),
          usd=Usd(OWN, "wsim:yieldStrain"), gradient="material"),
    Value("Soft", "pressure", "Pa", ANY, varies=True, needs=("start",), fit=Theta("plain", high=1e3),
          usd=Usd("WsimSoftAPI", "wsim:pressure"), gradient="material"),
    Value("Springs", "stiffness", "N/m", POSITIVE, varies=True, stiffens=True, fit=LOG, each=Each("springs", LOG),
          usd=Usd("WsimSpringsAPI", "wsim:stiffness", "float[]"), gradient="material"),
    *(Value(owner, "damping", "s", tets=owner == "Soft", varies=True, stiffens=True,
            needs=("start", "alone") if owner == "Soft" else ("start",), fit=LOG, usd=Usd(schema, "wsim:damping"),
            gradient="material") for owner, schema in DAMPING.items()),
    *(Value(owner, "density", "kg/m^3", POSITIVE, varies=True, stiffens=True, needs=("mass", "alone"), fit=LOG,
            usd=Usd(RUB, "physics:density", "float"), gradient="density") for owner in ("Cloth", "Soft")),
    Value("Springs", "mass", "kg", POSITIVE, stiffens=True, needs=("apart",), fit=LOG, gradient="mass"),
    *(Value(owner, "mass", "kg", POSITIVE, live=False, why=f"{FIXED}; take density, or masses()",
            mend="author physics:mass, or leave it to the density") for owner in ("Cloth", "Soft")),
    *(Value(owner, f"{kind}_friction", "1", varies=True, needs=("collider", "alone"), fit=None if owner == "Springs" else LOG,
            usd=Usd(RUB, f"physics:{kind}Friction", "float"), gradient="contact")
      for kind in ("static", "dynamic") for owner in (*BODIES, "Collider")),
    Value("Collider", "thickness", "m", varies=True, usd=Usd("WsimColliderAPI", "wsim:thickness"), gradient="contact"),
    Value("Collider", "restitution", "1", Range(high=1.0, closed=True), varies=True, needs=("throws",),
          fit=Theta("bounded", 0.0, 1.0), usd=Usd(RUB, "physics:restitution", "float"), gradient="contact"),

    Value("Load", "force", "N", ANY, "curve", fit=PLAIN, each=Each("keys", PLAIN),
          usd=Usd("WsimLoadAPI", "wsim:load:force", "vector3d"), gradient="load"),
    Value("Load", "traction", "Pa", ANY, "curve", fit=PLAIN, each=Each("keys", PLAIN),
          usd=Usd("WsimLoadAPI", "wsim:load:traction", "vector3d"), gradient="load"),
    Value("Scene", "gravity", "m/s^2", ANY, "vector", local=True, varies=True, fit=PLAIN, gradient="whole"),
    Value("Scene", "wind", "m/s", ANY, "vector", local=True, varies=True, needs=("air",), fit=PLAIN,
          usd=Usd(AIR, "wsim:wind", "vector3d"), gradient="whole"),
    Value("Scene", "air_drag", "1/s", local=True, varies=True, stiffens=True, fit=LOG, usd=Usd(AIR, "wsim:airDrag"),
          gradient="whole"),

    *(Value(owner, "velocities", "m/s", ANY, "array", each=Each("points", Theta("plain")), gradient="start")
      for owner in BODIES),
    *(Value(owner, "positions", "m", ANY, "array", gradient="start") for owner in BODIES),
    *(Value(owner, "rest_shape", "m", ANY, "array", stiffens=True, gradient="rest",
            each=None if owner == "Springs" else Each("points", Theta("plain", high=0.01), 1.0)) for owner in BODIES),
    Value("Springs", "lengths", "m", POSITIVE, "array", stiffens=True, each=Each("springs", LOG, 0.05),
          usd=Usd("WsimSpringsAPI", "wsim:lengths", "float[]"), gradient="rest"),
    Value("Springs", "actuation", "1", POSITIVE, "curve", each=Each("keys", LOG, 0.05),
          usd=Usd("WsimSpringsAPI", "wsim:actuation", "double[]"), gradient="actuation"),
    *(Value(owner, "motion", "m", ANY, "motion", each=Each("frames", Theta("plain"), 0.05), why=f"it is no array; take {what}")
      for owner, what in (("Pin", "targets"), ("Collider", "shift"))),
    Value("Pin", "targets", "m", ANY, "array", live=False, gradient="targets"),
    *(Value(owner, name, unit, ANY, "array", live=False, gradient="path") for owner in ("Pin", "Collider") for name, unit in (
        ("keys", "m"), ("tangents", "m/s"), ("handles", "1"), ("turns", "rad"))),
    Value("Collider", "points", "m", ANY, "array", live=False, why="the shape of a mesh that deforms has none yet"),
    Value("Collider", "shift", "m", ANY, "array", live=False, gradient="shift"),
    Value("Collider", "surface", "m/s", ANY, "array", live=False, gradient="surface"),
    Value("Skeleton", "turns", "rad", ANY, "array", live=False, gradient="turns"),
    Value("Skeleton", "weights", "1", ANY, "array", live=False, gradient="weights"),

    *(Value("Body", name, unit, ANY, "vector", fit=PLAIN, gradient="body") for name, unit in (
        ("velocity", "m/s"), ("spin", "rad/s"), ("force", "N"), ("torque", "N m"))),
    *(Value("Body", name, "1/s", fit=LOG, gradient="body") for name in ("drag", "spin_drag")),
    Value("Body", "mass", "kg", POSITIVE, fit=LOG, gradient="body"),
    Value("Body", "inertia", "kg m^2", POSITIVE, "vector", gradient="body"),
    *(Value("Body", f"{kind}_friction", "1", live=True, fit=LOG, gradient="body" if kind == "dynamic" else "",
            why="" if kind == "dynamic" else "it decides whether a point sticks, and no more; take dynamic_friction")
      for kind in ("static", "dynamic")),
    Value("Body", "restitution", "1", Range(high=1.0, closed=True), fit=Theta("bounded", 0.0, 1.0), gradient="body"),
    *(Value("Joint", name, unit, fit=LOG, gradient="body") for name, unit in (("stiffness", "N/m"), ("damping", "N s/m"))),
    Value("Joint", "target", "m", ANY, varies=True, needs=("driven",), fit=PLAIN, gradient="body"),
    Value("Joint", "speed", "m/s", ANY, varies=True, needs=("driven",), why="no recording knows it yet; take target"),
    Value("Body", "density", "kg/m^3", POSITIVE, live=False, why=f"{FIXED}; take mass"),

    *(Value("Fluid", name, unit, ANY, usd=Usd(DOMAIN, f"wsim:fluid:{name}"), fit=Theta("plain", high=high), gradient="fluid")
      for name, unit, high in (("lift", "1/K", 0.01), ("weight", "1", 1.0))),
    *(Value("Fluid", name, "1/s", usd=Usd(DOMAIN, f"wsim:fluid:{called}"), fit=LOG, gradient="fluid") for name, called in (
        ("smoke_decay", "smokeDecay"), ("cooling", "cooling"))),
    *(Value("Fluid", name, unit, needs=("start",), usd=Usd(DOMAIN, f"wsim:fluid:{name}"), fit=LOG, gradient="fluid")
      for name, unit in (("vorticity", "1"), ("viscosity", "m^2/s"))),
    *(Value("Fluid", name, unit, ANY, "array", live=False, gradient="fluid") for name, unit in (
        ("velocity", "m/s"), ("smoke", "1"), ("temperature", "K"))),
    Value("Fluid", "side_velocities", "m/s", ANY, "array", gradient="fluid"),
    Value("Fluid", "acceleration", "m/s^2", ANY, "array", needs=("start",), gradient="fluid"),
    *(Value("Fluid", name, unit, POSITIVE, live=False, why=AIRY, usd=Usd(DOMAIN, f"wsim:fluid:{called}"))
      for name, called, unit in (("cell", "cellSize", "m"), ("density", "density", "kg/m^3"), ("tolerance", "tolerance", "1"),
                                 ("cfl", "cfl", "1"))),
    *(Value("Source", name, unit, ANY, usd=Usd(SOURCE, f"wsim:fluid:{name}"), fit=PLAIN, gradient="fluid") for name, unit in (
        ("smoke", "1/s"), ("temperature", "K/s"), ("expansion", "1/s"))),
    *(Value("Source", name, unit, ANY, "vector", fit=Theta("plain"), gradient="fluid") for name, unit in (
        ("velocity", "m/s"), ("place", "m"))),
    Value("Source", "strength", "1", ANY, "factor", fit=Theta("plain"), gradient="fluid"),
    *(Value("Liquid", name, unit, POSITIVE, live=False, why=AIRY, usd=Usd(LIQUID, f"wsim:liquid:{called}"))
      for name, called, unit in (("cell", "cellSize", "m"), ("density", "density", "kg/m^3"), ("tolerance", "tolerance", "1"),
                                 ("cfl", "cfl", "1"))),
    Value("Liquid", "flip", "1", Range(high=1.0, closed=True), live=False, why=AIRY, usd=Usd(LIQUID, "wsim:liquid:flip")),

    Value("Cloth", "thickness", "m", POSITIVE, live=False, usd=Usd(OWN, "wsim:thickness"), why=FIXED),
    *(Value("Cloth", name, "1", live=False, usd=Usd(FLAT, f"wsim:{name}"), why=f"{FIXED}, and no input; take air_coefficient()")
      for name in ("drag", "lift")),
    Value("Cloth", "normal_drag", "kg/(m^2 s)", live=False, usd=Usd(OWN, "wsim:normalDrag"),
          why=f"{FIXED}, and no input; take air_coefficient()"),
    Value("Cloth", "weld", "m", live=False, usd=Usd(FLAT, "wsim:weld", uniform=True), why="it says which points are one"),
    Value("Springs", "radius", "m", live=False, usd=Usd("WsimSpringsAPI", "wsim:radius"), why=FIXED),
    Value("Pin", "stiffness", "N/m", Range(strict=True, endless=True), live=False,
          usd=Usd("PhysicsAttachment", "physics:stiffness", "float"), why=f"{FIXED}, and no input; take pin()",
          mend="author physics:stiffness; inf for a hard pin"),
    Value("Pin", "damping", "N s/m", live=False, usd=Usd("PhysicsAttachment", "physics:damping", "float"),
          why=f"{FIXED}, and no input; take pin()"),
    Value("Scene", "air_density", "kg/m^3", live=False, usd=Usd(AIR, "wsim:airDensity"), why=FIXED),
    Value("Scene", "contact_width", "m", live=False, usd=Usd(AIR, "wsim:contactWidth"), why=FIXED),
    Value("Scene", "contact_tolerance", "m/s", live=False, usd=Usd(AIR, "wsim:contactTolerance"), why=FIXED),
    Value("Scene", "sleep_speed", "m/s", live=False, usd=Usd(AIR, "wsim:sleepSpeed"), why=FIXED),
    Value("Scene", "error", "1", POSITIVE, live=False, usd=Usd(AIR, "wsim:error", uniform=True),
          why="no motion follows from it", mend="give 0.01 for 1 % of the scene's size"),
]


def of(owner: str) -> dict[str, Value]:
    """All values of a class, by name."""
    return {row.name: row for row in VALUES if row.owner == owner}


def find(owner: str, name: str) -> Value | None:
    """The row of a value; of a body that of the whole scene where one body may have its own."""
    row = of(owner).get(name)
    if row is None and owner in BODIES:
        whole = of("Scene").get(name)
        return whole if whole and whole.local else None
    return row


def live(owner: str) -> list[str]:
    """Names that `Simulation.set` takes of a class; of "" those of all classes."""
    return list(dict.fromkeys(row.name for row in VALUES if row.live and (owner in ("", row.owner)
                                                                         or (row.local and owner in BODIES))))


def inputs(owner: str) -> list[str]:
    """Names of a class that recordings are differentiated with respect to."""
    return [row.name for row in VALUES if row.gradient and row.owner == owner]


def varying(owner: str) -> list[str]:
    """Names of a class that may vary in time."""
    return [row.name for row in VALUES if row.varies and row.owner == owner]


def stiffens(name: str) -> bool:
    """True if explicit steps are bounded by a value of that name."""
    return any(row.stiffens for row in VALUES if row.name == name)


def validate(owner: str, holder) -> None:
    """Raises ValueError for the first number of a material that its bounds do not allow."""
    for row in numbers(owner):
        if hasattr(holder, row.name) and (wrong := row.range.wrong(row.name, getattr(holder, row.name), True)):
            raise ValueError(wrong)


def numbers(owner: str) -> Iterator[Value]:
    """Rows of single numbers of a class, which have bounds."""
    return (row for row in VALUES if row.owner == owner and row.form == "number")
