"""report.html: one file that opens offline; the viewer, numbers, calibration, times beside errors."""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from raytwin.compare.finding import CAUSES, Finding
from raytwin.compare.heatmap import signed_error
from raytwin.show import data_urls, numbers, viewer
from raytwin.show.page import write_page
from raytwin.show.view import PairView, showable, view_of

if TYPE_CHECKING:
    from raytwin.study.compare_scene import Result
    from raytwin.study.diff_files import Diff

LISTED = 8
"""Worst pixels in the table."""
AROUND = 48
"""Pixels across the view that a link opens; a tile larger than a third of it gets three times its own side."""
Reason = tuple[str, str | None]
"""The text of a reason, and the address of its place in the picture, or None."""
SAYS = {
    "pass": "The two images agree within ",
    "differs": "One side models less light on purpose; otherwise the images agree within ",
    "fail": "The two images do not agree within ",
    "undecided": "The images are too noisy, or tell too little, to be compared within ",
}
"""Verdict -> the headline where no reason is given, before what the images are compared within."""


def write_report(shown: "PairView | Result | Diff", path: str | os.PathLike[str], script: str | None = None) -> None:
    """Write the report as one HTML file that needs no other. `script`: a viewer's script that pages share."""
    view = shown if isinstance(shown, PairView) else view_of(shown)
    first, others = first_said(view.comparison.findings, view.comparison.passed)
    shape = shape_of(view)
    write_page(
        path,
        "report.html.j2",
        (viewer.style(),) if view.alike else (),
        () if script or not view.alike else (viewer.script(),),
        r=view,
        c=view.comparison,
        SAYS=SAYS,
        groups=list(numbers.rows(view.comparison, view.tolerance, view.pair.noisy)),
        calibrated=calibrated(view),
        headline=linked([first], shape)[0][0] if first else None,
        named=first is not None and first.kind in CAUSES,
        reasons=linked(others, shape)[0],
        shared=script,
        **(side_by_side(view) if view.alike else {"alone": alone(view)}),
    )


def first_said(findings: Sequence[Finding], passed: bool) -> tuple[Finding | None, list[Finding]]:
    """Return the headline, a cause where one is named or what an expected difference leaves out, and the rest."""
    if findings and findings[0].kind == "expected":
        text = findings[0].text
        return Finding("note", f"{text[0].upper()}{text[1:]}."), list(findings[1:])
    ordered = sorted(findings, key=lambda finding: finding.kind not in CAUSES)
    return (None, ordered) if passed or not ordered else (ordered[0], ordered[1:])


def linked(findings: Iterable[Finding], shape: Sequence[int]) -> tuple[list[Reason], list[dict[str, int]]]:
    """Return each finding's reason with the address of its place, and the places themselves, each once.

    `shape`: the image's. A finding about the whole image leads to all of it.
    """
    found: list[Reason] = []
    places: list[dict[str, int]] = []
    for finding in findings:
        address, place = "#whole" if finding.kind == "image" else None, finding.place
        if address is None and place is not None and len(shape) > 1 and place.x < shape[1] and place.y < shape[0]:
            x, y = place.x + place.width // 2, place.y + place.height // 2
            address = f"#pixel={x},{y},{max(AROUND, 3 * max(place.width, place.height))}"
            if place._asdict() not in places:
                places.append(place._asdict())
        found.append((finding.reason, address))
    return found, places


def side_by_side(view: PairView) -> dict[str, Any]:
    """The viewer's data, and the worst pixels."""
    error = signed_error(view.test, view.reference)
    worst = data_urls.worst_pixels(error, LISTED)
    apart = data_urls.mismatches(*view.surfaces) if view.surfaces else []
    height, width = error.shape
    packed, panes = packed_and_panes(view)
    share = view.tolerance.p999_abs / view.scale
    data = packed.for_page() | {
        "names": {"test": view.names.test, "reference": view.names.reference},
        "panes": panes,
        "objects": view.objects,
        "noisy": view.pair.noisy,
        "bound": {"share": share, "scale": view.scale, "held": allowed(view) is not None},
        "places": linked(view.comparison.findings, shape_of(view))[1],
        "failing": view.comparison.failing,
        "marks": apart,
        "exposure": data_urls.stops(view.reference),
        "start": worst[0] if worst else None,
        "address": True,
        "parts": packed_parts(view),
    }
    rows = pixel_rows(view, worst, apart)
    return {
        "width": width,
        "height": height,
        "data": data,
        "parts": {part["name"] for part in data["parts"]},
        "thin": packed.thin,
        "worst": rows,
        "apart": len(apart),
    }


def packed_parts(view: PairView) -> list[dict[str, Any]]:
    """The ledger's parts as maps."""
    if (ledger := view.pair.ledger) is None:
        return []
    return viewer.pack_parts(ledger.pictures, ledger.step, {row.part: row.noise or 0.0 for row in ledger.parts})


def packed_and_panes(view: PairView) -> tuple[viewer.Packed, list[dict[str, Any]]]:
    """The viewer's planes, and its panes in reading order; what the images lack is left out."""
    names, (height, width) = view.names, view.reference.shape[:2]
    panes = [
        {"key": "test", "kind": "radiance", "title": names.test_title, "tab": names.test},
        {"key": "reference", "kind": "radiance", "title": names.reference_title, "tab": names.reference},
        {"key": "map", "kind": "map", "title": "Difference", "tab": "difference"},
    ]
    if view.surfaces:
        panes.append({"key": "objects", "kind": "objects", "title": "Silhouettes", "tab": "silhouettes"})
    with ThreadPoolExecutor() as pool:
        drawn = pool.submit(photos, view)
        packed = viewer.pack(view.test, view.reference, surfaces=view.surfaces is not None, means=view.pair.noisy)
        panes += drawn.result()
    return packed, [pane | {"alt": f"{pane['title']} of {view.title}, {width} by {height} pixels"} for pane in panes]


def photos(view: PairView) -> list[dict[str, Any]]:
    """Panes of the augmented photo and of the photo. Large ones are reduced."""
    panes = []
    for tab, title, pixels in (
        ("augmented", "Augmented photo", view.pair.augmented),
        ("photo", "Photo", view.pair.photo),
    ):
        if pixels is not None:
            url, note = data_urls.small_jpeg(pixels)
            panes.append({"key": tab, "kind": "picture", "title": title, "tab": tab, "url": url, "note": note})
    return panes


def alone(view: PairView) -> list[dict[str, str]]:
    """The pictures one by one, for images of different sizes. What is not a picture is left out."""
    found = []
    for title, image in ((view.names.test_title, view.test), (view.names.reference_title, view.reference)):
        if showable(image):
            url, note = data_urls.small_jpeg(data_urls.exposed(image, data_urls.exposure(image)))
            size = "{1} × {0} pixels".format(*image.shape)
            found.append({"title": title, "alt": f"{title}, {size}", "note": f"{size}; shown as {note}", "url": url})
    return found


def shape_of(view: PairView) -> tuple[int, ...]:
    """The pictures' shape; empty where their sizes differ, so that no place can be shown."""
    return view.reference.shape if view.alike else ()


def allowed(view: PairView) -> float | None:
    """The largest error that a single value may have; None where noise decides instead."""
    return None if view.pair.noisy else view.tolerance.p999_abs


# ------------------------------------------------------------------------------------------ numbers for the page


def pixel_rows(view: PairView, worst: list[tuple[int, int]], apart: list[tuple[int, int]]) -> list[dict[str, Any]]:
    """Exact values at pixels worth a look: those that see another object first, then the worst errors."""
    names = dict(enumerate(view.objects)) | {-1: "background"}
    chosen = list(dict.fromkeys([*apart[: LISTED // 2], *worst]))[:LISTED]
    rows = []
    for x, y in chosen:
        a, b = view.test.mean[y, x].astype(float), view.reference.mean[y, x].astype(float)
        row = {"x": x, "y": y, "reference": b.tolist(), "error": (a - b).tolist(), "seen": "–"}
        if view.surfaces:
            seen = [names.get(i, f"object {i}") for i in (int(s.ids[y, x]) for s in view.surfaces)]
            row["seen"] = seen[0] if seen[0] == seen[1] else f"{seen[0]} / {seen[1]}"
        rows.append(row)
    return rows


def calibrated(view: PairView) -> dict[str, Any] | None:
    """The calibration's tables and pictures, and the photo whose pose the camera has."""
    if (calibration := view.pair.calibration) is None:
        return None
    from raytwin.show.calibration_page import calibration_tables  # which loads OpenCV

    return calibration_tables(calibration) | {"posed": view.pair.pose.photo if view.pair.pose else None}
