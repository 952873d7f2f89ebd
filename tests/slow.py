"""Tests that take longest, or start many processes: `pytest -m "not slow"` leaves them out. A file, or one test."""

import re
from pathlib import Path

SLOW = (
    "augment/test_augment_photos.py",
    "bench/test_bench_run.py",
    "bench/test_calibration_cost.py",
    "bench/test_power.py",
    "compare/test_decision.py::test_noise_alone_fails_no_more_often_than_stated",
    "files/test_hostile_images.py",
    "jobs/test_reference.py::test_todays_mitsuba_agrees_with_shipped_references",
    "paper/test_paper.py",
    "photos/test_calibration.py::test_auto_takes_the_model_that_made_the_views",
    "photos/test_calibration.py::test_its_standard_deviations_are_those_of_repeated_calibrations",
    "photos/test_calibration.py::test_the_set_with_the_lowest_error_is_the_one_that_is_called_degenerate",
    "photos/test_calibration.py::test_twenty_real_photos_and_one_of_two_boards_give_the_known_camera",
    "photos/test_uncertainty.py",
    "speed/test_boxes.py::test_a_lens_costs_the_box_little",
    "speed/test_boxes.py::test_a_pinholes_box_is_tight",
    "speed/test_boxes.py::test_a_rectangles_box_holds_every_hit",
    "speed/test_boxes.py::test_a_spheres_box_holds_every_hit",
    "speed/test_boxes.py::test_a_spheres_box_holds_every_hit_of_a_sphere_before_the_lens",
    "speed/test_boxes.py::test_no_object_that_shades_another_is_missed",
    "test_denoise.py",
    "test_package.py",
    "test_paper_figures.py",
    "test_pytest_plugin.py::test_arrays_files_renders_and_functions_pass_where_they_agree_and_fail_where_not",
    "test_pytest_plugin.py::test_report_lists_every_comparison_once_failures_first",
    "test_pytest_plugin.py::test_update_makes_what_is_missing_or_stale_from_the_scene_and_the_command_it_names_works",
    "test_pytest_plugin.py::test_update_takes_an_image_without_a_scene_as_its_own_reference_but_never_a_broken_one",
    "test_readme.py::test_every_command_of_the_readme_runs_as_written",
    "tracer/test_tracer_camera.py::test_opencv_projects_a_point_of_the_ray_back_onto_the_pixel",
    "tracer/test_tracer_camera.py::test_undistort_agrees_with_opencv_iterated_to_the_end",
    "twin/test_backend.py",
    "twin/test_truths.py",
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
