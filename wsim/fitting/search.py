"""Levenberg-Marquardt with a horizon that grows as far as the fit holds. More 1978 (trust region); Transtrum, Sethna 2012
(second derivatives along a step).

At theta all copies are run together and the normal equations are summed up moment by moment. With what was summed up so far

    (J^T J / s^2 + P + lam 1) d = -(J^T r / s^2 + P (theta - mean)),    |d| <= radius        s noise, P of the priors
    (J^T J / s^2 + P + lam 1) q = -J^T K d^2 / 2 s^2                    what curvature adds to the step d

As soon as q is larger than the error bars that the data so far allow, later data cannot make the step any better: the run is
left there, and d is taken. So first steps cost a few frames, and only those near the end the whole horizon. A step after which
the misfit over the same frames is larger is taken back, with a quarter of the radius. Where no noise is given, s is what the
linear model leaves, and never less than the floor (`wsim.fitting.floor`, and CHANCE times what differences show of chance).

Converged means, at a theta that was run over all that is used: the step from there is less than DONE error bars (so that it
would take less than DONE^2 off chi^2) in all that is known to better than a factor e, and promises less than 1 off chi^2 in the
rest; something is known; and what seems not to be seen was looked at with the longest difference. That theta is the result.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wsim.fitting import state
from wsim.fitting.copies import Broken
from wsim.fitting.misfit import Misfit, Part, Steps
from wsim.fitting.normal_equations import FARTHEST, Spectrum, Sums
from wsim.scene import Problem, SceneError

RADIUS = 1.0           # largest step of a mapped parameter: a factor e
WEAK = 0.1             # lam: what the data leave open within 3 units of theta moves little
CURVED = 1e-5          # curvature of less than this (of theta) never ends a run early
DONE = 0.2             # error bars that the step from the last theta may have
CHANCE = 10.0          # noise is at least so many times what a simulation leaves to chance: that is alike from point to point
JITTER = 1e-9          # of the floor's unit: chance that forward differences, which cannot measure it, are taken to have
LINEAR = 0.2           # part of the answer to a change of theta by NEAR that curvature may be, where it is more than noise
NEAR = 1e-3            # no model knows a parameter better: where such a change is not answered in proportion, all is chance
SLACK = 1e-3           # of the misfit: as good as equal
LOUD = 4.0             # s^2 over what it was at an earlier moment: the linear model is what is wrong, not the data


@dataclass
class Prior:
    """Of each parameter in the mapped space: weight 1 / sigma^2 (0: none) and mean."""

    weight: np.ndarray
    mean: np.ndarray

    def misfit(self, theta: np.ndarray) -> float:
        return float((self.weight * (theta - self.mean)**2).sum())


class Search:
    """theta, and how it got there. `run` until it is found, or `limit` simulations are spent; `best` is the result."""

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

    # what is known at one theta

    def chance(self, sums: Sums) -> float:
        """Of all residuals together, where forward differences cannot measure it."""
        return JITTER / 1e-7 * self.misfit.floor * np.sqrt(sums.count)

    def floor(self, sums: Sums) -> float:
        """s^2 below which nothing is claimed."""
        least = self.misfit.floor**2
        if sums.second is None or not sums.count:
            return least
        seen = sums.second[sums.second > 0.0] * sums.steps.h[sums.second > 0.0]**4 / 6.0
        return max(least, CHANCE**2 * float(seen.min(initial=np.inf if len(seen) else 0.0)) / sums.count)

    def noise(self, sums: Sums, left: float | None = None) -> float:
        """s^2. left: sum of r^2; None: after the step of the linear model."""
        left = sums.least if left is None else left
        return max(1.0 if self.known else left / max(sums.count - len(sums.theta), 1), self.floor(sums))

    def calm(self, sums: Sums) -> float:
        """s^2, but at most LOUD times what it was at any earlier moment."""
        return min(self.noise(sums), max(LOUD * sums.quiet, self.floor(sums)))

    def spectrum(self, sums: Sums) -> Spectrum:
        return sums.spectrum(self.chance(sums))

    # one step

    def equations(self, sums: Sums) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """S, V and U^T (-side) of J over s above the roots of the priors, without what is lost."""
        s, root = np.sqrt(self.noise(sums)), np.sqrt(self.prior.weight)
        spectrum = self.spectrum(sums)
        seen = (spectrum.V @ (sums.J.T @ sums.R[:-1, -1])) / np.maximum(spectrum.S, 1e-300) / s
        rows = np.concatenate([spectrum.J / s, np.diag(root)])
        side = np.concatenate([np.where(spectrum.kept, seen, 0.0), root * (sums.theta - self.prior.mean)])
        U, S, V = np.linalg.svd(rows, full_matrices=False)
        known = S > 1e-12 * max(S[0], 1e-300)
        return S[known], V[known], -(U.T @ side)[known]

    def step(self, sums: Sums) -> tuple[np.ndarray, np.ndarray]:
        """d and q."""
        S, V, side = self.equations(sums)
        lam = WEAK
        while True:
            d = V.T @ (S / (S**2 + lam) * side)
            if np.abs(d).max(initial=0.0) <= self.radius or lam > 1e300:
                break
            lam *= 2.0
        if sums.bend is None:
            return d, np.zeros_like(d)
        square = 0.5 * (sums.steps.B.T @ d)**2 / self.noise(sums)
        return d, -V.T @ ((V @ (sums.bend @ square)) / (S**2 + lam))

    def bars(self, sums: Sums, q: np.ndarray, noise: float) -> float:
        """Length of q in error bars of noise s^2."""
        return float(np.sqrt(((sums.J @ q)**2).sum() / noise + (self.prior.weight * q**2).sum()))

    def ends(self, sums: Sums) -> bool:
        """Whether more data would not make the step any better."""
        d, q = self.step(sums)
        if sums.bend is None:
            return bool(np.abs(d).max() > 0.1 and self.bars(sums, d, self.calm(sums)) > 3.0) or self.enough(sums, d)
        if np.abs(d).max() <= RADIUS / 2.0 and self.enough(sums, q):
            return True
        return bool(np.abs(q).max() > CURVED and self.bars(sums, q, self.calm(sums)) > 1.0)

    def enough(self, sums: Sums, left: np.ndarray) -> bool:
        """Whether what is left to go is less than `accuracy`, and all is known to it."""
        if not self.accuracy or np.abs(left).max() > 0.25 * self.accuracy:
            return False
        A = self.spectrum(sums).J
        A = A.T @ A / self.noise(sums) + np.diag(self.prior.weight)
        if np.linalg.eigvalsh(A)[0] < 1.0 / self.accuracy**2:
            return False
        return bool(2.0 * np.sqrt(np.diag(np.linalg.inv(A))).max() <= self.accuracy)

    def there(self, sums: Sums) -> bool:
        """Whether the fit has converged here."""
        if self.enough(sums, self.step(sums)[0]):
            return True
        S, _, side = self.equations(sums)
        strong = S >= 1.0                                   # error bars below a factor e
        return bool(sums.time >= self.end and strong.any() and np.linalg.norm(side[strong]) <= DONE
                    and np.linalg.norm(side[~strong]) <= 1.0 and not self.hidden(sums))

    def hidden(self, sums: Sums) -> bool:
        """Whether something seems not to be seen that a longer difference may show."""
        lost = self.spectrum(sums).V[~self.spectrum(sums).kept]
        short = np.abs(sums.steps.h) < 0.99 * max(FARTHEST, self.misfit.eps)
        return bool((np.abs(lost @ sums.steps.B[:, short]) > 0.1).any())

    def next_steps(self) -> Steps:
        best, eps = self.best, self.misfit.eps
        if best is None:
            return Steps.axes(len(self.theta), eps)
        return best.next_steps(eps, self.chance(best), (0.5 / CHANCE)**2 * self.noise(best))

    # a walk through time

    def look(self) -> Sums | None:
        """Sums at theta as far as they are worth it; None where the last step was wrong."""
        best = self.best
        sums, most = Sums.at(self.theta, self.next_steps(), self.misfit.central), np.inf
        if best:
            most = self.cost(best, best) + SLACK
            most += SLACK * most
        try:
            for part in self.misfit.walk(self.theta, steps=sums.steps):
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
        each = (NEAR * part.J @ sums.steps.B, 0.5 * NEAR**2 * part.K)
        first, second = (np.sqrt(np.mean(a**2, axis=0)) for a in each)
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
            else:
                d, _ = self.step(sums)
                if self.best is not None:
                    self.radius = min(RADIUS, max(self.radius, 2.0 * float(np.abs(d).max())))
                self.best, self.converged = sums, self.there(sums)
                if self.converged and not self.misfit.central:
                    self.best = self.look_behind(sums)
                    self.converged = self.there(self.best)
            self.theta = self.best.theta + self.step(self.best)[0]
            self.each(self)
            if self.stuck():
                break
        if not self.converged and self.misfit.walked >= self.limit:
            self.notes.append(f"not converged within {self.limit:g} simulations: allow more, or start nearer")

    def look_behind(self, best: Sums) -> Sums:
        """Forward differences see no curvature, and cannot tell chance from answers: once more with the other sign, which makes
        central ones of them."""
        sums = Sums.at(best.theta, best.steps, central=True)
        first: list[Part] = []
        try:
            for steps in (best.steps, Steps(best.steps.B, -best.steps.h)):
                for k, part in enumerate(self.misfit.walk(best.theta, steps=steps)):
                    if part.time > best.time:
                        break
                    if steps is best.steps:
                        first.append(part)
                        continue
                    curves = (first[k].J - part.J) @ best.steps.B / best.steps.h          # type: ignore[operator]
                    sums.add(Part(part.time, part.frame, part.r, 0.5 * (first[k].J + part.J), curves))
        except Broken:
            return best
        return sums

    def stuck(self) -> bool:
        """Whether no step is left though the fit has not converged; it says why."""
        best = self.best
        assert best is not None
        if self.converged or best.time < self.end or self.hidden(best):
            return False
        S, _, side = self.equations(best)
        if not (S >= 1.0).any() and np.linalg.norm(side) <= 1.0:
            what = "by more than a simulation leaves to chance" if not len(S) else "enough to know it to a factor e"
            self.notes.append(f"nothing that was observed depends {what} on what is fitted: values are not to be trusted")
            return True
        if self.radius >= 1e-9 and np.abs(self.theta - best.theta).max() > 0.0:
            return False
        self.notes.append("no step makes the misfit any smaller, though first derivatives promise it")
        return True

    # stopping and going on

    @property
    def names(self) -> list[str]:
        return [p.name for p in self.misfit.parameters]

    def save(self, path) -> None:
        b = self.best
        best = b and {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in vars(b).items()
                      if name not in ("steps", "before")}
        state.write(path, self.names, {
            "theta": self.theta.tolist(), "radius": self.radius, "steps": self.steps, "simulations": self.misfit.walked,
            "launches": self.misfit.launches, "converged": self.converged, "end": self.end, "notes": self.notes, "best": best,
            "along": b and [b.steps.B.tolist(), b.steps.h.tolist()]})

    def resume(self, path) -> None:
        """Goes on from a file of `save`. Raises SceneError where it is of another fit."""
        with state.reading(path, self.names) as found:
            b = found["best"]
            self.theta, self.radius, self.steps = np.array(found["theta"]), float(found["radius"]), int(found["steps"])
            self.misfit.walked, self.misfit.launches = float(found["simulations"]), int(found["launches"])
            self.converged, self.end, self.notes = bool(found["converged"]), float(found["end"]), list(found["notes"])
            if b:
                arrays = {k: None if b[k] is None else np.array(b[k]) for k in ("theta", "R", "bend", "second")}
                self.best = Sums(**b | arrays, steps=Steps(*(np.array(a) for a in found["along"])))


def rate(sums: Sums) -> str:
    """How fast derivatives grow at the end of the horizon, in words."""
    times, J = np.array([r[0] for r in sums.rows]), np.array(sums.growth)
    late = times >= 0.5 * times[-1] if len(times) else np.zeros(0, bool)
    good = late & (J.max(axis=1, initial=0.0) > 0.0) if len(times) else late
    if good.sum() < 3:
        return "too early to tell how fast perturbations grow"
    slope = float(np.polyfit(times[good], np.log(J[good].max(axis=1)), 1)[0])
    return f"perturbations grow by exp({slope:.3g} t), t in seconds"
