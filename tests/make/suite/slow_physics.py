"""What `tests.make.suite.slow` has of tests/physics."""

from tests.make.suite.slow_particles import PARTICLES

PHYSICS = PARTICLES | {
    "physics/animation/test_skinning.py": {
        "test_a_character_is_where_usd_skins_it_at_frames_and_between": ["CesiumMan.usdz-classicLinear-float32"],
        "test_device_and_host_agree_with_blend_shapes_and_scales": ["dualQuaternion-True"],
        "test_skeletons_of_a_scene_are_evaluated_together_and_each_moves_its_own_mesh": []},
    "physics/cloth/test_bending.py": {
        "test_a_strip_bends_alike_on_every_mesh_with_order_two": ["skewed"],
        "test_solvers_come_to_rest_where_the_beam_does": ["xpbd-backward_euler-8"]},
    "physics/cloth/test_drape.py": {
        "test_a_limp_disc_hangs_down_and_a_stiff_one_stays_flat": ["0.05-5.0-45.0"]},
    "physics/cloth/test_edge_contacts.py": {
        "test_nothing_sharp_stands_out_between_points": [],
        "test_a_box_that_flies_between_points_of_a_sheet_is_met_and_momentum_is_kept": ["leapfrog"],
        "test_folds_beside_a_corner_gain_no_energy": []},
    "physics/cloth/test_element_adjoint.py": {
        "test_gradients_are_those_of_differences": ["dihedral-True"]},
    "physics/cloth/test_kind.py": {
        "test_gradients_go_through_every_solver": ["how2", "how1", "how0", "how4"]},
    "physics/cloth/test_live_fabric.py": {
        "test_by_poisson_s_ratio": ["rk4-more6--0.4-25.0", "leapfrog-more1-0.0-0.0", "xpbd-more2-0.2-25.0",
            "newton-more5-0.0-0.0", "newton-more8--0.4-25.0", "newton-more4-0.2-25.0"],
        "test_by_a_strain_limit": ["membrane-newton", "membrane-leapfrog", "springs-leapfrog", "springs-newton",
            "membrane-xpbd"],
        "test_what_a_pin_bears_by_poisson_s_ratio": ["newton", "leapfrog"],
        "test_as_an_input_of_a_rollout": ["True-poisson-<lambda>", "False-poisson-<lambda>"],
        "test_limits_of_a_new_rest_shape_are_live_ones": ["newton"],
        "test_explicit_steps_follow_a_poisson_s_ratio_that_stiffens": [],
        "test_a_live_value_is_that_of_a_scene_built_with_it": ["strain_limit-values5-<lambda>"]},
    "physics/cloth/test_muscles.py": {
        "test_muscles_move_a_soft_body_over_the_ground": [],
        "test_newtons_method_moves_it_as_far_as_leapfrog": [],
        "test_gradients_by_the_factors": ["rk4", "midpoint", "sdirk3"]},
    "physics/cloth/test_rest_shape.py": {
        "test_a_fit_finds_a_shape": [],
        "test_a_sheet": ["springs-newton-more5", "membrane-newton-more4", "membrane-leapfrog-more0", "springs-leapfrog-more1"],
        "test_a_bar": ["neo_hookean-True-newton", "corotational-True-leapfrog", "corotational-False-leapfrog"],
        "test_a_net": ["leapfrog-net", "rk4-net", "rk4-muscled", "newton-muscled"],
        "test_strain_limits_and_tethers": ["0.01-False"]},
    "physics/cloth/test_settling.py": {
        "test_a_sheet_at_rest_has_its_whole_weight": ["implicit-implicit_midpoint", "implicit-bdf2"],
        "test_a_hanging_cloth_settles_within_2_to_6_s": ["leather-1.0-edge"],
        "test_motion_along_the_normal_decays_and_motion_in_the_plane_stays": ["explicit-rk4"]},
    "physics/compiled/test_alone.py": {
        "test_a_whole_module_has_the_bits_of_its_parts": ["implicit-float64"]},
    "physics/contact/test_candidate_lists.py": {
        "test_lists_find_what_a_search_of_the_whole_mesh_finds": ["sheet-deforms-float64"],
        "test_a_run_is_that_of_searches_in_every_substep": []},
    "physics/contact/test_candidates.py": {
        "test_a_list_tells_what_the_tree_tells": ["more than a list has room for-sheet", "more than a list has room for-solid",
            "few faces-solid"]},
    "physics/contact/test_free_flight_test.py": {
        "test_a_sheet_falls_on_a_floor_as_with_contacts_throughout": ["stages", "leaps"],
        "test_a_floor_is_met_from_where_the_fall_of_a_frame_reaches": ["newton", "stages"],
        "test_what_is_through_a_thin_wall_within_a_frame_is_caught": ["newton", "stages", "leaps"],
        "test_what_is_in_and_out_of_reach_within_a_frame_is_caught": ["stages", "leaps"],
        "test_a_collider_that_comes_by_within_a_frame_is_met": ["march-by1", "stages-by6", "newton-by8", "march-by2",
            "leaps-by5"],
        "test_a_restart_goes_on_to_the_bit_from_every_frame": ["newton-float64", "stages-float64", "midpoint-float64"],
        "test_implicit_steps_have_the_bits_of_contacts_that_find_nothing": ["newton-bdf2"],
        "test_a_far_collider_leaves_explicit_steps_their_bits": ["leaps-shape3-float32", "leaps-shape4-float64"],
        "test_no_search_finds_a_contact_of_points_within_their_clearance": ["0", "2"]},
    "physics/contact/test_collider_adjoint.py": {
        "test_a_sheet_that_slides_on_a_mesh": ["sphere-xpbd"],
        "test_by_friction_and_thickness_of_a_collider": ["plane-leapfrog", "deforming-leapfrog", "sphere-xpbd", "plane-xpbd",
            "deforming-xpbd", "sheet-xpbd"],
        "test_by_the_motion_of_a_collider": ["plane-leapfrog", "plane-xpbd", "deforming-xpbd", "sheet-xpbd", "sphere-xpbd",
            "deforming-leapfrog"],
        "test_a_plane_of_triangles_has_the_gradients_of_a_plane": ["xpbd-False", "leapfrog-False", "leapfrog-True"],
        "test_by_the_restitution_of_two_colliders_in_two_worlds": ["explicit-leapfrog"],
        "test_the_graph_of_a_deforming_mesh_has_the_bits_of_its_launches": [],
        "test_the_motion_of_a_collider_is_found_from_what_it_throws": []},
    "physics/contact/test_friction_newton.py": {
        "test_a_cloth_on_a_ball_is_strained_as_little_with_friction_as_without": ["bdf2", "backward_euler"]},
    "physics/contact/test_midpoint.py": {
        "test_contacts_do_no_work_and_what_they_throw_back_is_taken": ["0.4"],
        "test_a_sheet_falls_on_a_ball_and_slides_down_without_giving_way": ["3", "6"],
        "test_layers_fall_on_a_floor_and_never_intersect": []},
    "physics/contact/collider/test_poses.py": {
        "test_an_outline_is_the_same_whichever_frames_it_is_worked_out_with": ["smooth", "eased", "stack", "still"],
        "test_a_mesh_that_swells_is_met_where_its_ball_is_near": ["newton"],
        "test_a_collider_that_moves_far_away_has_no_poses": ["catmull_rom-shape1"],
        "test_a_broad_phase_changes_no_bit": ["0-float32"]},
    "physics/contact/test_project.py": {
        "test_a_resting_point_stays_for_1000_substeps": ["shape6-float64", "shape1-float64", "shape2-float64",
            "shape3-float64", "shape4-float64", "shape5-float64"],
        "test_indicators_tell_how_deep_points_are": []},
    "physics/contact/test_project_adjoint.py": {
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides": ["plane-leapfrog", "sphere-leapfrog", "box-leapfrog",
            "capsule-leapfrog", "cylinder-leapfrog", "cone-leapfrog", "box-xpbd"],
        "test_bdf2_forgets_what_was_before_a_contact": ["more0", "more1"],
        "test_a_smoothed_contact_has_no_kink_where_it_begins": ["leapfrog"],
        "test_checkpoints_find_the_same_contacts_again": []},
    "physics/contact/test_restitution.py": {
        "test_a_sheet_thrown_at_a_sphere_never_gains_energy": ["implicit-backward_euler-0.0", "implicit-bdf2-0.0",
            "xpbd-backward_euler-0.0", "xpbd-bdf2-0.0"],
        "test_sensitivities_are_those_of_the_motion": [],
        "test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme": ["xpbd-backward_euler", "xpbd-bdf2",
            "explicit-leapfrog"],
        "test_sensitivities_of_xpbd_are_of_first_order": [],
        "test_the_kernel_alone_differentiates": ["True"]},
    "physics/contact/test_soft_contacts.py": {
        "test_a_bar_that_lands_and_slides": ["sphere-backward_euler"],
        "test_a_bar_that_sticks_is_carried": [],
        "test_a_bar_of_quadratic_tets_under_pressure": [],
        "test_by_the_motion_of_a_collider": ["sphere-backward_euler", "sheet-bdf2"]},
    "physics/contact/collider/test_toy_shape.py": {
        "test_cloth_rests_on_it": ["implicit-more1", "explicit-more2"]},
    "physics/fluid/liquid/test_bodies.py": {
        "test_the_buoyancy_of_what_is_as_dense_as_the_liquid_is_its_weight": ["shape1-7.8", "shape0-6.3"],
        "test_a_light_body_rises_as_its_added_mass_lets_it": ["10.0"],
        "test_momentum_goes_from_a_stream_to_a_body": []},
    "physics/fluid/liquid/test_liquid.py": {
        "test_a_column_at_rest_stays_at_rest": ["n2-0.3125-1e-05"]},
    "physics/fluid/liquid/test_sheets.py": {
        "test_liquid_poured_onto_a_pinned_sheet_stays_above_it": [],
        "test_a_mesh_whose_points_move_is_the_collider_that_moves_so": []},
    "physics/fluid/liquid/test_transfers.py": {
        "test_a_linear_velocity_comes_back_as_it_was": ["3"]},
    "physics/fluid/obstacles/test_obstacles.py": {
        "test_a_mesh_is_an_obstacle_as_its_shape_is": [],
        "test_a_wall_thinner_than_a_cell_does_not_leak": ["0.0"]},
    "physics/fluid/pressure/test_pressure.py": {
        "test_float64_goes_as_far_as_it_is_asked_to": []},
    "physics/fluid/test_accuracy.py": {
        "test_other_schemes_lose_to_the_projection_what_reflection_keeps": ["bfecc-0.0342", "linear-0.0512"]},
    "physics/fluid/test_bodies.py": {
        "test_a_body_that_is_pushed_takes_as_much_air_along_as_it_displaces": ["cubic"]},
    "physics/fluid/test_cavity.py": {
        "test_published_extrema_are_those_of_finite_differences": ["400-0.0005", "1000-0.0015"]},
    "physics/fluid/test_scalars.py": {
        "test_a_smooth_blob_after_a_turn": ["maccormack-0.19", "bfecc-0.145"],
        "test_what_is_conserved_stays_to_rounding": ["float64-1e-13"]},
    "physics/fluid/test_tiles.py": {
        "test_what_is_far_from_all_smoke_need_not_be_carried": ["n2-sides2-3", "n3-sides3-1"]},
    "physics/motion/fused/test_thread_team.py": {
        "test_any_number_of_threads_gives_the_bits_of_launch_by_launch": ["everything-2", "blown-3"]},
    "physics/motion/fused/test_contact_faces.py": {
        "test_threads_that_share_faces_find_the_contacts_of_one_that_tries_all": ["closed-lists", "open-lists",
            "closed-lists without room", "open-lists without room"]},
    "physics/motion/fused/test_contact_lanes.py": {
        "test_threads_that_try_a_collider_each_find_the_contacts_of_one_that_tries_all": ["box-0.0", "plane-0.001",
            "sphere-0.0", "plane-0.0", "box-0.001", "sphere-0.001"]},
    "physics/motion/fused/test_kernel_fusion.py": {
        "test_one_launch_of_many_substeps_leaves_the_bits": ["everything-float32", "mesh-float32"]},
    "physics/motion/fused/test_mass_scaling.py": {
        "test_a_mesh_of_like_triangles_and_other_solvers_keep_their_masses": ["settings0"]},
    "physics/joints/test_beside.py": {
        "test_islands_and_contacts_of_many_launches_give_the_bits_of_one": [],
        "test_bodies_of_a_joint_pass_through_each_other_unless_it_says_that_they_collide": [],
        "test_a_chain_lies_on_a_sheet_and_its_joints_stay_closed": []},
    "physics/joints/test_hinged_blows.py": {
        "test_joints_take_part_in_blows_beside_a_cloth_too": ["xpbd"]},
    "physics/joints/test_humanoid.py": {
        "test_worlds_of_joints_are_alike": [],
        "test_a_hinge_with_a_strong_damper_hardly_moves": [],
        "test_bodies_of_the_humanoid_move_together_as_if_nothing_held_them_in_free_fall": []},
    "physics/joints/test_loops.py": {
        "test_a_parallel_four_bar_keeps_its_energy_through_the_line": ["10", "60", "80", "120"]},
    "physics/joints/test_motion.py": {
        "test_one_driven_coordinate_is_a_damped_oscillator": ["40.0-1.5-float64", "400.0-0.0-float32", "4000.0-20.0-float64",
            "4000.0-20.0-float32", "40000.0-100.0-float64", "40000.0-100.0-float32", "1000.0-500.0-float64",
            "0.0-50.0-float32", "100000.0-10.0-float64", "100000.0-10.0-float32"]},
    "physics/joints/test_pivots.py": {
        "test_one_sweep_is_where_sweeps_of_single_rows_end": []},
    "physics/joints/test_sleep.py": {
        "test_a_damped_chain_sleeps_hanging_straight_and_a_thrown_ball_wakes_all_of_it_and_no_other": ["coloured"],
        "test_a_driven_hinge_is_awake_while_its_target_moves_and_sleeps_behind_it": ["coloured"],
        "test_what_a_joint_hangs_on_wakes_it_when_it_moves": ["coloured"],
        "test_a_chain_that_slept_goes_on_as_one_that_never_did": ["coloured"],
        "test_many_launches_give_the_bits_of_one_and_a_restart_those_of_a_run": [],
        "test_a_sleeping_arm_that_a_spring_bears_does_not_move_while_others_do": ["coloured"],
        "test_a_drive_with_a_speed_keeps_its_island_awake": ["coloured"]},
    "physics/motion/test_borne.py": {
        "test_a_cloth_that_a_box_stretches_gains_no_energy_by_leapfrog": []},
    "physics/motion/test_compensated.py": {
        "test_a_sheet_of_996_substeps_in_float32": []},
    "physics/motion/test_explicit.py": {
        "test_membranes_and_hinges_agree_with_a_converged_implicit_solution": [],
        "test_energy_of_the_stiff_oscillator": ["explicit_euler-20959.16-0.01"],
        "test_energy_of_the_pendulum": ["symplectic_euler--1.249-0.0005", "rk4--1.01e-06-5e-09"],
        "test_the_observed_order_is_the_declared_one": ["explicit_euler-0.002"]},
    "physics/motion/test_loads.py": {
        "test_a_force_over_time_moves_by_its_integral_and_has_exact_derivatives": ["implicit-sdirk3"]},
    "physics/motion/fast_paths/test_simd_sheets.py": {
        "test_any_number_of_threads_gives_the_same_bits": ["3"],
        "test_others_act_between_substeps": []},
    "physics/motion/test_shorter_steps.py": {
        "test_leapfrog_falls_on_where_its_steps_become_shorter": ["repeated"]},
    "physics/motion/test_soft_pins.py": {
        "test_gradients_by_the_stiffness_of_soft_pins_of_one_point": ["1", "0"]},
    "physics/motion/fast_paths/test_threads.py": {
        "test_any_number_of_threads_gives_the_same_bits": ["settings0-3", "settings1-3"]},
    "physics/motion/test_toy_integrator.py": {
        "test_the_observed_order_of_a_toy_is_the_declared_one": ["implicit-two_step"]},
    "physics/joints/trees/test_pushed.py": {
        "test_points_that_hit_a_hinged_rod_turn_it_by_their_angular_momentum": ["0.0-explicit-more1", "0.0-xpbd-more0"],
        "test_a_soft_cube_and_two_links_in_flight_keep_their_momentum_by_leapfrog": ["True"]},
    "physics/joints/trees/test_touching.py": {
        "test_a_hinge_and_a_ball_that_start_inside_a_wall_keep_their_speeds": ["0.001-float32"]},
    "physics/rigid/answers/test_rolling.py": {
        "test_the_steady_precession_of_a_coin_is_that_of_its_equations_of_motion": ["low", "small", "thick"]},
    "physics/rigid/narrow/test_gjk.py": {
        "test_hulls_face_to_face_touch_at_four_points_with_equal_gaps": ["f64"],
        "test_hulls_anywhere_have_the_gap_of_their_differences": ["f32-0.001"],
        "test_hulls_that_nearly_touch_are_told_apart_from_those_that_do": ["f32"],
        "test_round_shapes_have_the_gap_of_a_search_over_directions": ["f64"],
        "test_keys_of_hulls_last_under_small_motions": ["f64"]},
    "physics/rigid/solver/test_colours.py": {
        "test_launches_of_passes_and_colours_give_the_bits_of_one_launch": [],
        "test_a_column_stands_and_sinks_no_more_than_this": ["20-0.008"],
        "test_a_heap_without_weight_keeps_its_momentum": []},
    "physics/rigid/solver/test_converged.py": {
        "test_fixed_sweeps_come_near_to_the_converged_motion": []},
    "physics/rigid/solver/test_sleep.py": {
        "test_a_column_sleeps_after_half_a_second_and_nothing_moves_any_more": ["coloured"],
        "test_a_collider_that_moves_wakes_what_it_touches": ["coloured"],
        "test_who_is_woken_goes_on_as_who_never_slept": ["listed"],
        "test_a_body_that_starts_asleep_hangs_until_something_comes_near": ["coloured"],
        "test_a_repeated_run_and_a_restart_are_the_same_to_the_bit": ["coloured"]},
    "physics/rigid/standing/test_floors.py": {
        "test_a_box_slides_over_triangles_as_far_as_friction_lets_it_and_does_not_catch": ["float64-1", "float32-1",
            "float32-32"],
        "test_a_ball_rests_on_the_bounds_of_a_mesh": ["boundingCube-1.0"]},
    "physics/rigid/standing/test_stacks.py": {
        "test_everyday_objects_stand_at_the_defaults_of_a_stage": ["tower", "twenty cubes of four millimetres",
            "ten tonnes on a kilogram"]},
    "physics/rigid/standing/test_statics.py": {
        "test_two_cards_that_lean_on_each_other_stand_where_friction_is_enough": ["1.05-True"],
        "test_an_arch_stands_where_it_is_thicker_than_milankovitch_says": ["0.12-True", "0.16-True"],
        "test_a_house_of_cards_stands_by_friction": ["0.6-True"]},
    "physics/rigid/test_contact.py": {
        "test_a_mesh_lies_as_its_hull_does": [],
        "test_three_bounces_are_as_high_as_restitution_says": ["float32"],
        "test_a_box_sticks_half_a_degree_under_the_critical_angle_and_slips_half_a_degree_over_it": ["float64"],
        "test_ten_boxes_sink_less_than_three_millimetres_and_come_to_rest": ["float64"]},
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
    "physics/rods/test_with_surfaces.py": {
        "test_a_rope_that_is_thrown_at_a_cloth_never_passes": ["0-xpbd bdf2", "0-newton", "0-newton bdf2", "0-leapfrog",
            "0-rk4", "1-xpbd", "1-xpbd bdf2", "1-newton bdf2", "1-leapfrog", "1-rk4", "1-newton"],
        "test_a_rope_and_a_cloth_that_collide_keep_their_momentum": ["xpbd bdf2", "newton bdf2", "leapfrog", "rk4", "xpbd"],
        "test_a_rope_on_a_cloth_sticks_and_slips_at_the_critical_angle": ["xpbd", "newton bdf2", "leapfrog", "rk4", "newton"],
        "test_a_ridge_bears_a_rope_and_stretches_it_no_more_than_its_weight_does": ["xpbd bdf2", "newton", "newton bdf2",
            "rk4", "leapfrog"],
        "test_strands_that_fall_on_a_soft_body_lie_on_it": ["explicit", "implicit"],
        "test_a_run_goes_on_from_its_file_to_the_bit": [],
        "test_results_are_the_same_from_run_to_run_and_in_worlds": []},
    "physics/rods/test_body_edges.py": {
        "test_a_box_that_falls_between_points_is_caught": ["edge-touching", "corner-alone", "corner-touching"],
        "test_a_mesh_is_caught_as_the_box_that_it_is": []},
    "physics/rods/test_deforming.py": {
        "test_points_with_keys_carry_strands_as_a_prim_that_moves": ["False-False"],
        "test_a_mesh_that_bulges_lifts_what_lies_on_it": ["True"]},
    "physics/rods/test_edges.py": {
        "test_a_world_of_ropes_that_touch_steps_by_backward_euler_where_an_edge_meets_a_collider": []},
    "physics/rods/test_nets.py": {
        "test_every_substep_of_a_net_under_bodies_is_solved": ["5-0.03-0.0", "4-0.1-0.5"]},
    "physics/contact/selfcontact/test_colliders.py": {
        "test_a_spike_pokes_through_without": [],
        "test_a_coarse_cloth_lies_on_a_spike": ["explicit", "implicit"],
        "test_a_mesh_that_grows_lifts_the_cloth": [],
        "test_an_edge_of_a_cube_stays_below_triangles_larger_than_the_cube": ["box"],
        "test_friction_at_a_tip_is_coulombs": ["0.0"],
        "test_a_cloth_between_colliders_that_meet_stops_and_goes_on_once_they_part": ["explicit", "implicit"]},
    "physics/contact/selfcontact/test_crossed.py": {
        "test_surfaces_that_start_crossed_fall_freely_and_gain_no_energy": ["newton bdf2", "newton midpoint", "rk4"],
        "test_a_cloth_folded_through_itself_goes_on_calmly": ["newton"],
        "test_a_collider_that_starts_inside_a_cloth_throws_nothing": ["newton"],
        "test_a_cloth_through_a_soft_body_stays_calm": ["leapfrog"],
        "test_leapfrog_holds_a_cloth_that_a_collider_starts_inside_of": []},
    "physics/contact/selfcontact/test_friction.py": {
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above": ["xpbd-plane", "xpbd bdf2-plane",
            "xpbd bdf2-cloth", "newton-plane", "newton-cloth", "newton bdf2-plane", "newton bdf2-cloth",
            "newton midpoint-plane", "newton midpoint-cloth", "leapfrog-plane", "leapfrog-cloth", "rk4-plane", "rk4-cloth"],
        "test_friction_that_is_set_live_is_that_of_the_material": ["leapfrog"]},
    "physics/contact/selfcontact/test_guarantee.py": {
        "test_a_crumpled_sheet_has_no_intersection_in_any_substep": [],
        "test_sheets_that_are_thrown_have_no_intersection_in_any_substep_by_the_midpoint": [],
        "test_pairs_that_are_pressed_in_turn_keep_their_momentum": [],
        "test_sheets_that_meet_within_a_substep_are_projected_and_not_cut": ["newton"],
        "test_cuts_end_where_proofs_do": [],
        "test_sheets_that_a_body_strikes_do_not_cross": ["newton bdf2"],
        "test_results_are_the_same_from_run_to_run": [],
        "test_a_list_without_room_is_made_again_though_one_for_a_proof_follows": []},
    "physics/contact/selfcontact/test_layers.py": {
        "test_fifty_layers_that_are_thrown_and_turn_keep_their_path_and_their_turn": ["newton midpoint", "leapfrog"],
        "test_a_block_of_jelly_that_falls_on_another_does_not_enter_it": ["explicit", "implicit"]},
    "physics/contact/selfcontact/test_momentum.py": {
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce": ["xpbd bdf2", "newton", "newton bdf2",
            "newton midpoint", "rk4", "leapfrog"],
        "test_angular_momentum_is_kept": ["newton midpoint-0.0", "newton midpoint-0.5", "leapfrog-0.5"],
        "test_what_is_tied_keeps_its_momentum_beside_what_strikes_it": ["newton"],
        "test_a_world_of_sheets_and_the_body_that_strikes_them_ends_as_one_alone": ["xpbd"],
        "test_a_rigid_body_far_away_changes_nothing_of_what_two_sheets_do": ["newton"],
        "test_sheets_and_the_body_that_strikes_them_keep_their_momentum": ["newton bdf2"]},
    "physics/contact/selfcontact/test_rest.py": {
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is": ["xpbd bdf2", "newton", "newton bdf2", "newton midpoint",
            "leapfrog", "rk4"],
        "test_a_folded_cloth_at_rest_on_a_cloth_is_calm_by_the_midpoint": [],
        "test_a_folded_cloth_at_rest_is_not_read_as_falling_by_rk4": []},
    "physics/contact/selfcontact/test_tree.py": {
        "test_boxes_that_meet_are_found_once": ["12"]},
    "physics/soft/test_plastic.py": {
        "test_a_restart_and_a_repeated_frame_go_on_bit_for_bit": ["implicit-bdf2"]},
    "physics/soft/test_plastic_adjoint.py": {
        "test_a_bar_that_flows": ["neo_hookean-more1-2e-06"],
        "test_by_the_yield": ["more1", "more2"],
        "test_checkpoints_and_a_run_under_way": ["more0"]},
    "physics/soft/test_soft_reference.py": {
        "test_an_engine_that_is_right_is_judged_right": []},
    "physics/solver/schwarz/test_schwarz.py": {
        "test_the_preconditioner_is_the_sum_over_the_domains_of_all_levels": ["8-1-16"],
        "test_a_smooth_load_takes_a_fifth_of_the_iterations_of_block_jacobi": ["1000.0"],
        "test_the_preconditioner_is_symmetric_and_positive": ["float64-1e-12"]},
    "physics/solver/schwarz/test_steps.py": {
        "test_orders_on_stiff_cloth": ["backward_euler-1.0", "sdirk3-1.6", "bdf2-2.0"]},
    "physics/solver/test_coarse_space.py": {
        "test_iterations_do_not_grow_with_the_number_of_points": []},
    "physics/solver/test_newton.py": {
        "test_solved_steps_follow_an_independent_solver": ["implicit_midpoint", "sdirk3"],
        "test_a_drape_stays_outside_and_has_the_same_bits_twice": ["float32"],
        "test_a_scrambled_cloth_ends_finite_and_recovers": ["springs-float32", "springs-float64", "membrane-float32"],
        "test_the_observed_order_is_the_declared_one": ["implicit_midpoint-2", "bdf2-2", "sdirk3-3"]},
    "physics/solver/test_newton_adjoint_contacts.py": {
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides": ["plane-backward_euler"],
        "test_what_stands_on_its_feet_gives_way_by_statics": [],
        "test_a_sheet_that_slides_on_a_floor_along_a_wall": [],
        "test_a_recording_ends_where_a_simulation_of_many_newton_steps_does": [],
        "test_a_sheet_that_sticks_to_a_turning_plane_is_carried": [],
        "test_what_is_thrown_back": []},
    "physics/solver/test_newton_adjoint_limits.py": {
        "test_a_sheet_that_is_pulled": ["backward_euler-both"],
        "test_triangles_and_a_soft_pin": [],
        "test_a_recording_ends_where_a_simulation_does": ["bdf2-limit-3", "sdirk3-tethers-3", "implicit_midpoint-tethers-3"],
        "test_among_contacts": ["sphere-backward_euler-0.4"],
        "test_what_is_thrown_back": [],
        "test_checkpoints_and_worlds_give_the_same": ["<lambda>1"],
        "test_float32_is_near_float64": [],
        "test_a_recording_says_how_far_it_is_from_a_simulation": ["0.0-implicit-1e-05-1e-08", "0.4-implicit-0.2-0.02",
            "0.4-auto-0-0"],
        "test_where_a_moving_pin_puts_its_points": ["bdf2", "sdirk3"],
        "test_lengths_at_rest_are_what_limits_and_tethers_allow": ["tethers-backward_euler"],
        "test_a_throw_is_found_again": []},
    "physics/solver/test_newton_surfaces.py": {
        "test_cloth_on_a_still_box_only_loses_energy": ["implicit_midpoint", "backward_euler"],
        "test_sheets_that_are_thrown_at_each_other_gain_no_energy": ["implicit_midpoint"],
        "test_a_ball_that_falls_into_cloth_that_collides_with_itself_gives_it_no_energy": ["backward_euler", "bdf2"],
        "test_small_and_large_cloth_on_a_box_only_loses_energy": ["10.0"]},
    "physics/solver/test_step_modules.py": {
        "test_a_scene_adds_no_kernel_to_a_module_that_another_has_filled": ["membrane"]},
    "physics/solver/test_sweep_strain.py": {
        "test_no_seam_tears_where_triangles_of_1_to_62_carry_a_cloth": ["65-1"]},
    "physics/solver/test_xpbd.py": {
        "test_recorded_projection_has_the_right_gradient": ["dihedral", "membrane"]},
    "physics/solver/test_xpbd_adjoint.py": {
        "test_soft_pins": ["more1", "more3", "more2", "more0"],
        "test_undone_sweeps_are_as_good_as_fresh_buffers": ["membrane-inf-False", "springs-inf-True", "springs-0.003-False"],
        "test_a_launch_for_each_colour_gives_the_same_as_one_for_all": ["membrane-0.0002", "springs-0.0", "membrane-0.0"],
        "test_a_stiff_sheet_of_240_substeps": ["membrane", "springs"],
        "test_a_chain": ["bdf2-16", "implicit_midpoint-16"],
        "test_a_sheet_that_stretches_shears_and_bends": ["membrane", "springs"],
        "test_wind": ["more0"],
        "test_the_normal_drag_of_a_fabric": ["more0"]},
    "physics/test_host_report.py": {
        "test_a_first_frame_and_its_report_compile_one_module_and_each_kernel_once": [],
        "test_a_first_frame_compiles_one_module_though_half_of_its_stretches_launch_nothing": [],
        "test_depths_on_the_host_are_those_of_kernels": ["cylinder", "capsule", "sphere", "cone"]},
}
