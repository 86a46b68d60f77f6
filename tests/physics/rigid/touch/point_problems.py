"""A body under points by two ways, NumPy in float64: Newton's method on six unknowns, and sweeps of single contacts that know
nothing of it."""

from dataclasses import dataclass

import numpy as np


def skew(r):
    x, y, z = np.moveaxis(np.asarray(r, float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)


@dataclass
class Problem:
    """M (6, 6), q (6,) momentum; of each contact n, r, base, slip, mu, m: kernels/rigid/touch/body_point_solve.py, with f = m /
    h."""

    M: np.ndarray
    q: np.ndarray
    n: np.ndarray
    r: np.ndarray
    base: np.ndarray
    slip: np.ndarray
    mu: np.ndarray
    m: np.ndarray
    h: float

    def arms(self):
        """(contacts, 3, 6): the velocity of a place from that of the body."""
        return np.concatenate([np.broadcast_to(np.eye(3), (len(self.n), 3, 3)), -skew(self.r)], -1)

    def pushes(self, V):
        """P (contacts, 3) [m] of Coulomb's law, and dP/dU."""
        n, h = self.n, self.h
        U = self.arms() @ V
        lam = self.base + h * (n * U).sum(1)
        on = (lam > 0.0)[:, None]
        lam = np.maximum(lam, 0.0)
        across = np.eye(3) - n[:, :, None] * n[:, None, :]
        s = np.einsum("nij,nj->ni", across, self.slip - h * U)
        size = np.linalg.norm(s, axis=1)
        bound = self.mu * lam
        sticks = (size <= bound)[:, None]
        way = s / np.maximum(size, 1e-300)[:, None]
        P = lam[:, None] * n + np.where(sticks, -s, -bound[:, None] * way)
        slope = h * n[:, :, None] * n[:, None, :]
        sliding = (-(self.mu * h)[:, None, None] * way[:, :, None] * n[:, None, :] + (h * bound / np.maximum(size, 1e-300))[
            :, None, None] * (across - way[:, :, None] * way[:, None, :]))
        return P * on, (slope + np.where(sticks[:, :, None], h * across, sliding)) * on[:, :, None]

    def newton(self, most=80):
        """(V, evaluations): halved steps on |F| in the norm of M^-1."""
        B, f, inverse = self.arms(), self.m / self.h, np.linalg.inv(self.M)

        def at(V):
            P, slope = self.pushes(V)
            F = self.M @ V - self.q + np.einsum("nki,nk->i", B, f[:, None] * P)
            return F, self.M + np.einsum("nki,nkl,nlj->ij", B, f[:, None, None] * slope, B), F @ inverse @ F
        V, (F, K, size) = np.zeros(6), at(np.zeros(6))
        first, part, step = size, 1.0, -np.linalg.solve(K, F)
        count = 1
        while count < most:
            count += 1
            trial = V + part * step
            F, K, found = at(trial)
            if found < size:
                V, size, part = trial, found, 1.0
                if size <= 1e-26 * first:
                    break
                step = -np.linalg.solve(K, F)
            else:
                part *= 0.5
                if part < 1e-4:
                    break
        return V, count

    def swept(self, sweeps=20000, enough=1e-14):
        """V by projected Gauss-Seidel: contacts in turn, each against the body as it is, until nothing changes."""
        B, inverse, h = self.arms(), np.linalg.inv(self.M), self.h
        f = self.m / h
        J, V = np.zeros((len(self.n), 3)), inverse @ self.q
        for _ in range(sweeps):
            most = 0.0
            for i, n in enumerate(self.n):
                W = B[i] @ inverse @ B[i].T + np.eye(3) / (f[i] * h)         # velocity of the place less the point's, by -J
                lam = n @ J[i]
                # the gap closes by h (n.U) - n.J / f = -base
                wants = lam + (self.base[i] / h + n @ (B[i] @ V) - lam / (f[i] * h)) / (n @ W @ n)
                new = max(wants, 0.0)
                V = V - inverse @ B[i].T @ ((new - lam) * n)
                T = J[i] - lam * n
                slide = self.slip[i] / h - B[i] @ V + T / (f[i] * h)
                t1 = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
                t1 /= np.linalg.norm(t1)
                E = np.stack([t1, np.cross(n, t1)])
                T2 = T + E.T @ np.linalg.solve(E @ W @ E.T, -(E @ slide))
                bound = self.mu[i] * new
                size = np.linalg.norm(T2)
                if size > bound:
                    T2 *= bound / size
                V = V - inverse @ B[i].T @ (T2 - T)
                most = max(most, np.abs(new * n + T2 - J[i]).max() * np.linalg.norm(inverse))
                J[i] = new * n + T2
            if most < enough:
                break
        return V


def problem(rng, contacts, mu, ratio, h=2e-3):
    """Points under a ball of 1 kg and 0.2 m, `ratio` of its mass together, which it falls into; some are out of reach."""
    n = rng.normal(size=(contacts, 3))
    n[:, 1] = -np.abs(n[:, 1]) - 0.3
    n /= np.linalg.norm(n, axis=1)[:, None]
    m = rng.uniform(0.5, 1.5, contacts)
    m *= ratio / m.sum()
    return Problem(np.diag([1.0] * 3 + [0.016] * 3), np.zeros(6), n, 0.2 * n, rng.uniform(-1e-3, 4e-3, contacts),
                   rng.normal(size=(contacts, 3)) * 2e-3, np.full(contacts, mu), m, h)


def squeezed_box(rng, ratio, h=2e-3):
    """A box of 1 kg and 0.08 m between two layers of 16 points, each of `ratio` of its mass, that slip on it a little."""
    side = np.repeat([-1.0, 1.0], 16)
    n, r = np.outer(side, [0.0, 1.0, 0.0]), rng.uniform(-0.04, 0.04, (32, 3))
    r[:, 1] = 0.04 * side
    return Problem(np.diag([1.0] * 3 + [1.07e-3] * 3), np.zeros(6), n, r, rng.uniform(1e-5, 3e-5, 32) - 2e-5 * side,
                   2e-6 * rng.normal(size=(32, 3)), np.full(32, 0.5), np.full(32, ratio), h)
