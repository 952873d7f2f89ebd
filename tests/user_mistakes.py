"""A user's mistakes over the public names: not run. `mypy --strict` must refuse each line that says `# wrong`."""

import numpy as np

import raytwin


def mistakes(scene: raytwin.Scene, image: raytwin.Image) -> None:
    mean: int = image.mean  # wrong
    variance: str = image.variance  # wrong
    lit: float = image.mean.shape  # wrong
    image.mean.brighten()  # wrong
    raytwin.rendr(scene)  # wrong
    if image.surface is not None:
        ids: list[int] = image.surface.ids  # wrong
        print(ids)
    traced: np.ndarray = raytwin.trace(scene, "shadow")  # wrong
    rendered: str = raytwin.render(scene, samples="64")  # wrong
    written: str = raytwin.read_scene("scenes/single")  # wrong
    verdict: int = raytwin.compare_images(image, image).verdict  # wrong
    raytwin.compare_images(image.mean, image)  # wrong
    raytwin.Sphere((0.0, 0.0), 1.0)  # wrong
    print(mean, variance, lit, traced, rendered, written, verdict)
