"""Fitting to observations: `fit` in fit.py, of few parameters or of fields; Track, Scan and Pull are what was observed."""

from wsim.fitting.field_result import FieldFit
from wsim.fitting.files import read
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observe import Scan, Track
from wsim.fitting.pulls import Pull

__all__ = ["FieldFit", "Fit", "Pull", "Scan", "Settings", "Track", "fit", "read"]
