"""Every name that wsim reads from a stage or writes to one, in one table; names of values are in their rows
(`wsim.scene.values.table`).

A row says which schema owns an attribute, its USD type, its unit, and the field of the scene that it carries; load
and save both go through these rows, so that a name of the deformable proposal that changes is changed here alone.
Names in `physics:` are those of UsdPhysics and of the deformable proposal of the Alliance for OpenUSD physics group
(OpenUSD-proposals, pull request 111, revision of summer 2026); names in `wsim:` are described in schema/.
"""

from dataclasses import dataclass

from wsim.scene.values import table

# Schemas of the deformable proposal, which no OpenUSD release registers yet.
BODY = "PhysicsDeformableBodyAPI"
SURFACE_SIM = "PhysicsSurfaceDeformableSimAPI"
CURVES_SIM = "PhysicsCurvesDeformableSimAPI"
VOLUME_SIM = "PhysicsVolumeDeformableSimAPI"
SURFACE_MATERIAL = table.SHEET
CURVES_MATERIAL = "PhysicsCurvesDeformableMaterialAPI"
VOLUME_MATERIAL = table.SOLID
POSE, ATTACHMENT = "PhysicsDeformablePoseAPI", "PhysicsAttachment"       # the first applied by name: POSE:<name>
ELEMENT_FILTER = "PhysicsElementCollisionFilter"
COLLISION_GROUP, FILTERED_PAIRS, FILTERED = "PhysicsCollisionGroup", "PhysicsFilteredPairsAPI", "physics:filteredPairs"

# Schemas of UsdPhysics.
PHYSICS_SCENE = "PhysicsScene"
COLLISION, MESH_COLLISION = "PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"
RIGID_BODY, MASS, FIXED_JOINT = "PhysicsRigidBodyAPI", "PhysicsMassAPI", "PhysicsFixedJoint"
JOINTS_ADD = "newton:jointsAddMobility"
MATERIAL = table.RUB
BINDING = "MaterialBindingAPI"

# Schemas of wsim, registered from schema/.
WSIM_SCENE, WSIM_CLOTH, WSIM_MATERIAL = table.AIR, table.FLAT, table.OWN
WSIM_SPRINGS, WSIM_COLLIDER, WSIM_SOFT = "WsimSpringsAPI", "WsimColliderAPI", "WsimSoftAPI"
WSIM_ATTACHMENT, WSIM_LOAD, WSIM_RIGID = "WsimAttachmentAPI", "WsimLoadAPI", "WsimRigidBodyAPI"
ACTUATORS, WSIM_ACTUATOR, WSIM_JOINT = ("MjcActuator", "NewtonActuator"), "WsimActuatorAPI", "WsimJointAPI"
WSIM_SHAPES, WSIM_DOMAIN, WSIM_SOURCE, WSIM_LIQUID, WSIM_POUR = table.HELD, table.DOMAIN, table.SOURCE, table.LIQUID, table.POUR
NEWTON_POINTS, NEWTON_MATERIAL, NEWTON_MPM_SCENE = "NewtonPointsDeformableSimAPI", "NewtonMPMMaterialAPI", "NewtonMPMSceneAPI"
WSIM_RODS, WSIM_GRAINS, WSIM_DRAIN, PHYSX_SET = ("WsimRodsAPI", "WsimMaterialPointsAPI", "WsimMaterialSinkAPI",
                                                 "PhysxParticleSetAPI")
WSIM_SKELETON, WSIM_CORRECTIVE, WSIM_PARTICLES = "WsimSkeletonAPI", "WsimCorrectiveAPI", "WsimParticlesAPI"

# Fallbacks of the proposal, in SI units; the schemas are not registered, so USD cannot supply them.
YOUNGS_MODULUS, POISSONS_RATIO = 1.0e6, 0.3      # [Pa], [1]
THICKNESS, DENSITY = 1.0e-3, 1.0e3      # [m], [kg/m^3]
GRAVITY = 9.81              # [m/s^2]

# Powers of (length, mass) in each unit; time is in seconds on every stage.
UNITS = {
    "1": (0, 0), "s": (0, 0), "1/s": (0, 0), "rad": (0, 0), "rad/s": (0, 0), "m": (1, 0), "m/s": (1, 0), "m/s^2": (1, 0),
    "kg": (0, 1), "kg/m^3": (-3, 1), "N": (1, 1), "N/m": (0, 1), "N m": (2, 1), "N m^2": (3, 1), "N s/m": (0, 1), "Pa": (-1, 1),
    "K": (0, 0), "K/s": (0, 0), "1/K": (0, 0), "m^2/s": (2, 0), "kg m^2": (2, 1),
    "1/s^2": (0, 0), "kg/(m^2 s)": (-2, 1), "Pa s": (-1, 1), "m^3": (3, 0), "kg/s": (0, 1),
}


@dataclass(frozen=True)
class AttributeEntry:
    """`attribute` of `schema`, of USD type `type`, in `unit`, carries `field` of a scene's `owner`."""

    owner: str
    field: str
    schema: str
    attribute: str
    type: str
    unit: str = "1"
    uniform: bool = False


OTHERS = (
    AttributeEntry("Scene", "direction", PHYSICS_SCENE, "physics:gravityDirection", "vector3f"),
    AttributeEntry("Scene", "magnitude", PHYSICS_SCENE, "physics:gravityMagnitude", "float", "m/s^2"),
    AttributeEntry("Scene", "substeps", WSIM_SCENE, "wsim:substeps", "int", uniform=True),
    AttributeEntry("Scene", "iterations", WSIM_SCENE, "wsim:iterations", "int", uniform=True),
    AttributeEntry("Scene", "solver", WSIM_SCENE, "wsim:solver", "token", uniform=True),
    AttributeEntry("Scene", "integrator", WSIM_SCENE, "wsim:integrator", "token", uniform=True),
    AttributeEntry("Scene", "coordinates", WSIM_SCENE, "wsim:coordinates", "token", uniform=True),
    AttributeEntry("Scene", "contact_model", WSIM_SCENE, "wsim:contactModel", "token", uniform=True),

    AttributeEntry("Bulk", "model", WSIM_MATERIAL, "wsim:elasticModel", "token", uniform=True),

    AttributeEntry("Elastic", "young", SURFACE_MATERIAL, "physics:youngsModulus", "float", "Pa"),
    AttributeEntry("Elastic", "curve_stretch", CURVES_MATERIAL, "physics:curvesStretchStiffness", "float", "N"),

    AttributeEntry("Friction", "density", MATERIAL, "physics:density", "float", "kg/m^3"),

    AttributeEntry("Body", "mass", BODY, "physics:mass", "float", "kg"),
    AttributeEntry("Body", "density", BODY, "physics:density", "float", "kg/m^3"),
    AttributeEntry("Body", "enabled", BODY, "physics:bodyEnabled", "bool"),
    AttributeEntry("Body", "kinematic", BODY, "physics:kinematicEnabled", "bool"),

    AttributeEntry("Cloth", "points", "Mesh", "points", "point3f[]", "m"),
    AttributeEntry("Cloth", "counts", "Mesh", "faceVertexCounts", "int[]"),
    AttributeEntry("Cloth", "indices", "Mesh", "faceVertexIndices", "int[]"),
    AttributeEntry("Cloth", "velocities", "Mesh", "velocities", "vector3f[]", "m/s"),
    AttributeEntry("Cloth", "rest_points", SURFACE_SIM, "physics:restShapePoints", "point3f[]", "m"),
    AttributeEntry("Cloth", "masses", SURFACE_SIM, "physics:masses", "float[]", "kg"),
    AttributeEntry("Cloth", "thicknesses", SURFACE_SIM, "physics:thicknesses", "float[]", "m"),
    AttributeEntry("Cloth", "model", WSIM_CLOTH, "wsim:model", "token", uniform=True),
    AttributeEntry("Cloth", "tethers", WSIM_CLOTH, "wsim:tethers", "bool", uniform=True),
    AttributeEntry("Cloth", "self_collision", WSIM_CLOTH, "wsim:selfCollision", "bool", uniform=True),

    AttributeEntry("Elements", "masses", SURFACE_SIM, "physics:masses:elementType", "token", uniform=True),
    AttributeEntry("Elements", "thicknesses", SURFACE_SIM, "physics:thicknesses:elementType", "token", uniform=True),
    AttributeEntry("Elements", "rest_angles", SURFACE_SIM, "physics:restBendAnglesDefault", "token", uniform=True),

    AttributeEntry("Soft", "points", "TetMesh", "points", "point3f[]", "m"),
    AttributeEntry("Soft", "tets", "TetMesh", "tetVertexIndices", "int4[]"),
    AttributeEntry("Soft", "surface", "TetMesh", "surfaceFaceVertexIndices", "int3[]"),
    AttributeEntry("Soft", "orientation", "TetMesh", "orientation", "token", uniform=True),
    AttributeEntry("Soft", "velocities", "TetMesh", "velocities", "vector3f[]", "m/s"),
    AttributeEntry("Soft", "rest_points", VOLUME_SIM, "physics:restShapePoints", "point3f[]", "m"),
    AttributeEntry("Soft", "rest_tets", VOLUME_SIM, "physics:restTetVertexIndices", "int4[]"),
    AttributeEntry("Soft", "masses", VOLUME_SIM, "physics:masses", "float[]", "kg"),
    AttributeEntry("Soft", "masses_of", VOLUME_SIM, "physics:masses:elementType", "token", uniform=True),
    AttributeEntry("Soft", "quadratic", WSIM_SOFT, "wsim:quadratic", "bool", uniform=True),
    AttributeEntry("Soft", "filled", WSIM_SOFT, "wsim:filled", "float[]"),
    AttributeEntry("Soft", "self_collision", WSIM_SOFT, "wsim:selfCollision", "bool", uniform=True),

    AttributeEntry("Part", "tets", "GeomSubset", "indices", "int[]"),
    *(AttributeEntry("Part", name, "GeomSubset", usd, "token", uniform=True) for name, usd in (
        ("kind", "elementType"), ("family", "familyName"))),
    AttributeEntry("Pose", "points", f"{POSE}:bind", "physics:deformablePose:bind:points", "point3f[]", "m"),
    AttributeEntry("Pose", "purposes", f"{POSE}:bind", "physics:deformablePose:bind:purposes", "token[]", uniform=True),

    AttributeEntry("Springs", "points", "BasisCurves", "points", "point3f[]", "m"),
    AttributeEntry("Springs", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    AttributeEntry("Springs", "velocities", "BasisCurves", "velocities", "vector3f[]", "m/s"),
    AttributeEntry("Springs", "particles", WSIM_SPRINGS, "wsim:particles", "int[]", uniform=True),
    AttributeEntry("Springs", "masses", WSIM_SPRINGS, "wsim:masses", "float[]", "kg"),
    AttributeEntry("Springs", "muscles", WSIM_SPRINGS, "wsim:muscles", "int[]", uniform=True),

    *(AttributeEntry("Clusters", name, place, usd, kind, unit, kind in ("int[]", "bool") and place == WSIM_SHAPES)
      for name, place, usd, kind, unit in (row.split() for row in (
        "points Mesh points point3f[] m", "counts Mesh faceVertexCounts int[] 1", "indices Mesh faceVertexIndices int[] 1",
        "velocities Mesh velocities vector3f[] m/s", f"rest_points {WSIM_SHAPES} wsim:restPoints point3f[] m",
        *(f"{name} {WSIM_SHAPES} wsim:{usd}" for name, usd in (
          ("masses", "masses float[] kg"), ("sizes", "clusterSizes int[] 1"), ("members", "clusterMembers int[] 1"),
          ("self_collision", "selfCollision bool 1")))))),
    AttributeEntry("Rods", "points", "BasisCurves", "points", "point3f[]", "m"),
    AttributeEntry("Rods", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    AttributeEntry("Rods", "velocities", "BasisCurves", "velocities", "vector3f[]", "m/s"),
    AttributeEntry("Rods", "directors", "BasisCurves", "normals", "normal3f[]"),
    AttributeEntry("Rods", "rest_points", CURVES_SIM, "physics:restShapePoints", "point3f[]", "m"),
    AttributeEntry("Rods", "rest_directors", CURVES_SIM, "physics:restNormals", "normal3f[]"),
    AttributeEntry("Rods", "diameters", CURVES_SIM, "physics:thicknesses", "float[]", "m"),
    AttributeEntry("Rods", "masses", CURVES_SIM, "physics:masses", "float[]", "kg"),
    AttributeEntry("Rods", "self_collision", WSIM_RODS, "wsim:selfCollision", "bool", uniform=True),
    AttributeEntry("Rods", "drag", WSIM_RODS, "wsim:drag", "double"),
    AttributeEntry("Rods", "skin_drag", WSIM_RODS, "wsim:skinDrag", "double"),
    AttributeEntry("Followers", "points", "BasisCurves", "points", "point3f[]", "m"),
    AttributeEntry("Followers", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    AttributeEntry("RodMaterial", "young", CURVES_MATERIAL, "physics:youngsModulus", "float", "Pa"),
    AttributeEntry("RodMaterial", "poisson", CURVES_MATERIAL, "physics:poissonsRatio", "float"),
    AttributeEntry("RodMaterial", "stretch", CURVES_MATERIAL, "physics:curvesStretchStiffness", "float", "N"),
    AttributeEntry("RodMaterial", "bend", CURVES_MATERIAL, "physics:curvesBendStiffness", "float", "N m^2"),
    AttributeEntry("RodMaterial", "damping", WSIM_MATERIAL, "wsim:damping", "double", "s"),
    AttributeEntry("RodMaterial", "twist", CURVES_MATERIAL, "physics:curvesTwistStiffness", "float", "N m^2"),

    AttributeEntry("RigidBody", "force", WSIM_RIGID, "wsim:force", "vector3d", "N"),
    AttributeEntry("RigidBody", "torque", WSIM_RIGID, "wsim:torque", "vector3d", "N m"),
    AttributeEntry("RigidBody", "drag", WSIM_RIGID, "wsim:linearDamping", "double", "1/s"),
    AttributeEntry("RigidBody", "spin_drag", WSIM_RIGID, "wsim:angularDamping", "double", "1/s"),
    AttributeEntry("Actuator", "axis", WSIM_ACTUATOR, "wsim:axis", "token", uniform=True),
    AttributeEntry("Joint", "hinges", WSIM_JOINT, "wsim:hinges", "vector3d[]", "m", uniform=True),

    AttributeEntry("Skeleton", "driven", WSIM_SKELETON, "wsim:skel:bodyJoints", "token[]", uniform=True),
    AttributeEntry("Corrective", "joint", WSIM_CORRECTIVE, "wsim:corrective:joint", "token", uniform=True),
    AttributeEntry("Corrective", "rotation", WSIM_CORRECTIVE, "wsim:corrective:rotation", "quatf", uniform=True),
    AttributeEntry("Corrective", "width", WSIM_CORRECTIVE, "wsim:corrective:width", "float", uniform=True),

    AttributeEntry("Fluid", "sides", WSIM_DOMAIN, "wsim:fluid:sides", "token[]", uniform=True),
    AttributeEntry("Fluid", "side_velocities", WSIM_DOMAIN, "wsim:fluid:sideVelocities", "vector3d[]", "m/s", uniform=True),
    *(AttributeEntry("Fluid", name, WSIM_DOMAIN, f"wsim:fluid:{usd}", kind, uniform=True) for name, usd, kind in (
        ("slip", "slip", "bool"), ("layers", "layers", "bool"), ("advection", "advection", "token"),
        ("scalar_advection", "scalarAdvection", "token"), ("pressure", "pressure", "token"), ("steps", "steps", "int"),
        ("margin", "margin", "double"), ("conserve", "conserve", "bool"), ("most_steps", "mostSteps", "int"))),
    AttributeEntry("Fluid", "velocity", WSIM_DOMAIN, "wsim:fluid:startVelocity", "vector3f[]", "m/s"),
    AttributeEntry("Fluid", "smoke", WSIM_DOMAIN, "wsim:fluid:startSmoke", "float[]"),
    AttributeEntry("Fluid", "temperature", WSIM_DOMAIN, "wsim:fluid:startTemperature", "float[]"),
    AttributeEntry("Fluid", "acceleration", WSIM_DOMAIN, "wsim:fluid:acceleration", "vector3f[]", "m/s^2"),
    AttributeEntry("Source", "hold", WSIM_SOURCE, "wsim:fluid:hold", "bool", uniform=True),
    AttributeEntry("Source", "velocity", WSIM_SOURCE, "wsim:fluid:velocity", "vector3d", "m/s"),
    AttributeEntry("Source", "strength", WSIM_SOURCE, "wsim:fluid:strength", "double"),
    AttributeEntry("Liquid", "sides", WSIM_LIQUID, "wsim:liquid:sides", "token[]", uniform=True),
    AttributeEntry("Liquid", "transfer", WSIM_LIQUID, "wsim:liquid:transfer", "token", uniform=True),
    AttributeEntry("Liquid", "volume", WSIM_LIQUID, "wsim:liquid:keepVolume", "bool", uniform=True),
    AttributeEntry("Liquid", "steps", WSIM_LIQUID, "wsim:liquid:steps", "int", uniform=True),
    AttributeEntry("Liquid", "most_steps", WSIM_LIQUID, "wsim:liquid:mostSteps", "int", uniform=True),
    AttributeEntry("LiquidSource", "role", WSIM_POUR, "wsim:liquid:role", "token", uniform=True),
    AttributeEntry("LiquidSource", "velocity", WSIM_POUR, "wsim:liquid:velocity", "vector3d", "m/s"),
    AttributeEntry("LiquidSource", "strength", WSIM_POUR, "wsim:liquid:strength", "double"),
    *(AttributeEntry("MaterialPoints", name, WSIM_GRAINS, f"wsim:mpm:{usd}", kind, unit, kind == "token")
      for name, usd, kind, unit in (row.split(" ", 3) for row in (
        "cell cellSize double m", "material material token 1", "velocity velocity vector3d m/s", "spin spin vector3d rad/s",
        "volumes volumes double[] m^3", "density density double kg/m^3", "viscosity viscosity double Pa s",
        "young youngsModulus double Pa", "poisson poissonsRatio double 1", "model model token 1", "bulk bulkModulus double Pa",
        "exponent exponent double 1", "tension bearsTension bool 1", "compression_limit compressionLimit double 1",
        "tension_limit tensionLimit double 1", "hardening hardening double 1", "friction_angle frictionAngle double rad",
        "cohesion cohesion double Pa", "cone cone token 1", "integrator integrator token 1", "drag drag double 1",
        "pour_start pourStart double 1", "pour_end pourEnd double 1", "pour_rate pourRate double kg/s"))),
    *(AttributeEntry("Particles", name, schema, prefix + usd, kind, unit, kind == "token") for schema, prefix, rows in (
        ("Points", "", "points points point3f[] m|velocities velocities vector3f[] m/s|widths widths float[] m"),
        (WSIM_PARTICLES, "wsim:particles:", "material material token 1|radius radius double m|density density double kg/m^3|"
         "static_friction staticFriction double 1|dynamic_friction dynamicFriction double 1|rolling_friction rollingFriction "
         "double 1|viscosity viscosity double Pa s|smoothing smoothing double 1|surface_tension surfaceTension double N/m|vel"
         "ocity velocity vector3d m/s|pour_start pourStart double 1|pour_end pourEnd double 1|pour_rate pourRate double kg/s"))
      for name, usd, kind, unit in (row.split(" ", 3) for row in rows.split("|"))),
    AttributeEntry("Pin", "enabled", ATTACHMENT, "physics:attachmentEnabled", "bool"),
    AttributeEntry("Pin", "type0", ATTACHMENT, "physics:type0", "token", uniform=True),
    AttributeEntry("Pin", "type1", ATTACHMENT, "physics:type1", "token", uniform=True),
    AttributeEntry("Pin", "points", ATTACHMENT, "physics:indices0", "int[]"),
    AttributeEntry("Pin", "places", ATTACHMENT, "physics:coords1", "vector3f[]", "m"),
    AttributeEntry("Tie", "points", ATTACHMENT, "physics:indices0", "int[]"),
    AttributeEntry("Tie", "others", ATTACHMENT, "physics:indices1", "int[]"),
    AttributeEntry("Pin", "reaction", WSIM_ATTACHMENT, "wsim:reaction", "vector3f[]", "N"),
    AttributeEntry("Pin", "reaction_noise", WSIM_ATTACHMENT, "wsim:reactionNoise", "float", "N"),
    AttributeEntry("Pin", "reaction_weights", WSIM_ATTACHMENT, "wsim:reactionWeights", "float[]"),

    AttributeEntry("Load", "points", WSIM_LOAD, "wsim:load:points", "int[]", uniform=True),
    AttributeEntry("Load", "weights", WSIM_LOAD, "wsim:load:weights", "float[]", uniform=True),
    AttributeEntry("Load", "triangles", WSIM_LOAD, "wsim:load:triangles", "int3[]", uniform=True),
)


def value_attribute_entries() -> list[AttributeEntry]:
    """Rows of the table of values; those of a material are of its class, `HOLDERS`."""
    found = {}
    for value in table.VALUES:
        if usd := value.usd:
            owner = HOLDERS.get(value.owner, value.owner) if usd.schema in table.MATERIALS else value.owner
            found[owner, value.name] = AttributeEntry(owner, value.name, usd.schema, usd.attribute, usd.type, value.unit,
                                                      usd.uniform)
    return list(found.values())


HOLDERS = {"Cloth": "Fabric", "Soft": "Bulk", "Springs": "Friction", "Clusters": "Friction", "Collider": "Friction"}
TABLE = (*OTHERS, *value_attribute_entries())
# primvars wsim:<name> of values with one number for each element, and their units (`wsim.usd.result.fields`)
PER_TET = {v.name: v.unit for v in table.values_of_class("Soft").values() if v.each and v.form == "number"}
PER_ELEMENT = {v.name: v.unit for v in table.values_of_class("Cloth").values() if v.each and v.form == "number"}
SRC0, SRC1 = "physics:src0", "physics:src1"                     # relationships of an attachment
STEPS_HINT = "newton:timeStepsPerSecond"                        # read where wsim:substeps is not authored
INTO = "wsim:fluid:domain"                                       # relationship of WsimFluidSourceAPI: one domain; none: all
POURED = "wsim:liquid:domain"                                    # relationship of WsimLiquidSourceAPI: one domain; none: all
DRIVERS = "wsim:skel:bodies"                                     # relationship of WsimSkeletonAPI: rigid bodies
GUIDES = "wsim:guides"                                           # relationship of WsimRodsAPI: the rods that curves follow
LOADED = "wsim:load:body"                                        # relationship of WsimLoadAPI: the body
ORDER = "wsim:order"                                             # relationship of WsimSceneAPI: objects in their order

# Names of UsdPhysics and of the proposal that stand on such prims and are not read, or not by a row.
UNREAD = (
    SRC0, SRC1, FILTERED, "physics:coords0", "physics:collisionEnabled", "physics:approximation", "physics:simulationOwner",
    "physics:startsAsleep", "physics:restTriVertexIndices", "physics:restAdjTriPairs",
    "physics:restBendAngles", "physics:curvesShearStiffness",
)

_ROWS = {(row.owner, row.field): row for row in TABLE}


def attribute_entry(owner: str, field: str) -> AttributeEntry:
    """The row of one field. KeyError if neither this table nor that of values has one."""
    if (owner, field) not in _ROWS:
        return {(entry.owner, entry.field): entry for entry in value_attribute_entries()}[owner, field]
    return _ROWS[owner, field]


def schema_fields(owner: str, schema: str = "") -> list[str]:
    """Fields of an owner that are values, of one schema or of all, in the order of their table."""
    return [entry.field for entry in value_attribute_entries() if entry.owner == owner and schema in ("", entry.schema)]


# Older and foreign spellings: what is found -> what the current revision calls it. They are reported, not read.
FOREIGN_ATTRIBUTES = {
    "physics:stretchStiffness": "physics:surfaceStretchStiffness (force/length: the old value times the thickness)",
    "physics:shearStiffness": "physics:surfaceShearStiffness (force/length: the old value times the thickness)",
    "physics:bendStiffness": "physics:surfaceBendStiffness (force * length: the old value times the thickness cubed)",
    "physics:twistStiffness": "physics:curvesTwistStiffness",
    "physics:thickness": "physics:thicknesses on the simulation mesh, with physics:thicknesses:elementType = constant",
    "physics:restTetVtxIndices": "physics:restTetVertexIndices", "physics:restTriVtxIndices": "physics:restTriVertexIndices",
    "physics:surfaceThickness": "physics:thicknesses on the simulation mesh, with elementType = constant",
}
FOREIGN_SCHEMAS = {
    "OmniPhysicsDeformableBodyAPI": BODY, "OmniPhysicsSurfaceDeformableSimAPI": SURFACE_SIM,
    "OmniPhysicsCurvesDeformableSimAPI": CURVES_SIM,
    "OmniPhysicsVolumeDeformableSimAPI": VOLUME_SIM,
    "OmniPhysicsSurfaceDeformableMaterialAPI": SURFACE_MATERIAL,
    "OmniPhysicsDeformableMaterialAPI": VOLUME_MATERIAL,
    "PhysxParticleClothAPI": f"{BODY} and {SURFACE_SIM}",
    "PhysxDeformableSurfaceAPI": f"{BODY} and {SURFACE_SIM}",
    "PhysxDeformableBodyAPI": f"{BODY} and {VOLUME_SIM}",
    "PhysxDeformableBodyMaterialAPI": VOLUME_MATERIAL,
}
FOREIGN_TYPES = ("OmniPhysics", "PhysxPhysics")         # prims: OmniPhysicsVtxXformAttachment and its like
FOREIGN_PREFIXES = {"omniphysics:": "physics:", "physxDeformable:": "physics:"}

# Schemas of what wsim does not simulate, and what that is.
FEATURES = {"PhysxVehicleAPI": "the vehicles of PhysX", "MjcTendon": "tendons of MuJoCo"}
