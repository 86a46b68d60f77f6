"""Modules of kernels that scenes with self-contact share: compiled once, and found in Warp's cache by later scenes, whatever
their solver. What only some scenes need stays in the module of the plan.

    core        search, proof, projections and cuts, of surfaces and of strands: 3 CPU-s to compile
    sweeps      contact rows of surfaces, and frames without contacts: 1 CPU-s
    newton      the same rows in Newton steps, for each kind of forces

Warp knows a module by its set of kernels, and compiles it anew where one comes to it: all of a set are made at once. On CUDA
the threads of a block are in the name, since strands and surfaces of one plan may have others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsim.kernels.contact.selfcontact import motion_bounds, pairs, rows, search, separation_proof, step_clamp, tree
from wsim.kernels.contact.selfcontact.newton import energy, push, solve
from wsim.kernels.math.real import types
from wsim.kernels.solver import line_search, pcg

if TYPE_CHECKING:
    from collections.abc import Callable

    from wsim.model.model import Model

CORE = (tree.morton_order_kernel, tree.leaf_box_kernel, motion_bounds.motion_moment_kernel, motion_bounds.moment_fold_kernel,
        motion_bounds.rigid_fit_kernel, motion_bounds.tube_axis_kernel, motion_bounds.tube_watch_kernel,
        motion_bounds.thin_tube_kernel, search.candidate_sift_kernel,
        search.list_made_kernel, separation_proof.pair_inspection_kernel, separation_proof.uncertified_share_kernel,
        separation_proof.pair_projection_kernel, pairs.settle_sums, step_clamp.cut_claim_kernel, step_clamp.cut_factor_kernel,
        step_clamp.motion_cut_kernel, step_clamp.frame_report_kernel)  # and search.meet
CORE_WORDS = tree.node_box_kernel, separation_proof.proof_round_kernel  # of no precision
SWEEPS = motion_bounds.frame_displacement_kernel, rows.active_row_kernel, rows.near_pair_flag_kernel  # and rows.press
SWEEPS_WORDS = (rows.sweep_count_kernel,)
NEWTON = {"stiffen": push.row_stiffness_kernel, "renew": push.row_push_kernel, "join": push.join_block_kernel,
          "give": push.row_force_kernel, "take": push.row_sum_transfer_kernel,
          "multiply": energy.row_product_kernel, "change": energy.psi_change_kernel, "tell": energy.world_change_kernel,
          "spread": solve.share_solution_kernel,
          "measure": solve.step_energy_kernel, "compare": solve.energy_scale_kernel, "count": solve.count_newton_kernel}
NEWTON_WORDS = {"share": solve.share_step_kernel}


def search_proof_module(model: Model) -> str:
    """Name of the module of search and proof."""
    def make_meeting_kernel(real, module):
        return search.box_candidate_kernel(real, module, not model.device.is_cuda)
    return _make_shared_module(model, "wsim_selfcontact", (*CORE, make_meeting_kernel), CORE_WORDS)


def contact_sweep_module(model: Model, turns: bool) -> str:
    """Name of the module of contact rows. turns: as `rows.pair_sweep_kernel`."""
    def make_pressing_kernel(real, module):
        return rows.pair_sweep_kernel(real, module, turns)
    return _make_shared_module(model, f"wsim_selfcontact_sweeps{'_turns' * turns}", (*SWEEPS, make_pressing_kernel),
                               SWEEPS_WORDS)


def newton_contact_module(model: Model, springs: bool, elements: bool) -> str:
    """Name of the module of contact rows in Newton steps of such forces."""
    def make_force_kernels(real, module):
        solve.joined_product_kernel(real, module, springs, elements)
        pcg.pcg_chunk_kernels(real, module, springs, elements)
        line_search.step_choice_kernel(real, module)
    name = "_".join(["wsim_selfcontact_newton", *["springs"] * springs, *["elements"] * elements])
    return _make_shared_module(model, name, (*NEWTON.values(), make_force_kernels), tuple(NEWTON_WORDS.values()))


def _make_shared_module(model: Model, name: str, kernels: tuple[Callable, ...], words: tuple[Callable, ...]) -> str:
    """Makes all kernels of a module, which the model loads with its own; returns its name."""
    name = f"{name}_{types(model.real).name}" + f"_{model.block}" * model.device.is_cuda
    for make in kernels:
        make(model.real, name)
    for make in words:
        make(name)
    model.modules[name] = model.block
    return name
