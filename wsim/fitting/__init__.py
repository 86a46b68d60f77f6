"""Fitting to observations: `fit` in fit.py, of few parameters or of fields; Track and Scan are what was observed."""

from wsim.fitting.field_result import FieldFit
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observe import Scan, Track, read

__all__ = ["FieldFit", "Fit", "Scan", "Settings", "Track", "fit", "read"]
