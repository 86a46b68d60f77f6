"""What tests/physics/cloth/test_element_adjoint.py shares with other tests: Case, STEP, WEIGHTS."""

import numpy as np
import warp as wp

from tests.make.rows.equations import EQUATIONS
from wsim.kernels.cloth import curvature, curvature_adjoint, element, element_adjoint
from wsim.kernels.cloth.corner_gradients import adjoint_works

STEP = 1e-3
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])         # of differences of order 8


class Case:
    """Constraints whose points are all their own, bent and stretched by a third and more, and a loss p.f."""

    def __init__(self, constraint: str, damped: bool, count: int = 40):
        rng, row = np.random.default_rng(5), EQUATIONS[constraint]
        self.constraint, self.damped, self.count, self.corners = constraint, damped, count, row.points
        n = count * row.points
        flat = {3: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], 4: [[0, 0, 0], [1, 0, 0], [0.4, 1, 0], [0.6, -1, 0]]}[row.points]
        self.values = {"x": np.tile(np.array(flat, float), (count, 1)) + 0.1 * rng.normal(size=(n, 3)),
                       "d": 0.1 * rng.normal(size=(n, 3)), "v": rng.normal(size=(n, 3)), "tau": rng.uniform(0.1, 0.5, count)}
        if row.rows == 3:
            spd = rng.uniform(1.0, 3.0, size=(count, 4)) * (1.0, 0.2, 0.5, 1.0)
            self.values |= {"rest": np.eye(2) + 0.2 * rng.normal(size=(count, 2, 2)), "stiffness": spd}
        else:
            self.values |= {"rest": rng.uniform(-2.3, 2.3, count), "stiffness": rng.uniform(1.0, 3.0, count)}
        self.p = rng.normal(size=(n, 3))
        self.module = f"test_corner_{constraint}_{damped}"
        if row.rows == 3:
            self.forces = element.membrane_force_kernel(real=wp.float64, module=self.module, damped=damped)
        else:                                                       # curvatures of twenty triangles of any six hinges
            self.forces = curvature.hinge_force_kernel(wp.float64, self.module)
            self.slot = rng.integers(0, count, (20, 9)).astype(np.int32)
            self.values["value"] = rng.normal(size=(180, 3)) * (np.arange(180) % 9 < 6)[:, None]

    def batch(self, values: dict):
        data = element.force_elements(EQUATIONS[self.constraint], wp.float64)()
        types = {"rest": wp.mat22d, "stiffness": wp.vec4d} if self.corners == 3 else {}
        ids = np.arange(self.count * self.corners, dtype=np.int32).reshape(self.count, self.corners)
        data.point = wp.array(ids, dtype=wp.types.vector(self.corners, int), device="cpu")
        for name in ("rest", "stiffness", "tau"):
            setattr(data, name, wp.array(values[name], dtype=types.get(name, wp.float64), device="cpu"))
        return data

    def curvatures(self, values: dict):
        cur = curvature.sheet_curvatures(wp.float64)()
        used = np.flatnonzero(np.arange(180) % 9 < 6)
        hinge = self.slot.ravel()[used]
        ends = np.cumsum(np.bincount(hinge, minlength=self.count))
        ints = {"slot": self.slot.ravel(), "count": np.full(20, 6), "begin": np.r_[0, ends[:-1]], "end": ends,
                "item": used[np.argsort(hinge, kind="stable")]}
        for name, found in ints.items():
            setattr(cur, name, wp.array(found.astype(np.int32), dtype=int, device="cpu"))
        cur.value = wp.array(values["value"], dtype=wp.vec3d, device="cpu")
        own = np.bincount(hinge, (values["value"]**2).sum(axis=1)[used], self.count)
        cur.own = wp.array(own, dtype=wp.float64, device="cpu")
        for name, dtype, size in (*((name, wp.float64, 40) for name in ("z", "y", "slope", "kept")), ("C", wp.vec3d, 20),
                                  ("Y", wp.vec3d, 20), ("G", wp.vec3d, 120)):
            setattr(cur, name, wp.zeros(size, dtype=dtype, device="cpu"))
        return cur

    def launch(self, kernel, *inputs, count: int = 0) -> None:
        wp.launch(kernel, count or self.count, list(inputs), device="cpu")

    def inputs(self, values: dict) -> list:
        pair = np.zeros((4, *values["d"].shape))
        pair[1], pair[3] = values["d"], values["v"]                     # source 1
        x, d = (wp.array(a.reshape(-1, 3), dtype=wp.vec3d, device="cpu") for a in (values["x"], pair))
        return [self.batch(values), x, d, 1, 0]

    def loss(self, values: dict) -> float:
        f = wp.zeros(len(self.p), dtype=wp.vec3d, device="cpu")
        inputs = self.inputs(values)
        if self.corners == 4:
            cur = self.curvatures(values)
            self.launch(curvature.hinge_strain_kernel(wp.float64, self.module, self.damped), *inputs[:4], cur)
            self.launch(curvature.curvature_sum_kernel(wp.float64, self.module), cur, count=20)
            inputs.append(cur)
        self.launch(self.forces, *inputs, f)
        assert np.isfinite(f.numpy()).all()
        return float((f.numpy() * self.p).sum())

    def slope(self, name: str, way: np.ndarray) -> float:
        def at(s: float) -> float:
            return self.loss(self.values | {name: self.values[name] + s * way})
        return sum(w * (at(k * STEP) - at(-k * STEP)) for k, w in enumerate(WEIGHTS, 1)) / STEP

    def gradients(self, direct: bool) -> dict:
        by, work = self.batch({k: np.zeros_like(a) for k, a in self.values.items()}), adjoint_works(wp.float64)()
        p = wp.array(self.p, dtype=wp.vec3d, device="cpu")
        work.corners, work.rates = (wp.zeros(len(self.p), dtype=wp.vec3d, device="cpu") for _ in range(2))
        if direct:
            work.p = p
        else:
            wp.copy(work.corners, p)
        inputs, how, more = self.inputs(self.values), (wp.float64, self.module, self.damped), {}
        if self.corners == 4:
            cur, by_cur = (self.curvatures(self.values | {"value": v}) for v in (self.values["value"], np.zeros((180, 3))))
            self.launch(curvature_adjoint.bending_product_kernel(*how, direct), *inputs, cur, work)
            self.launch(curvature.curvature_sum_kernel(*how[:2], both=True), cur, count=20)
            self.launch(curvature_adjoint.bending_adjoint_kernel(*how, True, direct), *inputs, cur, work, by)
            self.launch(curvature_adjoint.curvature_adjoint_kernel(*how[:2]), cur, by_cur, count=20)
            more = {"value": by_cur.value.numpy()}
        else:
            self.launch(element_adjoint.membrane_adjoint_kernel(*how, True, direct), *inputs, work, by)
        positions = work.corners.numpy()
        return {"x": positions, "d": positions, "v": work.rates.numpy(),
                **{name: getattr(by, name).numpy() for name in ("rest", "stiffness", "tau")}, **more}
