"""The stability atlas in the terminal."""

from raytwin.show.atlas_page import atlas_summary
from raytwin.study.atlas.experiment import Atlas, Curve, Found


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
