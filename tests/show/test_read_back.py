"""What is written is read back: numbers of a summary, pixels of a picture, text of a lesson."""

import numpy as np
import pytest

from raytwin.errors import InputError
from raytwin.photos.camera import detect_photos
from raytwin.photos.camera.calibration_result import Calibration, View
from raytwin.show.atlas_page import atlas_summary
from raytwin.show.terminal_text import calibration_summary
from raytwin.study.atlas.experiment import Atlas, Curve, Found
from raytwin.teach.walk.desk import Desk
from raytwin.teach.walk.written import with_functions


def test_calibrates_summary_has_each_number_beside_its_name():
    K = ((812.5, 0.0, 321.25), (0.0, 834.75, 242.5), (0.0, 0.0, 1.0))
    sigma = {"fx": 1.5, "fy": 2.5, "cx": 3.5, "cy": 4.5, "k1": 0.25}
    view = View("a.jpg", 7, 0.125, np.eye(3).tolist(), (0.0, 0.0, 1.0), influence=1.75)
    text = calibration_summary(Calibration((640, 480), "k1", K, (-0.125,), sigma, 0.375, (view,)))
    found = {line.split()[0]: line.split()[1:] for line in text.splitlines() if "+-" in line}
    expected = {"fx": (812.5, 1.5), "fy": (834.75, 2.5), "cx": (321.25, 3.5), "cy": (242.5, 4.5), "k1": (-0.125, 0.25)}
    assert found.keys() == expected.keys()
    for name, row in found.items():
        assert (float(row[0]), float(row[2])) == pytest.approx(expected[name], rel=1e-4)
    row = next(line.split() for line in text.splitlines() if "a.jpg" in line)
    assert list(map(float, row[1:4])) == pytest.approx([7, 0.125, 1.75], abs=5e-3)


def test_the_atlas_says_where_each_method_breaks_or_refuses_and_what_was_predicted():
    curves = {
        "good": Curve((1e-7, 1e-7, 1e-7), None, None),
        "breaks": Curve((1e-7, 1e-2, 1.0), 20.0, 30.0),
        "refuses": Curve((1e-7, 1e-7, None), None, None),
    }
    text = atlas_summary(Atlas((Found("far", "radii", (1.0, 10.0, 100.0), 1e-3, curves, "", ""),)))
    head, *rows = text.splitlines()
    assert head == "far: radii 1 to 100, bound 0.001"
    assert [" ".join(row.split()) for row in rows] == [
        "good holds; 7 digits at the last",
        "breaks breaks at 20; predicted 30; 0 digits at the last",
        "refuses refuses at 100; refused at the last",
    ]


def test_functions_are_replaced_each_in_its_own_place():
    text = "a = 1\n\ndef f(x):\n    return x\n\n\ndef g(x):\n    # long\n    y = 2\n    return y\n\nb = f(3) + g(4)\n"
    made = with_functions(text, {"f": "def f(x):\n    z = 5 * x\n    return z\n\n", "g": "def g(x):\n    return 7 * x"})
    first, last = "def f(x):\n    z = 5 * x\n    return z\n", "def g(x):\n    return 7 * x\n"
    assert made == f"a = 1\n\n{first}\n\n{last}\nb = f(3) + g(4)\n"
    with pytest.raises(InputError, match="one of f, g, got h"):
        with_functions(text, {"h": ""})


@pytest.mark.nightly
def test_the_lessons_corners_are_half_a_pixel_off_opencvs(scenes):
    desk = Desk(scenes / "desk")
    found, _ = detect_photos([scenes / "desk" / "photos" / desk.photo_name], desk.board.family)
    tags = next(iter(found.values()))
    assert desk.corners == pytest.approx(np.array([tag.corners for tag in tags]) + 0.5)
    given = []
    desk.homographies(lambda corners: given.append(corners) or corners.mean(axis=1))
    expected = np.array([tag.corners for tag in tags if tag.id in desk.board.centers()]) + 0.5
    assert any(corners.shape == expected.shape and np.allclose(corners, expected, atol=1e-6) for corners in given)
