"""What a run of the paper's figures holds: paper.json."""

import msgspec

from raytwin.bench import Calibrated, LeftOut


class Published(msgspec.Struct, frozen=True):
    """Seconds that the paper states, and for what."""

    figure: str
    what: str
    seconds: tuple[float, ...]


PUBLISHED = (
    Published("calibration", "12 MP photos", (34.8,)),
    Published("calibration", "a quarter of the side", (2.5,)),
    Published("calibration", "photos of 1000 x 1333", (4.5,)),
    Published("intersection", "untrimmed, 756 x 1008, two spheres", (17.7, 19.6)),
    Published("intersection", "trimmed, 756 x 1008, two spheres", (1.3, 8.0)),
)


class Frame(msgspec.Struct, frozen=True):
    """One method's frame: seconds, and errors of radiance against the untrimmed float64 truth.

    `cut`, `wasted`: pixels that see an object outside its box, and pixels of boxes that do not see it; null where no
    boxes are used. Errors are null for yardsticks.
    """

    method: str
    family: str
    label: str
    width: int
    height: int
    seconds_median: float
    seconds_iqr: float
    rmse: float | None
    p999_abs: float | None
    max_abs: float | None
    cut: int | None = None
    wasted: int | None = None


class Boxed(msgspec.Struct, frozen=True):
    """Boxes of one kind round every object of a scene, summed: `pixels` in them, `wasted`, and `cut` outside."""

    scene: str
    trim: str
    width: int
    height: int
    pixels: int
    wasted: int
    cut: int
    microseconds: float


class Ratio(msgspec.Struct, frozen=True):
    what: str
    asked: str
    measured: float


class Paper(msgspec.Struct, frozen=True):
    """A whole run; paper.json. `floor`: by width x height, the RMSE that rounding the truth to float32 costs."""

    scene: str
    machine: dict[str, str]
    versions: dict[str, str]
    budget: float
    seconds: float
    covered: float
    published: tuple[Published, ...]
    calibration: tuple[Calibrated, ...]
    intersection: tuple[Frame, ...]
    speculation: tuple[Frame, ...]
    boxes: tuple[Boxed, ...]
    ratios: tuple[Ratio, ...]
    floor: dict[str, float]
    left_out: tuple[LeftOut, ...]
