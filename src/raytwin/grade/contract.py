"""What students may write: the stages of the contract, a row each. To add one: a file in `stages/`, its row here."""

from raytwin.grade.stage import Stage
from raytwin.grade.stages import back_project, estimate_pose, hit_points, intersect_sphere, render, shade

CONTRACT: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        back_project.STAGE,
        estimate_pose.STAGE,
        intersect_sphere.STAGE,
        shade.STAGE,
        hit_points.STAGE,
        render.STAGE,
    )
}
"""name -> stage, in the order in which a tracer goes through them."""
