"""What recordings refuse to differentiate, as data: the case, and the words of the error. Documents and tests read it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Refused:
    """what: the case, in words. text: what is said of it, with places for words."""

    what: str
    text: str


REFUSED: dict[str, Refused] = {
    "method": Refused("methods whose row in `wsim.scene.methods.METHODS` says gradients=False",
                      "gradients do not go through {method}; leave out gradients=True, or take these objects out of the scene"),
    "surfaces": Refused("contacts of surfaces with each other", "has wsim:selfCollision, and contacts of surfaces have no "
                        "derivative; leave it out of all that the scene simulates, or leave out gradients=True"),
    "varying": Refused("values that vary in time", "{name} varies in time, and a recording has one value for all its frames; "
                       "author one value, or take it out of scene.varying ({count} in it)"),
    "limits": Refused("reactions of pins where tethers or strain limits pull", "has tethers or a strain limit, which pull at "
                      "pins without a law of force; reactions are not to be had: leave them out"),
    "moved": Refused("targets, stiffness and damping of a pin that moves, where its own reaction is in the loss",
                     "moves, and what it bears is in the loss: with respect to its {name} that has no derivative yet; hold it "
                     "still, or leave its reaction out"),
    "weft": Refused("a weft of 0", "its weft is 0 and follows stretch: it has no derivative of its own"),
    "shear": Refused("a shear below a millionth of stretch", "its shear is below {least:g} of stretch, and taken as that: no "
                     "derivative"),
    "density": Refused("the density of given masses", "its masses follow no single density; take masses()"),
    "mass": Refused("the mass of a cloth or soft body", "is no spring net, which has a mass of its own; take density() or "
                    "masses()"),
    "lengths": Refused("rest lengths of a cloth", "is no spring net: it has no rest lengths of its own"),
    "air": Refused("drag and lift where both are 0", "has no coefficient {name!r} with a derivative; drag, lift and "
                   "normal_drag have one where one of them is not 0"),
    "wind": Refused("wind that meets nothing", "no cloth has drag or lift, so that wind does nothing; leave it out"),
    "restitution": Refused("a restitution of 0", "its restitution is 0, and nothing is thrown back: no derivative; give it one "
                           "> 0"),
    "ends": Refused("contacts with colliders by the implicit midpoint", "is met where the steps of {integrator} end, which has "
                    "no derivative; take wsim:integrator = bdf2, backward_euler or an explicit one"),
    "touched": Refused("contacts without a collider", "there is no collider, so that nothing touches"),
    "actuation": Refused("muscles that there are not", "no net has muscles; give one an actuation"),
    "impulses": Refused("contacts of rigid bodies after a number of sweeps", "can meet {other}, and impulses after a number of "
                        "sweeps have no derivative: give the scene a contact_tolerance (wsim:contactTolerance), 1e-10 m/s in "
                        "float64, or switch collisions off (physics:collisionEnabled, Collider.meets)"),
    "held": Refused("contacts of rigid bodies beside joints", "can meet {other} where there are joints, and such contacts "
                    "are not solved to a residual: no derivative; switch collisions off (physics:collisionEnabled, "
                    "Collider.meets)"),
    "meshes": Refused("contacts of rigid bodies with triangle meshes", "is a mesh of triangles that rigid bodies meet, which "
                      "has no derivative; put convex shapes in its place (physics:approximation)"),
    "points": Refused("contacts of rigid bodies with cloth, springs and soft bodies", "can meet {other}, and contacts "
                      "of bodies and points have no derivative; switch its collisions off (physics:collisionEnabled, "
                      "Collider.meets)"),
    "sleep": Refused("bodies that may fall asleep", "may fall asleep in contact, which has no derivative; give the scene a "
                     "sleep_speed (wsim:sleepSpeed) of 0"),
    "driven": Refused("drives that push a joint against its limit", "its drive pushes it against a limit, which has no "
                      "derivative; widen the limit, or take the drive out"),
    "actuators": Refused("actuators of joints", "is an actuator, which has no derivative yet; take a drive of the joint, or "
                         "leave out gradients=True"),
    "features": Refused("manifolds that change with the smallest motion", "touches by other features when it is moved by a ten "
                        "thousandth of its size, and has no derivative of one side; move it, or another shape, a little"),
    "followed": Refused("a skeleton that nothing follows", "no pin and no collider follows it, so that nothing here knows its "
                        "joints"),
    "dressed": Refused("what follows skeletons that rigid bodies drive", "rigid bodies drive its joints, and colliders or pins "
                       "follow them: that has no derivative yet; animate the joints, or leave out gradients=True"),
    "corrective": Refused("joint angles of a mesh with corrective shapes", "follows a mesh with a corrective shape, which "
                          "{bones} drives: with respect to its turns that has no derivative yet; leave the shape out"),
    "scaled": Refused("joint angles of scaled joints under dual quaternions", "follows dual quaternions of {bones}, whose "
                      "joints are scaled: with respect to turns that has no derivative yet; take classicLinear"),
    "unanimated": Refused("joint angles where no joint is animated", "has no joint that is animated; give it translations and "
                          "rotations at a key"),
    "shapes": Refused("weights of blend shapes that there are not", "has no blend shapes with a weight; give it some"),
    "idle": Refused("air in which no point moves", "nothing that moves here knows {name}; leave it out"),
    "surface": Refused("surfaces in air where no collider moves", "is no obstacle of air in which one moves: its surface has "
                       "no velocity with a derivative"),
    "forming": Refused("surfaces in air of meshes whose points move", "is a mesh whose points move: its surface in the air has "
                       "no derivative; take one that moves as a whole"),
    "layers": Refused("layers along the walls of a fluid", "resolves layers along its walls, which has no derivative; leave "
                      "its {name} False"),
    "margin": Refused("the part of a fluid that follows its smoke", "solves a part of its air alone, which has no derivative "
                      "where that changes; leave its {name} 0"),
    "conserve": Refused("smoke that keeps its sum", "keeps the sum of what its air carries, which has no derivative; leave its "
                        "{name} False"),
    "walls": Refused("smoke in which cloth and soft bodies are walls", "has {name} in its air as a wall, and smoke has no "
                     "derivative by what cloth does; take one of them out of the scene"),
    "still": Refused("values of fluids and sources of which nothing runs", "nothing of its {name} runs: {why}"),
    "law": Refused("numbers that the law of material points has none of", "has the law {law}, and {name} is none of its "
                   "numbers with a derivative; name another"),
    "mixed": Refused("numbers of material points of several materials", "has several materials, so that its {name} is no "
                     "single number: no derivative; give each material a body of its own"),
    "grown": Refused("implicit steps of material points, and particles that come and go", "{what}, which has no derivative; "
                     "{fix}"),
    "curved": Refused("contacts of material points with colliders that are curved, are meshes, or turn", "is a {shape}{how}: "
                      "where material points meet it there is no derivative; take a Plane or a Box that does not turn"),
    "poured": Refused("values of colliders beside material points", "is a collider beside material points: with respect to its "
                      "{name} that has no derivative; name a value of the points"),
    "load": Refused("loads that there are not", "there is no load; give the scene one"),
    "pin": Refused("anything but stiffness and damping of a soft pin", "is no soft pin with a derivative with respect to "
                   "{name!r}; soft pins have stiffness and damping"),
    "material": Refused("what a body has none of", "has no {name!r} with a derivative; there are {names}"),
    "value": Refused("values whose row says why", "has no derivative with respect to {name}: {why}; there are {names}"),
}


def gradient_refusal(key: str, path: str, **words):
    """The SceneError of a row of `REFUSED` at a prim path."""
    from wsim.scene import Problem, SceneError
    return SceneError(Problem(path, REFUSED[key].text.format(**words)))
