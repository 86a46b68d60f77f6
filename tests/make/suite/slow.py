"""Rows that took more than seven seconds, and tests without rows that took more than ten, in a run of all on two cores with an
empty kernel cache (`pytest --durations`), and those that took longest in a run with kernels that were there. They are marked
slow, beside those that are marked where they stand. A test with rows keeps one that is not."""

SLOW = {
    "fitting/test_fields.py": [
        "test_the_motion_of_a_pin_is_found_from_what_hangs_on_it",
        "test_a_soft_and_a_stiff_half_are_found_from_one_bent_shape", "test_noise_does_not_blow_up[smooth]",
        "test_without_a_belief_noise_is_what_is_found", "test_noise_does_not_blow_up[tv]"],
    "fitting/test_numbers_and_fields.py": [
        "test_a_number_and_a_field_are_found_together", "test_a_field_and_a_density_are_found_by_sweeps",
        "test_a_stiffness_field_is_found_from_scans_without_correspondence"],
    "fitting/test_shared.py": [
        "test_copies_that_take_turns_give_the_same_fit_to_the_bit[explicit]",
        "test_copies_that_take_turns_give_the_same_fit_to_the_bit[implicit]"],
    "gpu/test_capture.py": [
        "test_a_frame_takes_no_memory[implicit-backward_euler]", "test_a_frame_takes_no_memory[implicit-bdf2]",
        "test_a_frame_takes_no_memory[xpbd-bdf2]", "test_a_frame_takes_no_memory[xpbd-backward_euler]"],
    "gradient/rigid/test_contacts.py": [
        "test_checkpoints_are_refused", "test_a_box_slides_by_its_friction"],
    "gradient/test_bounds.py": [
        "test_jvp_at_the_end_of_a_range_is_from_the_side_that_is_allowed[/floor:dynamic_friction-leapfrog]",
        "test_jvp_at_the_end_of_a_range_is_from_the_side_that_is_allowed[/cloth:dynamic_friction-leapfrog]"],
    "gradient/test_coverage.py": [
        "test_what_is_refused_raises_with_its_words_and_path[features]"],
    "gradient/test_gradients.py": [
        "test_a_sheet_by_implicit_steps[backward_euler-membrane]", "test_a_sheet_by_implicit_steps[bdf2-springs]",
        "test_a_sheet_by_implicit_steps[sdirk3-springs]", "test_a_bar_of_quadratic_tets_under_pressure[neo_hookean-more2]",
        "test_a_sheet_that_stretches_shears_and_bends[membrane]",
        "test_a_bar_of_quadratic_tets_under_pressure[corotational-more0]"],
    "gradient/test_reaction_adjoint.py": [
        "test_a_soft_pin[solver0]", "test_wind[more0]", "test_wind[more1]",
        "test_looking_changes_nothing_and_gradients_repeat_to_the_bit[scene1]",
        "test_a_bar_that_flows[corotational-more0-1e-07]", "test_muscles[sdirk3]", "test_muscles[rk4]"],
    "physics/carrier/test_balls.py": [
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept[xpbd-backward_euler]",
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept[implicit-backward_euler]",
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept[implicit-implicit_midpoint]",
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept[explicit-rk4]",
        "test_momentum_of_a_toy_carrier_and_a_cloth_is_kept[implicit-bdf2]"],
    "physics/cloth/test_element_adjoint.py": [
        "test_gradients_are_those_of_differences[dihedral-True]"],
    "physics/cloth/test_live_fabric.py": [
        "test_by_poisson_s_ratio[rk4-more6--0.4-25.0]", "test_by_a_strain_limit[membrane-newton]",
        "test_by_a_strain_limit[membrane-leapfrog]"],
    "physics/cloth/test_muscles.py": [
        "test_muscles_move_a_soft_body_over_the_ground", "test_newtons_method_moves_it_as_far_as_leapfrog"],
    "physics/cloth/test_rest_shape.py": [
        "test_a_fit_finds_a_shape"],
    "physics/contact/test_clearance.py": [
        "test_a_sheet_falls_on_a_floor_as_with_contacts_throughout[stages]",
        "test_a_floor_is_met_from_where_the_fall_of_a_frame_reaches[newton]",
        "test_a_floor_is_met_from_where_the_fall_of_a_frame_reaches[stages]",
        "test_what_is_through_a_thin_wall_within_a_frame_is_caught[newton]",
        "test_what_is_through_a_thin_wall_within_a_frame_is_caught[stages]",
        "test_what_is_in_and_out_of_reach_within_a_frame_is_caught[stages]",
        "test_a_collider_that_comes_by_within_a_frame_is_met[march-by1]",
        "test_a_collider_that_comes_by_within_a_frame_is_met[stages-by6]",
        "test_a_collider_that_comes_by_within_a_frame_is_met[newton-by8]",
        "test_a_restart_goes_on_to_the_bit_from_every_frame[newton-float64]",
        "test_a_restart_goes_on_to_the_bit_from_every_frame[stages-float64]"],
    "physics/contact/test_collider_adjoint.py": [
        "test_a_sheet_that_slides_on_a_mesh[sphere-xpbd]", "test_by_friction_and_thickness_of_a_collider[plane-leapfrog]",
        "test_by_friction_and_thickness_of_a_collider[deforming-leapfrog]",
        "test_by_the_motion_of_a_collider[plane-leapfrog]"],
    "physics/contact/test_friction_newton.py": [
        "test_a_cloth_on_a_ball_is_strained_as_little_with_friction_as_without[bdf2]"],
    "physics/contact/test_project_adjoint.py": [
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[plane-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[sphere-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[box-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[capsule-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[cylinder-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[cone-leapfrog]",
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[box-xpbd]",
        "test_bdf2_forgets_what_was_before_a_contact[more0]",
        "test_a_smoothed_contact_has_no_kink_where_it_begins[leapfrog]"],
    "physics/contact/test_restitution.py": [
        "test_a_sheet_thrown_at_a_sphere_never_gains_energy[implicit-backward_euler-0.0]",
        "test_a_sheet_thrown_at_a_sphere_never_gains_energy[implicit-bdf2-0.0]",
        "test_sensitivities_are_those_of_the_motion[midpoint-118-3]", "test_sensitivities_are_those_of_the_motion[rk4-118-3]",
        "test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme[xpbd-backward_euler]",
        "test_a_sheet_thrown_at_a_sphere_has_the_gradients_of_its_scheme[xpbd-bdf2]",
        "test_sensitivities_are_those_of_the_motion[leapfrog-90-2]"],
    "physics/contact/test_soft_contacts.py": [
        "test_a_bar_that_lands_and_slides[sphere-backward_euler]", "test_a_bar_that_sticks_is_carried[sheet-bdf2]",
        "test_a_bar_of_quadratic_tets_under_pressure"],
    "physics/contact/test_toy_shape.py": [
        "test_cloth_rests_on_it[implicit-more1]", "test_cloth_rests_on_it[explicit-more2]"],
    "physics/fluid/test_accuracy.py": [
        "test_other_schemes_lose_to_the_projection_what_reflection_keeps[bfecc-0.0342]",
        "test_other_schemes_lose_to_the_projection_what_reflection_keeps[linear-0.0512]"],
    "physics/fluid/test_bodies.py": [
        "test_a_body_that_is_pushed_takes_as_much_air_along_as_it_displaces[cubic]"],
    "physics/fluid/liquid/test_bodies.py": [
        "test_the_buoyancy_of_what_is_as_dense_as_the_liquid_is_its_weight[shape1-7.8]",
        "test_a_light_body_rises_as_its_added_mass_lets_it[10.0]", "test_momentum_goes_from_a_stream_to_a_body"],
    "physics/fluid/liquid/test_sheets.py": [
        "test_liquid_poured_onto_a_pinned_sheet_stays_above_it",
        "test_a_mesh_whose_points_move_is_the_collider_that_moves_so"],
    "physics/fluid/obstacles/test_obstacles.py": [
        "test_a_mesh_is_an_obstacle_as_its_shape_is", "test_a_wall_thinner_than_a_cell_does_not_leak[0.0]"],
    "physics/joints/test_beside.py": [
        "test_islands_and_contacts_of_many_launches_give_the_bits_of_one",
        "test_bodies_of_a_joint_pass_through_each_other_unless_it_says_that_they_collide"],
    "physics/joints/test_humanoid.py": [
        "test_worlds_of_joints_are_alike", "test_a_hinge_with_a_strong_damper_hardly_moves",
        "test_bodies_of_the_humanoid_move_together_as_if_nothing_held_them_in_free_fall"],
    "physics/motion/test_compensated.py": [
        "test_a_sheet_of_996_substeps_in_float32"],
    "physics/motion/test_explicit.py": [
        "test_membranes_and_hinges_agree_with_a_converged_implicit_solution"],
    "physics/rigid/narrow/test_gjk.py": [
        "test_hulls_face_to_face_touch_at_four_points_with_equal_gaps[f64]"],
    "physics/rigid/solver/test_colours.py": [
        "test_launches_of_passes_and_colours_give_the_bits_of_one_launch"],
    "physics/rigid/solver/test_converged.py": [
        "test_fixed_sweeps_come_near_to_the_converged_motion"],
    "physics/rigid/solver/test_sleep.py": [
        "test_a_column_sleeps_after_half_a_second_and_nothing_moves_any_more[coloured]",
        "test_a_collider_that_moves_wakes_what_it_touches[coloured]"],
    "physics/rigid/standing/test_floors.py": [
        "test_a_box_slides_over_triangles_as_far_as_friction_lets_it_and_does_not_catch[float64-1]",
        "test_a_box_slides_over_triangles_as_far_as_friction_lets_it_and_does_not_catch[float32-1]"],
    "physics/rigid/standing/test_statics.py": [
        "test_two_cards_that_lean_on_each_other_stand_where_friction_is_enough[1.05-True]"],
    "physics/rigid/test_contact.py": [
        "test_a_mesh_lies_as_its_hull_does"],
    "physics/rigid/test_usd.py": [
        "test_scenes_of_others_run_and_come_to_rest[box_on_plane-1-1.0]"],
    "physics/rigid/touch/test_blows.py": [
        "test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has[xpbd bdf2]",
        "test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has[rk4]",
        "test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has[newton]",
        "test_a_ball_without_restitution_and_friction_gives_a_sheet_no_more_energy_than_it_has[newton bdf2]",
        "test_an_elastic_blow_keeps_energy[xpbd bdf2]", "test_an_elastic_blow_keeps_energy[leapfrog]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.0-xpbd bdf2]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.0-rk4]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.0-newton]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.0-newton bdf2]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-xpbd]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-xpbd bdf2]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-leapfrog]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-rk4]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-newton]",
        "test_velocities_that_are_read_have_all_momentum_in_each_frame[0.5-newton bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-xpbd]", "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-xpbd]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-xpbd bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[1.0-xpbd bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-xpbd bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-leapfrog]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[1.0-leapfrog]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-leapfrog]", "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-rk4]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[1.0-rk4]", "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-rk4]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-newton]", "test_what_a_ball_gives_a_sheet_it_has_lost[1.0-newton]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-newton]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[0.01-newton bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[1.0-newton bdf2]",
        "test_what_a_ball_gives_a_sheet_it_has_lost[100.0-newton bdf2]",
        "test_a_blow_that_rebounds_keeps_a_part_of_the_speed[xpbd bdf2]",
        "test_a_blow_that_rebounds_keeps_a_part_of_the_speed[leapfrog]",
        "test_nothing_passes_at_twenty_metres_a_second[leapfrog]", "test_a_ball_in_a_sheet_comes_to_rest[0.01]",
        "test_a_ball_in_a_sheet_comes_to_rest[100.0]", "test_runs_are_the_same_to_the_bit",
        "test_a_blow_that_rebounds_keeps_a_part_of_the_speed[xpbd]", "test_nothing_passes_at_twenty_metres_a_second[xpbd]"],
    "physics/rigid/touch/test_scene.py": [
        "test_what_cannot_be_gives_way_and_says_so[change1-other1-bdf2 takes its place]",
        "test_what_cannot_be_gives_way_and_says_so[change2-other2-bdf2 takes its place]",
        "test_a_run_goes_on_to_the_bit_and_holds_points_and_transforms[way1]",
        "test_a_run_goes_on_to_the_bit_and_holds_points_and_transforms[way2]",
        "test_a_soft_cube_on_a_box_on_a_plane_rests[600.0]", "test_a_box_on_a_trampoline_net_rests",
        "test_newtons_method_repeats_what_it_has_not_foreseen", "test_a_soft_cube_on_a_box_on_a_plane_rests[100.0]"],
    "physics/soft/test_plastic.py": [
        "test_a_restart_and_a_repeated_frame_go_on_bit_for_bit[implicit-bdf2]"],
    "physics/soft/test_plastic_adjoint.py": [
        "test_a_bar_that_flows[neo_hookean-more1-2e-06]", "test_by_the_yield[more1]", "test_by_the_yield[more2]"],
    "physics/solver/schwarz/test_steps.py": [
        "test_orders_on_stiff_cloth[backward_euler-1.0]", "test_orders_on_stiff_cloth[sdirk3-1.6]"],
    "physics/solver/test_newton_adjoint_contacts.py": [
        "test_a_sheet_that_falls_on_a_turning_collider_and_slides[plane-backward_euler]",
        "test_what_stands_on_its_feet_gives_way_by_statics", "test_a_sheet_that_slides_on_a_floor_along_a_wall",
        "test_a_recording_ends_where_a_simulation_of_many_newton_steps_does"],
    "physics/solver/test_newton_adjoint_limits.py": [
        "test_a_sheet_that_is_pulled[backward_euler-both]", "test_triangles_and_a_soft_pin",
        "test_a_recording_ends_where_a_simulation_does[bdf2-limit-3]", "test_among_contacts[sphere-backward_euler-0.4]",
        "test_what_is_thrown_back", "test_checkpoints_and_worlds_give_the_same[<lambda>1]",
        "test_float32_is_near_float64[<lambda>1]",
        "test_a_recording_says_how_far_it_is_from_a_simulation[0.0-implicit-1e-05-1e-08]"],
    "physics/selfcontact/test_colliders.py": [
        "test_a_spike_pokes_through_without", "test_a_coarse_cloth_lies_on_a_spike[explicit]",
        "test_a_coarse_cloth_lies_on_a_spike[implicit]", "test_a_mesh_that_grows_lifts_the_cloth",
        "test_an_edge_of_a_cube_stays_below_triangles_larger_than_the_cube[box]", "test_friction_at_a_tip_is_coulombs[0.0]"],
    "physics/selfcontact/test_soft.py": ["test_a_block_of_jelly_that_falls_on_another_does_not_enter_it[explicit]",
        "test_a_block_of_jelly_that_falls_on_another_does_not_enter_it[implicit]"],
    "physics/selfcontact/test_layers.py": [
        "test_fifty_layers_that_are_thrown_and_turn_keep_their_path_and_their_turn[newton midpoint]"],
    "physics/contact/test_midpoint.py": [
        "test_contacts_do_no_work_and_what_they_throw_back_is_taken[0.4]",
        "test_a_sheet_falls_on_a_ball_and_slides_down_without_giving_way[3]",
        "test_layers_fall_on_a_floor_and_never_intersect"],
    "physics/selfcontact/test_friction.py": [
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[xpbd-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[xpbd bdf2-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[xpbd bdf2-cloth]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton-cloth]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton bdf2-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton bdf2-cloth]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton midpoint-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[newton midpoint-cloth]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[leapfrog-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[leapfrog-cloth]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[rk4-plane]",
        "test_a_square_of_cloth_sticks_below_the_angle_of_friction_and_slides_above[rk4-cloth]"],
    "physics/selfcontact/test_momentum.py": [
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce[xpbd bdf2]",
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce[newton]",
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce[newton bdf2]",
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce[newton midpoint]",
        "test_angular_momentum_is_kept[newton midpoint-0.0]", "test_angular_momentum_is_kept[newton midpoint-0.5]",
        "test_two_sheets_that_collide_keep_their_momentum_and_do_not_bounce[rk4]"],
    "physics/selfcontact/test_rest.py": [
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[xpbd bdf2]",
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[newton]",
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[newton bdf2]",
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[newton midpoint]",
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[leapfrog]",
        "test_a_folded_cloth_at_rest_is_calm_and_as_thick_as_it_is[rk4]",
        "test_a_folded_cloth_at_rest_on_a_cloth_is_calm_by_the_midpoint"],
    "physics/selfcontact/test_guarantee.py": [
        "test_a_crumpled_sheet_has_no_intersection_in_any_substep[0]",
        "test_sheets_that_are_thrown_have_no_intersection_in_any_substep_by_the_midpoint"],
    "physics/solver/test_xpbd_adjoint.py": [
        "test_soft_pins[more1]", "test_soft_pins[more3]",
        "test_undone_sweeps_are_as_good_as_fresh_buffers[membrane-inf-False]",
        "test_undone_sweeps_are_as_good_as_fresh_buffers[springs-inf-True]",
        "test_a_launch_for_each_colour_gives_the_same_as_one_for_all[membrane-0.0002]",
        "test_a_launch_for_each_colour_gives_the_same_as_one_for_all[springs-0.0]",
        "test_a_stiff_sheet_of_240_substeps[membrane]"],
    "scene/test_chord.py": [
        "test_penetration_is_that_of_the_deepest_place_of_a_triangle[cone]"],
    "simulation/test_examples.py": [
        "test_a_cloth_is_thrown_into_the_frame"],
    "simulation/test_skip.py": [
        "test_exactly_the_kernels_of_the_scene_are_compiled[shirt]", "test_a_change_of_the_scene_changes_just_its_kernels"],
    "sweep/test_curves.py": [
        "test_a_world_follows_its_curve_as_one_alone_follows_that_of_its_scene[explicit]",
        "test_a_world_follows_its_curve_as_one_alone_follows_that_of_its_scene[implicit]"],
    "sweep/test_worlds.py": [
        "test_values_of_all_worlds_at_once_are_those_of_one_after_another[explicit]",
        "test_a_world_that_breaks_is_taken_out_and_leaves_the_others_as_they_were[explicit]",
        "test_a_world_is_reset_alone[explicit]"],
    "tools/test_scenes.py": [
        "test_scenes_run[shirt]", "test_scenes_run[ribbon]", "test_scenes_run[twisted_cloth]",
        "test_scenes_run[rollers]", "test_scenes_run[worn_shirt]", "test_rollers_pull_a_cloth_at_their_speed",
        "test_the_humanoid_comes_to_rest_with_its_joints_closed",
        "test_rigid_scenes_stand_until_the_ball_comes_and_fall_then[arch-2.9-0.005-12]",
        "test_rigid_scenes_stand_until_the_ball_comes_and_fall_then[dominoes-0.0-0.001-30]",
        "test_the_squeezed_cube_is_carried_by_friction"],
}
