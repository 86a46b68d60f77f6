"""What a bench varies: solver, integrator, substeps, iterations and precision of one run, and which of them a scene bears.

Of scenes with soft bodies XPBD is no solver (`check` says so). Where nothing but tets, springs and pins act the implicit
midpoint is tried as well, which takes no energy from a body that swings, and sdirk3.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from math import inf, isfinite

from wsim.scene import Scene
from wsim.scene.integrator import TABLE
from wsim.scene.methods import has_tets

COARSE = 0.01          # [s] about the longest substep that is tried
SWEEPS = (1, 4, 16)    # of XPBD; residuals fall by h^2 / sweeps, so more than these lose to more substeps
NEWTON = (1, 4)        # steps of Newton's method; four leave nothing where the first went the right way


@dataclass(frozen=True)
class Setting:
    """Fields of a `Scene`, and the precision of its simulation."""

    solver: str
    integrator: str
    substeps: int
    iterations: int
    precision: str = "float32"

    def applied_to_scene(self, scene: Scene) -> Scene:
        """The scene stepped with this setting."""
        return replace(scene, solver=self.solver, integrator=self.integrator, substeps=self.substeps,
                       iterations=self.iterations)

    def with_more_substeps(self, times: int = 2) -> "Setting":
        return replace(self, substeps=self.substeps * times)

    def as_dict(self) -> dict:
        return asdict(self)

    @property
    def options(self) -> str:
        """The setting as options of `wsim run`."""
        return (f"--solver {self.solver} --integrator {self.integrator} --substeps {self.substeps} --iterations "
                f"{self.iterations}" + f" --precision {self.precision}" * (self.precision != "float32"))

    def __str__(self) -> str:
        return f"{self.solver} {self.integrator} {self.substeps} x {self.iterations} {self.precision}"


def scene_is_smooth(scene: Scene) -> bool:
    """True if nothing but springs, membranes, hinges, tets and pins act: positions depend smoothly on the step."""
    return not scene.colliders and not any(
        body.tethers or isfinite(body.material_number("strain_limit", inf)) for body in scene.bodies())


def first_substeps(scene: Scene) -> int:
    """The power of two whose substeps last about COARSE."""
    n = 1
    while n * scene.fps * COARSE < 0.7:
        n *= 2
    return n


def first_setting_of_series(scene: Scene, quick: bool = False) -> Iterator[Setting]:
    """The coarsest setting of each series of runs; a series goes on by more substeps. Most promising first."""
    n, implicit = first_substeps(scene), [m for m in TABLE.values() if not m.explicit]
    plain = [m for m in implicit if not m.rebounds]
    yield Setting("explicit", "auto", 1, 1)                    # leapfrog with as many substeps as are stable
    for sweeps in () if has_tets(scene) else SWEEPS[:2] if quick else SWEEPS:
        for m in plain:
            if not m.watched or sweeps > 1:                    # it needs its residual
                yield Setting("xpbd", m.name, n, sweeps)
    more = [m for m in implicit if m.rebounds and has_tets(scene) and scene_is_smooth(scene)]
    for steps in NEWTON[:1] if quick else NEWTON:
        for m in (*plain, *more):
            yield Setting("implicit", m.name, n, steps)


def unusable_solvers(scene: Scene) -> dict[str, str]:
    """Solvers that are not tried at all, and why."""
    return {"xpbd": "it has no tetrahedra, of which soft bodies are made"} if has_tets(scene) else {}
