"""What tests/physics/solver/test_newton_adjoint.py shares with other tests: Probe."""

import numpy as np

from tests.make.physics.solver.newton import DOUBLE
from wsim.scene import Scene
from wsim.simulation.simulation import Simulation


class Probe:
    """The solver of a scene with its parts laid open; d [m] is the state that everything is asked at."""

    def __init__(self, scene: Scene, **more):
        self.sim = Simulation(scene, **(DOUBLE | more))
        self.sim.model.load()
        self.sim.plan.before_frame(0.0)
        self.m, self.clock = self.sim.plan.ports.newton_assembly, self.sim.plan.clock
        self.method = self.sim.plan.method("implicit")
        self.rate, self.n = 1.0 / self.clock.effective_step, self.sim.model.points
        points = self.sim.plan.method("points")
        points.predict(self.clock)
        self.method.start(self.clock)
        self.set(self.sim.state.e.numpy())

    def set(self, d):
        self.sim.state.d.assign(np.asarray(d).reshape(-1, 3))

    def force(self, d=None):
        if d is not None:
            self.set(d)
        self.m.linearise(self.rate)
        return self.m.f.numpy().ravel().copy()                       # on the CPU .numpy() is no copy

    def differences(self, d, eps):
        """-df/dd by central differences."""
        d = np.asarray(d, float).ravel()
        columns = [(self.force(d - eps * e) - self.force(d + eps * e)) / (2.0 * eps) for e in np.eye(len(d))]
        return np.stack(columns, axis=1)

    def matrix(self, d):
        """The Jacobian that the solver uses, dense."""
        self.force(d)
        rows, A = self.m.rows, self.m.A
        K = np.zeros((self.n, 3, self.n, 3))
        for i in range(self.n):
            K[i, :, i] += A.own.numpy()[i] * np.eye(3)
            blocks = []
            if self.m.springs:
                for e in range(rows.spring.numpy()[i], rows.spring.numpy()[i + 1]):
                    link = A.link.numpy()[e]
                    blocks.append((rows.other.numpy()[e], -link[3] * np.eye(3) - np.outer(link[:3], link[:3])))
            if self.m.elements:
                for e in range(rows.pair.numpy()[i], rows.pair.numpy()[i + 1]):
                    blocks.append((rows.column.numpy()[e], A.block.numpy()[e]))
            for j, block in blocks:
                K[i, :, j] += block
                K[i, :, i] -= block
        return K.reshape(3 * self.n, 3 * self.n)

    def change(self, p):
        """Phi(d + p) - Phi(d)."""
        self.m.v.y.assign(np.asarray(p).reshape(-1, 3))
        self.m.system.drop.fill_(1e30)                                     # nothing is good enough: nothing moves
        self.method.line.search(self.rate, 0)
        return self.method.line.change.numpy()[:, 0].sum()
