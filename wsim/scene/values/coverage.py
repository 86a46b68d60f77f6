"""Coverage of gradients as data: what recordings differentiate through, with respect to what, of what, by which solver, and how
that is tested; and what they refuse, with the words. Refusals, documents and tests read it.

A value without a row in `COVERED` has no derivative: its own row says why (`wsim.scene.values.table`). Rows name tests below
tests/ as file::function; a solver without one has no such thing, or shares the code that is tested by another.
"""

from dataclasses import dataclass

from wsim.scene.values import table
from wsim.scene.values.refusals import REFUSED, gradient_refusal
from wsim.scene.values.value import ValueRow

THROUGH, BY, OF = "through", "with respect to", "of"


@dataclass(frozen=True)
class Covered:
    """what: in words; with respect to values Owner.name, one or several. explicit, xpbd, implicit: tests by that solver;
    rigid, fluid, mpm: of rigid bodies, fluids and material points, whose steps are no solver's."""

    kind: str
    what: str
    explicit: str = ""
    xpbd: str = ""
    implicit: str = ""
    rigid: str = ""
    fluid: str = ""
    mpm: str = ""

    @property
    def tests(self) -> dict[str, str]:
        """Tests by solver."""
        names = ("explicit", "xpbd", "implicit", "rigid", "fluid", "mpm")
        return {name: test for name in names if (test := getattr(self, name))}

    def names(self) -> list[tuple[str, str]]:
        """(owner, name) of values."""
        return [(each.partition(".")[0], each.partition(".")[2]) for each in self.what.split()] if self.kind == BY else []


CHAIN = BAR = "gradient/test_gradients.py"
SWEPT, LIMITS = "physics/solver/test_xpbd_adjoint.py", "physics/solver/test_newton_adjoint_limits.py"
SLID, MESH, SOLVED = (f"physics/{name}.py" for name in ("contact/test_project_adjoint", "contact/test_collider_adjoint",
                                                         "solver/test_newton_adjoint_contacts"))
BOUNCE, FLOW, PULLED = (f"physics/{name}.py" for name in ("contact/test_restitution", "soft/test_plastic_adjoint",
                                                           "cloth/test_muscles"))
RESTS, LIVE, LOADED = (f"physics/{name}.py" for name in ("cloth/test_rest_shape", "cloth/test_live_fabric",
                                                          "motion/test_loads"))
SOFT, BORNE = "physics/contact/test_soft_contacts.py", "gradient/test_reaction_adjoint.py"
SHEET, STEPS = "test_a_sheet_that_stretches_shears_and_bends", "test_a_sheet_by_implicit_steps"
SLOPES = "gradient/test_value.py::test_every_value_has_the_slope_of_differences"
PUSH = "test_a_force_over_time_moves_by_its_integral_and_has_exact_derivatives"
FALL = "test_a_sheet_that_falls_on_a_turning_collider_and_slides"
JOINED, TOUCHED = "gradient/rigid/test_joints.py", "gradient/rigid/test_contacts.py"
FREELY, AIRY, PATHS = "gradient/test_bodies.py", "gradient/test_fluids.py", "gradient/test_paths.py"
GRAINS = "physics/soft/mpm/test_adjoint.py"
POURED = f"{GRAINS}::test_every_law_has_the_slope_of_differences"
EVERY = f"{AIRY}::test_every_value_has_the_slope_of_differences"
BONES, WORN = (f"physics/animation/test_{name}.py" for name in ("gradients", "collider_gradients"))
BLOCK, SOLID = f"{BAR}::test_a_soft_bar", f"{BAR}::test_a_soft_bar_by_implicit_steps"

COVERED: list[Covered] = [
    Covered(THROUGH, "leapfrog, symplectic_euler, rk4, midpoint, explicit_euler",
            f"{CHAIN}::test_a_chain_of_springs_by_every_explicit_integrator"),
    Covered(THROUGH, "backward_euler, bdf2, implicit_midpoint", "", f"{SWEPT}::test_a_chain", f"{CHAIN}::{STEPS}"),
    Covered(THROUGH, "sdirk3", "", "", f"{CHAIN}::{STEPS}"),
    Covered(THROUGH, "springs", f"{CHAIN}::test_every_gradient_of_a_chain_is_that_of_a_complex_step", f"{SWEPT}::test_a_chain",
            f"{CHAIN}::{STEPS}"),
    Covered(THROUGH, "membranes, bending, and their damping", f"{CHAIN}::{SHEET}", f"{SWEPT}::{SHEET}", f"{CHAIN}::{STEPS}"),
    Covered(THROUGH, "soft bodies of four nodes a tet, all four materials, their damping", BLOCK, "", SOLID),
    Covered(THROUGH, "soft bodies of ten nodes a tet, pressure", f"{BAR}::test_a_bar_of_quadratic_tets_under_pressure", "",
            f"{BAR}::test_a_bar_of_quadratic_tets_under_pressure"),
    Covered(THROUGH, "plastic flow", f"{FLOW}::test_a_bar_that_flows", "", f"{FLOW}::test_a_bar_that_flows"),
    Covered(THROUGH, "ties", f"{BAR}::test_a_bar_with_a_cloth_laid_on_it"),
    Covered(THROUGH, "hard pins", f"{CHAIN}::test_where_a_pin_puts_its_points", f"{SWEPT}::test_a_chain",
            f"{CHAIN}::test_where_a_pin_puts_its_points"),
    Covered(THROUGH, "skinning, linear and of dual quaternions, to pins",
            *(f"{BONES}::test_angles_and_weights_have_the_slope_of_differences",) * 3),
    Covered(THROUGH, "skinning, linear and of dual quaternions, to colliders",
            *(f"{WORN}::test_joint_angles_have_the_slope_of_differences",) * 3),
    Covered(THROUGH, "soft pins", *(f"{SWEPT}::test_soft_pins",) * 3),
    Covered(THROUGH, "strain limits and tethers", f"{RESTS}::test_strain_limits_and_tethers",
            f"{LIVE}::test_by_a_strain_limit", f"{LIMITS}::test_a_sheet_that_is_pulled"),
    Covered(THROUGH, "contacts with convex shapes, friction", f"{SLID}::{FALL}", f"{SLID}::{FALL}", f"{SOLVED}::{FALL}"),
    Covered(THROUGH, "contacts with meshes, that deform too", f"{MESH}::test_a_sheet_that_slides_on_a_mesh",
            f"{MESH}::test_a_sheet_that_slides_on_a_mesh", f"{SOFT}::test_a_bar_that_lands_and_slides"),
    Covered(THROUGH, "restitution", *(f"{BOUNCE}::test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme",) * 2,
            f"{SOLVED}::test_what_is_thrown_back"),
    Covered(THROUGH, "muscles", *(f"{PULLED}::test_gradients_by_the_factors",) * 3),
    Covered(THROUGH, "loads", *(f"{LOADED}::{PUSH}",) * 3),
    Covered(THROUGH, "wind (drag and lift, normal_drag of fabrics)", *(f"{SWEPT}::test_wind",) * 3),
    Covered(THROUGH, "free motion of rigid bodies", rigid=f"{FREELY}::test_a_free_symmetric_top_by_its_closed_form"),
    Covered(THROUGH, "joints of rigid bodies, their limits and drives",
            rigid=f"{JOINED}::test_every_kind_of_joint_has_the_slope_of_differences"),
    Covered(THROUGH, "contacts and friction of rigid bodies that are solved to a residual (contact_tolerance)",
            rigid=f"{TOUCHED}::test_every_contact_has_the_slope_of_differences"),
    Covered(THROUGH, "impacts of rigid bodies, at their time", rigid=f"{TOUCHED}::test_a_ball_bounces_when_it_comes"),
    Covered(THROUGH, "advection-reflection of fluids, their projection round obstacles that stand, forces, viscosity, "
            "confinement, sources", fluid=f"{AIRY}::test_fifty_steps_round_an_obstacle"),
    Covered(THROUGH, "other advection of fluids (cubic, MacCormack, BFECC, linear)",
            fluid=f"{AIRY}::test_schemes_that_carry_there_and_back"),
    Covered(THROUGH, "material points of every law: elastic, snow, sand, water, with plastic flow", mpm=POURED),
    Covered(THROUGH, "contacts of material points with planes and boxes that do not turn, friction",
            mpm=f"{GRAINS}::test_contacts_have_the_slope_of_differences"),

    Covered(BY, "Cloth.positions Cloth.velocities Cloth.stretch Cloth.bend Cloth.weft Cloth.shear Cloth.damping Cloth.density",
            f"{CHAIN}::{SHEET}", f"{SWEPT}::{SHEET}", f"{CHAIN}::{STEPS}"),
    Covered(BY, "Cloth.poisson", *(f"{LIVE}::test_by_poisson_s_ratio",) * 3),
    Covered(BY, "Cloth.strain_limit", "", f"{LIVE}::test_by_a_strain_limit", f"{LIVE}::test_by_a_strain_limit"),
    Covered(BY, "Springs.positions Springs.velocities Springs.stiffness Springs.damping",
            f"{CHAIN}::test_a_chain_of_springs_by_every_explicit_integrator", f"{SWEPT}::test_a_chain",
            f"{RESTS}::test_a_net"),
    Covered(BY, "Springs.mass", SLOPES, SLOPES),
    Covered(BY, "Springs.lengths Springs.rest_shape", *(f"{RESTS}::test_a_net",) * 3),
    Covered(BY, "Springs.actuation", *(f"{PULLED}::test_gradients_by_the_factors",) * 3),
    Covered(BY, "Cloth.rest_shape", *(f"{RESTS}::test_a_sheet",) * 3),
    Covered(BY, "Soft.rest_shape", f"{RESTS}::test_a_bar", "", f"{RESTS}::test_a_bar"),
    Covered(BY, "Soft.positions Soft.velocities Soft.young Soft.poisson Soft.damping", BLOCK, "", SOLID),
    Covered(BY, "Soft.pressure", f"{BAR}::test_a_bar_of_quadratic_tets_under_pressure", "",
            f"{BAR}::test_a_bar_of_quadratic_tets_under_pressure"),
    Covered(BY, "Soft.yield_strain", f"{FLOW}::test_by_the_yield", "", f"{FLOW}::test_by_the_yield"),
    Covered(BY, "Soft.density", SLOPES, "",
            "fitting/test_numbers_and_fields.py::test_the_gradient_of_the_misfit_is_that_of_differences"),
    Covered(BY, "Scene.gravity", f"{CHAIN}::{SHEET}", f"{SWEPT}::{SHEET}", f"{CHAIN}::{STEPS}", mpm=POURED),
    Covered(BY, "Scene.air_drag", f"{CHAIN}::{SHEET}", f"{SWEPT}::{SHEET}", f"{CHAIN}::{STEPS}"),
    Covered(BY, "Scene.wind", *(f"{SWEPT}::test_wind",) * 3),
    Covered(BY, "Pin.targets", f"{CHAIN}::test_where_a_pin_puts_its_points", f"{SWEPT}::test_soft_pins",
            f"{CHAIN}::test_where_a_pin_puts_its_points"),
    Covered(BY, "Skeleton.turns Skeleton.weights", *(f"{BONES}::test_angles_and_weights_have_the_slope_of_differences",) * 3),
    Covered(BY, "Pin.keys Pin.tangents Pin.handles Pin.turns", *(f"{PATHS}::test_by_what_the_path_of_a_pin_is_made_of",) * 3),
    Covered(BY, "Load.force Load.traction", *(f"{LOADED}::{PUSH}",) * 3),
    Covered(BY, "Cloth.static_friction Cloth.dynamic_friction Springs.static_friction Springs.dynamic_friction",
            f"{SLID}::{FALL}", f"{SLID}::{FALL}", f"{SOLVED}::{FALL}"),
    Covered(BY, "Soft.static_friction Soft.dynamic_friction", SLOPES, "", f"{SOFT}::test_a_bar_that_lands_and_slides"),
    Covered(BY, "Collider.static_friction Collider.dynamic_friction Collider.thickness",
            *(f"{MESH}::test_by_friction_and_thickness_of_a_collider",) * 2),
    Covered(BY, "Collider.restitution", *(f"{MESH}::test_by_the_restitution_of_two_colliders_in_two_worlds",) * 2,
            f"{SOLVED}::test_what_is_thrown_back"),
    Covered(BY, "Collider.shift", *(f"{MESH}::test_by_the_motion_of_a_collider",) * 2,
            f"{SOFT}::test_by_the_motion_of_a_collider"),
    Covered(BY, "Collider.keys Collider.tangents Collider.handles Collider.turns",
            *(f"{PATHS}::test_by_what_the_path_of_a_collider_is_made_of",) * 3),

    Covered(BY, "Body.velocity Body.spin Body.force Body.torque Body.drag Body.spin_drag Body.mass Body.inertia",
            rigid=f"{FREELY}::test_every_value_of_a_body_has_the_slope_of_differences"),
    Covered(BY, "Body.dynamic_friction Body.restitution", rigid=f"{TOUCHED}::test_a_box_slides_by_its_friction"),
    Covered(BY, "Joint.stiffness Joint.damping Joint.target", rigid=f"{JOINED}::test_drives_have_the_slope_of_differences"),

    Covered(BY, "Fluid.lift Fluid.weight Fluid.vorticity Fluid.viscosity Fluid.smoke_decay Fluid.cooling Fluid.side_velocities "
            "Fluid.acceleration",
            fluid=EVERY),
    Covered(BY, "Collider.surface", fluid=f"{AIRY}::test_by_the_turning_of_an_obstacle"),
    Covered(BY, "Fluid.velocity Fluid.smoke Fluid.temperature", fluid=EVERY),
    Covered(BY, "Source.smoke Source.temperature Source.expansion Source.velocity Source.place Source.strength", fluid=EVERY),
    Covered(BY, "MaterialPoints.positions MaterialPoints.velocities MaterialPoints.young MaterialPoints.poisson "
            "MaterialPoints.density MaterialPoints.viscosity MaterialPoints.bulk MaterialPoints.exponent "
            "MaterialPoints.friction_angle MaterialPoints.cohesion MaterialPoints.compression_limit "
            "MaterialPoints.tension_limit MaterialPoints.hardening", mpm=POURED),

    Covered(OF, "positions and velocities", f"{CHAIN}::{SHEET}", f"{SWEPT}::{SHEET}", f"{CHAIN}::{STEPS}", mpm=POURED),
    Covered(OF, "reactions of pins", f"{BORNE}::test_a_chain_by_leapfrog", f"{BORNE}::test_a_chain_by_sweeps",
            f"{BORNE}::test_a_soft_bar"),
    Covered(OF, "poses and twists of rigid bodies",
            rigid=f"{FREELY}::test_what_is_seen_of_a_body_has_the_slope_of_differences"),
    Covered(OF, "smoke, temperature and velocity of fluids", fluid=EVERY),
]

def differentiable_row(scene, path: str, name: str, own=()) -> ValueRow:
    """The row of a value of the object at a path ("/": the scene) that has a derivative. own: values of that body that a
    recording has. Raises SceneError, with the path and the reason, where there is none."""
    from wsim.scene.methods import object_at_path
    thing = object_at_path(scene, path)
    owner = type(thing).__name__ if thing is not None else ""
    row = table.values_of_class(owner).get(name)
    if row is not None and owner == "Load" and name != thing.name:
        row = None
    if row is None or not row.gradient:
        raise no_derivative_error(path, name, owner, own, row.why if row else "")
    return row


def no_derivative_error(path: str, name: str, owner: str, own=(), why: str = ""):
    """The SceneError of a value that has no derivative there; those that have one are named."""
    from wsim.scene import Problem, SceneError
    names = ", ".join(["positions", "velocities", "rest_shape", *own] if own else table.gradient_input_names(owner)) or "none"
    if why:
        return gradient_refusal("value", path, name=name, why=why, names=names)
    if owner == "Scene":
        return SceneError(Problem(name, f"is no value of the whole scene; there are {names}"))
    said = f"a collider has {names}" if owner == "Collider" else f"there are {names}"
    return SceneError(Problem(path, f"has no {name!r} to be differentiated by; {said}"))


def coverage_lines() -> list[tuple[str, str, str]]:
    """(kind, what, solvers) of all rows, then what is refused: of documents."""
    found = [(row.kind, ", ".join(row.what.split()) if row.kind == BY else row.what, ", ".join(row.tests)) for row in COVERED]
    apart = [(f"{row.owner}.{row.name}", row.why) for row in table.VALUES if not row.gradient]
    found += [("refused", f"with respect to {name} ({why})" if why else f"with respect to {name}", "") for name, why in apart]
    return found + [("refused", row.what, "") for key, row in REFUSED.items() if key not in ("value", "material")]


def table_rows() -> list[str]:
    """Rows of the tables in wsim/docs/gradients.md: what a run may hold and a loss may look at, by solver; inputs by owner."""
    rows = [f"| {row.what} | {', '.join(row.tests)} |" for row in COVERED if row.kind != BY]
    by: dict[str, list[str]] = {}
    for owner, name in (pair for row in COVERED for pair in row.names()):
        by.setdefault(owner, []).append(name)
    return [*rows, *(f"| `{owner}` | {', '.join(names)} |" for owner, names in by.items())]


def coverage_text() -> str:
    """The table in plain text."""
    return "\n".join(f"    {kind:<16}{what}{f'   [{solvers}]' if solvers else ''}" for kind, what, solvers in coverage_lines())
