"""What varies in time of a scene -> samples of the attributes that a load makes curves of. Attributes of type float keep seven
digits."""

import numpy as np
from pxr import Usd

from wsim.scene import Cloth, Scene, Varying
from wsim.scene.methods import every
from wsim.scene.values import table
from wsim.usd.attributes import author
from wsim.usd.names import HOLDERS
from wsim.usd.prims.fabric import bound, plane_stress
from wsim.usd.settings import author_varying_gravity
from wsim.usd.stage import Reading, Units


def author_varying(stage: Usd.Stage, scene: Scene, settings: Usd.Prim, units: Units) -> None:
    """Samples at the keys of every curve; the prims and their materials are there."""
    things = {thing.path: thing for thing in (*scene.bodies(), *scene.colliders, *(thing for _, thing in every(scene)))}
    for varying in scene.varying:
        times = varying.curve.times
        if varying.name == "stretch":                          # what is written follows Poisson's ratio too
            times = np.unique(np.concatenate([times, *(v.curve.times for v in _poisson(scene, varying.path))]))
        for time in times.tolist():
            code, value = units.code(time), varying.curve.at(time)
            if varying.path != "/":
                _of(Reading(stage, units), scene, things[varying.path], varying, value, time)
            elif varying.name == "gravity":
                author_varying_gravity(settings, value, units, code)
            else:
                author(settings, "Scene", varying.name, value, units, time=code)


def _poisson(scene: Scene, path: str) -> list[Varying]:
    return [v for v in scene.varying if (v.path, v.name) == (path, "poisson")]


def _of(reading: Reading, scene: Scene, thing, varying: Varying, value, time: float) -> None:
    prim, units, kind, name = reading.stage.GetPrimAtPath(thing.path), reading.units, type(thing), varying.name
    row = table.of(kind.__name__)[name]
    if row.usd is None or row.usd.schema not in table.MATERIALS:
        author(prim, kind.__name__, name, value, units, time=units.code(time))
        return
    through = None
    if kind is Cloth and name == "stretch":
        nu = [float(v.curve.at(time)) for v in _poisson(scene, thing.path)]
        through = plane_stress(nu[0] if nu else thing.material.poisson)
    author(bound(reading, prim), HOLDERS[kind.__name__], name, value, units, through, units.code(time))
