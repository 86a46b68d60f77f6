"""Measures of rigid bodies now: of one world alone, or of all of them.

    rigid_energy     kinetic energy of the bodies and of what turns in joints, and energy in gravity [J]
    rigid_overlap    depth to which the points of manifolds lie in each other, at most [m]
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from wsim.physics.rigid.contacts import RigidContactTables
    from wsim.physics.rigid.method import RigidMethod


def rigid_indicators(method: RigidMethod, world: int | None) -> dict[str, float]:
    """Indicators of one world; None: energy of the first, and what joints and contacts of all worlds say."""
    of, places = world or 0, method.origin + method.get("x")
    mine, mass = np.array([each == of for _, each in method.bodies]), np.array([m.mass for m in method.masses])
    kinetic = 0.5 * ((method.read("p") * method.velocities()).sum(1) + (method.read("L") * method.spins()).sum(1))
    rotors = method.joints.stored_energy(of) if method.joints else 0.0
    found = {"rigid_energy": float((kinetic - mass * (places @ method.gravity[of]))[mine].sum()) + rotors}
    if method.contacts:
        found |= method.contacts.indicators() if world is None else {"rigid_overlap": contact_overlap(method.contacts, world)}
    if method.touch and world is None:
        found |= method.touch.indicators()
    return found | (method.joints.indicators(world) if method.joints else {})


def contact_overlap(contacts: RigidContactTables, world: int | None = None) -> float:
    """Depth to which the points of manifolds lie in each other now, at most [m]; None: of all worlds."""
    used = points_of_world(contacts, world)
    return max(0.0, -float(contacts.work.now.numpy().reshape(-1, 4)[used].min(initial=0.0)))


def points_of_world(contacts: RigidContactTables, world: int | None) -> np.ndarray:
    """Which points of manifolds there are in a world, or in all, (manifolds, 4) bool."""
    used = np.arange(4) < contacts.list.count.numpy()[:, None]
    if world is None:
        return used
    a = contacts.list.a.numpy()
    return used & ((a >= 0) & (contacts.table.world.numpy()[np.maximum(a, 0)] == world))[:, None]
