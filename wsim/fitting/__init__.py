"""Fitting of few parameters to observations: `fit` in fit.py; Track and Scan are what was observed."""

from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observe import Scan, Track, read

__all__ = ["Fit", "Scan", "Settings", "Track", "fit", "read"]
