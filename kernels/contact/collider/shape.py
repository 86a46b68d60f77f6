"""Signed distance to convex solids in their own frame, axis z (sizes as in wsim/scene/__init__.py).

    q    point [m]       phi  signed distance to the surface [m], negative inside       n  outward unit normal, grad phi

Exact inside and outside. Where several surface points are nearest (a centre, an axis), one of them is chosen.
Regions come from the coordinates and not from a difference with the nearest point, so that n keeps its
precision at the surface in float32.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, SIM108, UP018

from collections.abc import Iterable
from functools import cache
from importlib import import_module
from typing import Any

import warp as wp

PLANE, SPHERE, BOX, CAPSULE, CYLINDER, CONE = range(6)
CONVEX = ("plane", "sphere", "box", "capsule", "cylinder", "cone")
MORE: dict[str, Any] = {}            # formulas (size, q) -> (phi, n) of further convex shapes, see `add_convex_shape`


def add_convex_shape(kind: str, formula: Any) -> None:
    """Makes a convex shape of another place known. formula: a generic function of Warp, phi convex in q, |n| = 1."""
    if kind not in CONVEX and MORE.setdefault(kind, formula) is not formula:
        raise ValueError(f"there is another shape of colliders called {kind}")


def make_known(rows: Iterable[Any], names: Iterable[str]) -> None:
    """Adds the shapes of these names whose formula stands in another place; rows: as wsim/scene/solids.py has them."""
    for row in rows:
        if row.formula and row.kind in names:
            place, _, name = row.formula.partition(":")
            add_convex_shape(row.kind, getattr(import_module(place), name))


def shape_code(kind: str) -> int:
    """By which kernels tell shapes: the place in CONVEX, below 0 for those of `add_convex_shape`; meshes are above all of
    them."""
    return CONVEX.index(kind) if kind in CONVEX else -1 - list(MORE).index(kind)


@wp.func
def radial_distance(q: Any):
    """Distance from the axis [m] and unit vector away from it; x on the axis."""
    zero = type(q[0])(0.0)
    out = type(q)(q[0], q[1], zero)
    rho = wp.length(out)
    if rho > zero:
        out = out / rho
    else:
        out = type(q)(type(q[0])(1.0), zero, zero)
    return rho, out


@wp.func
def sphere_distance(R: Any, q: Any):
    """Ball of radius R; up at the centre."""
    rho = wp.length(q)
    n = type(q)(type(R)(0.0), type(R)(0.0), type(R)(1.0))
    if rho > type(R)(0.0):
        n = q / rho
    return rho - R, n


@wp.func
def box_signed_distance(half: Any, q: Any):
    """Box of half edges `half`: outside by the part of |q| beyond them, inside the nearest face."""
    zero = type(q[0])(0.0)
    a = wp.abs(q) - half
    side = type(q)(wp.sign(q[0]), wp.sign(q[1]), wp.sign(q[2]))
    out = wp.max(a, type(q)(zero, zero, zero))
    phi = wp.length(out)
    n = wp.cw_mul(side, out)
    if phi > zero:
        n = n / phi
    else:
        i = int(wp.argmax(a))
        phi = a[i]
        n = type(q)(zero, zero, zero)
        n[i] = side[i]
    return phi, n


@wp.func
def capsule_distance(R: Any, H: Any, q: Any):
    """All within R of the segment |z| <= H; x away from its axis at the axis."""
    rho, out = radial_distance(q)
    c = q - type(q)(type(R)(0.0), type(R)(0.0), wp.clamp(q[2], -H, H))
    length = wp.length(c)
    n = out
    if length > type(R)(0.0):
        n = c / length
    return length - R, n


@wp.func
def cylinder_distance(R: Any, H: Any, q: Any):
    """rho <= R, |z| <= H: a box in (rho, z)."""
    zero = type(R)(0.0)
    rho, out = radial_distance(q)
    up = type(q)(zero, zero, wp.sign(q[2]))
    a = rho - R
    b = wp.abs(q[2]) - H
    phi = wp.max(a, b)
    n = out
    if b > a:
        n = up
    if a > zero and b > zero:                       # beyond the rim
        phi = wp.sqrt(a * a + b * b)
        n = (a * out + b * up) / phi
    return phi, n


@wp.func
def cone_distance(R: Any, H: Any, q: Any):
    """Apex at z = H, base of radius R at z = -H. In (rho, z), from the rim: u along the flank up to L, s off it,
    b below the base."""
    zero = type(R)(0.0)
    rho, out = radial_distance(q)
    up = type(q)(zero, zero, type(R)(1.0))
    L = wp.sqrt(R * R + type(R)(4.0) * H * H)
    flank = (type(R)(2.0) * H / L) * out + (R / L) * up
    x = rho - R
    z = q[2] + H
    u = (type(R)(2.0) * H * z - R * x) / L
    s = (type(R)(2.0) * H * x + R * z) / L
    b = -z
    phi = wp.max(s, b)                              # inside: the nearest of flank and base
    n = flank
    if b > s:
        n = -up
    v = q
    corner = bool(False)
    if u > L:                                       # beyond the apex
        v = q - H * up
        corner = True
    if u < zero and x > zero:                       # beyond the rim
        v = x * out + z * up
        corner = True
    if corner:
        phi = wp.length(v)
        n = v / phi
    return phi, n


@cache
def convex_distance_func(kinds: tuple[str, ...]):
    """Function (kind, size, q) -> (phi, n) over the convex shapes of `kinds`; no other shape is compiled.

    size [m]: (radius, -, -), (half edges), or (radius, half height, -)."""
    has_sphere, has_box, has_capsule, has_cylinder, has_cone = (name in kinds for name in CONVEX[1:])

    @wp.func
    def convex_signed_distance(kind: int, size: Any, q: Any):
        phi = q[2]
        n = type(q)(type(phi)(0.0), type(phi)(0.0), type(phi)(1.0))
        if has_sphere:
            if kind == SPHERE:
                phi, n = sphere_distance(size[0], q)
        if has_box:
            if kind == BOX:
                phi, n = box_signed_distance(size, q)
        if has_capsule:
            if kind == CAPSULE:
                phi, n = capsule_distance(size[0], size[1], q)
        if has_cylinder:
            if kind == CYLINDER:
                phi, n = cylinder_distance(size[0], size[1], q)
        if has_cone:
            if kind == CONE:
                phi, n = cone_distance(size[0], size[1], q)
        return phi, n

    found = convex_signed_distance
    for name in kinds:
        if name in MORE:
            found = _with_added_shape(found, name)
    return found


def _with_added_shape(before: Any, name: str) -> Any:
    """`before`, and a shape of `add_convex_shape`."""
    own, formula = shape_code(name), MORE[name]

    def added_shape_distance(kind: int, size: Any, q: Any):
        phi, n = before(kind, size, q)
        if kind == own:
            phi, n = formula(size, q)
        return phi, n

    added_shape_distance.__qualname__ = f"distance_or_{name}"
    return wp.func(added_shape_distance)
