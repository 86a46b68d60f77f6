"""Energy and strain of a written result, from its points and velocities."""

import numpy as np

from wsim.model.midnodes import places_with_midnodes, with_midnode_values
from wsim.model.model import PointBody, make_body
from wsim.scene import Scene, SceneError
from wsim.scene.bodies import bodies_sampled_by_point
from wsim.show.prim import prim_to_world_matrix
from wsim.show.visible import VisibleStage
from wsim.simulation.measure.indicators import edge_strain
from wsim.usd.load import read_stage
from wsim.usd.result.samples import particle_of_each_vertex


class ResultMeasures:
    """Energies [J] and strain of a result's bodies from its points and velocities (no elastic energy)."""

    def __init__(self, seen: VisibleStage, scene: Scene):
        self.seen, self.gravity = seen, np.asarray(scene.gravity, float)
        self.bodies = [make_body(source, 0, k, 0) for k, source in enumerate(bodies_sampled_by_point(scene))]

    @staticmethod
    def of(seen: VisibleStage) -> "ResultMeasures | None":
        """Measures of a stage, None where it holds no scene that could be simulated."""
        try:
            scene = read_stage(seen.stage)
        except SceneError:
            return None
        return ResultMeasures(seen, scene) if scene.bodies() else None

    def at(self, t: float) -> dict[str, float]:
        """Indicators at a time code; the kinetic energy only where velocities were written."""
        strains, kinetic, potential = [np.zeros(0)], 0.0, 0.0
        for body in self.bodies:
            x, v = self._state(body, t)
            strains.append(edge_strain(body, x - body.origin))
            potential -= float(body.masses @ x @ self.gravity)
            kinetic += float(0.5 * body.masses @ (v * v).sum(axis=1))
        strain = np.concatenate(strains)
        found = {"kinetic_energy": kinetic, "gravity_energy": potential}
        if len(strain):
            found |= {"max_strain": float(np.abs(strain).max()), "rms_strain": float(np.sqrt(np.mean(strain**2)))}
        return found

    def _state(self, body: PointBody, t: float) -> tuple[np.ndarray, np.ndarray]:
        """World positions [m] and velocities [m/s] of a body in solver order at a time code."""
        prim = self.seen.stage.GetPrimAtPath(body.path)
        M, particles = prim_to_world_matrix(prim, t), particle_of_each_vertex(prim)
        index = body.index if particles is None else body.index[particles]
        x, v = np.zeros((body.count, 3)), np.zeros((body.count, 3))
        x[index] = np.asarray(prim.GetAttribute("points").Get(t), float) @ M[:3, :3].T + M[:3, 3]
        velocities = prim.GetAttribute("velocities").Get(t)
        if velocities is not None and len(velocities) == len(index):
            v[index] = np.asarray(velocities, float) @ M[:3, :3].T
        for a in (x, v):                       # middles of quadratic tets are not in a result
            a[places_with_midnodes(body)] = with_midnode_values(a[body.index], body.ends)
        return self.seen.meters * x, self.seen.meters * v
