"""What a fit knows and what it does not: error bars, correlations, singular values, and the directions that data leave open.

    C = (J^T J / s^2 + P)^-1        covariance of theta; an error bar is the root of its diagonal, in the parameter's unit
                                    times d value / d theta; P of the priors
    J / s = U S V^T                 a direction v of theta with singular value S is known to 1 / S

A direction is open where 1 / S is more than OPEN units of theta (a factor e), or S lost in what J itself errs
(`wsim.fitting.least_squares.normal_equations`).
"""

from dataclasses import dataclass

import numpy as np

from wsim.fitting.least_squares.levenberg_marquardt import OPEN
from wsim.fitting.least_squares.normal_equations import JacobianSpectrum
from wsim.fitting.parameter import Parameter

NOTHING = 0.01         # of the noise, what a factor e of a parameter moves of all that was observed: said to be nothing
PART = 0.2             # of a direction's largest entry, from which a parameter belongs to it


@dataclass
class ParameterEstimate:
    """Estimates of the parameters, (p,), each in its unit; `theta` in the mapped space."""

    theta: np.ndarray
    values: np.ndarray
    errors: np.ndarray            # one standard deviation; inf: not identifiable
    low: np.ndarray               # two error bars below and above, through the map
    high: np.ndarray
    covariance: np.ndarray        # of theta, 0 along directions that are not identifiable, (p, p)
    correlation: np.ndarray       # (p, p)
    singular: np.ndarray          # descending
    open: list[np.ndarray]        # directions of theta, (p,) each
    words: list[str]


def estimate_with_errors(parameters: list[Parameter], theta: np.ndarray, spectrum: JacobianSpectrum, noise: float,
                         prior: np.ndarray) -> ParameterEstimate:
    """spectrum of the Jacobian at theta, noise s^2, prior: weights (p,) of the priors."""
    singular, V, J = spectrum.S / np.sqrt(noise), spectrum.V, spectrum.J
    wide = (singular < 1.0 / OPEN) | ~spectrum.kept
    priors = V**2 @ prior                                                # what the priors know of each direction
    directions = [V[k] for k in range(len(theta)) if wide[k] and priors[k] < 1.0 / OPEN**2]
    known = np.where(wide, 0.0, singular**2)
    A = V.T @ (known[:, None] * V) + np.diag(prior)
    size, W = np.linalg.eigh(A)
    C = W @ (np.where(size > 0.0, 1.0 / np.maximum(size, 1e-30), 0.0)[:, None] * W.T)
    sigma = np.sqrt(np.diag(C))
    for v in directions:
        sigma = np.where(np.abs(v) > 1e-2, np.inf, sigma)
    shown = np.sqrt(np.diag(C))
    shown = np.where(shown > 0.0, shown, 1.0)                            # of what changes nothing C has nothing
    correlation = C / np.outer(shown, shown)
    values = np.array([p.map.inverse(float(t)) for p, t in zip(parameters, theta, strict=True)])
    slopes = np.array([p.map.slope(float(t)) for p, t in zip(parameters, theta, strict=True)])
    low, high = (np.array([p.map.inverse(float(t)) if np.isfinite(t) else np.nan
                           for p, t in zip(parameters, theta + s * sigma, strict=True)]) for s in (-2.0, 2.0))
    errors = np.where(np.isfinite(sigma), slopes * np.where(np.isfinite(sigma), sigma, 0.0), np.inf)
    dark = [v for v in directions if np.linalg.norm(J @ v) < NOTHING * np.sqrt(noise)]
    return ParameterEstimate(theta, values, errors, low, high, C, correlation, singular, directions,
                             describe_open_directions(parameters, dark, np.sqrt((J**2).sum(axis=0) / noise))
                             + describe_faint_directions(parameters, [v for v in directions if not any(v is d for d in dark)]))


def describe_faint_directions(parameters: list[Parameter], directions: list[np.ndarray]) -> list[str]:
    """Directions that show, and by less than the noise."""
    found = []
    for v in directions:
        names = [p.name for p, part in zip(parameters, v, strict=True) if abs(part) > PART]
        what = "its value is" if len(names) == 1 else "together their values are"
        found.append(f"{_list_of_names(names)} show{'s' * (len(names) == 1)} in what was observed by less than the noise: "
                     f"{what} not "
                     "known to a factor e; give a prior, or better data")
    return found


def describe_open_directions(parameters: list[Parameter], directions: list[np.ndarray], seen: np.ndarray) -> list[str]:
    """Directions that do not show, whatever the noise. seen: length of each column of J / s."""
    if not directions:
        return []
    found, V = [], np.array(directions)
    alone = [k for k, s in enumerate(seen) if s < NOTHING]
    found += [f"{parameters[k].name} changes nothing that was observed: it cannot be found from these data" for k in alone]
    if len(alone) >= len(directions):
        return found
    if len(directions) - len(alone) == 1:
        V[:, alone] = 0.0
        v = V[np.argmax(np.linalg.norm(V, axis=1))]
        return [*found, _describe_direction(parameters, v / v[np.argmax(np.abs(v))])]
    held = [p.name for k, p in enumerate(parameters) if k not in alone and np.abs(V[:, k]).max() > PART]
    return [*found, f"of {_list_of_names(held)} only {len(held) - len(directions) + len(alone)} "
            f"combination{'s' * (len(held) - len(directions) + len(alone) != 1)} can be found: give priors, or other data"]


def _describe_direction(parameters: list[Parameter], v: np.ndarray) -> str:
    """One open direction, its largest entry 1."""
    own = [k for k in range(len(v)) if abs(v[k]) > PART]
    names = [parameters[k].name for k in own]
    logs = all(parameters[k].map.kind == "log" for k in own)
    even = np.allclose(np.abs(v[own]), 1.0, atol=0.1)
    if len(own) == 1:
        return f"{names[0]} changes nothing that was observed: it cannot be found from these data"
    if not (logs and even):
        parts = ", ".join(f"{parameters[k].name} {'x' if parameters[k].map.kind == 'log' else '+'} "
                          f"{_amount_of_change(parameters[k], v[k])}" for k in own)
        return (f"{_list_of_names(names)} can change together and nothing that was observed changes ({parts}, say): give one "
                "of them, or a prior")
    up, down = ([parameters[k].name for k in own if v[k] * s > 0.0] for s in (1.0, -1.0))
    if len(own) == 2:
        what = f"the ratio of {up[0]} to {down[0] if down else up[1]}" if not down else f"the product of {up[0]} and {down[0]}"
    elif not down:
        what = f"the ratios of {_list_of_names(up)} to each other"
    else:
        what = (f"combinations that stay as they are when {_list_of_names(up)} grow and {_list_of_names(down)} shrink by the "
                f"same factor")
    return f"only {what} matters here: {_list_of_names(names)} cannot be told apart; give one of them, or a prior"


def _amount_of_change(p: Parameter, v: float) -> str:
    if p.map.kind == "log":
        return f"{np.exp(0.1 * v):.3g}"
    return f"{0.1 * v * (p.map.high if p.map.kind == 'plain' else 1.0):.2g}"


def _list_of_names(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
