"""Fitting to observations: `fit` in fit.py, of few parameters or of fields. What was seen: Track, Scan, Functional, Profile,
Pull, Markers, Smoke."""

from wsim.fitting.fields.result import FieldFit
from wsim.fitting.fit import Fit, Settings, fit
from wsim.fitting.observations.functional import Functional
from wsim.fitting.observations.markers import Markers
from wsim.fitting.observations.observe import Scan, Track
from wsim.fitting.observations.observed_usd import read
from wsim.fitting.observations.profile import Profile
from wsim.fitting.observations.reactions import Pull
from wsim.fitting.observations.smoke import Smoke

__all__ = ["FieldFit", "Fit", "Functional", "Markers", "Profile", "Pull", "Scan", "Settings", "Smoke", "Track", "fit", "read"]
