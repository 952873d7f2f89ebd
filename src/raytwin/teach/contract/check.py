"""raytwin.check: a student's function held against the test of its stage, at home, in a notebook or in a test."""

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from raytwin.errors import check_one_of
from raytwin.teach.contract.check_function import judge_function, repair_function
from raytwin.teach.contract.stage_result import StageResult
from raytwin.teach.contract.stage_table import LESSONS

DEFAULT_HINTS = 2
"""What a repair shows unless told otherwise: the line, and what is wrong there."""


def check(
    stage: str,
    function: Callable[..., Any],
    *,
    seed: int = 0,
    hints: int = DEFAULT_HINTS,
    page: str | Path | None = None,
) -> StageResult:
    """Test `function` as the named stage of a tracer, and say in a sentence what is wrong.

    A script prints the result. The Python prompt and a notebook show it. `seed` draws the test's numbers. If one small
    change of the function's text repairs it, `hints` shows the line (1), what is wrong there (2), or what to write (3);
    0 turns this off. It tries some thousand changes, for at most four seconds. Of a sampler, `page` gets pictures of
    what it draws and what it claims. Raises InputError for a stage that is none, and for a page of what is no sampler.
    """
    check_one_of("stage", stage, LESSONS)
    result = judge_function(LESSONS[stage], function, seed)
    if hints and not result.passed and (found := repair_function(LESSONS[stage], function, seed)):
        result = replace(result, hint=found.hint(hints))
    if page is not None:  # by its name: it stands above the contract
        import_module("raytwin.show.sampler_page").write_sampler(stage, function, Path(page))
    if not hasattr(sys, "ps1"):  # no prompt, of Python's or of a notebook, that shows what is returned
        print(result)
    return result
