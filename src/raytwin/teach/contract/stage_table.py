"""What students may write: the stages of the contract, a row each.

To add one: a file in `stages/`, its row here, its text in starter.py.txt, its mistakes in stage_faults.tsv.
"""

from raytwin.teach.contract.stage import Stage
from raytwin.teach.contract.stages import (
    back_project,
    estimate_pose,
    intersect_sphere,
    lessons,
    pictures,
    samplers,
    shade,
)

CONTRACT: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        back_project.STAGE,
        estimate_pose.STAGE,
        intersect_sphere.STAGE,
        shade.STAGE,
        pictures.HIT_POINTS,
        pictures.RENDER,
    )
}
"""name -> stage, in the order in which a tracer goes through them."""

LESSONS: dict[str, Stage] = CONTRACT | {
    stage.name: stage
    for stage in (
        *lessons.LESSON_STAGES,
        *samplers.SAMPLER_STAGES,
    )
}
"""Those, and the further ones that a learner's walk has: what `raytwin.check` knows, and no submission need define."""
