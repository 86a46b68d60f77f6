"""What a run left, and whether that is holding: pure functions on numbers, so that each can be shown to fail.

    finite      every position and velocity of every frame
    energy      kinetic + elastic + gravity <= what the abuse put in, all the time (see Row.energy, `ledger`)
    recovery    RMS strain of the edges after settling <= `recovery` of the row
    momentum    sum m v stays where no force from outside acts
    rest        no drift and no jitter of what has come to rest
    time        the row ends inside its limit
    refusal     a SceneError: held only where the row lists it
"""

from dataclasses import asdict, dataclass, field
from math import exp, inf, isfinite, sqrt

import numpy as np

SLACK = 0.02          # of the energy put in: a step of backward Euler on springs that buckle is convex only nearly
MAY = ("refusal", "strain", "energy", "jitter")        # what can be listed; no number, no end and no answer cannot
ROUNDING = 1e-5       # strain of an edge a hundredth of the scene's size, whose ends are rounded to float32's 6e-8


@dataclass
class Record:
    """One run of a row with a solver. Lists have one entry a frame."""

    row: str
    solver: str
    integrator: str
    finite: bool = True
    energy: list[float] = field(default_factory=list)          # [J]
    budget: list[float] = field(default_factory=list)          # [J] put in so far
    momentum: list[float] = field(default_factory=list)        # |p - p0| / sum m |v|, while abused
    strain: list[float] = field(default_factory=list)          # RMS of the edges
    worst: float = 0.0                                         # largest |strain| of an edge at any frame
    abused: int = 0                                            # frames until the abuse ended
    bound: float = inf                                         # RMS strain that counts as recovered
    left: float = 0.0                                          # what the solver is known to leave besides (sweeps)
    swing: float = 1.0                                         # by which energy as read goes up and down, see `swing`
    momentum_bound: float = inf
    drift: float = 0.0                                         # [m] largest way of a point from when it had settled
    jitter: float = 0.0                                        # [m/s] largest speed after that
    drift_bound: float = inf
    jitter_bound: float = inf
    refusal: str = ""                                          # text of a SceneError
    broke: str = ""                                            # anything else raised
    ms: float = 0.0                                            # a frame, mean without the first
    seconds: float = 0.0
    limit: float = inf                                         # [s]
    hung: bool = False
    notes: list[str] = field(default_factory=list)             # warnings of the run

    def as_dict(self) -> dict:
        lists = ("energy", "budget", "momentum", "strain")
        out = {k: v for k, v in asdict(self).items() if k not in lists}
        out |= {"final_strain": self.strain[-1] if self.strain else None, "energy_ratio": energy_ratio(self),
                "frames": len(self.energy)}
        return {k: (v if not isinstance(v, float) or isfinite(v) else None) for k, v in out.items()}


@dataclass(frozen=True)
class Verdict:
    held: bool
    text: str


def energy_ratio(record: Record) -> float:
    """Largest energy over what had been put in by then; inf where none was put in and some is there."""
    ratios = [0.0 if e <= 0.0 else (e / b if b > 0.0 else inf)
              for e, b in zip(record.energy, record.budget, strict=True)]
    return most(ratios)


def most(values: list[float]) -> float:
    """The largest, or NaN where there is one (Python's own max goes by the order); 0 of none."""
    return float(np.max(values, initial=0.0))


def faults(record: Record) -> list[tuple[str, str]]:
    """(kind, words) of everything that a record fails in, refusals included."""
    found = []
    if record.hung or record.seconds > record.limit:
        found.append(("time", f"not done after {record.limit:g} s"))
    if record.broke:
        found.append(("broke", record.broke))
    if record.refusal:
        found.append(("refusal", f"refused: {record.refusal}"))
    if not record.finite:
        found.append(("finite", f"not finite in frame {len(record.energy)}"))
    ratio = energy_ratio(record)
    if not ratio <= record.swing * (1.0 + SLACK):                       # also: no number
        found.append(("energy", f"{ratio:.3g} times the energy put in"))
    if record.momentum and not most(record.momentum) <= record.momentum_bound:
        found.append(("momentum", f"momentum off by {most(record.momentum):.2g}, bound {record.momentum_bound:.2g}"))
    if not (record.refusal or record.broke or record.hung or not record.finite):
        last = record.strain[-1] if record.strain else inf
        if not last <= record.bound + record.left:
            found.append(("strain", f"RMS strain {last:.3g} after settling, bound {record.bound + record.left:.3g}"))
        if not record.drift <= record.drift_bound:
            found.append(("drift", f"drifts {record.drift:.2g} m, bound {record.drift_bound:.2g}"))
        if not record.jitter <= record.jitter_bound:
            found.append(("jitter", f"jitters at {record.jitter:.2g} m/s, bound {record.jitter_bound:.2g}"))
    return found


def judge(record: Record, listed: dict[str, str]) -> Verdict:
    """listed: kind of fault -> reason, written down beforehand. Only what is in MAY can be listed."""
    found = faults(record)
    bad = [text for kind, text in found if kind not in listed or kind not in MAY]
    if bad:
        return Verdict(False, "; ".join(bad))
    if found:
        return Verdict(True, "; ".join(f"{text.splitlines()[0]:.90}, as listed: {listed[kind]}" for kind, text in found))
    if record.strain and record.strain[-1] > record.bound:
        return Verdict(True, f"held, but for the strain that sweeps leave: up to {record.left:.2g} here")
    return Verdict(True, "held")


def decay(frequency: float, drag: float, seconds: float) -> float:
    """What is left of an oscillation of `frequency` [rad/s] under a velocity decay `drag` [1/s]: x'' + c x' + w^2 x = 0.

    Below c = 2 w it rings under (1 + c t / 2) exp(-c t / 2), which also bounds the critical case; above, the slow root
    rate w^2 / c <= lambda decays: (c t / 2 + 1) covers the mixing there too."""
    c = drag
    slow = c / 2.0 if 2.0 * frequency >= c else c / 2.0 - sqrt(c * c / 4.0 - frequency**2)
    return min(1.0, (1.0 + min(slow, c / 2.0) * seconds) * exp(-slow * seconds))


def swing(part: float) -> float:
    """How far the energy of symplectic Euler may rise: it keeps E - (h / 2) v.f (Hairer, Lubich, Wanner 2006, IX.3), and of a
    mode |h v.f / 2| <= (h omega / 2) E. part: h omega / 2 < 1 of the fastest mode."""
    return (1.0 + part) / (1.0 - part)


def leapfrog_swing(part: float) -> float:
    """How far the energy of leapfrog may rise: of a mode it keeps v^2 + (1 - part^2) omega^2 x^2 (Hairer, Lubich, Wanner 2003,
    Acta Numerica, 5). part: h omega / 2 < 1 of the fastest mode."""
    return 1.0 / (1.0 - part * part)


def sweeps_leave(gravity: float, h: float, edges: int, length: float, iterations: int) -> float:
    """Strain that Gauss-Seidel sweeps leave in a sheet that hangs by `edges` edges of `length` [m].

    Multipliers start from 0 each substep; a sweep gives an edge at most what closes its own gap C, m C / 2 between
    equal masses, so the topmost carries N m g h^2 after n sweeps only if C >= 2 N g h^2 / n. A load far heavier
    than the edge's ends, M / m times, leaves as many times more: rows with one list it."""
    return 2.0 * edges * gravity * h * h / (iterations * length)


def recovery(static: float, faded: float) -> float:
    """RMS strain that counts as recovered: twice the static one (the sheet is coarse, its load uneven), what the abuse
    left times its decay, and rounding."""
    return 2.0 * static + faded + ROUNDING
