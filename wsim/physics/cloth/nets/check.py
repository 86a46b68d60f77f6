"""What can be wrong with one spring net by itself: its springs, arrays, muscles. NumPy only."""

from collections.abc import Iterator

import numpy as np

from wsim.physics.cloth.nets.objects import Springs
from wsim.scene import Problem, Scene
from wsim.scene.check.objects import (
    check_placement,
    check_point_array,
    check_point_masses,
    check_table_values,
    object_warning,
    thing_error,
)


def check(net: Springs, scene: Scene) -> list[Problem]:
    """Problems of a spring net."""
    path, n, m = net.path, len(net.points), len(net.edges)
    found = [*check_point_array(path, "points", net.points, (n,)), *check_placement(path, net.points, net.motion)]
    found += list(check_point_array(path, "masses", net.masses, (n, 1), 0.0, True)) or check_point_masses(path, net.masses)
    found += check_point_array(path, "velocities", net.velocities, (n,))
    found += check_point_array(path, "stiffnesses", net.stiffness, (m, 1), 0.0, True)
    found += check_point_array(path, "rest lengths", net.lengths, (m,), 0.0, True)
    found += check_table_values(net)
    found += _check_muscles(net)
    if m == 0:
        found.append(thing_error(path, "a net without springs", "at least one", "author curves of two or more points"))
    bad = ((net.edges < 0) | (net.edges >= n)).any(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        return [*found, thing_error(path, f"spring {k} joins points {net.edges[k].tolist()}", f"0 to {n - 1}",
                                     "name points of this net")]
    p, q = net.points[net.edges[:, 0]], net.points[net.edges[:, 1]]
    zero = (net.edges[:, 0] == net.edges[:, 1]) | ((p == q).all(axis=1) & (net.lengths is None))
    if zero.any():
        k = int(np.argmax(zero))
        found.append(thing_error(path, f"{zero.sum()} springs are of length 0, first spring {k} on points "
                                  f"{net.edges[k].tolist()}", "> 0", "make the two points one, or give rest lengths"))
    return found


def _check_muscles(net: Springs) -> Iterator[Problem]:
    """Factors over time, and which spring is of which group."""
    path, m, curve = net.path, len(net.edges), net.actuation
    if curve is None:
        if net.muscles is not None:
            yield thing_error(path, "muscles without an actuation", "both, or none", "author wsim:actuation, or leave them out")
        return
    yield from check_point_array(path, "factors of actuation", curve.values.ravel(), (curve.values.size,), 0.0, True)
    if not curve.plain and not (least := float(np.min(curve.bounds()[0]))) > 0.0:
        yield thing_error(path, f"factors of actuation down to {least:g} between or outside of their keys (kind {curve.kind})",
                           "> 0", "take kind monotone, which stays between its keys, or hold it outside of them")
    if not np.isfinite(curve.times).all():
        yield thing_error(path, "times of actuation that are no numbers", "finite ones", "author its keys again")
    groups, of = curve.values.shape[1], np.zeros(m, np.int32) if net.muscles is None else net.muscles
    if len(of) != m:
        yield thing_error(path, f"{len(of)} muscles", f"{m}, the group of each spring", "author -1 for a spring that is none")
    bad = (of < -1) | (of >= groups)
    if bad.any():
        k = int(np.argmax(bad))
        yield thing_error(path, f"spring {k} is of muscle group {of[k]}",
                           f"-1 (passive) to {groups - 1}: actuation has {groups} "
                           "groups", "name one of them, or give the actuation more values a key")
    elif missing := sorted(set(range(groups)) - set(of.tolist())):
        yield object_warning(path, f"no spring is of muscle group {missing[0]}", f"springs in each of {groups} groups",
                             "leave the group out of wsim:actuation")
