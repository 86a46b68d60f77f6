"""Pieces of a curve between keys: u(s) of the fraction s of the time, by a code, and a cubic of u. NumPy only.

    kind              u(s)                       cubic of u
    linear            s                          p + u (q - p)
    hold              0                          p
    eased             easing, or its parameter   p + u (q - p), or p + y(u) (q - p) of two handles
    hermite, rules    s                          by slopes m, n at the keys: Hermite with m dt, n dt
    bezier            x(u) = s                   Hermite with 3 m w, 3 n w' of handles w [s] long

The rate is d cubic/du du/ds / dt. Formulas: kernels/animation/{cubic,easing}.py, which the device evaluates too.
"""

from dataclasses import dataclass

import numpy as np

from wsim.kernels.animation import cubic
from wsim.scene.curve import easing
from wsim.scene.curve.easing import BEZIER, HOLD, STRAIGHT
from wsim.scene.curve.slopes import broadcast_column


@dataclass
class Pieces:
    """code (pieces,); x of handles, (pieces, 2) [1]; part: (a, b, c, d), (pieces, ...) each; span [s], (pieces,)."""

    code: np.ndarray
    x: np.ndarray
    part: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    span: np.ndarray

    def at(self, k: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(values, rates a second) of pieces k (n,) at fractions s (n,), (n, ...) each."""
        u, du = easing.warp_fractions(self.code[k], self.x[k], s)
        a, b, c, d = (part[k] for part in self.part)
        U = broadcast_column(u, a)
        return (cubic.cubic_piece_value(a, b, c, d, U),
                cubic.cubic_piece_rate(b, c, d, U) * broadcast_column(du / self.span[k], a))


def straight_curve_pieces(times: np.ndarray, p: np.ndarray, q: np.ndarray, code: np.ndarray) -> Pieces:
    """Pieces from p (pieces, ...) to q by a code each that is no Bezier."""
    none = np.zeros_like(p)
    return Pieces(code, np.zeros((len(code), 2)), (p, q - p, none, none), np.diff(times))


def eased_curve_pieces(times: np.ndarray, p: np.ndarray, q: np.ndarray, names: list) -> Pieces:
    """Pieces by the name or handles of an easing each."""
    code, x, y = np.zeros(len(names), np.int64), np.zeros((len(names), 2)), np.full((len(names), 2), 1.0 / 3.0)
    y[:, 1] = 2.0 / 3.0
    for k, name in enumerate(names):
        four = easing.easing_handles(name)
        code[k] = BEZIER if four else easing.CODES[name]
        if four:
            x[k], y[k] = four[::2], four[1::2]
    way = q - p
    part = cubic.hermite_coefficients(p, q, broadcast_column(3.0 * y[:, 0], p) * way,
                                      broadcast_column(3.0 * (1.0 - y[:, 1]), p) * way)
    plain = broadcast_column(code != BEZIER, p)
    line = p, way, 0.0 * p, 0.0 * p
    a, b, c, d = (np.where(plain, own, of) for own, of in zip(line, part, strict=True))
    return Pieces(code, x, (a, b, c, d), np.diff(times))


def hermite_curve_pieces(times: np.ndarray, p: np.ndarray, q: np.ndarray, leave: np.ndarray, arrive: np.ndarray,
                         widths=None) -> Pieces:
    """Pieces by slopes (pieces, ...) a second behind and before the keys. widths: of both handles [s], (pieces, 2); None:
    Hermite."""
    span = np.diff(times)
    if widths is None:
        dt = broadcast_column(span, p)
        part = cubic.hermite_coefficients(p, q, dt * leave, dt * arrive)
        return Pieces(np.full(len(span), STRAIGHT), np.zeros((len(span), 2)), part, span)
    first, last = (3.0 * broadcast_column(widths[:, j], p) for j in (0, 1))
    x = np.stack([widths[:, 0] / span, 1.0 - widths[:, 1] / span], 1)
    return Pieces(np.full(len(span), BEZIER), x, cubic.hermite_coefficients(p, q, first * leave, last * arrive), span)


def override_piece_forms(pieces: Pieces, p: np.ndarray, q: np.ndarray, form: np.ndarray) -> Pieces:
    """The pieces with those that are "linear" or "hold" instead of "curve", by form (pieces,)."""
    line, hold = broadcast_column(form == "linear", p), broadcast_column(form == "hold", p)
    a, b, c, d = (np.where(hold, h, np.where(line, m, c)) for h, m, c in zip(
        (p, 0.0 * p, 0.0 * p, 0.0 * p), (p, q - p, 0.0 * p, 0.0 * p), pieces.part, strict=True))
    code = np.where(form == "hold", HOLD, np.where(form == "linear", STRAIGHT, pieces.code))
    return Pieces(code, pieces.x, (a, b, c, d), pieces.span)


def piece_control_hull(pieces: Pieces) -> np.ndarray:
    """Values (m, ...) whose range holds every piece: its Bezier control points, or samples and an end of what overshoots."""
    a, b, c, d = pieces.part
    found = [a, a + b / 3.0, a + (b + b + c) / 3.0, a + b + c + d]
    for code in sorted(set(pieces.code.tolist()) - {STRAIGHT, HOLD, BEZIER}):
        own = pieces.code == code
        u = easing.easing_function(easing.BY_CODE[code])(np.linspace(0.0, 1.0, 1001))[0]
        found += [a[own] + end * b[own] for end in (u.min() - 1e-4, u.max() + 1e-4)]
    return np.concatenate(found)
