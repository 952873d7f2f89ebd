"""How often the correct cause is named: `python -m measure.named_causes`.

Mistakes in tracers that students wrote, and correct tracers, which must not be blamed. Drawn scenes as a rubric has
them: three with shadows, one without.
"""

import time

from measure import record
from tracers_by_students import CORRECT, MISTAKES, mistaken, run

from raytwin.explain.diagnosis import SubmittedImage, diagnose
from raytwin.explain.draw_scene import draw_scene
from raytwin.explain.explanation import Explanation
from raytwin.renderers.scene_exchange import as_arrays

SCENES = [(draw_scene(seed), "shadow" if seed < 3 else "lambert") for seed in range(4)]
ROWS = "all", "hidden", "detected", "named first", "first three", "false though proved"


def diagnosed(text: str) -> Explanation:
    """What is said of a tracer's pictures of every scene."""
    made = run(text, [as_arrays(scene, rung) for scene, rung in SCENES])
    return diagnose(
        [SubmittedImage(scene, picture, rung=rung) for (scene, rung), picture in zip(SCENES, made, strict=True)]
    )


def main() -> None:
    counts = dict.fromkeys(ROWS, 0)
    blamed = sum(diagnosed(mistaken(*variation)).cause is not None for variation in CORRECT)
    began = time.process_time()
    for wanted, *mistake in MISTAKES:
        made = diagnosed(mistaken(*mistake))
        names = [cause.name for cause in made.causes[:3]] or ["unknown"]
        near = bool({*wanted} & {*names})
        counts["all"] += 1
        counts["hidden"] += made.certainty == "correct"
        counts["detected"] += made.certainty != "correct"
        counts["named first"] += names[0] in wanted
        counts["first three"] += near
        counts["false though proved"] += made.certainty == "proved" and not near
        if names[0] not in wanted and made.certainty != "correct":
            print(f"{wanted[0]}: {names}, {made.certainty} {made.sentences[:1]}", flush=True)
    seconds = (time.process_time() - began) / len(MISTAKES)
    rows = [
        *counts.items(),
        ("correct tracers that were blamed", f"{blamed} of {len(CORRECT)}"),
        ("CPU seconds each, with the pictures", f"{seconds:.2f}"),
    ]
    record.table("causes", "students", ["", "count"], rows, "python -m measure.named_causes")


if __name__ == "__main__":
    main()
