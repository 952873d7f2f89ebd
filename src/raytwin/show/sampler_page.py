"""What a sampler draws, what it claims, and their difference, as pictures of its directions; the numbers below."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from raytwin.errors import InputError, check_one_of
from raytwin.images.image import Image
from raytwin.show.page import write_page
from raytwin.show.picture_pair import SCRIPTS, STYLES, picture_pair
from raytwin.teach.contract.check_function import call_stage, judge_function
from raytwin.teach.contract.stage import Case
from raytwin.teach.contract.stage_table import LESSONS
from raytwin.teach.contract.stages.samplers import SAMPLERS, Drawn

PIXELS = 48
"""Pixels across the disk of directions."""
CALLS = 16
"""Calls of the function for each of its cases: 262144 directions in a picture."""


def write_sampler(name: str, function: Callable[..., Any], path: Path) -> None:
    """Write the page of a function that should be the sampler of this name.

    Raises InputError where there is no such sampler, or the function gives no arrays of the shapes that it should.
    """
    check_one_of("sampler", name, SAMPLERS)
    stage = LESSONS[name]
    images: dict[str, Image] = {}
    result = judge_function(stage, function)
    for number, case in enumerate(stage.cases(0)):
        cases = [stage.cases(seed)[number] for seed in range(CALLS)]
        answers = call_stage(stage, function, cases)
        shapes = [array.shape for array in case.expected]
        for answer in answers:
            if isinstance(answer, str) or [array.shape for array in answer] != shapes:
                raise InputError(name, f"arrays {', '.join(map(str, shapes))}", result.sentence)
        together = [np.concatenate(arrays) for arrays in zip(*answers, strict=True)]
        images |= density_maps(Drawn(SAMPLERS[name], case, tuple(together)), case)
    drawn, beside, *_ = images
    data = picture_pair(images, (drawn, beside), like=drawn.replace("drawn", "asked for"))
    write_page(path, "sampler.html.j2", STYLES, SCRIPTS, result=result, **data)


def density_maps(drawn: Drawn, case: Case) -> dict[str, Image]:
    """The densities per steradian of the directions, seen along z: equal areas are equal solid angles."""
    edge = np.sqrt(1 - drawn.lowest)
    side = np.linspace(-edge, edge, PIXELS + 1)
    x, y, z = drawn.directions.T
    scale = np.sqrt(np.maximum(1 + z, 1e-12))
    across = partial(np.histogram2d, y / scale, x / scale, [side, side])
    counts = across()[0]
    middle = (side[1:] + side[:-1]) / 2
    height = 1 - middle[:, None] ** 2 - middle**2
    maps = {
        "drawn": counts / (len(z) * 2 * (side[1] - side[0]) ** 2),
        "claimed": across(weights=drawn.pdf)[0] / np.maximum(counts, 1),
        "asked for": drawn.at("pdf", z=height),
    }
    whole = np.hypot(*np.meshgrid(*2 * [np.abs(middle) + side[1] - middle[0]])) < edge  # the rim's pixels are cut
    return {
        f"{case.shows}: {key}": Image(np.repeat(np.where(whole, density, 0)[..., None], 3, 2).astype(np.float32))
        for key, density in maps.items()
    }
