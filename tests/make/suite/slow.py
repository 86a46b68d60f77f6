"""Rows and tests that `pytest` leaves to `pytest -m slow`, beside those that are marked where they stand, by file and test:
whole tests of two seconds of a core, or three to compile what no other needs, whose kind a cheaper one covers, and rows of a
third of a second, or one to compile, beside a cheaper one of the same test. A test that covers its kind alone stays."""

from tests.make.suite.slow_physics import PHYSICS

SLOW = PHYSICS | {
    "fitting/test_fabric.py": {
        "test_both_are_found_from_noisy_motion": ["0.3-0.1"]},
    "fitting/test_fields.py": {
        "test_the_motion_of_a_pin_is_found_from_what_hangs_on_it": [],
        "test_a_soft_and_a_stiff_half_are_found_from_one_bent_shape": [],
        "test_noise_does_not_blow_up": ["smooth", "tv"],
        "test_without_a_belief_noise_is_what_is_found": [],
        "test_the_gradient_of_the_misfit_is_that_of_differences": ["scene8-rest_shape[]", "scene19-weft[]",
            "scene20-stretch[]", "scene14-bend[]", "scene2-young[]", "scene17-shear[]"],
        "test_a_fit_goes_on_from_its_file": [],
        "test_other_fields_are_written_where_the_loader_finds_them": ["sheet-rest_shape[]", "<lambda>-rest_shape[]",
            "sheet-velocities[]", "sheet-bend[]"],
        "test_the_stiffness_of_each_spring_of_a_net_is_found": [],
        "test_the_command_writes_the_field_and_the_loader_reads_it": [],
        "test_the_velocities_of_a_throw_are_found_from_where_it_ends": []},
    "fitting/test_joints_and_contacts.py": {
        "test_a_coefficient_is_found_from_markers_with_an_error_bar": ["friction"]},
    "fitting/test_memory.py": {
        "test_what_a_simulation_holds_is_all_that_was_allocated": ["sheet", "flowing bar"]},
    "fitting/test_numbers_and_fields.py": {
        "test_a_number_and_a_field_are_found_together": [],
        "test_a_field_and_a_density_are_found_by_sweeps": [],
        "test_a_stiffness_field_is_found_from_scans_without_correspondence": [],
        "test_the_gradient_of_the_misfit_is_that_of_differences": ["<lambda>-<lambda>-names5", "<lambda>-<lambda>-names9",
            "<lambda>-<lambda>-names4", "<lambda>-scanned-names1", "<lambda>-<lambda>-names6"],
        "test_what_cannot_be_recorded_is_not_put_down_to_the_start": [],
        "test_a_prior_of_a_number_counts": []},
    "fitting/test_shared.py": {
        "test_copies_that_take_turns_give_the_same_fit_to_the_bit": ["explicit", "implicit"]},
    "gpu/test_capture.py": {
        "test_a_frame_takes_no_memory": []},
    "gradient/rigid/test_contacts.py": {
        "test_checkpoints_are_refused": [],
        "test_a_box_slides_by_its_friction": []},
    "gradient/test_bounds.py": {
        "test_jvp_at_the_end_of_a_range_is_from_the_side_that_is_allowed": ["/floor:dynamic_friction-leapfrog",
            "/cloth:dynamic_friction-leapfrog", "/floor:dynamic_friction-xpbd", "/floor:thickness-leapfrog"],
        "test_products_and_verdicts_by_where_a_collider_is": ["leapfrog"]},
    "gradient/test_coverage.py": {
        "test_what_is_refused_raises_with_its_words_and_path": ["features", "margin", "forming"]},
    "gradient/test_fluids.py": {
        "test_every_value_has_the_slope_of_differences": ["/air:viscosity", "wind"],
        "test_schemes_that_carry_there_and_back": ["maccormack-/fire:place"],
        "test_a_recorded_run_is_the_plain_one_to_the_bit": []},
    "gradient/test_gradients.py": {
        "test_a_sheet_by_implicit_steps": ["backward_euler-membrane", "bdf2-springs", "sdirk3-springs"],
        "test_a_bar_of_quadratic_tets_under_pressure": ["neo_hookean-more2", "corotational-more0"],
        "test_a_sheet_that_stretches_shears_and_bends": ["membrane"],
        "test_a_chain_of_springs_by_every_explicit_integrator": ["rk4", "leapfrog", "midpoint", "explicit_euler"],
        "test_where_a_pin_puts_its_points": ["implicit-bdf2-True"],
        "test_a_soft_bar": ["corotational-0.0", "neo_hookean-0.0", "corotational-0.001", "neo_hookean-0.001", "linear-0.0"],
        "test_a_soft_bar_by_implicit_steps": ["sdirk3-neo_hookean", "implicit_midpoint-corotational"]},
    "gradient/test_paths.py": {
        "test_contacts_that_few_newton_steps_do_not_find_are_sought_once_more": ["1"]},
    "gradient/test_products.py": {
        "test_seeds_times_jvp_is_vjp_times_direction": ["implicit", "membrane", "solid"],
        "test_hessians_are_symmetric_and_errors_are_named": ["membrane"],
        "test_targets_of_a_pin_that_moves": ["60.0"]},
    "gradient/test_reaction_adjoint.py": {
        "test_a_soft_pin": ["solver0", "solver2"],
        "test_wind": ["more0", "more1"],
        "test_looking_changes_nothing_and_gradients_repeat_to_the_bit": ["scene1", "scene3"],
        "test_a_bar_that_flows": ["corotational-more0-1e-07"],
        "test_muscles": ["sdirk3", "rk4", "newton", "leapfrog", "midpoint"],
        "test_a_sheet_by_sweeps": ["springs-how1"],
        "test_a_chain_by_leapfrog": ["how0"],
        "test_a_soft_bar": ["solver0"],
        "test_a_chain_by_sweeps": ["implicit_midpoint-16", "bdf2-16", "sdirk3-16"]},
    "gradient/test_trajectory.py": {
        "test_positions_are_the_bits_of_a_simulation": ["scene1"],
        "test_so_they_are_of_one_without_gradients": ["scene1"]},
    "gradient/test_value.py": {
        "test_every_value_has_the_slope_of_differences": ["xpbd-Skeleton.turns"]},
    "scene/test_chord.py": {
        "test_penetration_is_that_of_the_deepest_place_of_a_triangle": ["cone"],
        "test_a_collider_stays_below_the_cloth_between_its_points": ["solid"]},
    "show/test_smoke.py": {
        "test_kernels_of_smoke_are_loaded_for_smoke_alone": []},
    "simulation/measure/test_checks.py": {
        "test_colliders_that_move_points_give_what_the_points_have": ["xpbd", "implicit"],
        "test_wind_and_loads_give_what_the_cloth_has": ["implicit"],
        "test_a_turntable_and_a_belt_drag_what_lies_on_them_without_a_warning": ["float64"]},
    "simulation/predicted/test_measured.py": {
        "test_sweeps_report_at_least_the_error_that_they_have_and_the_main_run_keeps_its_bits": []},
    "simulation/predicted/test_sag.py": {
        "test_a_run_sinks_as_far_as_is_said": ["wall"]},
    "simulation/predicted/test_settled.py": {
        "test_what_sweeps_leave_is_warned_of_with_the_strain_of_a_solved_chain": ["0.0"]},
    "simulation/test_diagnose.py": {
        "test_a_simulation_says_what_first_went_bad": ["xpbd-pins"]},
    "simulation/test_examples.py": {
        "test_a_cloth_is_thrown_into_the_frame": [],
        "test_two_numbers_are_found_with_their_error_bars": ["scenes.examples.moduli_of_a_bar-0.005"]},
    "simulation/test_measure.py": {
        "test_methods_do_not_write_over_indicators_of_each_other": []},
    "simulation/test_simulation.py": {
        "test_the_observed_order_is_the_declared_one": ["backward_euler-1"],
        "test_a_restart_from_the_fields_is_exact": ["bdf2"]},
    "simulation/test_skip.py": {
        "test_exactly_the_kernels_of_the_scene_are_compiled": ["shirt", "flag", "tablecloth", "cape"],
        "test_a_change_of_the_scene_changes_just_its_kernels": [],
        "test_exactly_the_modules_of_the_scene_are_imported": ["shirt", "cape"],
        "test_no_viewer_no_writer_and_no_second_copy_of_the_kernels": ["cape", "shirt"],
        "test_no_adjoint_is_compiled": ["cape", "shirt"],
        "test_methods_arrays_and_reasons_agree": ["cape", "shirt"]},
    "simulation/test_varying.py": {
        "test_a_run_follows_curves_as_if_each_frame_were_set_by_hand": ["explicit"]},
    "sweep/test_curves.py": {
        "test_a_world_follows_its_curve_as_one_alone_follows_that_of_its_scene": ["explicit", "implicit"]},
    "sweep/test_worlds.py": {
        "test_values_of_all_worlds_at_once_are_those_of_one_after_another": ["explicit"],
        "test_a_world_that_breaks_is_taken_out_and_leaves_the_others_as_they_were": ["explicit"],
        "test_a_world_is_reset_alone": ["explicit"]},
    "tools/test_lint.py": {                            # tools/lint.py asks the same of the same files: a step of .ci/run
        "test_the_sources_keep": ["layers", "cycles", "size", "words"],
        "test_names_are_no_worse_than_they_were": []},
    "tools/test_packaging.py": {
        "test_an_editable_clone_is_imported_from_its_parent_folder": [],
        "test_root_folders_are_inside_the_package": [],
        "test_schemas_are_inside": [],
        "test_nothing_else_is_installed": [],
        "test_a_type_checker_is_told_that_it_is_typed": []},
    "tools/test_reference.py": {
        "test_converged_integrators_have_their_order": ["backward_euler-1"]},
    "tools/test_scenes.py": {
        "test_scenes_run": ["shirt", "ribbon", "twisted_cloth", "rollers", "worn_shirt", "cape", "hanging_cloth"],
        "test_rollers_pull_a_cloth_at_their_speed": [],
        "test_the_humanoid_comes_to_rest_with_its_joints_closed": [],
        "test_rigid_scenes_stand_until_the_ball_comes_and_fall_then": ["arch-2.9-0.005-12", "dominoes-0.0-0.001-30",
            "pyramid-3.5-0.001-10"],
        "test_the_squeezed_cube_is_carried_by_friction": [],
        "test_the_bar_is_twisted_by_a_full_turn_and_keeps_its_volume": [],
        "test_scenes_of_fluids_blow_smoke": ["waved_flag", "cavity"]},
    "tools/test_stress_rows.py": {
        "test_the_abuse_ends_finite_and_recovers": ["yanked", "slivers 1:100000", "membrane 1e-3", "needles 1:100", "buttons"],
        "test_a_soft_body_ends_finite_and_recovers": ["soft inside out, corotational"]},
    "tools/test_stress_work.py": {
        "test_what_carries_the_scene_gives_what_leapfrog_has": []},
    "usd/new/test_new_asset.py": {
        "test_a_scene_that_another_stage_refers_to_still_runs": ["cloth", "softbody"]},
    "usd/new/test_new_softbody.py": {
        "test_a_mesh_among_others_moves_into_a_body_of_its_own": ["/ball"]},
    "usd/prims/test_painted.py": {
        "test_faces_in_series_stretch_each_by_its_own_stiffness": ["xpbd-128"]},
    "usd/prims/test_rods.py": {
        "test_thirty_strands_in_one_another_are_solved_with_whatever_room_there_is": []},
    "usd/result/test_keeping.py": {
        "test_restarts_and_interrupted_runs_leave_copies_alone": [".usd", ".usda"]},
    "usd/result/test_resume.py": {
        "test_a_restart_from_the_fields_is_exact": ["draped-explicit-leapfrog", "draped-xpbd-backward_euler",
            "draped-xpbd-bdf2", "blown-explicit-rk4", "draped-implicit-backward_euler", "blown-explicit-leapfrog",
            "draped-implicit-implicit_midpoint"],
        "test_a_restart_that_lacks_a_field_begins_without_history": ["explicit-leapfrog-b"]},
    "usd/test_compliance.py": {
        "test_what_bodies_and_smoke_write_passes": ["plume-more2"]},
    "usd/test_first_hour.py": {
        "test_new_answers_with_one_line_that_has_the_cure": ["a half-open one"]},
    "usd/test_soft_abuse.py": {
        "test_a_spoilt_attribute_is_read_or_refused": []},
    "usd/test_splines.py": {
        "test_a_motion_of_any_kind_comes_back_from_a_file": ["eased"]},
    "usd/test_value_clips.py": {
        "test_a_run_with_clips_has_the_bits_of_one_without": []},
}
