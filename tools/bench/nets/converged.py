"""Backward Euler and BDF2 for spring nets with every step solved to rounding: the error of the integrator alone.

With s the last step and d the unknown one, v = (d - a) / q: a = 0, q = h (backward Euler; the first step of BDF2)
or a = s/3, q = 2h/3 (BDF2); v = v~ + q acceleration(x + d), v~ the last velocity v or v + (v - v_before) / 3. Solved is

    M (d - b) = q^2 F(x + d),    b = a + q (v~ + q g)

the minimum of (d - b) M (d - b) / 2 + q^2 U(x + d), by Newton with the exact Jacobian and SciPy's sparse LU. Order 1
and 2 in h. Hairer, Wanner 1996, V.1; Nocedal, Wright 2006, ch. 3 (line search).
"""

from collections.abc import Callable, Sequence

import numpy as np

from tools.bench.nets.reference import Net, steps_between


def converged(net: Net, times: Sequence[float], h: float, integrator: str = "bdf2",
              each: Callable[[float, np.ndarray, np.ndarray], None] | None = None) -> np.ndarray:
    """Positions (times, n, 3) [m] by "backward_euler" or "bdf2" of step h [s], every step solved to rounding.

    each(t, x, v) is called after every step. RuntimeError when Newton does not converge: take a smaller step.
    """
    if integrator not in ("backward_euler", "bdf2"):
        raise ValueError(f'integrator is {integrator!r}; allowed is "backward_euler" or "bdf2"')
    x, v, t = net.points, np.zeros_like(net.points), 0.0
    s, v_before, positions = None, v, []
    solve = _newton(net)
    for steps in steps_between(times, h):
        for _ in range(steps):
            if integrator == "backward_euler" or s is None:
                a, q, v_tilde = np.zeros_like(x), h, v
            else:
                a, q, v_tilde = s / 3.0, 2.0 * h / 3.0, v + (v - v_before) / 3.0
            d = solve(x, a + q * (v_tilde + q * net.free * np.asarray(net.gravity)), q)
            s, v_before = d, v
            x, v, t = x + d, (d - a) / q, t + h
            if each is not None:
                each(t, x, v)
        positions.append(x)
    return np.array(positions)


def _newton(net: Net) -> Callable[[np.ndarray, np.ndarray, float], np.ndarray]:
    """solve(x, b, q): d with M (d - b) = q^2 F(x + d), F the spring forces at free points, zero at pins.

    Where a step goes uphill or the matrix is indefinite (compressed springs), the step is halved, then the negative
    part of the stiffness is left out until a full step succeeds.
    """
    from scipy.sparse import csc_matrix, diags
    from scipy.sparse.linalg import splu

    n, (i, j) = len(net.points), net.edges.T
    free, masses = np.repeat(net.free[:, 0], 3), np.repeat(net.masses, 3)
    row, column = np.repeat(np.arange(3), 3), np.tile(np.arange(3), 3)
    ends = [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)]
    rows = np.concatenate([(3 * a[:, None] + row).ravel() for a, _, _ in ends])
    columns = np.concatenate([(3 * b[:, None] + column).ravel() for _, b, _ in ends])
    signs = [sign for _, _, sign in ends]

    def stiffness(x, clamped):
        r = x[j] - x[i]
        length = np.linalg.norm(r, axis=1)
        u = r / length[:, None]
        side = net.stiffness * (1.0 - net.lengths / length)           # across the spring; negative when compressed
        side = np.maximum(side, 0.0) if clamped else side
        along = net.stiffness - side
        blocks = side[:, None, None] * np.eye(3) + along[:, None, None] * u[:, :, None] * u[:, None]
        values = np.concatenate([sign * blocks.ravel() for sign in signs])
        keep = diags(free)
        return keep @ csc_matrix((values, (rows, columns)), (3 * n, 3 * n)) @ keep

    def potential(x, b, d, q):
        strain = np.linalg.norm(x[j] + d[j] - x[i] - d[i], axis=1) - net.lengths
        return 0.5 * float(net.masses @ np.sum((d - b) ** 2, axis=1) + q * q * net.stiffness @ strain ** 2)

    def solve(x, b, q):
        d, clamped = b.copy(), False
        for _ in range(200):
            residual = net.masses[:, None] * (d - b) - q * q * net.free * net.forces(x + d)
            matrix = csc_matrix(diags(masses) + q * q * stiffness(x + d, clamped))
            factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            change = factors.solve(-residual.ravel()).reshape(-1, 3)
            if np.max(np.abs(change)) < 1e-10:                        # [m]; Newton's next change is its square
                return d + change
            step, before, slope = 1.0, potential(x, b, d, q), float(np.sum(residual * change))
            while slope < 0 and step > 1e-3 and potential(x, b, d + step * change, q) > before + 1e-4 * step * slope \
                    + 1e-12 * before:
                step *= 0.5
            if slope < 0 and step > 1e-3:
                d, clamped = d + step * change, clamped and step < 1.0
            elif clamped:
                break
            else:
                clamped = True                                        # uphill: leave out the negative part once
        raise RuntimeError(f"Newton stalls at a change of {np.max(np.abs(change)):.1e} m; take a smaller step")

    return solve
