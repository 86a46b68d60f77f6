"""A solver of Newton on a scene of problems.py: PEER_PYTHON tools/bench/rigid/run_newton.py SCENE.json SETTING.json OUT.npz
[--device cuda:0|cpu]

Setting: solver, steps a frame, iterations where they are not the solver's own; stiff: contacts (ke, kd, kf of shapes) that give
by a millimetre under the heaviest body, as penalty solvers always have here, instead of Newton's 2500 N/m. Contacts are found
once a step by Newton's pipeline, those of mujoco and kamino by themselves. Frames are graphs where the solver can be captured,
on a CPU too (`graph` says so).
"""

import sys
from pathlib import Path

import newton
import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from tools.bench.rigid.clock import main  # noqa: E402

NATIVE = ("mujoco", "kamino")                # find contacts themselves
PENALTY = ("semi_implicit", "featherstone")


def solver_of(model: newton.Model, setting: dict, scene: dict):
    name, own = setting["solver"], {k: setting[k] for k in ("iterations",) if k in setting}
    shapes = sum(b["shape"] is not None for b in scene["bodies"])
    if name == "xpbd":
        return newton.solvers.SolverXPBD(model, enable_restitution=scene["restitution"] > 0.0, **own)
    if name == "vbd":
        return newton.solvers.SolverVBD(model, **own)
    if name == "mujoco":
        return newton.solvers.SolverMuJoCo(model, njmax=160 * shapes + 64, nconmax=24 * shapes + 32, **own)
    if name == "steel":
        return newton.solvers.SolverSteel(model, free_body_constraint_max=80 * shapes + 64, **own)
    if name == "kamino":
        config = newton.solvers.SolverKamino.Config.from_model(model, dynamics_solver="dvi", sparse_dynamics=True,
                                                               sparse_jacobian=True)
        config.use_collision_detector = True
        return newton.solvers.SolverKamino(model, config=config)
    kinds = {"semi_implicit": newton.solvers.SolverSemiImplicit, "featherstone": newton.solvers.SolverFeatherstone}
    return kinds[name](model, angular_damping=0.0)


def model_of(scene: dict, setting: dict, device) -> newton.Model:
    builder = newton.ModelBuilder(gravity=wp.vec3(*scene["gravity"]))
    if setting["solver"] == "kamino":
        newton.solvers.SolverKamino.register_custom_attributes(builder)
    weight = max(b["mass"] for b in scene["bodies"]) * 9.81
    config = newton.ModelBuilder.ShapeConfig(mu=scene["friction"], restitution=scene["restitution"], density=0.0)
    if setting["solver"] in PENALTY or setting.get("stiff"):
        config.ke, config.kd, config.kf = weight / 1e-3, 0.05 * weight / 1e-3, weight
    numbers = []
    for b in scene["bodies"]:
        make = builder.add_link if scene["joints"] else builder.add_body
        inertia = wp.mat33(*np.diag(b["moments"]).ravel().tolist())
        body = make(xform=wp.transform(wp.vec3(*b["at"]), wp.quat(*b["turn"])), mass=b["mass"], inertia=inertia,
                    lock_inertia=True)
        numbers.append(body)
        if b["shape"] == "box":
            builder.add_shape_box(body, hx=b["size"][0], hy=b["size"][1], hz=b["size"][2], cfg=config)
        elif b["shape"] == "sphere":
            builder.add_shape_sphere(body, radius=b["size"][0], cfg=config)
        builder.body_qd[body] = wp.spatial_vector(*b["velocity"], *b["spin"])
    if scene["joints"]:
        jointed(builder, scene, numbers)
    else:
        builder.joint_qd = np.array(builder.body_qd).flatten().tolist()
    if scene["ground"]:
        builder.add_shape_plane(xform=wp.transform_identity(), width=0.0, length=0.0, cfg=config)
    if setting["solver"] == "vbd":
        builder.color()
    return builder.finalize(device=device)


def jointed(builder: newton.ModelBuilder, scene: dict, numbers: list[int]) -> None:
    joints = []
    for j in scene["joints"]:
        a, b = j["bodies"]
        there, here = (np.array(j["point"]) - (scene["bodies"][k]["at"] if k >= 0 else np.zeros(3)) for k in (a, b))
        joints.append(builder.add_joint_ball(
            numbers[a] if a >= 0 else -1, numbers[b], parent_xform=wp.transform(wp.vec3(*there), wp.quat_identity()),
            child_xform=wp.transform(wp.vec3(*here), wp.quat_identity()), collision_filter_parent=True))
    builder.add_articulation(joints)


class Run:
    def __init__(self, scene: dict, setting: dict, device: str):
        wp.config.log_level = wp.LOG_WARNING
        self.model = model_of(scene, setting, device)
        self.pipeline = None if setting["solver"] in NATIVE else newton.CollisionPipeline(self.model)
        self.contacts = self.pipeline.contacts() if self.pipeline else None
        self.solver = solver_of(self.model, setting, scene)
        self.now, self.next, self.control = self.model.state(), self.model.state(), self.model.control()
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.now)
        self.steps, self.h = setting["steps"], 1.0 / (scene["fps"] * setting["steps"])
        assert self.steps % 2 == 0, "a graph wants an even number of steps"
        self.count, self.graph = 0, None
        self.facts = {"version": newton.__version__, "precision": "float32", "graph": False}

    def launch(self) -> None:
        for _ in range(self.steps):
            self.now.clear_forces()
            if self.pipeline:
                self.pipeline.collide(self.now, self.contacts)
            self.solver.step(self.now, self.next, self.control, self.contacts, self.h)
            self.now, self.next = self.next, self.now

    def step(self) -> None:
        self.count += 1
        if self.count == 3:
            try:
                with wp.ScopedCapture(device=self.model.device) as capture:
                    self.launch()
                self.graph, self.facts["graph"] = capture.graph, True
            except Exception as error:                  # what reads the device within a step stays as it is
                self.facts["eager"] = f"{type(error).__name__}: {error}"[:200]
        if self.graph:
            wp.capture_launch(self.graph)
        elif self.count != 3 or "eager" in self.facts:
            self.launch()
        wp.synchronize_device(self.model.device)

    def state(self) -> dict:
        q, v = self.now.body_q.numpy().astype(np.float64), self.now.body_qd.numpy().astype(np.float64)
        return {"x": q[:, :3], "q": q[:, 3:], "v": v[:, :3], "w": v[:, 3:]}


if __name__ == "__main__":
    main(Run)
