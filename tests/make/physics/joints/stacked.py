"""A stage of two cubes with joints between them."""

from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics


def stage_of(tmp_path, joints, adds: bool = True) -> Usd.Stage:
    """Two cubes; joints: (type, axis, low, high) between them, outermost first."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    for k, name in enumerate(("/a", "/b")):
        cube = UsdGeom.Cube.Define(stage, name)
        cube.AddTranslateOp().Set((3.0 * k, 0.0, 0.0))
        UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim())
        UsdPhysics.CollisionAPI.Apply(cube.GetPrim())
    stage.GetPrimAtPath("/b").CreateAttribute("newton:jointsAddMobility", Sdf.ValueTypeNames.Bool).Set(adds)
    for k, (kind, axis, low, high) in enumerate(joints):
        joint = kind.Define(stage, f"/j{k}")
        joint.CreateBody0Rel().SetTargets([Sdf.Path("/a")])
        joint.CreateBody1Rel().SetTargets([Sdf.Path("/b")])
        joint.CreateLocalPos0Attr(Gf.Vec3f(3.0, 0.0, 0.0))
        joint.CreateAxisAttr(axis)
        joint.CreateLowerLimitAttr(low)
        joint.CreateUpperLimitAttr(high)
    stage.Save()
    return stage
