"""Every name that wsim reads from a stage or writes to one, in one table; names of values are in their rows
(`wsim.scene.values.table`).

A row says which schema owns an attribute, its USD type, its unit, and the field of the scene that it carries; load
and save both go through these rows, so that a name of the deformable proposal that changes is changed here alone.
Names in `physics:` are those of UsdPhysics and of the deformable proposal of the Alliance for OpenUSD physics group
(OpenUSD-proposals, pull request 111, revision of summer 2026); names in `wsim:` are described in schema/.
"""

from dataclasses import dataclass
from math import inf

from wsim.scene.values import table

# Schemas of the deformable proposal, which no OpenUSD release registers yet.
BODY = "PhysicsDeformableBodyAPI"
SURFACE_SIM = "PhysicsSurfaceDeformableSimAPI"
CURVES_SIM = "PhysicsCurvesDeformableSimAPI"
VOLUME_SIM = "PhysicsVolumeDeformableSimAPI"
SURFACE_MATERIAL = table.SHEET
CURVES_MATERIAL = "PhysicsCurvesDeformableMaterialAPI"
VOLUME_MATERIAL = table.SOLID
POSE = "PhysicsDeformablePoseAPI"       # applied by name: POSE:<name>
ATTACHMENT = "PhysicsAttachment"
ELEMENT_FILTER = "PhysicsElementCollisionFilter"
COLLISION_GROUP, FILTERED_PAIRS, FILTERED = "PhysicsCollisionGroup", "PhysicsFilteredPairsAPI", "physics:filteredPairs"

# Schemas of UsdPhysics.
PHYSICS_SCENE = "PhysicsScene"
COLLISION = "PhysicsCollisionAPI"
MESH_COLLISION = "PhysicsMeshCollisionAPI"
RIGID_BODY, MASS, FIXED_JOINT = "PhysicsRigidBodyAPI", "PhysicsMassAPI", "PhysicsFixedJoint"
JOINTS_ADD = "newton:jointsAddMobility"
MATERIAL = table.RUB
BINDING = "MaterialBindingAPI"

# Schemas of wsim, registered from schema/.
WSIM_SCENE, WSIM_CLOTH, WSIM_MATERIAL = table.AIR, table.FLAT, table.OWN
WSIM_SPRINGS, WSIM_COLLIDER, WSIM_SOFT = "WsimSpringsAPI", "WsimColliderAPI", "WsimSoftAPI"
WSIM_ATTACHMENT, WSIM_LOAD, WSIM_RIGID = "WsimAttachmentAPI", "WsimLoadAPI", "WsimRigidBodyAPI"
WSIM_DOMAIN, WSIM_SOURCE = table.DOMAIN, table.SOURCE
WSIM_LIQUID, WSIM_POUR = table.LIQUID, table.POUR
WSIM_RODS = "WsimRodsAPI"
WSIM_SKELETON, WSIM_CORRECTIVE = "WsimSkeletonAPI", "WsimCorrectiveAPI"

# Fallbacks of the proposal, in SI units; the schemas are not registered, so USD cannot supply them.
YOUNGS_MODULUS = 1.0e6      # [Pa]
POISSONS_RATIO = 0.3
THICKNESS = 1.0e-3          # [m]
DENSITY = 1.0e3             # [kg/m^3]
GRAVITY = 9.81              # [m/s^2]

# Powers of (length, mass) in each unit; time is in seconds on every stage.
UNITS = {
    "1": (0, 0), "s": (0, 0), "1/s": (0, 0), "rad": (0, 0), "rad/s": (0, 0), "m": (1, 0), "m/s": (1, 0), "m/s^2": (1, 0),
    "kg": (0, 1),
    "kg/m^3": (-3, 1), "N": (1, 1), "N/m": (0, 1), "N m": (2, 1), "N m^2": (3, 1), "N s/m": (0, 1), "Pa": (-1, 1),
    "K": (0, 0), "K/s": (0, 0), "1/K": (0, 0), "m^2/s": (2, 0), "kg m^2": (2, 1),
    "kg/(m^2 s)": (-2, 1),
}


@dataclass(frozen=True)
class Entry:
    """`attribute` of `schema`, of USD type `type`, in `unit`, carries `field` of a scene's `owner`."""

    owner: str
    field: str
    schema: str
    attribute: str
    type: str
    unit: str = "1"
    uniform: bool = False


OTHERS = (
    Entry("Scene", "direction", PHYSICS_SCENE, "physics:gravityDirection", "vector3f"),
    Entry("Scene", "magnitude", PHYSICS_SCENE, "physics:gravityMagnitude", "float", "m/s^2"),
    Entry("Scene", "substeps", WSIM_SCENE, "wsim:substeps", "int", uniform=True),
    Entry("Scene", "iterations", WSIM_SCENE, "wsim:iterations", "int", uniform=True),
    Entry("Scene", "solver", WSIM_SCENE, "wsim:solver", "token", uniform=True),
    Entry("Scene", "integrator", WSIM_SCENE, "wsim:integrator", "token", uniform=True),

    Entry("Bulk", "model", WSIM_MATERIAL, "wsim:elasticModel", "token", uniform=True),

    Entry("Elastic", "young", SURFACE_MATERIAL, "physics:youngsModulus", "float", "Pa"),
    Entry("Elastic", "curve_stretch", CURVES_MATERIAL, "physics:curvesStretchStiffness", "float", "N"),

    Entry("Friction", "density", MATERIAL, "physics:density", "float", "kg/m^3"),

    Entry("Body", "mass", BODY, "physics:mass", "float", "kg"),
    Entry("Body", "density", BODY, "physics:density", "float", "kg/m^3"),
    Entry("Body", "enabled", BODY, "physics:bodyEnabled", "bool"),
    Entry("Body", "kinematic", BODY, "physics:kinematicEnabled", "bool"),

    Entry("Cloth", "points", "Mesh", "points", "point3f[]", "m"),
    Entry("Cloth", "counts", "Mesh", "faceVertexCounts", "int[]"),
    Entry("Cloth", "indices", "Mesh", "faceVertexIndices", "int[]"),
    Entry("Cloth", "velocities", "Mesh", "velocities", "vector3f[]", "m/s"),
    Entry("Cloth", "rest_points", SURFACE_SIM, "physics:restShapePoints", "point3f[]", "m"),
    Entry("Cloth", "masses", SURFACE_SIM, "physics:masses", "float[]", "kg"),
    Entry("Cloth", "thicknesses", SURFACE_SIM, "physics:thicknesses", "float[]", "m"),
    Entry("Cloth", "model", WSIM_CLOTH, "wsim:model", "token", uniform=True),
    Entry("Cloth", "tethers", WSIM_CLOTH, "wsim:tethers", "bool", uniform=True),
    Entry("Cloth", "self_collision", WSIM_CLOTH, "wsim:selfCollision", "bool", uniform=True),

    Entry("Elements", "masses", SURFACE_SIM, "physics:masses:elementType", "token", uniform=True),
    Entry("Elements", "thicknesses", SURFACE_SIM, "physics:thicknesses:elementType", "token", uniform=True),
    Entry("Elements", "rest_angles", SURFACE_SIM, "physics:restBendAnglesDefault", "token", uniform=True),

    Entry("Soft", "points", "TetMesh", "points", "point3f[]", "m"),
    Entry("Soft", "tets", "TetMesh", "tetVertexIndices", "int4[]"),
    Entry("Soft", "surface", "TetMesh", "surfaceFaceVertexIndices", "int3[]"),
    Entry("Soft", "orientation", "TetMesh", "orientation", "token", uniform=True),
    Entry("Soft", "velocities", "TetMesh", "velocities", "vector3f[]", "m/s"),
    Entry("Soft", "rest_points", VOLUME_SIM, "physics:restShapePoints", "point3f[]", "m"),
    Entry("Soft", "rest_tets", VOLUME_SIM, "physics:restTetVertexIndices", "int4[]"),
    Entry("Soft", "masses", VOLUME_SIM, "physics:masses", "float[]", "kg"),
    Entry("Soft", "masses_of", VOLUME_SIM, "physics:masses:elementType", "token", uniform=True),
    Entry("Soft", "quadratic", WSIM_SOFT, "wsim:quadratic", "bool", uniform=True),
    Entry("Soft", "filled", WSIM_SOFT, "wsim:filled", "float[]"),
    Entry("Soft", "self_collision", WSIM_SOFT, "wsim:selfCollision", "bool", uniform=True),

    Entry("Part", "tets", "GeomSubset", "indices", "int[]"),
    Entry("Part", "kind", "GeomSubset", "elementType", "token", uniform=True),
    Entry("Part", "family", "GeomSubset", "familyName", "token", uniform=True),

    Entry("Pose", "points", f"{POSE}:bind", "physics:deformablePose:bind:points", "point3f[]", "m"),
    Entry("Pose", "purposes", f"{POSE}:bind", "physics:deformablePose:bind:purposes", "token[]", uniform=True),

    Entry("Springs", "points", "BasisCurves", "points", "point3f[]", "m"),
    Entry("Springs", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    Entry("Springs", "velocities", "BasisCurves", "velocities", "vector3f[]", "m/s"),
    Entry("Springs", "particles", WSIM_SPRINGS, "wsim:particles", "int[]", uniform=True),
    Entry("Springs", "masses", WSIM_SPRINGS, "wsim:masses", "float[]", "kg"),
    Entry("Springs", "muscles", WSIM_SPRINGS, "wsim:muscles", "int[]", uniform=True),

    Entry("Rods", "points", "BasisCurves", "points", "point3f[]", "m"),
    Entry("Rods", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    Entry("Rods", "velocities", "BasisCurves", "velocities", "vector3f[]", "m/s"),
    Entry("Rods", "directors", "BasisCurves", "normals", "normal3f[]"),
    Entry("Rods", "rest_points", CURVES_SIM, "physics:restShapePoints", "point3f[]", "m"),
    Entry("Rods", "rest_directors", CURVES_SIM, "physics:restNormals", "normal3f[]"),
    Entry("Rods", "diameters", CURVES_SIM, "physics:thicknesses", "float[]", "m"),
    Entry("Rods", "masses", CURVES_SIM, "physics:masses", "float[]", "kg"),
    Entry("Rods", "self_collision", WSIM_RODS, "wsim:selfCollision", "bool", uniform=True),
    Entry("Rods", "drag", WSIM_RODS, "wsim:drag", "double"),
    Entry("Rods", "skin_drag", WSIM_RODS, "wsim:skinDrag", "double"),
    Entry("Followers", "points", "BasisCurves", "points", "point3f[]", "m"),
    Entry("Followers", "counts", "BasisCurves", "curveVertexCounts", "int[]"),
    Entry("RodMaterial", "young", CURVES_MATERIAL, "physics:youngsModulus", "float", "Pa"),
    Entry("RodMaterial", "poisson", CURVES_MATERIAL, "physics:poissonsRatio", "float"),
    Entry("RodMaterial", "stretch", CURVES_MATERIAL, "physics:curvesStretchStiffness", "float", "N"),
    Entry("RodMaterial", "bend", CURVES_MATERIAL, "physics:curvesBendStiffness", "float", "N m^2"),
    Entry("RodMaterial", "damping", WSIM_MATERIAL, "wsim:damping", "double", "s"),
    Entry("RodMaterial", "twist", CURVES_MATERIAL, "physics:curvesTwistStiffness", "float", "N m^2"),

    Entry("RigidBody", "force", WSIM_RIGID, "wsim:force", "vector3d", "N"),
    Entry("RigidBody", "torque", WSIM_RIGID, "wsim:torque", "vector3d", "N m"),
    Entry("RigidBody", "drag", WSIM_RIGID, "wsim:linearDamping", "double", "1/s"),
    Entry("RigidBody", "spin_drag", WSIM_RIGID, "wsim:angularDamping", "double", "1/s"),

    Entry("Skeleton", "driven", WSIM_SKELETON, "wsim:skel:bodyJoints", "token[]", uniform=True),
    Entry("Corrective", "joint", WSIM_CORRECTIVE, "wsim:corrective:joint", "token", uniform=True),
    Entry("Corrective", "rotation", WSIM_CORRECTIVE, "wsim:corrective:rotation", "quatf", uniform=True),
    Entry("Corrective", "width", WSIM_CORRECTIVE, "wsim:corrective:width", "float", uniform=True),

    Entry("Fluid", "sides", WSIM_DOMAIN, "wsim:fluid:sides", "token[]", uniform=True),
    Entry("Fluid", "side_velocities", WSIM_DOMAIN, "wsim:fluid:sideVelocities", "vector3d[]", "m/s", uniform=True),
    Entry("Fluid", "slip", WSIM_DOMAIN, "wsim:fluid:slip", "bool", uniform=True),
    Entry("Fluid", "layers", WSIM_DOMAIN, "wsim:fluid:layers", "bool", uniform=True),
    Entry("Fluid", "advection", WSIM_DOMAIN, "wsim:fluid:advection", "token", uniform=True),
    Entry("Fluid", "scalar_advection", WSIM_DOMAIN, "wsim:fluid:scalarAdvection", "token", uniform=True),
    Entry("Fluid", "pressure", WSIM_DOMAIN, "wsim:fluid:pressure", "token", uniform=True),
    Entry("Fluid", "steps", WSIM_DOMAIN, "wsim:fluid:steps", "int", uniform=True),
    Entry("Fluid", "margin", WSIM_DOMAIN, "wsim:fluid:margin", "double", uniform=True),
    Entry("Fluid", "conserve", WSIM_DOMAIN, "wsim:fluid:conserve", "bool", uniform=True),
    Entry("Fluid", "most_steps", WSIM_DOMAIN, "wsim:fluid:mostSteps", "int", uniform=True),
    Entry("Fluid", "velocity", WSIM_DOMAIN, "wsim:fluid:startVelocity", "vector3f[]", "m/s"),
    Entry("Fluid", "smoke", WSIM_DOMAIN, "wsim:fluid:startSmoke", "float[]"),
    Entry("Fluid", "temperature", WSIM_DOMAIN, "wsim:fluid:startTemperature", "float[]"),
    Entry("Fluid", "acceleration", WSIM_DOMAIN, "wsim:fluid:acceleration", "vector3f[]", "m/s^2"),
    Entry("Source", "hold", WSIM_SOURCE, "wsim:fluid:hold", "bool", uniform=True),
    Entry("Source", "velocity", WSIM_SOURCE, "wsim:fluid:velocity", "vector3d", "m/s"),
    Entry("Source", "strength", WSIM_SOURCE, "wsim:fluid:strength", "double"),
    Entry("Liquid", "sides", WSIM_LIQUID, "wsim:liquid:sides", "token[]", uniform=True),
    Entry("Liquid", "transfer", WSIM_LIQUID, "wsim:liquid:transfer", "token", uniform=True),
    Entry("Liquid", "volume", WSIM_LIQUID, "wsim:liquid:keepVolume", "bool", uniform=True),
    Entry("Liquid", "steps", WSIM_LIQUID, "wsim:liquid:steps", "int", uniform=True),
    Entry("Liquid", "most_steps", WSIM_LIQUID, "wsim:liquid:mostSteps", "int", uniform=True),
    Entry("LiquidSource", "role", WSIM_POUR, "wsim:liquid:role", "token", uniform=True),
    Entry("LiquidSource", "velocity", WSIM_POUR, "wsim:liquid:velocity", "vector3d", "m/s"),
    Entry("LiquidSource", "strength", WSIM_POUR, "wsim:liquid:strength", "double"),

    Entry("Pin", "enabled", ATTACHMENT, "physics:attachmentEnabled", "bool"),
    Entry("Pin", "type0", ATTACHMENT, "physics:type0", "token", uniform=True),
    Entry("Pin", "type1", ATTACHMENT, "physics:type1", "token", uniform=True),
    Entry("Pin", "points", ATTACHMENT, "physics:indices0", "int[]"),
    Entry("Pin", "places", ATTACHMENT, "physics:coords1", "vector3f[]", "m"),
    Entry("Tie", "points", ATTACHMENT, "physics:indices0", "int[]"),
    Entry("Tie", "others", ATTACHMENT, "physics:indices1", "int[]"),
    Entry("Pin", "reaction", WSIM_ATTACHMENT, "wsim:reaction", "vector3f[]", "N"),
    Entry("Pin", "reaction_noise", WSIM_ATTACHMENT, "wsim:reactionNoise", "float", "N"),
    Entry("Pin", "reaction_weights", WSIM_ATTACHMENT, "wsim:reactionWeights", "float[]"),

    Entry("Load", "points", WSIM_LOAD, "wsim:load:points", "int[]", uniform=True),
    Entry("Load", "weights", WSIM_LOAD, "wsim:load:weights", "float[]", uniform=True),
    Entry("Load", "triangles", WSIM_LOAD, "wsim:load:triangles", "int3[]", uniform=True),
)


def of_values() -> list[Entry]:
    """Rows of the table of values; those of a material are of its class, `HOLDERS`."""
    found = {}
    for value in table.VALUES:
        if usd := value.usd:
            owner = HOLDERS.get(value.owner, value.owner) if usd.schema in table.MATERIALS else value.owner
            found[owner, value.name] = Entry(owner, value.name, usd.schema, usd.attribute, usd.type, value.unit, usd.uniform)
    return list(found.values())


HOLDERS = {"Cloth": "Fabric", "Soft": "Bulk", "Springs": "Friction", "Collider": "Friction"}
TABLE = (*OTHERS, *of_values())
# primvars wsim:<name> of values with one number for each element, and their units (`wsim.usd.result.fields`)
PER_TET = {v.name: v.unit for v in table.of("Soft").values() if v.each and v.form == "number"}
PER_ELEMENT = {v.name: v.unit for v in table.of("Cloth").values() if v.each and v.form == "number"}
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


def row(owner: str, field: str) -> Entry:
    """The row of one field. KeyError if neither this table nor that of values has one."""
    if (owner, field) not in _ROWS:
        return {(entry.owner, entry.field): entry for entry in of_values()}[owner, field]
    return _ROWS[owner, field]


def fields(owner: str, schema: str = "") -> list[str]:
    """Fields of an owner that are values, of one schema or of all, in the order of their table."""
    return [entry.field for entry in of_values() if entry.owner == owner and schema in ("", entry.schema)]


# Older and foreign spellings: what is found -> what the current revision calls it. They are reported, not read.
FOREIGN_ATTRIBUTES = {
    "physics:stretchStiffness": "physics:surfaceStretchStiffness (force/length: the old value times the thickness)",
    "physics:shearStiffness": "physics:surfaceShearStiffness (force/length: the old value times the thickness)",
    "physics:bendStiffness": "physics:surfaceBendStiffness (force * length: the old value times the thickness cubed)",
    "physics:twistStiffness": "physics:curvesTwistStiffness",
    "physics:thickness": "physics:thicknesses on the simulation mesh, with physics:thicknesses:elementType = constant",
    "physics:restTetVtxIndices": "physics:restTetVertexIndices",
    "physics:restTriVtxIndices": "physics:restTriVertexIndices",
    "physics:surfaceThickness": "physics:thicknesses on the simulation mesh, with elementType = constant",
}
FOREIGN_SCHEMAS = {
    "OmniPhysicsDeformableBodyAPI": BODY,
    "OmniPhysicsSurfaceDeformableSimAPI": SURFACE_SIM,
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
FEATURES = {
    "NewtonPointsDeformableSimAPI": "the material point method (sand, snow, jelly as particles)",
    "PhysxParticleSystem": "the particles of PhysX", "PhysxParticleSetAPI": "the particles of PhysX",
    "PhysxVehicleAPI": "the vehicles of PhysX", "MjcActuator": "actuators of MuJoCo", "NewtonActuator": "actuators",
    "MjcTendon": "tendons of MuJoCo", "MjcEqualityJointAPI": "couplings of joints", "NewtonMimicAPI": "couplings of joints",
}

NO_LIMIT = inf
