"""Tests that take longest, or start many processes: `pytest -m "not slow"` leaves them out. A file, or one test."""

import re
from pathlib import Path

SLOW = (
    "augment/test_augment_photos.py",
    "bench/test_bench_run.py",
    "bench/test_calibration_cost.py",
    "bench/test_power.py",
    "boards/test_pickled.py::test_the_courses_boards_are_right_handed_against_its_photos_and_y_down_would_mirror_them",
    "compare/test_decision.py::test_a_bias_of_the_minimum_detectable_size_is_found_nine_times_in_ten_and_a_third_of_it_seldom",
    "compare/test_decision.py::test_noise_alone_fails_no_more_often_than_stated",
    "explore/test_explore.py",
    "files/test_hostile_images.py",
    "grade/test_class.py",
    "grade/test_cluster.py",
    "grade/test_diagnosis.py::test_light_that_is_followed_is_told_from_what_walks_would_bring",
    "grade/test_diagnosis.py::test_nan_an_empty_scene_and_a_black_picture_are_no_obstacle",
    "grade/test_draw.py::test_a_seed_gives_one_scene_and_another_seed_another",
    "grade/test_draw.py::test_drawn_scenes_are_blind_to_nothing_at_their_own_size",
    "grade/test_gradescope.py",
    "grade/test_hostile.py",
    "grade/test_stages.py::test_every_mistake_is_found_and_called_by_its_name_and_by_no_other",
    "jobs/test_reference.py::test_a_reference_that_todays_mitsuba_does_not_make_fails",
    "jobs/test_reference.py::test_todays_mitsuba_agrees_with_shipped_references",
    "jobs/test_reference.py::test_todays_render_agrees_with_a_fresh_reference",
    "paper/test_paper.py",
    "photos/test_calibration.py::test_a_bent_board_was_all_that_was_wrong_with_the_degenerate_sets_centre",
    "photos/test_calibration.py::test_a_photo_without_tags_among_many_is_left_out_and_named",
    "photos/test_calibration.py::test_auto_takes_the_model_that_made_the_views",
    "photos/test_calibration.py::test_its_standard_deviations_are_those_of_repeated_calibrations",
    "photos/test_calibration.py::test_photos_taken_with_a_known_camera_give_that_camera_back",
    "photos/test_calibration.py::test_the_pose_of_a_photo_is_the_one_its_calibration_found",
    "photos/test_calibration.py::test_the_same_detections_give_the_same_camera_on_any_number_of_threads",
    "photos/test_calibration.py::test_the_same_detections_give_the_same_camera_to_the_last_bit_and_opencv_keeps_its_threads",
    "photos/test_calibration.py::test_the_set_with_the_lowest_error_is_the_one_that_is_called_degenerate",
    "photos/test_calibration.py::test_twenty_real_photos_and_one_of_two_boards_give_the_known_camera",
    "photos/test_calibration.py::test_what_is_taken_predicts_unseen_photos_as_well_as_five_coefficients_on_a_flat_board",
    "photos/test_trust.py::test_a_bent_boards_pose_is_found_with_its_shape",
    "photos/test_trust.py::test_a_flat_board_is_taken_for_flat",
    "photos/test_trust.py::test_a_pitch_wrong_in_one_direction_is_blamed_on_the_board",
    "photos/test_trust.py::test_a_poses_sigma_is_how_far_poses_lie_off",
    "photos/test_trust.py::test_halves_of_a_real_set_differ_by_what_their_sigmas_say",
    "photos/test_trust.py::test_halves_of_the_shipped_photos_differ_by_what_their_sigmas_say",
    "photos/test_trust.py::test_however_a_board_is_bent_the_camera_lies_as_far_off_as_sigma_says",
    "photos/test_trust.py::test_no_photo_of_a_real_set_is_called_odd",
    "photos/test_trust.py::test_on_a_flat_board_the_fit_is_opencvs",
    "photos/test_trust.py::test_on_photos_of_a_bent_board_the_bend_and_the_camera_are_the_truth",
    "photos/test_trust.py::test_over_a_hundred_sets_the_truth_lies_as_far_off_as_sigma_says",
    "photos/test_trust.py::test_photos_that_err_as_one_widen_sigma",
    "photos/test_trust.py::test_the_photo_whose_pose_is_wanted_is_not_searched_again",
    "photos/test_trust.py::test_two_boards_give_one_camera_and_each_its_own_pose",
    "photos/test_uncertainty.py::test_the_predicted_deviations_are_those_of_repeated_calibrations",
    "report/test_against.py::test_each_photo_has_a_page_that_shows_its_errors_and_all_share_one_script",
    "report/test_bench_page.py",
    "report/test_html.py::test_axe_core_finds_nothing_serious",
    "report/test_ladder_page.py::test_axe_core_finds_nothing_serious",
    "report/test_view.py::test_flips_map_is_on_the_page_where_it_was_asked_for",
    "scene/test_undone.py::test_a_march_by_another_route_ends_at_the_same_places",
    "scene/test_undone.py::test_all_who_ask_take_the_same_lenses",
    "scene/test_undone.py::test_the_tracers_quick_inverse_and_its_plain_one_and_the_twins_end_where_the_way_does",
    "scene/test_undone.py::test_what_is_undone_comes_back_and_grows_all_along_its_way",
    "speed/test_boxes.py::test_a_lens_costs_the_box_little",
    "speed/test_boxes.py::test_a_pinholes_box_is_tight",
    "speed/test_boxes.py::test_a_rectangles_box_holds_every_hit",
    "speed/test_boxes.py::test_a_spheres_box_holds_every_hit",
    "speed/test_boxes.py::test_a_spheres_box_holds_every_hit_of_a_sphere_before_the_lens",
    "speed/test_boxes.py::test_no_object_that_shades_another_is_missed",
    "speed/test_boxes.py::test_spheres_in_a_line_to_the_sun_are_listed_once",
    "speed/test_speculation.py::test_every_pixel_of_a_lone_sphere_is_within_the_tolerance",
    "speed/test_tree.py::test_many_objects_give_the_same_light_as_one_after_the_other",
    "speed/test_walks.py",
    "test_cli.py::test_compare_passes_and_writes_every_file",
    "test_cli.py::test_it_works_without_any_llvm",
    "test_denoise.py",
    "test_light_install.py",
    "test_machine.py::test_a_full_disk_is_said_and_leaves_nothing_behind",
    "test_machine.py::test_a_home_that_cannot_be_entered_costs_the_cache_alone",
    "test_machine.py::test_an_engine_takes_no_libllvm_that_was_not_seen_to_work",
    "test_package.py",
    "test_paper_figures.py",
    "test_photographer.py::test_photographs_come_with_their_board_and_their_truth",
    "test_pytest_plugin.py",
    "test_readme.py::test_every_command_of_the_readme_runs_as_written",
    "test_readme.py::test_the_instructors_test_passes_with_a_right_renderer_and_fails_with_a_wrong_one",
    "tracer/test_highlights.py::test_head_on_the_highlight_sends_back_its_specular_and_aslant_no_more",
    "tracer/test_plain_trace.py::test_a_replaced_stage_replaces_it_in_the_plain_tracer_and_in_every_engine",
    "tracer/test_tracer_camera.py::test_opencv_projects_a_point_of_the_ray_back_onto_the_pixel",
    "tracer/test_tracer_camera.py::test_undistort_agrees_with_opencv_iterated_to_the_end",
    "twin/test_backend.py",
    "twin/test_outlines.py",
    "twin/test_shadow_offset.py::test_a_large_table_does_not_shade_itself",
    "twin/test_sky_and_gloss.py::test_the_scalar_twin_follows_light_under_maps_and_onto_highlights_too",
    "twin/test_truths.py",
    "twin/test_twin_camera.py::test_path_agrees_with_mitsubas_path_from_the_eye",
    "twin/test_twin_camera.py::test_small_spheres_stand_where_opencv_projects_them",
    "twin/test_twin_plain.py::test_a_plain_render_converges_to_the_twins",
    "twin/test_twin_render.py::test_a_head_on_sphere_is_a_disc_of_the_closed_forms_radius",
    "twin/test_twin_render.py::test_scalar_and_llvm_agree",
    "twin/test_twin_render.py::test_variance_by_batches_predicts_the_spread_between_seeds",
    "walk/test_walk.py::test_axe_core_finds_nothing_serious_in_what_a_cell_shows",
    "walk/test_walk.py::test_each_planted_mistake_is_said_in_words_and_the_walk_goes_on",
    "walk/test_walk.py::test_the_notebook_runs_from_its_first_cell_to_its_last",
    "walk/test_walk.py::test_with_its_functions_filled_in_it_arrives_at_the_twin",
)


def is_slow(nodeid: str) -> bool:
    """`tests/FILE::test_name[case]` of a row, or of a row's file."""
    file, _, name = nodeid.removeprefix("tests/").partition("::")
    return file in SLOW or f"{file}::{name.partition('[')[0]}" in SLOW


def rows_that_name_nothing(folder: Path) -> list[str]:
    """Rows whose file, or whose test in it, is not there any more."""
    wrong = []
    for row in SLOW:
        file, _, name = row.partition("::")
        path = folder / file
        if not path.is_file() or (name and not re.search(rf"^def {name}\(", path.read_text(encoding="utf-8"), re.M)):
            wrong.append(row)
    return wrong
