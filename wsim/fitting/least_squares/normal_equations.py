"""Normal equations of a fit, summed up moment by moment, and which directions of theta they know.

    [J r] = Q R        R alone is kept; of the second derivatives K along the directions b of the differences: J^T K and |K_b|

What J errs by is measured where it is taken: chance of the size e in every residual gives r+ - 2 r + r- = sqrt(6) e and
J b = e / sqrt(2) h, so that |K_b| h / sqrt(12) is an upper bound of the error of J b (More, Wild 2011: noise from
differences). A direction whose singular value is less than SURE of that error is not seen, whatever the noise of
the observations. The next differences are taken along the singular directions, in steps that move all that was observed
equally far, up to FARTHEST for those that hardly show, so that chance weighs least where it would be mistaken for an answer.
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.fitting.observations.residuals import DifferenceSteps, ResidualBlock

SURE = 3.0             # errors of J below which a singular value is one of them
FARTHEST = 0.03        # of theta: largest step of a difference
CRUDE = 3.0            # second derivatives over first that forward differences, which see none, are taken to have
LOST = 1e-12           # of the largest singular value: rounding of numbers
KEPT = 1 << 28        # [bytes] of residuals and Jacobians that are kept; if there are more, they are computed again when needed
FEW = 20               # residuals more than parameters, from which they tell what noise is


@dataclass
class JacobianSpectrum:
    """J = U S V^T, the error of each S, and which of them stand out from it."""

    S: np.ndarray
    V: np.ndarray                             # rows are directions, (p, p)
    error: np.ndarray
    kept: np.ndarray

    @property
    def J(self) -> np.ndarray:
        """A matrix as good as J for every purpose, and 0 along what is lost, (p, p)."""
        return (np.where(self.kept, self.S, 0.0)[:, None]) * self.V


@dataclass
class NormalEquations:
    """Sums over all that was seen until `time`."""

    theta: np.ndarray
    steps: DifferenceSteps
    R: np.ndarray                             # (p + 1, p + 1)
    bend: np.ndarray | None                   # J^T K, (p, directions)
    second: np.ndarray | None                 # |K|^2 of each direction
    quiet: float = np.inf                     # least s^2 that was seen on the way
    count: int = 0
    time: float = 0.0
    frame: int = 0
    alike: float = 0.0                        # sum of r at a moment times r at the one before, where both are of as many
    rows: list[tuple[float, int, float]] = field(default_factory=list)      # time, frame, rms of r
    growth: list[list[float]] = field(default_factory=list)                 # rms of each column, moment by moment
    before: np.ndarray | None = None          # r of the last moment
    blocks: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)      # r and J of each moment; []: over KEPT
    size: int = 0                             # [bytes] of all r and J

    @staticmethod
    def at(theta: np.ndarray, steps: DifferenceSteps, central: bool) -> "NormalEquations":
        p = len(theta)
        return NormalEquations(theta.copy(), steps, np.zeros((p + 1, p + 1)), np.zeros((p, p)) if central else None,
                               np.zeros(p) if central else None)

    def add(self, part: ResidualBlock) -> None:
        assert part.J is not None
        self.R = np.linalg.qr(np.concatenate([self.R, np.column_stack([part.J, part.r])]), mode="r")    # type: ignore
        if self.bend is not None and part.K is not None:
            self.bend, self.second = self.bend + part.J.T @ part.K, self.second + (part.K**2).sum(axis=0)
        self.count, self.time, self.frame = self.count + len(part.r), part.time, part.frame
        if self.count - len(self.theta) >= FEW:
            self.quiet = min(self.quiet, self.least / (self.count - len(self.theta)))
        if self.before is not None and len(self.before) == len(part.r):
            self.alike += float(self.before @ part.r)
        self.before = part.r
        self.size += part.r.nbytes + part.J.nbytes
        if self.size > KEPT:
            self.blocks.clear()
        else:
            self.blocks.append((part.r, part.J))
        self.rows.append((part.time, part.frame, float(np.sqrt(np.mean(part.r**2))) if len(part.r) else 0.0))
        self.growth.append(np.sqrt(np.mean(part.J**2, axis=0)).tolist() if len(part.r) else [0.0] * part.J.shape[1])

    @property
    def J(self) -> np.ndarray:
        """A matrix as good as J for every purpose, (p, p)."""
        return self.R[:-1, :-1]

    @property
    def misfit(self) -> float:
        """Sum of r^2."""
        return float((self.R[:, -1]**2).sum())

    @property
    def least(self) -> float:
        """Sum of r^2 after the step of the linear model."""
        return float(self.R[-1, -1]**2)

    def errors(self, chance: float) -> np.ndarray:
        """Errors of J along each direction of the differences, (directions,). chance: of all residuals, where nothing measures
        it."""
        h = np.abs(self.steps.h)
        if self.second is not None:
            return np.sqrt(self.second / 12.0) * h
        return 0.5 * CRUDE * h * np.linalg.norm(self.J @ self.steps.B, axis=0) + chance / h

    def spectrum(self, chance: float = 0.0) -> JacobianSpectrum:
        S, V = np.linalg.svd(self.J)[1:]
        error = np.linalg.norm(self.errors(chance)[:, None] * (self.steps.B.T @ V.T), axis=0)
        return JacobianSpectrum(S, V, error, np.maximum(SURE * error, LOST * S[0]) < S)

    def next_steps(self, eps: float, chance: float, quiet: float) -> DifferenceSteps:
        """Steps for differences from here on. quiet: s^2 of chance that would not matter: the step along what is seen best is
        made so short that second differences, were they all chance, are below."""
        s = self.spectrum(chance)
        with np.errstate(divide="ignore", invalid="ignore"):
            h = np.where(s.kept, eps * s.S[0] / s.S, FARTHEST)
        h = np.clip(h, eps, max(FARTHEST, eps))
        if self.second is not None and s.kept[0]:
            bent = np.sqrt(self.second.max() / max(6 * self.count, 1))
            h[0] = np.clip(np.sqrt(np.sqrt(quiet) / max(bent, 1e-300)), 0.1 * eps, eps)
        return DifferenceSteps(s.V.T.copy(), h)
