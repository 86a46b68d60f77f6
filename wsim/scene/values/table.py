"""The values of wsim: a row each. A new parameter is a row here, its field in the scene, and its use in the method that reads
it; `Simulation.set`, checks, values that vary in time, fits, inputs of gradients and names of attributes read this table.

    find(owner, name)      the row, or None
    of(owner)              all rows of a class, by name
"""

from collections.abc import Iterator
from math import inf, pi

from wsim.scene.values.value import LARGE, PerElementFit, ThetaMap, UsdAttribute, ValueRange, ValueRow

ANY, POSITIVE, LIMIT = ValueRange(-inf), ValueRange(strict=True), ValueRange(endless=True)
LOG, PLAIN, HALF, RATIO = (ThetaMap("log"), ThetaMap("plain", high=LARGE), ThetaMap("bounded", 0.0, 0.5),
                           ValueRange(-1.0, True, 0.5))
STEEP = ThetaMap("bounded", 0.0, 0.5 * pi)
BODIES, HELD = ("Cloth", "Springs", "Soft"), "WsimShapeMatchingAPI"

SHEET, SOLID, RUB = "PhysicsSurfaceDeformableMaterialAPI", "PhysicsVolumeDeformableMaterialAPI", "PhysicsMaterialAPI"
OWN, AIR, FLAT = "WsimMaterialAPI", "WsimSceneAPI", "WsimClothAPI"
DOMAIN, SOURCE = "WsimFluidDomainAPI", "WsimFluidSourceAPI"
LIQUID, POUR = "WsimLiquidDomainAPI", "WsimLiquidSourceAPI"
MATERIALS = (SHEET, SOLID, RUB, OWN)                 # schemas of materials: what they say is no attribute of the prim itself
DAMPING = {"Cloth": OWN, "Springs": "WsimSpringsAPI", "Soft": OWN}
FRICTION = ("static_friction", "dynamic_friction")
STEPPED = "gradients do not go through shape matching"
FIXED, AIRY = "fixed while a scene runs", "it says how a fluid is solved, or what its pressures are"
PARTS = {"stretch": ("stretch", "weft"), "stretch_warp": ("stretch",), "stretch_weft": ("weft",)}    # values of a parameter

VALUES: list[ValueRow] = [
    ValueRow("Cloth", "stretch", "N/m", POSITIVE, varies=True, stiffens=True, fit=LOG, each=PerElementFit("edges", LOG),
             usd=UsdAttribute(SHEET, "physics:surfaceStretchStiffness", "float"), gradient="material"),
    ValueRow("Cloth", "weft", "N/m", varies=True, stiffens=True, needs=("membrane",), each=PerElementFit("triangles", LOG),
             usd=UsdAttribute(OWN, "wsim:weftStretch"), gradient="material"),
    ValueRow("Cloth", "shear", "N/m", varies=True, stiffens=True, needs=("shear",), fit=LOG,
             each=PerElementFit("diagonals", LOG),
             usd=UsdAttribute(SHEET, "physics:surfaceShearStiffness", "float"), gradient="material"),
    ValueRow("Cloth", "bend", "N m", varies=True, stiffens=True, needs=("bend",), fit=LOG, each=PerElementFit("hinges", LOG),
             usd=UsdAttribute(SHEET, "physics:surfaceBendStiffness", "float"), gradient="material"),
    ValueRow("Cloth", "poisson", "1", RATIO, varies=True, stiffens=True, needs=("membrane",),
             fit=ThetaMap("bounded", -1.0, 0.5),
             usd=UsdAttribute(SHEET, "physics:poissonsRatio", "float"), gradient="material"),
    ValueRow("Cloth", "strain_limit", "1", LIMIT, varies=True, needs=("finite",), fit=LOG,
             usd=UsdAttribute(OWN, "wsim:strainLimit"), gradient="material"),
    ValueRow("Soft", "young", "Pa", POSITIVE, tets=True, varies=True, stiffens=True, needs=("alone",), fit=LOG,
             each=PerElementFit("tets", LOG), usd=UsdAttribute(SOLID, "physics:youngsModulus", "float"), gradient="material"),
    ValueRow("Soft", "poisson", "1", RATIO, tets=True, varies=True, stiffens=True, needs=("alone",), fit=HALF,
             each=PerElementFit("tets", HALF), usd=UsdAttribute(SOLID, "physics:poissonsRatio", "float"), gradient="material"),
    ValueRow("Soft", "yield_strain", "1", ValueRange(strict=True, endless=True), varies=True, needs=("finite", "alone"),
             usd=UsdAttribute(OWN, "wsim:yieldStrain"), gradient="material"),
    ValueRow("Soft", "pressure", "Pa", ANY, varies=True, needs=("start",), fit=ThetaMap("plain", high=1e3),
             usd=UsdAttribute("WsimSoftAPI", "wsim:pressure"), gradient="material"),
    ValueRow("Springs", "stiffness", "N/m", POSITIVE, varies=True, stiffens=True, fit=LOG, each=PerElementFit("springs", LOG),
             usd=UsdAttribute("WsimSpringsAPI", "wsim:stiffness", "float[]"), gradient="material"),
    ValueRow("Clusters", "stiffness", "1/s^2", ValueRange(strict=True, endless=True), varies=True,
             usd=UsdAttribute(HELD, "wsim:stiffness"), why=STEPPED),
    ValueRow("Clusters", "damping", "s", varies=True, needs=("start",), usd=UsdAttribute(HELD, "wsim:damping"), why=STEPPED),
    *(ValueRow(owner, "damping", "s", tets=owner == "Soft", varies=True, stiffens=True,
               needs=("start", "alone") if owner == "Soft" else ("start",), fit=LOG, usd=UsdAttribute(schema, "wsim:damping"),
               gradient="material") for owner, schema in DAMPING.items()),
    *(ValueRow(owner, "density", "kg/m^3", POSITIVE, varies=True, stiffens=True, needs=("mass", "alone"), fit=LOG,
               usd=UsdAttribute(RUB, "physics:density", "float"), gradient="density") for owner in ("Cloth", "Soft")),
    ValueRow("Springs", "mass", "kg", POSITIVE, stiffens=True, needs=("apart",), fit=LOG, gradient="mass"),
    *(ValueRow(owner, "mass", "kg", POSITIVE, live=False, why=f"{FIXED}; take density, or masses()",
               mend="author physics:mass, or leave it to the density") for owner in ("Cloth", "Soft")),
    *(ValueRow(owner, f"{kind}_friction", "1", varies=True, needs=("collider", "alone"),
               fit=None if owner in ("Springs", "Clusters") else LOG,
               usd=UsdAttribute(RUB, f"physics:{kind}Friction", "float"), gradient="" if owner == "Clusters" else "contact",
               why=STEPPED if owner == "Clusters" else "")
      for kind in ("static", "dynamic") for owner in (*BODIES, "Clusters", "Collider")),
    ValueRow("Collider", "thickness", "m", varies=True, usd=UsdAttribute("WsimColliderAPI", "wsim:thickness"),
             gradient="contact"),
    ValueRow("Collider", "restitution", "1", ValueRange(high=1.0, closed=True), varies=True, needs=("throws",),
             fit=ThetaMap("bounded", 0.0, 1.0), usd=UsdAttribute(RUB, "physics:restitution", "float"), gradient="contact"),

    ValueRow("Load", "force", "N", ANY, "curve", fit=PLAIN, each=PerElementFit("keys", PLAIN),
             usd=UsdAttribute("WsimLoadAPI", "wsim:load:force", "vector3d"), gradient="load"),
    ValueRow("Load", "traction", "Pa", ANY, "curve", fit=PLAIN, each=PerElementFit("keys", PLAIN),
             usd=UsdAttribute("WsimLoadAPI", "wsim:load:traction", "vector3d"), gradient="load"),
    ValueRow("Scene", "gravity", "m/s^2", ANY, "vector", local=True, varies=True, fit=PLAIN, gradient="whole"),
    ValueRow("Scene", "wind", "m/s", ANY, "vector", local=True, varies=True, needs=("air",), fit=PLAIN,
             usd=UsdAttribute(AIR, "wsim:wind", "vector3d"), gradient="whole"),
    ValueRow("Scene", "air_drag", "1/s", local=True, varies=True, stiffens=True, fit=LOG, usd=UsdAttribute(AIR, "wsim:airDrag"),
             gradient="whole"),

    *(ValueRow(owner, "velocities", "m/s", ANY, "array", each=PerElementFit("points", ThetaMap("plain")), gradient="start")
      for owner in BODIES),
    *(ValueRow(owner, "positions", "m", ANY, "array", gradient="start") for owner in BODIES),
    *(ValueRow(owner, "rest_shape", "m", ANY, "array", stiffens=True, gradient="rest",
               each=None if owner == "Springs" else PerElementFit("points", ThetaMap("plain", high=0.01), 1.0))
               for owner in BODIES),
    ValueRow("Springs", "lengths", "m", POSITIVE, "array", stiffens=True, each=PerElementFit("springs", LOG, 0.05),
             usd=UsdAttribute("WsimSpringsAPI", "wsim:lengths", "float[]"), gradient="rest"),
    ValueRow("Springs", "actuation", "1", POSITIVE, "curve", each=PerElementFit("keys", LOG, 0.05),
             usd=UsdAttribute("WsimSpringsAPI", "wsim:actuation", "double[]"), gradient="actuation"),
    *(ValueRow(owner, "motion", "m", ANY, "motion", each=PerElementFit("frames", ThetaMap("plain"), 0.05),
               why=f"it is no array; take {what}")
      for owner, what in (("Pin", "targets"), ("Collider", "shift"))),
    ValueRow("Pin", "targets", "m", ANY, "array", live=False, gradient="targets"),
    *(ValueRow(owner, name, unit, ANY, "array", live=False, gradient="path") for owner in ("Pin", "Collider")
      for name, unit in (
        ("keys", "m"), ("tangents", "m/s"), ("handles", "1"), ("turns", "rad"))),
    ValueRow("Collider", "points", "m", ANY, "array", live=False, why="the shape of a mesh that deforms has none yet"),
    ValueRow("Collider", "shift", "m", ANY, "array", live=False, gradient="shift"),
    ValueRow("Collider", "surface", "m/s", ANY, "array", live=False, gradient="surface"),
    ValueRow("Skeleton", "turns", "rad", ANY, "array", live=False, gradient="turns"),
    ValueRow("Skeleton", "weights", "1", ANY, "array", live=False, gradient="weights"),

    *(ValueRow("Body", name, unit, ANY, "vector", fit=PLAIN, gradient="body") for name, unit in (
        ("velocity", "m/s"), ("spin", "rad/s"), ("force", "N"), ("torque", "N m"))),
    *(ValueRow("Body", name, "1/s", fit=LOG, gradient="body") for name in ("drag", "spin_drag")),
    ValueRow("Body", "mass", "kg", POSITIVE, fit=LOG, gradient="body"),
    ValueRow("Body", "inertia", "kg m^2", POSITIVE, "vector", gradient="body"),
    *(ValueRow("Body", f"{kind}_friction", "1", live=True, fit=LOG, gradient="body" if kind == "dynamic" else "",
               why="" if kind == "dynamic" else "it decides whether a point sticks, and no more; take dynamic_friction")
      for kind in ("static", "dynamic")),
    ValueRow("Body", "restitution", "1", ValueRange(high=1.0, closed=True), fit=ThetaMap("bounded", 0.0, 1.0), gradient="body"),
    *(ValueRow("Joint", name, unit, fit=LOG, gradient="body") for name, unit in (("stiffness", "N/m"), ("damping", "N s/m"))),
    ValueRow("Joint", "target", "m", ANY, varies=True, needs=("driven",), fit=PLAIN, gradient="body"),
    ValueRow("Joint", "speed", "m/s", ANY, varies=True, needs=("driven",), why="no recording knows it yet; take target"),
    ValueRow("Actuator", "control", "1", ANY, varies=True, needs=("actuated",),
             usd=UsdAttribute("WsimActuatorAPI", "wsim:control"), why="no recording knows it yet; take target of a drive"),
    ValueRow("Body", "density", "kg/m^3", POSITIVE, live=False, why=f"{FIXED}; take mass"),

    *(ValueRow("Fluid", name, unit, ANY, usd=UsdAttribute(DOMAIN, f"wsim:fluid:{name}"), fit=ThetaMap("plain", high=high),
               gradient="fluid")
      for name, unit, high in (("lift", "1/K", 0.01), ("weight", "1", 1.0))),
    *(ValueRow("Fluid", name, "1/s", usd=UsdAttribute(DOMAIN, f"wsim:fluid:{called}"), fit=LOG, gradient="fluid")
      for name, called in (
        ("smoke_decay", "smokeDecay"), ("cooling", "cooling"))),
    *(ValueRow("Fluid", name, unit, needs=("start",), usd=UsdAttribute(DOMAIN, f"wsim:fluid:{name}"), fit=LOG, gradient="fluid")
      for name, unit in (("vorticity", "1"), ("viscosity", "m^2/s"))),
    *(ValueRow("Fluid", name, unit, ANY, "array", live=False, gradient="fluid") for name, unit in (
        ("velocity", "m/s"), ("smoke", "1"), ("temperature", "K"))),
    ValueRow("Fluid", "side_velocities", "m/s", ANY, "array", gradient="fluid"),
    ValueRow("Fluid", "acceleration", "m/s^2", ANY, "array", needs=("start",), gradient="fluid"),
    *(ValueRow("Fluid", name, unit, POSITIVE, live=False, why=AIRY, usd=UsdAttribute(DOMAIN, f"wsim:fluid:{called}"))
      for name, called, unit in (("cell", "cellSize", "m"), ("density", "density", "kg/m^3"), ("tolerance", "tolerance", "1"),
                                 ("cfl", "cfl", "1"))),
    *(ValueRow("Source", name, unit, ANY, usd=UsdAttribute(SOURCE, f"wsim:fluid:{name}"), fit=PLAIN, gradient="fluid")
      for name, unit in (
        ("smoke", "1/s"), ("temperature", "K/s"), ("expansion", "1/s"))),
    *(ValueRow("Source", name, unit, ANY, "vector", fit=ThetaMap("plain"), gradient="fluid") for name, unit in (
        ("velocity", "m/s"), ("place", "m"))),
    ValueRow("Source", "strength", "1", ANY, "factor", fit=ThetaMap("plain"), gradient="fluid"),
    *(ValueRow("Liquid", name, unit, POSITIVE, live=False, why=AIRY, usd=UsdAttribute(LIQUID, f"wsim:liquid:{called}"))
      for name, called, unit in (("cell", "cellSize", "m"), ("density", "density", "kg/m^3"), ("tolerance", "tolerance", "1"),
                                 ("cfl", "cfl", "1"))),
    ValueRow("Liquid", "flip", "1", ValueRange(high=1.0, closed=True), live=False, why=AIRY,
             usd=UsdAttribute(LIQUID, "wsim:liquid:flip")),

    *(ValueRow("MaterialPoints", name, unit, where, needs=needs, fit=fit, gradient="grains")
      for name, unit, where, needs, fit in (
        ("young", "Pa", POSITIVE, (), LOG), ("poisson", "1", RATIO, (), HALF), ("density", "kg/m^3", POSITIVE, (), LOG),
        ("viscosity", "Pa s", ValueRange(), ("start",), LOG), ("bulk", "Pa", POSITIVE, (), LOG),
        ("exponent", "1", ValueRange(1.0, True), (), None), ("friction_angle", "rad", ValueRange(high=0.5 * pi), (), STEEP),
        ("cohesion", "Pa", ValueRange(), ("start",), LOG), ("compression_limit", "1", ValueRange(), (), LOG),
        ("tension_limit", "1", ValueRange(), (), LOG), ("hardening", "1", ValueRange(), (), LOG))),
    *(ValueRow("MaterialPoints", name, unit, ANY, "array", live=False, gradient="grains") for name, unit in (
        ("positions", "m"), ("velocities", "m/s"))),

    ValueRow("Cloth", "thickness", "m", POSITIVE, live=False, usd=UsdAttribute(OWN, "wsim:thickness"), why=FIXED),
    *(ValueRow("Cloth", name, "1", live=False, usd=UsdAttribute(FLAT, f"wsim:{name}"),
               why=f"{FIXED}, and no input; take air_coefficient()")
      for name in ("drag", "lift")),
    ValueRow("Cloth", "normal_drag", "kg/(m^2 s)", live=False, usd=UsdAttribute(OWN, "wsim:normalDrag"),
             why=f"{FIXED}, and no input; take air_coefficient()"),
    ValueRow("Cloth", "weld", "m", live=False, usd=UsdAttribute(FLAT, "wsim:weld", uniform=True),
             why="it says which points are one"),
    ValueRow("Springs", "radius", "m", live=False, usd=UsdAttribute("WsimSpringsAPI", "wsim:radius"), why=FIXED),
    *(ValueRow("Clusters", name, unit, ValueRange(strict=name == "spacing", endless=name in ("spacing", "yield_strain",
                                                                                         "max_strain")),
               live=False, usd=UsdAttribute(HELD, f"wsim:{usd}", uniform=name in ("spacing", "overlap")), why=FIXED)
      for name, usd, unit in (("spacing", "clusterSpacing", "m"), ("overlap", "clusterOverlap", "1"), ("creep", "creep", "1/s"),
                              ("yield_strain", "yieldStrain", "1"), ("max_strain", "maxStrain", "1"),
                              ("radius", "radius", "m"))),
    ValueRow("Clusters", "mass", "kg", POSITIVE, live=False, why=FIXED, mend="author physics:mass"),
    ValueRow("Pin", "stiffness", "N/m", ValueRange(strict=True, endless=True), live=False,
             usd=UsdAttribute("PhysicsAttachment", "physics:stiffness", "float"), why=f"{FIXED}, and no input; take pin()",
             mend="author physics:stiffness; inf for a hard pin"),
    ValueRow("Pin", "damping", "N s/m", live=False, usd=UsdAttribute("PhysicsAttachment", "physics:damping", "float"),
             why=f"{FIXED}, and no input; take pin()"),
    ValueRow("Scene", "air_density", "kg/m^3", live=False, usd=UsdAttribute(AIR, "wsim:airDensity"), why=FIXED),
    ValueRow("Scene", "contact_width", "m", live=False, usd=UsdAttribute(AIR, "wsim:contactWidth"), why=FIXED),
    ValueRow("Scene", "contact_tolerance", "m/s", live=False, usd=UsdAttribute(AIR, "wsim:contactTolerance"), why=FIXED),
    ValueRow("Scene", "sleep_speed", "m/s", live=False, usd=UsdAttribute(AIR, "wsim:sleepSpeed"), why=FIXED),
    ValueRow("Scene", "error", "1", POSITIVE, live=False, usd=UsdAttribute(AIR, "wsim:error", uniform=True),
             why="no motion follows from it", mend="give 0.01 for 1 % of the scene's size"),
]


def values_of_class(owner: str) -> dict[str, ValueRow]:
    """All values of a class, by name."""
    return {row.name: row for row in VALUES if row.owner == owner}


def find_value_row(owner: str, name: str) -> ValueRow | None:
    """The row of a value; of a body that of the whole scene where one body may have its own."""
    row = values_of_class(owner).get(name)
    if row is None and owner in BODIES:
        whole = values_of_class("Scene").get(name)
        return whole if whole and whole.local else None
    return row


def live_value_names(owner: str) -> list[str]:
    """Names that `Simulation.set` takes of a class; of "" those of all classes."""
    return list(dict.fromkeys(row.name for row in VALUES if row.live and (owner in ("", row.owner)
                                                                         or (row.local and owner in BODIES))))


def gradient_input_names(owner: str) -> list[str]:
    """Names of a class that recordings are differentiated with respect to."""
    return [row.name for row in VALUES if row.gradient and row.owner == owner]


def varying_value_names(owner: str) -> list[str]:
    """Names of a class that may vary in time."""
    return [row.name for row in VALUES if row.varies and row.owner == owner]


def limits_explicit_steps(name: str) -> bool:
    """True if explicit steps are bounded by a value of that name."""
    return any(row.stiffens for row in VALUES if row.name == name)


def validate_material_numbers(owner: str, holder) -> None:
    """Raises ValueError for the first number of a material that its bounds do not allow."""
    for row in number_rows(owner):
        if hasattr(holder, row.name) and (wrong := row.range.wrong(row.name, getattr(holder, row.name), True)):
            raise ValueError(wrong)


def number_rows(owner: str) -> Iterator[ValueRow]:
    """Rows of single numbers of a class, which have bounds."""
    return (row for row in VALUES if row.owner == owner and row.form == "number")
