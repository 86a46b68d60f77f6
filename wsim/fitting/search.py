"""Levenberg-Marquardt with a horizon that grows as far as the fit holds. More 1978 (trust region); Transtrum, Sethna 2012
(second derivatives along a step).

At theta all copies are run together and the normal equations are summed up moment by moment. With what was summed up so far

    (J^T J / s^2 + P + lam 1) d = -(J^T r / s^2 + P (theta - mean)),    |d| <= radius        s noise, P of the priors
    (J^T J / s^2 + P + lam 1) q = -J^T K d^2 / 2 s^2                    what curvature adds to the step d

As soon as q is larger than the error bars that the data so far allow, later data cannot make the step any better: the run is
left there, and d is taken. So first steps cost a few frames, and only those near the end the whole horizon. A step after which
the misfit over the same frames is larger is taken back, with a quarter of the radius. Where no noise is given, s is what the
linear model leaves.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wsim.fitting import state
from wsim.fitting.copies import Broken
from wsim.fitting.estimate import LOST
from wsim.fitting.misfit import Misfit, Part
from wsim.scene import Problem, SceneError

RADIUS = 1.0           # largest step of a mapped parameter: a factor e
WEAK = 0.1             # lam: what the data leave open within 3 units of theta moves little
CURVED = 1e-5          # curvature of less than this (of theta) never ends a run early
DONE = 0.3             # error bars that a last step may leave
SMALL = 1e-7           # of theta, that it may leave where there is no noise
FLOOR = 1e-9           # [m] least noise: data without any
LINEAR = 0.2           # part of the answer to a change of theta by NEAR that curvature may be, where it is more than noise
NEAR = 1e-3            # no model knows a parameter better: where such a change is not answered in proportion, all is chance
SLACK = 1e-3           # of the misfit: as good as equal
FEW = 20               # residuals more than parameters, from which they tell what noise is
LOUD = 4.0             # s^2 over what it was at an earlier moment: the linear model is what is wrong, not the data


@dataclass
class Sums:
    """Normal equations of all that was seen until `time`."""

    theta: np.ndarray
    R: np.ndarray                             # [J r] = Q R, (p + 1, p + 1)
    bend: np.ndarray | None                   # J^T K, (p, p)
    curve: float = 0.0                        # largest |K| / |J| of a column so far
    quiet: float = np.inf                     # least s^2 that was seen on the way
    count: int = 0
    time: float = 0.0
    frame: int = 0
    rows: list[tuple[float, int, float]] = field(default_factory=list)      # time, frame, rms of r
    growth: list[list[float]] = field(default_factory=list)                 # rms of each column, moment by moment

    @staticmethod
    def at(theta: np.ndarray, central: bool) -> "Sums":
        p = len(theta)
        return Sums(theta.copy(), np.zeros((p + 1, p + 1)), np.zeros((p, p)) if central else None)

    def add(self, part: Part) -> None:
        assert part.J is not None
        self.R = np.linalg.qr(np.concatenate([self.R, np.column_stack([part.J, part.r])]), mode="r")    # type: ignore
        if self.bend is not None and part.K is not None:
            self.bend = self.bend + part.J.T @ part.K
            size = np.linalg.norm(self.J, axis=0)
            curves = np.linalg.norm(part.K, axis=0) / np.maximum(size, 1e-300)
            self.curve = max(self.curve, float(curves[size > 1e-3 * size.max()].max(initial=0.0)))
        self.count, self.time, self.frame = self.count + len(part.r), part.time, part.frame
        if self.count - len(self.theta) >= FEW:
            self.quiet = min(self.quiet, self.least / (self.count - len(self.theta)))
        self.rows.append((part.time, part.frame, float(np.sqrt(np.mean(part.r**2))) if len(part.r) else 0.0))
        self.growth.append(np.sqrt(np.mean(part.J**2, axis=0)).tolist() if len(part.r) else [0.0] * part.J.shape[1])

    @property
    def J(self) -> np.ndarray:
        """As good as J for every purpose, (p, p)."""
        return self.R[:-1, :-1]

    @property
    def misfit(self) -> float:
        """Sum of r^2."""
        return float((self.R[:, -1]**2).sum())

    @property
    def least(self) -> float:
        """Sum of r^2 after the step of the linear model."""
        return float(self.R[-1, -1]**2)


@dataclass
class Prior:
    """Of each parameter in the mapped space: weight 1 / sigma^2 (0: none) and mean."""

    weight: np.ndarray
    mean: np.ndarray

    def misfit(self, theta: np.ndarray) -> float:
        return float((self.weight * (theta - self.mean)**2).sum())


class Search:
    """theta, and how it got there. `run` until it is found, or `limit` simulations are spent."""

    def __init__(self, misfit: Misfit, theta: np.ndarray, prior: Prior, *, sigma: bool, limit: float = 200.0,
                 accuracy: float = 0.0, each: Callable[["Search"], None] = lambda search: None):
        """sigma: residuals are in units of a known noise. accuracy: two error bars of theta that are enough; 0: what all
        the data give."""
        self.misfit, self.theta, self.prior, self.known = misfit, theta, prior, sigma
        self.limit, self.accuracy, self.each = limit, accuracy, each
        self.radius, self.steps = RADIUS, 0
        self.best: Sums | None = None
        self.accepted, self.converged, self.notes = False, False, []      # type: ignore[var-annotated]
        self.end = misfit.moments[-1]

    # one step

    def noise(self, sums: Sums) -> float:
        """s^2."""
        return 1.0 if self.known else max(sums.least / max(sums.count - len(sums.theta), 1), FLOOR**2)

    def calm(self, sums: Sums) -> float:
        """s^2, but at most LOUD times what it was at any earlier moment."""
        return min(self.noise(sums), max(LOUD * sums.quiet, FLOOR**2))

    def step(self, sums: Sums) -> tuple[np.ndarray, np.ndarray]:
        """d and q."""
        s2, root = self.noise(sums), np.sqrt(self.prior.weight)
        rows = np.concatenate([sums.J / np.sqrt(s2), np.diag(root)])
        side = np.concatenate([sums.R[:-1, -1] / np.sqrt(s2), root * (sums.theta - self.prior.mean)])
        U, S, V = np.linalg.svd(rows, full_matrices=False)
        kept = self.lost(sums) * S[0] < S                   # along the others J is what differences err, and no step is right
        U, S, V = U[:, kept], S[kept], V[kept]
        lam = WEAK
        while True:
            d = -V.T @ (S / (S**2 + lam) * (U.T @ side))
            if np.abs(d).max(initial=0.0) <= self.radius or lam > 1e300:
                break
            lam *= 2.0
        if sums.bend is None:
            return d, np.zeros_like(d)
        return d, -V.T @ ((V @ (sums.bend @ (0.5 * d**2) / s2)) / (S**2 + lam))

    def bars(self, sums: Sums, q: np.ndarray, noise: float) -> float:
        """Length of q in error bars of noise s^2."""
        return float(np.sqrt(((sums.J @ q)**2).sum() / noise + (self.prior.weight * q**2).sum()))

    def ends(self, sums: Sums) -> bool:
        """Whether more data would not make the step any better."""
        d, q = self.step(sums)
        if sums.bend is None:
            return bool(np.abs(d).max() > 0.1 and self.bars(sums, d, self.calm(sums)) > 3.0) or self.enough(sums, d, q)
        return bool(np.abs(q).max() > CURVED and self.bars(sums, q, self.calm(sums)) > 1.0) or self.enough(sums, d, q)

    def enough(self, sums: Sums, d: np.ndarray, q: np.ndarray) -> bool:
        """Whether the step leaves less than `accuracy`."""
        left = np.abs(d if sums.bend is None else q).max()
        if not self.accuracy or left > 0.25 * self.accuracy or np.abs(d).max() > RADIUS / 2.0:
            return False
        A = sums.J.T @ sums.J / self.noise(sums) + np.diag(self.prior.weight)
        if np.linalg.eigvalsh(A)[0] < 1.0 / self.accuracy**2:
            return False
        return bool(2.0 * np.sqrt(np.diag(np.linalg.inv(A))).max() <= self.accuracy)

    def there(self, sums: Sums) -> bool:
        """Whether the step from here is the last one."""
        d, q = self.step(sums)
        last = d if sums.bend is None else q
        whole = sums.time >= self.end and (np.abs(last).max() < SMALL or self.bars(sums, last, self.noise(sums)) < DONE)
        return bool(whole) or self.enough(sums, d, q)

    def lost(self, sums: Sums) -> float:
        """What differences leave of the largest singular value where it should be nothing."""
        eps = self.misfit.eps
        return max(LOST, eps, 1e-3) if sums.bend is None else max(LOST, (eps * sums.curve)**2)

    # a walk through time

    def look(self) -> Sums | None:
        """Sums at theta as far as they are worth it; None where the last step was wrong."""
        sums, best = Sums.at(self.theta, self.misfit.central), self.best
        most = np.inf
        if best:
            most = self.cost(best, best) + SLACK
            most += SLACK * most
        try:
            for part in self.misfit.walk(self.theta):
                if self.torn(part, sums):
                    break
                sums.add(part)
                if best and sums.time <= best.time and self.cost(sums, best) > most:
                    return None
                if (best is None or sums.time >= best.time) and self.ends(sums):
                    return sums
        except Broken as broken:
            if not sums.rows and best is None:
                raise SceneError(Problem("start", f"with the start values the simulation breaks before anything was seen: "
                                         f"{broken}; give other start values, or more substeps")) from None
            if best and sums.time < best.time:
                return None
            self.stop(sums, f"the simulation breaks: {broken}")
            return sums
        if best and sums.time < best.time:
            return None
        return sums

    def cost(self, sums: Sums, best: Sums) -> float:
        return sums.misfit / self.noise(best) + self.prior.misfit(sums.theta)

    def torn(self, part: Part, sums: Sums) -> bool:
        """Whether a change by NEAR is no longer answered in proportion: beyond this moment nothing can be said."""
        if part.K is None or part.J is None or not len(part.r) or not sums.rows:
            return False
        first, second = (np.sqrt(np.mean(a**2, axis=0)) for a in (NEAR * part.J, 0.5 * NEAR**2 * part.K))
        if not np.any((second > LINEAR * first) & (second > np.sqrt(self.noise(sums)))):
            return False
        self.stop(sums, f"the motion is chaotic or not smooth beyond: a change of {100.0 * NEAR:g} % is no longer answered in "
                        f"proportion; {rate(sums)}")
        return True

    def stop(self, sums: Sums, text: str) -> None:
        """The horizon ends at what was summed up."""
        if not sums.rows:
            raise SceneError(Problem("horizon", f"nothing can be fitted: {text}; observe earlier frames, or give better start "
                                     "values"))
        self.end = min(self.end, sums.time)
        self.notes = [f"frames up to {sums.frame} of {self.misfit.lasts[0]} are used; {text}"]

    # until it is found

    def run(self) -> None:
        while not self.converged and self.misfit.walked < self.limit:
            self.end, self.notes = self.misfit.moments[-1], []
            sums = self.look()
            self.steps, self.accepted = self.steps + 1, sums is not None
            if sums is None:
                assert self.best is not None
                d, _ = self.step(self.best)
                self.radius = 0.25 * float(np.abs(d).max())
                self.theta = self.best.theta + self.step(self.best)[0]
                if self.radius < 1e-9:
                    self.notes.append("no step makes the misfit any smaller")
                    break
            else:
                d, _ = self.step(sums)
                if self.best is not None:
                    self.radius = min(RADIUS, max(self.radius, 2.0 * float(np.abs(d).max())))
                self.best, self.converged = sums, self.there(sums)
                self.theta = sums.theta + d
            self.each(self)
        if not self.converged and self.misfit.walked >= self.limit:
            self.notes.append(f"not converged within {self.limit:g} simulations: allow more, or start nearer")

    # stopping and going on

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.misfit.parameters]

    def save(self, path) -> None:
        b = self.best
        best = b and {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in vars(b).items()}
        state.write(path, self.names, {
            "theta": self.theta.tolist(), "radius": self.radius, "steps": self.steps, "simulations": self.misfit.walked,
            "launches": self.misfit.launches, "converged": self.converged, "end": self.end, "notes": self.notes, "best": best})

    def resume(self, path) -> None:
        """Goes on from a file of `save`. Raises SceneError where it is of another fit."""
        with state.reading(path, self.names) as found:
            b = found["best"]
            self.theta, self.radius, self.steps = np.array(found["theta"]), float(found["radius"]), int(found["steps"])
            self.misfit.walked, self.misfit.launches = float(found["simulations"]), int(found["launches"])
            self.converged, self.end, self.notes = bool(found["converged"]), float(found["end"]), list(found["notes"])
            if b:
                bend = None if b["bend"] is None else np.array(b["bend"])
                self.best = Sums(**b | {"theta": np.array(b["theta"]), "R": np.array(b["R"]), "bend": bend})


def rate(sums: Sums) -> str:
    """How fast derivatives grow at the end of the horizon, in words."""
    times, J = np.array([r[0] for r in sums.rows]), np.array(sums.growth)
    late = times >= 0.5 * times[-1] if len(times) else np.zeros(0, bool)
    good = late & (J.max(axis=1, initial=0.0) > 0.0) if len(times) else late
    if good.sum() < 3:
        return "too early to tell how fast perturbations grow"
    slope = float(np.polyfit(times[good], np.log(J[good].max(axis=1)), 1)[0])
    return f"perturbations grow by exp({slope:.3g} t), t in seconds"
