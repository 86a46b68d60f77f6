"""Error and time of elastic waves in the material point method: the first axial and the first bending frequency of a free bar.

    PYTHONPATH=. python tools/bench/soft/mpm/bars.py [--across 4 8 16] [--device cpu]

A bar is 8 times as long as it is thick, 4 cells deep, and has a Poisson's ratio of 0, so that depth changes nothing. Axial:
f = sqrt(E / density) / (2 L). Bending: Timoshenko's free beam with the shear coefficient 5/6. It starts with the velocity of
the mode, so small that all is linear; its frequency is that of the velocity's projection on the mode, by least squares.
"""

import argparse
import time

import numpy as np

import wsim
from wsim.physics.mpm.objects import Jelly

THICK, RATIO, YOUNG, DENSITY = 1.0, 8.0, 1e6, 1000.0
SHEAR = 5.0 / 6.0
SPEED = 1e-3               # greatest of the mode [m/s]: strains of 1e-5


def beam_system(omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Roots, and the 4 x 4 matrix of moments and shear forces at both ends of Timoshenko's free beam [1/s]."""
    area, inertia, shear = THICK, THICK**3 / 12.0, 0.5 * YOUNG * SHEAR * THICK
    # -w^2 rho A y = S (y'' - b'),  -w^2 rho I b = E I b'' + S (y' - b);  y, b ~ exp(r x)
    a0, a1 = DENSITY * area * omega**2, DENSITY * inertia * omega**2
    stiff = YOUNG * inertia
    # (S r^2 + a0) (EI r^2 + a1 - S) + S^2 r^2 = 0
    squares = np.roots([shear * stiff, shear * a1 + a0 * stiff, a0 * (a1 - shear)])
    roots = np.concatenate([np.sqrt(squares.astype(complex)), -np.sqrt(squares.astype(complex))])
    ratio = (shear * roots**2 + a0) / (shear * roots)          # b / y
    rows = [f * np.exp(roots * x) for x in (0.0, RATIO * THICK) for f in (ratio * roots, roots - ratio)]
    return roots, np.array(rows)


def bending_mode() -> tuple[float, np.ndarray, np.ndarray]:
    """First angular frequency [1/s], roots and coefficients of the deflection."""
    def singular(omega: float) -> float:
        return float(np.linalg.svd(beam_system(omega)[1], compute_uv=False)[-1])
    slender = 22.3733 / (RATIO * THICK) ** 2 * np.sqrt(YOUNG * THICK**2 / 12.0 / DENSITY)
    trial = np.linspace(0.7, 1.0, 3001) * slender
    best = trial[np.argmin([singular(w) for w in trial])]
    step = trial[1] - trial[0]
    fine = np.linspace(best - step, best + step, 2001)
    omega = float(fine[np.argmin([singular(w) for w in fine])])
    roots, matrix = beam_system(omega)
    return omega, roots, np.linalg.svd(matrix)[2][-1].conj()


def mode_velocity(mode: str, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Angular frequency [1/s] and velocity (n, 3) of the mode, greatest 1, at places from the middle of the bar."""
    length, v = RATIO * THICK, np.zeros_like(x)
    if mode == "axial":
        v[:, 0] = np.sin(np.pi * x[:, 0] / length)
        return np.pi / length * np.sqrt(YOUNG / DENSITY), v
    omega, roots, c = bending_mode()
    area, shear = THICK, 0.5 * YOUNG * SHEAR * THICK
    ratio = (shear * roots**2 + DENSITY * area * omega**2) / (shear * roots)
    waves = np.exp(np.outer(x[:, 0] + 0.5 * length, roots))
    y, turn = waves @ c, waves @ (ratio * c)
    phase = y[np.argmax(np.abs(y))]
    v[:, 1], v[:, 0] = (y / phase).real, -(turn / phase).real * x[:, 1]
    return omega, v


def damped_wave(t: np.ndarray, a: float, d: float, f: float, p: float) -> np.ndarray:
    """a exp(-d t) cos(2 pi f t + p)."""
    return a * np.exp(-d * t) * np.cos(2 * np.pi * f * t + p)


def measure_bar(mode: str, across: int, device: str) -> tuple[float, float, float, int]:
    """Error of the frequency [1], decay of the velocity in a period [1], time of a period [s], particles."""
    cell = THICK / across
    counts = 2 * np.array([int(RATIO) * across, across, 4])
    index = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1).reshape(-1, 3)
    x = (index + 0.5 - 0.5 * counts) * 0.5 * cell
    omega, v = mode_velocity(mode, x)
    periods = 1.5
    scene = wsim.Scene(fps=24 * omega / (2 * np.pi), gravity=(0, 0, 0))
    scene.mpm("/bar", points=x, volumes=(0.5 * cell) ** 3, cell=cell, velocity=SPEED * v,
              material=Jelly(young=YOUNG, poisson=0.0, density=DENSITY))
    simulation = wsim.Simulation(scene, device=device)
    simulation.prepare()
    seen, began = [1.0], time.process_time()
    for _ in range(int(24 * periods)):
        simulation.step()
        seen.append(float((simulation.samples()[0].velocities * v).sum() / (SPEED * (v * v).sum())))
    took = (time.process_time() - began) / periods
    t = np.arange(len(seen)) / 24.0                            # periods of theory
    from scipy.optimize import curve_fit  # for the benchmark alone
    found = curve_fit(damped_wave, t, seen, [1.0, 0.0, 1.0, 0.0])[0]
    return float(found[2] - 1.0), float(found[1]), took, len(x)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--across", type=int, nargs="+", default=[4, 8, 16])
    parser.add_argument("--device", default="cpu")
    given = parser.parse_args()
    for mode in ("axial", "bending"):
        before = None
        for across in given.across:
            error, decay, took, count = measure_bar(mode, across, given.device)
            order = "" if before is None else f", order {np.log2(abs(before / error)):.2f}"
            print(f"{mode}: {across} cells across, {count} particles: frequency {100 * error:+.3f} %, "
                  f"decay {100 * decay:.3f} % a period, {took:.1f} CPU s a period{order}", flush=True)
            before = error


if __name__ == "__main__":
    main()
