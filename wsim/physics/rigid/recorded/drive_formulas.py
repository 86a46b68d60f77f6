"""Laws of drives of joints for all joints at once, as kernels/rigid/joint/drives.py has them; complex steps go through."""

from dataclasses import dataclass

import numpy as np

from wsim.kernels.rigid.joint.drives import LEAST, TERMS
from wsim.kernels.rigid.joint.tables import ACCELERATION, LOCKED, NONE

SMALL = 1.0e-300


def complex_oscillator_flow(q: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(1 - 2 Phi / h^2, 1 - Psi / h, chi) of q = h^2 k / m, z = h c / m, element by element."""
    size = 2.0 * np.maximum(np.sqrt(np.abs(q.real)), z.real)
    doubled = np.ceil(np.log2(np.maximum(size, 1.0))).astype(int)
    t = 0.5**doubled
    before, c, power = 0.0 * (q + z), 1.0 + 0.0 * (q + z), 1.0 + 0.0 * t
    phi, psi, chi = before, before, c
    for n in range(2, int(TERMS)):
        before, c = c, -z * c - q * before
        chi = chi + c * power * t
        power = power * t / n
        psi = psi - c * power
        phi = phi - 2.0 * c * power / (n + 1)
    P, F = t * (1.0 - psi), 0.5 * t * t * (1.0 - phi)
    for k in range(int(doubled.max(initial=0))):
        on = k < doubled
        after = P * (1.0 - q * F + chi), 2.0 * F - q * F * F + P * P, chi * chi - q * P * P
        P, F, chi = (np.where(on, new, old) for new, old in zip(after, (P, F, chi), strict=True))
    many = doubled > 0
    return np.where(many, 1.0 - 2.0 * F, phi), np.where(many, 1.0 - P, psi), chi


@dataclass
class DriveLaw:
    """a, b, a', b', d of all rows (..., joints, 6)."""

    a: np.ndarray
    b: np.ndarray
    a_last: np.ndarray
    b_last: np.ndarray
    d: np.ndarray


def complex_drive_law(K: np.ndarray, C: np.ndarray, m: np.ndarray, alone: np.ndarray) -> DriveLaw:
    """Laws of K = k h^2, C = c h and effective masses m, which count where `alone` (joints,) is 1."""
    least = float(LEAST)
    both = K + C
    rough = (np.where(both.real > least, 1.0 + 2.0 * K / np.where(both.real > least, both, 1.0), 1.0) * K / 6.0 + C / 3.0,
             -C / 6.0, 0.5 * K + 0.25 * C, -0.25 * C, 0.5 * C)
    on = (alone[:, None] == 1) & (K.real < 4.0 * m.real)
    q, z = np.where(on, K / m, 0.0), np.where(on, C / m, 0.0)
    root = np.sqrt(np.where(np.abs(q) > 0.0, q, 1.0))
    part = np.where(on, np.where(q.real <= 1.0, 1.0, 2.0 - root), 0.0)
    phi, psi, chi = complex_oscillator_flow(q, z)
    exact = (m * phi / (1.0 - phi), m * (phi - psi) / (1.0 - phi), m * psi / (1.0 - psi),
             m * (chi - 1.0 + psi) / (1.0 - psi), 0.0 * K)
    return DriveLaw(*(one + part * (other - one) for one, other in zip(rough, exact, strict=True)))


def reduce_locked_rows(kind: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Schur complement of the locked rows of each joint, of A_jj (..., joints, 6, 6)."""
    A, diagonal = A + 0.0, np.einsum("...ii->...i", A).real
    for m in range(6):
        on = (kind[:, m] == int(LOCKED)) & (A[..., m, m].real > 1.0e-12 * diagonal[..., m])
        part = np.where(on[..., None], A[..., :, m] / np.where(on, A[..., m, m], 1.0)[..., None], 0.0)
        part[..., m] = 0.0
        A = A - part[..., :, None] * A[..., m:m + 1, :]
    return A


def safe_reciprocal(size: np.ndarray) -> np.ndarray:
    return 1.0 / np.where(np.abs(size) > SMALL, size, 1.0)


def row_effective_masses(A: np.ndarray) -> np.ndarray:
    """What each row moves, (..., joints, 6), of `reduce_locked_rows`."""
    return safe_reciprocal(np.einsum("...ii->...i", A))


def coupled_drive_masses(drive: np.ndarray, A: np.ndarray) -> np.ndarray:
    """The same less what other driven rows of the joint share."""
    size = np.einsum("...ii->...i", A)
    driven = drive > int(NONE)
    shared = np.where(driven[:, :, None] & driven[:, None, :] & ~np.eye(6, dtype=bool), A * np.sign(A.real), 0.0)
    ratio = np.where(driven, size, 1.0)[..., :, None] / np.where(driven, size, 1.0)[..., None, :]
    return safe_reciprocal(size + (shared * np.sqrt(ratio)).sum(axis=-1))


def effective_drive_gains(drive: np.ndarray, m: np.ndarray, stiffness: np.ndarray,
                          damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of all rows; those of accelerations per effective mass."""
    mass = np.where(drive == int(ACCELERATION), m, 1.0)
    return mass * stiffness, mass * damping
