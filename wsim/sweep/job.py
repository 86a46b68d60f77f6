"""A sweep as data: what every worker is given, and what tells one sweep from another."""

import json
from dataclasses import asdict, dataclass, field
from math import isfinite

from wsim.scene import Problem, Scene, SceneError
from wsim.scene.integrator import INTEGRATORS, SOLVERS

KEEP = ("none", "last", "all")


@dataclass(frozen=True)
class Settings:
    """Settings of a sweep. Raises SceneError for values out of range.

    device      of the runs; None: the GPU if there is one
    precision   "float32" or "float64"
    changes     what every run has otherwise than its scene: frames, solver, integrator, substeps, iterations
    keep        result layers: "none", "last" (the last frame of each run) or "all" (every frame)
    worlds      runs that share one set of arrays at most; None: what suits the device and fits into its memory
    workers     processes, by Ray; None: this one, or on a cluster one a GPU, or one a core where there is none
    cores       of the CPU that each worker has
    address     of a Ray cluster: "auto" or a host; None: none
    retries     times that a run is tried again whose worker was lost
    """

    device: str | None = None
    precision: str = "float32"
    changes: dict = field(default_factory=dict)
    keep: str = "none"
    worlds: int | None = None
    workers: int | None = None
    cores: int = 1
    address: str | None = None
    retries: int = 2

    def __post_init__(self):
        wrong = []
        for name, allowed in (("precision", ("float32", "float64")), ("keep", KEEP)):
            if getattr(self, name) not in allowed:
                wrong.append(Problem(name, f"found {getattr(self, name)!r}; allowed are {', '.join(allowed)}"))
        for name, least in (("worlds", 1), ("workers", 1), ("cores", 1), ("retries", 0)):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, int) or value < least):
                wrong.append(Problem(name, f"found {value!r}; allowed is a whole number from {least}"))
        known: dict[str, tuple[str, ...] | None] = {"frames": None, "substeps": None, "iterations": None, "solver": SOLVERS,
                                                    "integrator": INTEGRATORS}
        for name, value in self.changes.items():
            options = known.get(name, ())
            if options is None and not (isinstance(value, int) and isfinite(value) and value >= 1):
                wrong.append(Problem(name, f"found {value!r}; allowed is a whole number from 1"))
            elif options is not None and value not in options:
                there = f"allowed are {', '.join(options)}" if options else f"a sweep changes {', '.join(known)}"
                wrong.append(Problem(name, f"found {value!r}; {there}"))
        if wrong:
            raise SceneError(wrong)

    @property
    def remote(self) -> bool:
        """True if Ray runs it."""
        return self.address is not None or (self.workers or 1) > 1


@dataclass(frozen=True)
class Job:
    """scene: a file, or a scene made in Python. variants: chosen for every run, as `wsim.load` takes them. folder: of the
    results, absolute. seed: of the draws."""

    scene: str | Scene
    variants: dict
    folder: str
    seed: int
    settings: Settings
    runs: str = "wsim.sweep.worker"           # module whose Worker runs it

    def files(self) -> list[str]:
        """Files that every worker must see."""
        return ([self.scene] if isinstance(self.scene, str) else []) + [self.folder]

    def lost(self, item: tuple, why: str) -> dict:
        """Row of a run whose workers were lost."""
        from wsim import __version__
        number, draw = item
        return {"run": number, **draw, "status": "failed", "why": f"its worker was lost: {why}", "frames": 0, "warnings": "",
                "seed": self.seed, "version": __version__, "scene_hash": "", "state": "", "result": "", "seconds": 0.0,
                "worker": "", "worlds": 1, "tries": 1}

    def identity(self, draws: list[dict], base: str) -> dict:
        """Things that two sweeps that go on from one another have in common. base: digest of the scene as it is loaded."""
        from wsim import __version__
        own = asdict(self.settings)
        made = {name: own[name] for name in ("precision", "changes", "keep")}
        scene = self.scene if isinstance(self.scene, str) else "(made in Python)"
        return json.loads(json.dumps({"version": __version__, "scene": scene, "scene_hash": base, "variants": self.variants,
                                      "seed": self.seed, **made, "draws": draws}))
