"""Matrices as USD has them."""

import numpy as np
from pxr import Gf

from wsim.usd.stage import StageUnits


def row_matrix(M: np.ndarray, units: StageUnits) -> Gf.Matrix4d:
    """Matrix as USD has it: acting on rows, lengths in stage units."""
    M = np.array(M, np.float64)
    M[:3, 3] /= units.metres
    return Gf.Matrix4d(*M.T.ravel().tolist())
