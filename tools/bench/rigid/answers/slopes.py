"""Round bodies that start at rest roll down a slope without slip: a = g sin / (1 + k), of moments k m r^2 about the axle.

    solid cylinder 1/2    ball 2/5    thin hoop 1
"""

from functools import partial

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import TILTS, named
from tools.bench.rigid.answers.shapes import ROUND, SIDE, floor
from tools.bench.rigid.answers.stage import RATES, G, Stage

SHARES = {"drum": 0.5, "wheel": 0.5, "disc": 0.5, "hoop": 1.0, "ball": 0.4}
SECONDS = 2.0


def slope(precision: str, degrees: float, rate, ground: str = "plane", r: float = 0.3, tilt: str = "level"):
    stage = Stage(*rate, turn=TILTS[tilt], lean=degrees)
    floor(stage, ground, 90.0 * r)
    for k, shape in enumerate(SHARES):
        made, hoop = ROUND[shape if shape != "hoop" else "disc"](r), {}
        if shape == "hoop":
            hoop = {"mass": 1.0, "center": np.zeros(3), "inertia": r * r * np.array([0.5, 0.5, 1.0])}
        stage.body(f"/{shape}", made, (-17.0 * r, 10.0 * r * (k - 2), r), SIDE, **hoop)
    seconds = SECONDS * np.sqrt(r / 0.3)
    track = stage.run(seconds, precision)
    figures = []
    for k, (shape, share) in enumerate(SHARES.items()):
        exact = G * np.sin(np.radians(degrees)) / (1.0 + share)
        way = (track.x[-1, k, 0] - track.x[0, k, 0]) / (0.5 * exact * track.t[-1]**2)
        figures += [Figure(f"{shape}: speed", abs(track.v[-1, k, 0] / (exact * track.t[-1]) - 1.0), 1e-2),
                    Figure(f"{shape}: way", abs(way - 1.0), 1e-2)]
    return figures, track.cpu


def cases() -> list[Case]:
    found = [Case(f"slope/{degrees:g}/plane/{named(rate)}", partial(slope, degrees=degrees, rate=rate))
             for degrees in (2.0, 10.0, 25.0) for rate in RATES]
    found += [Case(f"slope/10/{ground}/24x10", partial(slope, degrees=10.0, rate=RATES[0], ground=ground))
              for ground in ("box", "mesh")]
    return found + [Case("slope/10/plane/24x10/tilted", partial(slope, degrees=10.0, rate=RATES[0], tilt="tilted"))]
