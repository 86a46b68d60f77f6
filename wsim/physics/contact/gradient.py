"""Derivatives of a loss by what colliders and the friction of bodies are, from what contacts have gathered."""

import numpy as np

from wsim.scene import Problem, SceneError
from wsim.scene.values.coverage import gradient_refusal


class ContactGradient:
    """Gradients of contacts of a plan; motions: of each frame."""

    def __init__(self, plan, motions: list):
        contacts, bounce = plan.ports.contacts, plan.ports.restitution
        adjoint, rows, self.model = contacts.adjoint, contacts.rows, plan.model
        self.colliders, self.meshes = rows.colliders, rows.meshes
        self.by_friction, self.gap = adjoint.by_rows(adjoint.friction), adjoint.by_rows(adjoint.gap)
        self.by_restitution = bounce.restitution.grad.numpy().astype(np.float64) if bounce else None
        self.throws = bounce.restitution.numpy() > 0.0 if bounce else None
        self.clamped = [m is not None and m.least_gap > 0.0 and g <= m.least_gap
                        for g, m in zip(contacts.gap, self.meshes, strict=False)]      # of the first object
        each = np.stack([np.stack([part.numpy() for part in (sums if isinstance(sums, list) else [sums])]) for sums in motions])
        self.first, self.touched, self.object = rows.first, adjoint.touched[::-1], contacts.points.object.numpy()
        self.substeps = contacts.table.of.step.shape[0]
        self.steps = each.astype(np.float64).sum(axis=4)              # (frames, substeps or 1, objects, rows, 4, 3)
        self.motions = self.steps.sum(axis=1)

    def rows(self, path: str) -> list[int]:
        """Rows of a collider among those of an object, which has all of them. Raises SceneError where there is none."""
        found = [k for k, c in enumerate(self.colliders) if c.path == path]
        if not found:
            every = ", ".join(c.path for c in self.colliders)
            raise SceneError(Problem(path, f"is no collider; there are {every}"))
        return found

    def of_world(self, world: int) -> np.ndarray:
        return np.concatenate([np.arange(b.first, b.last) for b in self.model.bodies if b.world == world])

    def friction(self, path: str | None, world: int) -> np.ndarray:
        if path in [c.path for c in self.colliders]:
            found = self.by_friction[self.rows(str(path))][:, self.of_world(world)]
        else:
            body = self.model.body(path, world)
            found = self.by_friction[:, body.first:body.last]
        return 0.5 * found.sum(axis=(0, 1))                           # of the mean of both

    def restitution(self, path: str, world: int) -> float:
        part = np.ix_(np.array(self.rows(path)), self.of_world(world))
        if self.by_restitution is None or self.throws is None or not self.throws[part].all():
            raise gradient_refusal("restitution", path)
        return float(self.by_restitution[part].sum())

    def thickness(self, path: str, world: int) -> float:
        """0 of an open mesh that keeps more than its thickness in any case."""
        rows = [r for r in self.rows(path) if not self.clamped[r]]
        return float(self.gap[rows][:, self.of_world(world)].sum())

    def places(self, path: str, world: int) -> tuple[np.ndarray, np.ndarray]:
        """Gradient with respect to the place of a collider and a small turn about it, at the start of each substep of a frame
        and at the end of its last, (frames, substeps + 1, 3): from e0 s0 + e1 s1 and b0 s0 + b1 s1 with b the part of the
        frame at either end of a substep and e = 1 - b. Of linear keys the substep is the frame."""
        objects = [k for k, b in enumerate(self.model.bodies) if b.world == world]
        rows = self.steps[:, :, objects][:, :, :, self.rows(path)].sum(axis=(2, 3))            # (frames, substeps, 4, 3)
        n = rows.shape[1]
        both, late = rows[:, :, :2] + rows[:, :, 2:], rows[:, :, 2:]
        last = n * late - np.arange(n)[None, :, None, None] * both
        found = np.zeros((len(rows), n + 1, 2, 3))
        found[:, :-1] += both - last
        found[:, 1:] += last
        return found[:, :, 0], found[:, :, 1]

    def corners(self, path: str, world: int, frame: int) -> np.ndarray:
        """Gradient with respect to the points of a skinned mesh, in its own frame, where a frame and each of its substeps
        begins and where it ends, (substeps + 1, n, 3) [1/m]: contacts know X at the end of a substep and V = X - X before."""
        (number,), t = self.rows(path), self.touched[frame]
        mesh, own = self.meshes[number], self.of_world(world)
        found = np.zeros((self.substeps + 1, len(mesh.surface.points), 3))
        mine = (t.row - self.first[self.object[t.point]] == number) & np.isin(t.point, own)
        k, face, by = t.substep[mine], t.face[mine], t.by[mine]
        turned = (face[:, 1, None] + np.arange(3)) % 3
        near, crossed = np.take_along_axis(mesh.triangles[face[:, 0]], turned, axis=1), mesh.triangles[face[:, 2]]
        through = face[:, 2] >= 0
        np.add.at(found, (k[:, None] + 1, near), by[:, :3] + by[:, 3:6])
        np.add.at(found, (k[:, None], near), -by[:, 3:6])
        np.add.at(found, (k[through, None] + 1, crossed[through]), by[through, 6:])
        return found

    def motion(self, path: str, world: int) -> np.ndarray:
        objects = [k for k, b in enumerate(self.model.bodies) if b.world == world]
        each = self.motions[:, objects][:, :, self.rows(path)].sum(axis=(1, 2)).reshape(-1, 2, 2, 3)
        found = np.zeros((len(each) + 1, 2, 3))
        found[:-1] += each[:, 0]
        found[1:] += each[:, 1]
        return found
