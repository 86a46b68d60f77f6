"""Derivatives of a loss by what colliders and the friction of bodies are, from what contacts have gathered."""

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.scene.values.coverage import refuse


class ContactGradient:
    """Gradients of contacts of a plan; motions: of each frame."""

    def __init__(self, plan, motions: list):
        contacts, bounce = plan.find("contacts"), plan.find("bounce")
        adjoint, rows, self.model = contacts.adjoint, contacts.rows, plan.model
        self.colliders, self.meshes = rows.colliders, rows.meshes
        self.by_friction, self.gap = adjoint.by_rows(adjoint.friction), adjoint.by_rows(adjoint.gap)
        self.by_restitution = bounce.restitution.grad.numpy().astype(np.float64) if bounce else None
        self.throws = bounce.restitution.numpy() > 0.0 if bounce else None
        self.clamped = [m is not None and m.least_gap > 0.0 and g <= m.least_gap
                        for g, m in zip(contacts.gap, self.meshes, strict=False)]      # of the first object
        each = [sums.numpy().astype(np.float64).sum(axis=2) for sums in motions]
        self.motions = np.stack(each)                                 # (frames, objects, rows, 4, 3)

    def rows(self, path: str) -> list[int]:
        """Rows of a collider among those of an object, which has all of them. Raises SceneError where there is none."""
        found = [k for k, c in enumerate(self.colliders) if c.path == path]
        if not found:
            every = ", ".join(c.path for c in self.colliders)
            raise SceneError(Problem(path, f"is no collider; there are {every}"))
        return found

    def places(self, world: int) -> np.ndarray:
        return np.concatenate([np.arange(b.first, b.last) for b in self.model.bodies if b.world == world])

    def friction(self, path: str | None, world: int) -> np.ndarray:
        if path in [c.path for c in self.colliders]:
            found = self.by_friction[self.rows(str(path))][:, self.places(world)]
        else:
            body = self.model.body(path, world)
            found = self.by_friction[:, body.first:body.last]
        return 0.5 * found.sum(axis=(0, 1))                           # of the mean of both

    def restitution(self, path: str, world: int) -> float:
        part = np.ix_(np.array(self.rows(path)), self.places(world))
        if self.by_restitution is None or self.throws is None or not self.throws[part].all():
            raise refuse("restitution", path)
        return float(self.by_restitution[part].sum())

    def thickness(self, path: str, world: int) -> float:
        """0 of an open mesh that keeps more than its thickness in any case."""
        rows = [r for r in self.rows(path) if not self.clamped[r]]
        return float(self.gap[rows][:, self.places(world)].sum())

    def motion(self, path: str, world: int) -> np.ndarray:
        objects = [k for k, b in enumerate(self.model.bodies) if b.world == world]
        each = self.motions[:, objects][:, :, self.rows(path)].sum(axis=(1, 2)).reshape(-1, 2, 2, 3)
        found = np.zeros((len(each) + 1, 2, 3))
        found[:-1] += each[:, 0]
        found[1:] += each[:, 1]
        return found
