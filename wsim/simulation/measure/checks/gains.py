"""Which prim gained the energy that nothing gave it: on the host, for a warning."""

from __future__ import annotations

import numpy as np

from wsim.simulation.measure.checks.terms import field_aside


def gains_by_prim(balance, world: int) -> dict[str, float]:
    """Energy [J] that each prim of a world gained in the last frame, less the work of its weight and of its loads. What is
    stored in springs and elements is left out."""
    terms = balance.terms
    found = _gains_of_points(terms, world) if terms.model.bodies else {}
    return found | (_of_bodies(terms.rigid, world) if terms.rigid else {})


def _gains_of_points(terms, world: int) -> dict[str, float]:
    state, c = terms.state, terms.points.constants
    now, before = ({name: np.asarray(array.numpy(), np.float64) for name, array in arrays.items()} for arrays in (
        {name: state.points.arrays[name] for name in "xev"}, {name: field_aside(state.points, name) for name in "xev"}))
    w = c.w.numpy().astype(np.float64)
    m = np.where(w > 0.0, 1.0 / np.where(w > 0.0, w, 1.0), 0.0)
    moved = now["x"] - before["x"] + now["e"] - before["e"]
    kinetic = 0.5 * m * ((now["v"]**2).sum(1) - (before["v"]**2).sum(1))
    each = kinetic - m * (c.gravity.numpy()[c.object.numpy()] * moved).sum(1)
    return {b.path: float(each[b.first:b.last].sum()) for b in terms.model.bodies if b.world == world}


def _of_bodies(rigid, world: int) -> dict[str, float]:
    part, table = rigid.part, rigid.table
    now, before = ({name: np.asarray(array.numpy(), np.float64) for name, array in arrays.items()} for arrays in (
        {name: part.arrays[name] for name in "xepL"}, {name: field_aside(part, name) for name in "xepL"}))
    w, inverse = table.w.numpy().astype(np.float64), table.inverse.numpy().astype(np.float64).max(axis=1)
    moved = now["x"] - before["x"] + now["e"] - before["e"]
    kinetic = 0.5 * (w * ((now["p"]**2).sum(1) - (before["p"]**2).sum(1))
                     + inverse * ((now["L"]**2).sum(1) - (before["L"]**2).sum(1)))
    each = kinetic - (table.push.numpy() * moved).sum(1)
    return {body.path: float(each[k]) for k, (body, of) in enumerate(rigid.bodies) if of == world}
