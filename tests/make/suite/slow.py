"""Rows and tests that `pytest` leaves to `pytest -m slow`, beside those that are marked where they stand, by file and test:
whole tests of more than three seconds of a core whose kind a cheaper one covers, and rows of more than half a second beside a
cheaper one of the same test, with kernels that were there. A test that covers its kind alone keeps its cheapest row."""

SLOW = {
    "fitting/test_fields.py": {
        "test_the_motion_of_a_pin_is_found_from_what_hangs_on_it": [],
        "test_a_soft_and_a_stiff_half_are_found_from_one_bent_shape": [],
        "test_noise_does_not_blow_up": ["smooth", "tv"],
        "test_without_a_belief_noise_is_what_is_found": [],
        "test_the_gradient_of_the_misfit_is_that_of_differences": ["scene8-rest_shape[]", "scene19-weft[]",
            "scene20-stretch[]"],
        "test_a_fit_goes_on_from_its_file": [],
        "test_other_fields_are_written_where_the_loader_finds_them": ["sheet-rest_shape[]"]},
    "fitting/test_memory.py": {
        "test_what_a_simulation_holds_is_all_that_was_allocated": ["sheet", "flowing bar"]},
    "fitting/test_numbers_and_fields.py": {
        "test_a_number_and_a_field_are_found_together": [],
        "test_a_field_and_a_density_are_found_by_sweeps": [],
        "test_a_stiffness_field_is_found_from_scans_without_correspondence": [],
        "test_the_gradient_of_the_misfit_is_that_of_differences": ["<lambda>-<lambda>-names5", "<lambda>-<lambda>-names9"]},
    "fitting/test_shared.py": {
        "test_copies_that_take_turns_give_the_same_fit_to_the_bit": ["explicit", "implicit"]},
    "gpu/test_capture.py": {
        "test_a_frame_takes_no_memory": ["implicit-backward_euler", "implicit-bdf2", "xpbd-bdf2", "xpbd-backward_euler"]},
    "gradient/rigid/test_contacts.py": {
        "test_checkpoints_are_refused": [],
        "test_a_box_slides_by_its_friction": []},
    "gradient/test_bounds.py": {
        "test_jvp_at_the_end_of_a_range_is_from_the_side_that_is_allowed": ["/floor:dynamic_friction-leapfrog",
            "/cloth:dynamic_friction-leapfrog", "/floor:dynamic_friction-xpbd", "/floor:thickness-leapfrog"],
        "test_products_and_verdicts_by_where_a_collider_is": ["leapfrog"]},
    "gradient/test_coverage.py": {
        "test_what_is_refused_raises_with_its_words_and_path": ["features", "margin"],
        "test_every_value_has_the_slope_of_differences": ["explicit-Cloth.stretch"]},
    "gradient/test_fluids.py": {
        "test_every_value_has_the_slope_of_differences": ["/air:viscosity"]},
    "gradient/test_gradients.py": {
        "test_a_sheet_by_implicit_steps": ["backward_euler-membrane", "bdf2-springs", "sdirk3-springs"],
        "test_a_bar_of_quadratic_tets_under_pressure": ["neo_hookean-more2", "corotational-more0"],
        "test_a_sheet_that_stretches_shears_and_bends": ["membrane"],
        "test_a_chain_of_springs_by_every_explicit_integrator": ["rk4"],
        "test_where_a_pin_puts_its_points": ["implicit-bdf2-True"],
        "test_a_soft_bar": ["corotational-0.0", "neo_hookean-0.0", "corotational-0.001", "neo_hookean-0.001"],
        "test_a_soft_bar_by_implicit_steps": ["sdirk3-neo_hookean"]},
    "gradient/test_products.py": {
        "test_seeds_times_jvp_is_vjp_times_direction": ["implicit", "membrane"]},
    "gradient/test_reaction_adjoint.py": {
        "test_a_soft_pin": ["solver0", "solver2"],
        "test_wind": ["more0", "more1"],
        "test_looking_changes_nothing_and_gradients_repeat_to_the_bit": ["scene1"],
        "test_a_bar_that_flows": ["corotational-more0-1e-07"],
        "test_muscles": ["sdirk3", "rk4", "newton"],
        "test_a_sheet_by_sweeps": ["springs-how1"]},
    "physics/animation/test_skinning.py": {
        "test_a_character_is_where_usd_skins_it_at_frames_and_between": ["CesiumMan.usdz-classicLinear-float32"]},
    "physics/carrier/test_balls.py": {
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept": ["xpbd-backward_euler", "implicit-backward_euler",
            "implicit-implicit_midpoint", "explicit-rk4", "implicit-bdf2"]},
    "physics/cloth/test_drape.py": {
        "test_a_limp_disc_hangs_down_and_a_stiff_one_stays_flat": ["0.05-5.0-45.0"]},
    "physics/cloth/test_edge_contacts.py": {
        "test_nothing_sharp_stands_out_between_points": [],
        "test_a_box_that_flies_between_points_of_a_sheet_is_met_and_momentum_is_kept": ["leapfrog"]},
    "physics/cloth/test_element_adjoint.py": {
        "test_gradients_are_those_of_differences": ["dihedral-True"]},
    "physics/cloth/test_kind.py": {
        "test_gradients_go_through_every_solver": ["how2", "how1"]},
    "physics/cloth/test_live_fabric.py": {
        "test_by_poisson_s_ratio": ["rk4-more6--0.4-25.0", "leapfrog-more1-0.0-0.0", "xpbd-more2-0.2-25.0",
            "newton-more5-0.0-0.0", "newton-more8--0.4-25.0"],
        "test_by_a_strain_limit": ["membrane-newton", "membrane-leapfrog", "springs-leapfrog", "springs-newton"],
        "test_what_a_pin_bears_by_poisson_s_ratio": ["newton"],
        "test_as_an_input_of_a_rollout": ["True-poisson-<lambda>", "False-poisson-<lambda>"]},
    "physics/cloth/test_muscles.py": {
        "test_muscles_move_a_soft_body_over_the_ground": [],
        "test_newtons_method_moves_it_as_far_as_leapfrog": [],
        "test_gradients_by_the_factors": ["rk4", "midpoint", "sdirk3"]},
    "physics/cloth/test_rest_shape.py": {
        "test_a_fit_finds_a_shape": [],
        "test_a_sheet": ["springs-newton-more5", "membrane-newton-more4"],
        "test_a_bar": ["neo_hookean-True-newton", "corotational-True-leapfrog", "corotational-False-leapfrog"],
        "test_a_net": ["leapfrog-net", "rk4-net", "rk4-muscled", "newton-muscled"],
        "test_strain_limits_and_tethers": ["0.01-False"]},
    "physics/contact/test_candidates.py": {
        "test_a_list_tells_what_the_tree_tells": ["more than a list has room for-sheet",
            "more than a list has room for-solid"]},
    "physics/contact/test_clearance.py": {
        "test_a_sheet_falls_on_a_floor_as_with_contacts_throughout": ["stages"],
        "test_a_floor_is_met_from_where_the_fall_of_a_frame_reaches": ["newton", "stages"],
        "test_what_is_through_a_thin_wall_within_a_frame_is_caught": ["newton", "stages"],
        "test_what_is_in_and_out_of_reach_within_a_frame_is_caught": ["stages"],
        "test_a_collider_that_comes_by_within_a_frame_is_met": ["march-by1", "stages-by6", "newton-by8"],
        "test_a_restart_goes_on_to_the_bit_from_every_frame": ["newton-float64", "stages-float64", "midpoint-float64"]},
    "physics/contact/test_collider_adjoint.py": {
        "test_a_sheet_that_slides_on_a_mesh": ["sphere-xpbd"],
        "test_by_friction_and_thickness_of_a_collider": ["plane-leapfrog", "deforming-leapfrog", "sphere-xpbd"],
        "test_by_the_motion_of_a_collider": ["plane-leapfrog", "plane-xpbd", "deforming-xpbd", "sheet-xpbd", "sphere-xpbd",
            "deforming-leapfrog"],
        "test_a_plane_of_triangles_has_the_gradients_of_a_plane": ["xpbd-False", "leapfrog-False", "leapfrog-True"],
        "test_by_the_restitution_of_two_colliders_in_two_worlds": ["explicit-leapfrog"]},
    "physics/contact/test_friction_newton.py": {
        "test_a_cloth_on_a_ball_is_strained_as_little_with_friction_as_without": ["bdf2", "backward_euler"]},
    "physics/contact/test_midpoint.py": {
        "test_contacts_do_no_work_and_what_they_throw_back_is_taken": ["0.4"],
        "test_a_sheet_falls_on_a_ball_and_slides_down_without_giving_way": ["3", "6"],
        "test_layers_fall_on_a_floor_and_never_intersect": []},
    "physics/contact/test_poses.py": {
        "test_an_outline_is_the_same_whichever_frames_it_is_worked_out_with": ["smooth", "eased", "stack"]},
    "physics/contact/test_project_adjoint.py": {
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides": ["plane-leapfrog", "sphere-leapfrog", "box-leapfrog",
            "capsule-leapfrog", "cylinder-leapfrog", "cone-leapfrog", "box-xpbd"],
        "test_bdf2_forgets_what_was_before_a_contact": ["more0"],
        "test_a_smoothed_contact_has_no_kink_where_it_begins": ["leapfrog"]},
    "physics/contact/test_restitution.py": {
        "test_a_sheet_thrown_at_a_sphere_never_gains_energy": ["implicit-backward_euler-0.0", "implicit-bdf2-0.0",
            "xpbd-backward_euler-0.0", "xpbd-bdf2-0.0"],
        "test_sensitivities_are_those_of_the_motion": ["midpoint-118-3", "rk4-118-3", "leapfrog-90-2", "leapfrog-118-3"],
        "test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme": ["xpbd-backward_euler", "xpbd-bdf2"]},
    "physics/contact/test_soft_contacts.py": {
        "test_a_bar_that_lands_and_slides": ["sphere-backward_euler"],
        "test_a_bar_that_sticks_is_carried": ["sheet-bdf2"],
        "test_a_bar_of_quadratic_tets_under_pressure": [],
        "test_by_the_motion_of_a_collider": ["sphere-backward_euler"]},
    "physics/contact/test_toy_shape.py": {
        "test_cloth_rests_on_it": ["implicit-more1", "explicit-more2"]},
    "physics/fluid/liquid/test_bodies.py": {
        "test_the_buoyancy_of_what_is_as_dense_as_the_liquid_is_its_weight": ["shape1-7.8"],
        "test_a_light_body_rises_as_its_added_mass_lets_it": ["10.0"],
        "test_momentum_goes_from_a_stream_to_a_body": []},
    "physics/fluid/liquid/test_sheets.py": {
        "test_liquid_poured_onto_a_pinned_sheet_stays_above_it": [],
        "test_a_mesh_whose_points_move_is_the_collider_that_moves_so": []},
    "physics/fluid/obstacles/test_obstacles.py": {
        "test_a_mesh_is_an_obstacle_as_its_shape_is": [],
        "test_a_wall_thinner_than_a_cell_does_not_leak": ["0.0"]},
    "physics/fluid/test_accuracy.py": {
        "test_other_schemes_lose_to_the_projection_what_reflection_keeps": ["bfecc-0.0342", "linear-0.0512"]},
    "physics/fluid/test_bodies.py": {
        "test_a_body_that_is_pushed_takes_as_much_air_along_as_it_displaces": ["cubic"]},
    "physics/fluid/test_cavity.py": {
        "test_published_extrema_are_those_of_finite_differences": ["400-0.0005", "1000-0.0015"]},
    "physics/fluid/test_scalars.py": {
        "test_a_smooth_blob_after_a_turn": ["maccormack-0.19", "bfecc-0.145"]},
    "physics/fused/test_abreast.py": {
        "test_any_number_of_threads_gives_the_bits_of_launch_by_launch": ["everything-2", "blown-3"]},
    "physics/fused/test_contact_faces.py": {
        "test_threads_that_share_faces_find_the_contacts_of_one_that_tries_all": ["closed-lists"]},
    "physics/joints/test_beside.py": {
        "test_islands_and_contacts_of_many_launches_give_the_bits_of_one": [],
        "test_bodies_of_a_joint_pass_through_each_other_unless_it_says_that_they_collide": []},
    "physics/joints/test_humanoid.py": {
        "test_worlds_of_joints_are_alike": [],
        "test_a_hinge_with_a_strong_damper_hardly_moves": [],
        "test_bodies_of_the_humanoid_move_together_as_if_nothing_held_them_in_free_fall": []},
    "physics/joints/test_loops.py": {
        "test_a_parallel_four_bar_keeps_its_energy_through_the_line": ["10", "60", "80"]},
    "physics/joints/test_motion.py": {
        "test_one_driven_coordinate_is_a_damped_oscillator": ["40.0-1.5-float64", "400.0-0.0-float32", "4000.0-20.0-float64",
            "4000.0-20.0-float32", "40000.0-100.0-float64", "40000.0-100.0-float32", "1000.0-500.0-float64",
            "0.0-50.0-float32", "100000.0-10.0-float64", "100000.0-10.0-float32"]},
    "physics/joints/test_pivots.py": {
        "test_one_sweep_is_where_sweeps_of_single_rows_end": ["3-0", "6-6", "2-6"]},
    "physics/motion/test_compensated.py": {
        "test_a_sheet_of_996_substeps_in_float32": []},
    "physics/motion/test_explicit.py": {
        "test_membranes_and_hinges_agree_with_a_converged_implicit_solution": [],
        "test_energy_of_the_stiff_oscillator": ["explicit_euler-20959.16-0.01"],
        "test_energy_of_the_pendulum": ["symplectic_euler--1.249-0.0005", "rk4--1.01e-06-5e-09"]},
    "physics/motion/test_loads.py": {
        "test_a_force_over_time_moves_by_its_integral_and_has_exact_derivatives": ["implicit-sdirk3"]},
    "physics/motion/test_sheets.py": {
        "test_any_number_of_threads_gives_the_same_bits": ["3"]},
    "physics/motion/test_soft_pins.py": {
        "test_gradients_by_the_stiffness_of_soft_pins_of_one_point": ["1"]},
    "physics/motion/test_threads.py": {
        "test_any_number_of_threads_gives_the_same_bits": ["settings0-3", "settings1-3"]},
    "physics/rigid/narrow/test_gjk.py": {
        "test_hulls_face_to_face_touch_at_four_points_with_equal_gaps": ["f64"]},
    "physics/rigid/solver/test_colours.py": {
        "test_launches_of_passes_and_colours_give_the_bits_of_one_launch": []},
    "physics/rigid/solver/test_converged.py": {
        "test_fixed_sweeps_come_near_to_the_converged_motion": []},
    "physics/rigid/solver/test_sleep.py": {
        "test_a_column_sleeps_after_half_a_second_and_nothing_moves_any_more": ["coloured"],
        "test_a_collider_that_moves_wakes_what_it_touches": ["coloured"]},
    "physics/rigid/standing/test_floors.py": {
        "test_a_box_slides_over_triangles_as_far_as_friction_lets_it_and_does_not_catch": ["float64-1", "float32-1"]},
    "physics/rigid/standing/test_stacks.py": {
        "test_everyday_objects_stand_at_the_defaults_of_a_stage": ["tower", "twenty cubes of four millimetres"]},
    "physics/rigid/standing/test_statics.py": {
        "test_two_cards_that_lean_on_each_other_stand_where_friction_is_enough": ["1.05-True"],
        "test_an_arch_stands_where_it_is_thicker_than_milankovitch_says": ["0.12-True", "0.16-True"]},
    "physics/rigid/test_contact.py": {
        "test_a_mesh_lies_as_its_hull_does": []},
    "physics/rigid/test_usd.py": {
        "test_scenes_of_others_run_and_come_to_rest": ["box_on_plane-1-1.0"]},
    "physics/rigid/touch/test_blows.py": {
        "test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has": ["xpbd bdf2", "rk4", "newton",
            "newton bdf2", "leapfrog"],
        "test_an_elastic_blow_keeps_energy": ["xpbd bdf2", "leapfrog"],
        "test_velocities_that_are_read_have_all_momentum_in_each_frame": ["0.0-xpbd bdf2", "0.0-rk4", "0.0-newton",
            "0.0-newton bdf2", "0.5-xpbd", "0.5-xpbd bdf2", "0.5-leapfrog", "0.5-rk4", "0.5-newton", "0.5-newton bdf2",
            "0.0-leapfrog"],
        "test_what_a_ball_gives_a_sheet_it_has_lost": ["0.01-xpbd", "100.0-xpbd", "0.01-xpbd bdf2", "1.0-xpbd bdf2",
            "100.0-xpbd bdf2", "0.01-leapfrog", "1.0-leapfrog", "100.0-leapfrog", "0.01-rk4", "1.0-rk4", "100.0-rk4",
            "0.01-newton", "1.0-newton", "100.0-newton", "0.01-newton bdf2", "1.0-newton bdf2", "100.0-newton bdf2"],
        "test_a_blow_that_rebounds_keeps_a_part_of_the_speed": ["xpbd bdf2", "leapfrog", "xpbd"],
        "test_nothing_passes_at_twenty_metres_a_second": ["leapfrog", "xpbd"],
        "test_a_ball_in_a_sheet_comes_to_rest": ["0.01", "100.0", "1.0"],
        "test_runs_are_the_same_to_the_bit": []},
    "physics/rigid/touch/test_scene.py": {
        "test_what_cannot_be_gives_way_and_says_so": ["change1-other1-bdf2 takes its place",
            "change2-other2-bdf2 takes its place"],
        "test_a_run_goes_on_to_the_bit_and_holds_points_and_transforms": ["way1", "way2"],
        "test_a_soft_cube_on_a_box_on_a_plane_rests": ["600.0", "100.0"],
        "test_a_box_on_a_trampoline_net_rests": [],
        "test_newtons_method_repeats_what_it_has_not_foreseen": []},
    "physics/rods/test_among.py": {
        "test_a_rope_that_is_thrown_at_a_cloth_never_passes": ["0-xpbd bdf2", "0-newton", "0-newton bdf2", "0-leapfrog",
            "0-rk4", "1-xpbd", "1-xpbd bdf2", "1-newton bdf2", "1-leapfrog", "1-rk4"],
        "test_a_rope_and_a_cloth_that_collide_keep_their_momentum": ["xpbd bdf2", "newton bdf2", "leapfrog", "rk4"],
        "test_a_rope_on_a_cloth_sticks_and_slips_at_the_critical_angle": ["xpbd", "newton bdf2", "leapfrog", "rk4"],
        "test_a_ridge_bears_a_rope_and_stretches_it_no_more_than_its_weight_does": ["xpbd bdf2", "newton", "newton bdf2",
            "rk4"],
        "test_strands_that_fall_on_a_soft_body_lie_on_it": ["explicit"]},
    "physics/rods/test_nets.py": {
        "test_every_substep_of_a_net_under_bodies_is_solved": ["5-0.03-0.0"]},
    "physics/selfcontact/test_colliders.py": {
        "test_a_spike_pokes_through_without": [],
        "test_a_coarse_cloth_lies_on_a_spike": ["explicit", "implicit"],
        "test_a_mesh_that_grows_lifts_the_cloth": [],
        "test_an_edge_of_a_cube_stays_below_triangles_larger_than_the_cube": ["box"],
        "test_friction_at_a_tip_is_coulombs": ["0.0"],
        "test_a_cloth_between_colliders_that_meet_stops_and_goes_on_once_they_part": ["explicit", "implicit"]},
    "physics/selfcontact/test_crossed.py": {
        "test_surfaces_that_start_crossed_fall_freely_and_gain_no_energy": ["newton bdf2", "newton midpoint", "rk4"],
        "test_a_cloth_folded_through_itself_goes_on_calmly": ["newton"],
        "test_a_collider_that_starts_inside_a_cloth_throws_nothing": ["newton"]},
    "physics/selfcontact/test_friction.py": {
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above": ["xpbd-plane", "xpbd bdf2-plane",
            "xpbd bdf2-cloth", "newton-plane", "newton-cloth", "newton bdf2-plane", "newton bdf2-cloth",
            "newton midpoint-plane", "newton midpoint-cloth", "leapfrog-plane", "leapfrog-cloth", "rk4-plane", "rk4-cloth"],
        "test_friction_that_is_set_live_is_that_of_the_material": ["leapfrog"]},
    "physics/selfcontact/test_guarantee.py": {
        "test_a_crumpled_sheet_has_no_intersection_in_any_substep": ["0"],
        "test_sheets_that_are_thrown_have_no_intersection_in_any_substep_by_the_midpoint": [],
        "test_pairs_that_are_pressed_in_turn_keep_their_momentum": [],
        "test_sheets_that_meet_within_a_substep_are_projected_and_not_cut": ["newton"],
        "test_cuts_end_where_proofs_do": [],
        "test_sheets_that_a_body_strikes_do_not_cross": ["newton bdf2"]},
    "physics/selfcontact/test_layers.py": {
        "test_fifty_layers_that_are_thrown_and_turn_keep_their_path_and_their_turn": ["newton midpoint", "leapfrog"]},
    "physics/selfcontact/test_momentum.py": {
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce": ["xpbd bdf2", "newton", "newton bdf2",
            "newton midpoint", "rk4", "leapfrog"],
        "test_angular_momentum_is_kept": ["newton midpoint-0.0", "newton midpoint-0.5"],
        "test_what_is_tied_keeps_its_momentum_beside_what_strikes_it": ["newton"],
        "test_a_world_of_sheets_and_the_body_that_strikes_them_ends_as_one_alone": ["xpbd"]},
    "physics/selfcontact/test_rest.py": {
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is": ["xpbd bdf2", "newton", "newton bdf2", "newton midpoint",
            "leapfrog", "rk4"],
        "test_a_folded_cloth_at_rest_on_a_cloth_is_calm_by_the_midpoint": [],
        "test_a_folded_cloth_at_rest_is_not_read_as_falling_by_rk4": []},
    "physics/selfcontact/test_soft.py": {
        "test_a_block_of_jelly_that_falls_on_another_does_not_enter_it": ["explicit", "implicit"]},
    "physics/selfcontact/test_tree.py": {
        "test_boxes_that_meet_are_found_once": ["12"]},
    "physics/soft/test_plastic.py": {
        "test_a_restart_and_a_repeated_frame_go_on_bit_for_bit": ["implicit-bdf2"]},
    "physics/soft/test_plastic_adjoint.py": {
        "test_a_bar_that_flows": ["neo_hookean-more1-2e-06"],
        "test_by_the_yield": ["more1", "more2"],
        "test_checkpoints_and_a_run_under_way": ["more0"]},
    "physics/solver/schwarz/test_steps.py": {
        "test_orders_on_stiff_cloth": ["backward_euler-1.0", "sdirk3-1.6", "bdf2-2.0"]},
    "physics/solver/test_newton.py": {
        "test_solved_steps_follow_an_independent_solver": ["implicit_midpoint", "sdirk3"],
        "test_a_drape_stays_outside_and_has_the_same_bits_twice": ["float32"],
        "test_a_scrambled_cloth_ends_finite_and_recovers": ["springs-float32", "springs-float64"]},
    "physics/solver/test_newton_adjoint_contacts.py": {
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides": ["plane-backward_euler"],
        "test_what_stands_on_its_feet_gives_way_by_statics": [],
        "test_a_sheet_that_slides_on_a_floor_along_a_wall": [],
        "test_a_recording_ends_where_a_simulation_of_many_newton_steps_does": [],
        "test_a_sheet_that_sticks_to_a_turning_plane_is_carried": []},
    "physics/solver/test_newton_adjoint_limits.py": {
        "test_a_sheet_that_is_pulled": ["backward_euler-both"],
        "test_triangles_and_a_soft_pin": [],
        "test_a_recording_ends_where_a_simulation_does": ["bdf2-limit-3", "sdirk3-tethers-3"],
        "test_among_contacts": ["sphere-backward_euler-0.4"],
        "test_what_is_thrown_back": [],
        "test_checkpoints_and_worlds_give_the_same": ["<lambda>1"],
        "test_float32_is_near_float64": ["<lambda>1"],
        "test_a_recording_says_how_far_it_is_from_a_simulation": ["0.0-implicit-1e-05-1e-08", "0.4-implicit-0.2-0.02"],
        "test_where_a_moving_pin_puts_its_points": ["bdf2", "sdirk3"]},
    "physics/solver/test_newton_surfaces.py": {
        "test_cloth_on_a_still_box_only_loses_energy": ["implicit_midpoint", "backward_euler"],
        "test_sheets_that_are_thrown_at_each_other_gain_no_energy": ["implicit_midpoint"],
        "test_a_ball_that_falls_into_cloth_that_collides_with_itself_gives_it_no_energy": ["backward_euler"]},
    "physics/solver/test_xpbd_adjoint.py": {
        "test_soft_pins": ["more1", "more3", "more2"],
        "test_undone_sweeps_are_as_good_as_fresh_buffers": ["membrane-inf-False", "springs-inf-True"],
        "test_a_launch_for_each_colour_gives_the_same_as_one_for_all": ["membrane-0.0002", "springs-0.0"],
        "test_a_stiff_sheet_of_240_substeps": ["membrane"],
        "test_a_chain": ["bdf2-16"],
        "test_a_sheet_that_stretches_shears_and_bends": ["membrane"]},
    "scene/test_chord.py": {
        "test_penetration_is_that_of_the_deepest_place_of_a_triangle": ["cone"]},
    "simulation/measure/test_checks.py": {
        "test_colliders_that_move_points_give_what_the_points_have": ["xpbd", "implicit"]},
    "simulation/predicted/test_settled.py": {
        "test_what_sweeps_leave_is_warned_of_with_the_strain_of_a_solved_chain": ["0.0"]},
    "simulation/test_diagnose.py": {
        "test_a_simulation_says_what_first_went_bad": ["xpbd-pins"]},
    "simulation/test_examples.py": {
        "test_a_cloth_is_thrown_into_the_frame": []},
    "simulation/test_simulation.py": {
        "test_the_observed_order_is_the_declared_one": ["backward_euler-1"]},
    "simulation/test_skip.py": {
        "test_exactly_the_kernels_of_the_scene_are_compiled": ["shirt", "flag", "tablecloth", "cape"],
        "test_a_change_of_the_scene_changes_just_its_kernels": [],
        "test_exactly_the_modules_of_the_scene_are_imported": ["shirt"]},
    "sweep/test_curves.py": {
        "test_a_world_follows_its_curve_as_one_alone_follows_that_of_its_scene": ["explicit", "implicit"]},
    "sweep/test_worlds.py": {
        "test_values_of_all_worlds_at_once_are_those_of_one_after_another": ["explicit"],
        "test_a_world_that_breaks_is_taken_out_and_leaves_the_others_as_they_were": ["explicit"],
        "test_a_world_is_reset_alone": ["explicit"]},
    "tools/test_scenes.py": {
        "test_scenes_run": ["shirt", "ribbon", "twisted_cloth", "rollers", "worn_shirt"],
        "test_rollers_pull_a_cloth_at_their_speed": [],
        "test_the_humanoid_comes_to_rest_with_its_joints_closed": [],
        "test_rigid_scenes_stand_until_the_ball_comes_and_fall_then": ["arch-2.9-0.005-12", "dominoes-0.0-0.001-30"],
        "test_the_squeezed_cube_is_carried_by_friction": []},
    "usd/new/test_new_asset.py": {
        "test_a_scene_that_another_stage_refers_to_still_runs": ["cloth", "softbody"]},
    "usd/new/test_new_softbody.py": {
        "test_a_mesh_among_others_moves_into_a_body_of_its_own": ["/ball"]},
}
