"""Linear tetrahedra: forces against the energy, patch test, rotations, products with the stiffness."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels import fem
from wsim.kernels.material import TABLE, lame
from wsim.kernels.real import types
from wsim.tetra import tets
from wsim.tetra.lattice import box

MATERIALS = sorted(TABLE)
E, NU = 1e5, 0.3


class Body:
    """A box of tets on the CPU, evaluated by the kernels."""

    def __init__(self, material: str, real=wp.float64, size=(0.3, 0.2, 0.2), cells=(3, 2, 2)):
        self.material, self.real, t = material, real, types(real)
        self.points, self.tets = box(size, cells)
        n, module = len(self.points), f"test_fem_{material}_{t.name}"
        self.vec3, self.quat, (mu, lam) = t.vec3, t.quat, lame(E, NU)
        each = tets.gradients(self.points, self.tets)[:, 1:], tets.volumes(self.points, self.tets)
        self.batch = fem.elements(real)()
        self.batch.point = wp.array(self.tets, dtype=wp.vec4i, device="cpu")
        self.batch.gradient, self.batch.volume = self.array(each[0], t.mat33), self.array(each[1], real)
        self.batch.mu, self.batch.lam = (self.array(np.full(len(self.tets), v), real) for v in (mu, lam))
        self.start, self.item = (wp.array(a.astype(np.int32), dtype=int, device="cpu") for a in tets.corners(self.tets, n))
        self.kernels = {f.__name__: f(material, real=real, module=module) for f in (fem.forces, fem.energies, fem.tangent,
                                                                                    fem.product)}
        self.sum = fem.gather(real=real, module=module)

    def array(self, values, dtype):
        return wp.array(np.asarray(values, np.float32 if self.real is wp.float32 else np.float64), dtype=dtype, device="cpu")

    def none(self):
        return wp.zeros(len(self.tets), dtype=self.quat, device="cpu")

    def launch(self, name, inputs, outputs):
        wp.launch(self.kernels[name], len(self.tets), inputs, outputs, device="cpu")

    def gathered(self, parts) -> np.ndarray:
        total = wp.zeros(len(self.points), dtype=self.vec3, device="cpu")
        wp.launch(self.sum, len(self.points), [self.start, self.item, parts], [total], device="cpu")
        return total.numpy().astype(np.float64)

    def force(self, u) -> np.ndarray:
        parts = wp.zeros(4 * len(self.tets), dtype=self.vec3, device="cpu")
        self.launch("forces", [self.batch, self.array(u, self.vec3), self.none()], [parts, self.none()])
        return self.gathered(parts)

    def energy(self, u) -> float:
        out = wp.zeros(len(self.tets), dtype=wp.float64, device="cpu")
        self.launch("energies", [self.batch, self.array(u, self.vec3), self.none()], [out])
        return float(out.numpy().sum())

    def stiffness(self, u):
        """Function v -> K v at u."""
        t, held = types(self.real), fem.tangents(self.material, self.real)()
        held.q = self.none()
        for name in ("T",) if self.material == "corotational" else ("V", "A", "B"):
            setattr(held, name, wp.zeros(len(self.tets), dtype=t.mat33, device="cpu"))
        self.launch("tangent", [self.batch, self.array(u, self.vec3), self.none()], [held])

        def times(v):
            parts = wp.zeros(4 * len(self.tets), dtype=self.vec3, device="cpu")
            self.launch("product", [self.batch, held, self.array(v, self.vec3)], [parts])
            return self.gathered(parts)
        return times


def turn(seed: int = 3) -> np.ndarray:
    """Some proper rotation."""
    Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def bent(body: Body, seed: int = 1, size: float = 0.02) -> np.ndarray:
    """Random displacements of a fifth of a cell on top of a turn."""
    u = size * np.random.default_rng(seed).normal(size=body.points.shape)
    return u if body.material == "linear" else body.points @ (turn() - np.eye(3)).T + u


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_are_minus_the_gradient_of_the_energy(material):
    """Central differences of h = 1e-6 m in float64: h^2 of the third derivative, and rounding 1e-16 E / h."""
    body, rng, h = Body(material), np.random.default_rng(2), 1e-6
    u, v = bent(body), np.random.default_rng(2).normal(size=body.points.shape)
    slope = (body.energy(u + h * v) - body.energy(u - h * v)) / (2.0 * h)
    assert np.sum(body.force(u) * v) == pytest.approx(-slope, rel=1e-7)
    i, k = int(rng.integers(len(u))), int(rng.integers(3))
    one = np.zeros_like(u)
    one[i, k] = h
    assert body.force(u)[i, k] == pytest.approx(-(body.energy(u + one) - body.energy(u - one)) / (2.0 * h), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("real, bound", [(wp.float64, 1e-12), (wp.float32, 1e-5)])
def test_the_inside_of_a_body_under_uniform_strain_is_at_rest(material, real, bound):
    """Patch test: an affine displacement, here 10 % with shear, is a solution for every mesh. Beside the surface's forces."""
    body = Body(material, real, cells=(4, 3, 3))
    u = body.points @ np.array([[0.1, 0.05, 0.0], [0.02, -0.03, 0.04], [0.0, 0.01, 0.05]]).T
    lattice = np.abs(body.points) / body.points.max(axis=0)
    inside = (lattice < 1.0 - 1e-9).all(axis=1)
    force = body.force(u)
    assert inside.sum() == 12 and np.abs(force[inside]).max() < bound * np.abs(force).max()


@pytest.mark.parametrize("material", MATERIALS)
def test_forces_within_a_body_sum_to_nothing_and_turn_nothing(material):
    body = Body(material)
    u = bent(body)
    force, at = body.force(u), body.points + u
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-14 * size
    if material != "linear":
        assert np.abs(np.cross(at, force).sum(axis=0)).max() < 1e-14 * size * np.abs(at).max()


@pytest.mark.parametrize("material", ["corotational", "neo_hookean", "st_venant_kirchhoff"])
def test_a_turned_body_is_at_rest(material):
    """float32: displacements of 0.3 m are rounded by 2e-8, strains of cells of 0.1 m by 2e-7, stress over E."""
    body = Body(material, wp.float32)
    force = body.force(body.points @ (turn() - np.eye(3)).T)
    assert np.abs(force).max() < 1e-6 * E * 0.1**2


def test_a_turned_linear_body_swells():
    """Linear strain of a turn by 90 degrees is -1 in two directions: what it is shown beside the others for."""
    body = Body("linear")
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.abs(body.force(body.points @ (quarter - np.eye(3)).T)).max() > 0.1 * E * 0.1**2


@pytest.mark.parametrize("material", MATERIALS)
def test_products_are_differences_of_forces_where_the_stiffness_is_positive(material):
    """Stretched by 20 % in all directions, K has no negative part."""
    body, h = Body(material), 1e-6
    u = 0.2 * body.points + 1e-3 * np.random.default_rng(5).normal(size=body.points.shape)
    v = np.random.default_rng(6).normal(size=u.shape)
    found, wanted = body.stiffness(u)(v), -(body.force(u + h * v) - body.force(u - h * v)) / (2.0 * h)
    assert np.abs(found - wanted).max() < 1e-7 * np.abs(wanted).max()


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("size", [0.02, 0.3])
def test_the_stiffness_is_symmetric_and_never_negative(material, size):
    """Also where elements are turned inside out (displacements of 0.3 m of cells of 0.1 m)."""
    body = Body(material)
    times, rng = body.stiffness(bent(body, size=size)), np.random.default_rng(8)
    for _ in range(5):
        v, w = rng.normal(size=(2, *body.points.shape))
        Kv, Kw = times(v), times(w)
        scale = np.linalg.norm(Kv) * np.linalg.norm(w)
        assert abs(np.sum(w * Kv) - np.sum(v * Kw)) < 1e-13 * scale and np.sum(v * Kv) > 0.0


@pytest.mark.parametrize("material", MATERIALS)
def test_a_collapsed_body_has_finite_forces(material):
    body = Body(material, wp.float32)
    assert np.isfinite(body.force(-body.points)).all() and np.isfinite(body.force(-2.0 * body.points)).all()
