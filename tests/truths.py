"""Closed forms of light that more than one folder of tests holds images to."""

from math import acos, atan, pi, sqrt


def from_element(h: float, c: float) -> float:
    """F of a sphere of radius 1 at the distance h, c the cosine between the element's normal and its direction.

    Howell, A Catalog of Radiation Heat Transfer Configuration Factors, section B.
    """
    if h * c >= 1:
        return c / h**2
    if h * c <= -1:
        return 0.0
    cut = sqrt(1 - h * h * c * c)
    above = c * acos(-c * sqrt((h * h - 1) / (1 - c * c))) - cut * sqrt(h * h - 1)
    return (above / h**2 + atan(cut / sqrt(h * h - 1))) / pi
