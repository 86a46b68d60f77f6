"""What `tests.make.suite.slow` has of grains, fluids, clusters and material points."""

PARTICLES: dict[str, dict[str, list[str]]] = {
    "physics/position_based/test_meetings.py": {
        "test_a_pile_lies_on_a_cloth_by_newtons_method": ["29"]},
    "physics/position_based/test_pile_bodies.py": {
        "test_a_box_rests_on_grains_and_among_them": ["100-False", "1-True"],
        "test_no_box_is_thrown_by_the_grains_that_bury_it": ["0.01-steps1", "0.01-steps2"]},
    "physics/position_based/test_tension.py": {
        "test_pressure_in_a_drop_is_that_of_laplace": ["6-0.5"]},
    "physics/soft/clusters/test_coupling.py": {
        "test_a_blow_keeps_the_momentum_of_both": ["soft-4000.0"]},
    "physics/soft/mpm/actions/test_abuse.py": {
        "test_sand_does_not_pass_a_wall_of_a_quarter_cell_that_sweeps_through_it": ["explicit-False"],
        "test_blade_stirs_sand_in_a_closed_drum_and_none_is_within_it": ["explicit-False", "explicit-True"]},
    "physics/soft/mpm/test_bodies.py": {
        "test_light_and_heavy_balls_rest_on_sand": ["8.0-0.1"]},
    "physics/soft/mpm/test_fits.py": {
        "test_a_start_two_and_a_half_times_off_finds_the_value_within_its_error_bars": ["column-friction_angle-0.5-0.2"],
        "test_heights_along_a_line_tell_the_friction_angle_and_the_stiffness": ["column-friction_angle-true0-start0-0.016"]}}
