"""Fitting to observations: `fit` in fit.py, of few parameters or of fields. What was seen: Track, Scan, Functional, Pull."""

from wsim.fitting.field_result import FieldFit
from wsim.fitting.files import read
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.functional import Functional
from wsim.fitting.observe import Scan, Track
from wsim.fitting.pulls import Pull

__all__ = ["FieldFit", "Fit", "Functional", "Pull", "Scan", "Settings", "Track", "fit", "read"]
