"""The pipeline's speed limits on one made-up scene of 12 MP: every figure a ratio of medians from one interleaved run.

Two spheres cover about 5 % of the frame of a distorted lens. The yardsticks are one full writing of the output array
and Mitsuba's `direct` with one sample a pixel through the same lens.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from raytwin.bench.loop import loop
from raytwin.bench.measure import orders
from raytwin.scene import Camera, Scene, Sky, Sphere, Sun
from raytwin.tracer import corner_box, trim_box
from raytwin.tracer.speculate import speculate
from raytwin.tracer.trace import background, draw, trace

LENS = (0.1, -0.2, 0.001, -0.0005, 0.05)


def two_spheres(width: int = 4032, height: int = 3024) -> Scene:
    """Two spheres that cover about 5 % of a frame of a phone's lens, 0.5 m away."""
    f = 0.7234 * width
    camera = Camera(
        (width, height),
        ((f, 0.0, 0.5 * width), (0.0, 0.9965 * f, 0.496 * height), (0.0, 0.0, 1.0)),
        ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        (0.0, 0.0, 0.5),
        LENS,
    )
    spheres = Sphere((-0.05, 0.02, 0.05), 0.0455, (0.8, 0.3, 0.2)), Sphere((0.06, -0.03, 0.06), 0.047, (0.2, 0.3, 0.8))
    return Scene("two-spheres", camera, spheres, (), Sun((0.3, 0.4, 1.0)), Sky((0.1, 0.1, 0.1)))


def speed_limits(size: tuple[int, int] = (4032, 3024), repeats: int = 7, rung: str = "lambert", seed: int = 0) -> dict:
    """{"covered", "seconds": {name: [..]}, "ratios": [{"what", "asked", "measured"}]} of one warm run on this machine.

    Methods: Dr.Jit and NumPy in float32, trimmed and full; drawing into a given picture; Mitsuba;
    speculation; and at 1008 x 756, the paper's size, the Python loop. Needs a backend with LLVM.
    """
    from raytwin import twin

    scene = two_spheres(*size)
    small = scene.with_camera(scene.camera.resized(1008, 756))
    out, picture = background(scene, rung), background(scene, rung)
    twin.activate()
    mitsuba = twin.load_plain(scene, "direct")

    def frame(engine: str, trim: str) -> Callable[[], None]:
        def run() -> None:
            background(scene, rung, out)
            draw(scene, out, rung, engine, trim=trim)

        return run

    calls: dict[str, Callable[[], object]] = {
        "fill": lambda: out.fill(0.1),
        "drjit32 trimmed": frame("drjit32", "conic"),
        "drjit32 full": frame("drjit32", "none"),
        "drjit32 in place": lambda: draw(scene, picture, rung, "drjit32"),
        "numpy32 trimmed": frame("numpy32", "conic"),
        "numpy32 full": frame("numpy32", "none"),
        "numpy32 careful n=8": lambda: speculate(scene, 8, rung, "numpy32"),
        "numpy32 paper n=8": lambda: speculate(scene, 8, rung, "numpy32", "paper"),
        "mitsuba direct": lambda: twin.render_plain(mitsuba, 1),
        "drjit32 at 1008 x 756": lambda: trace(small, rung, "drjit32"),
        "loop at 1008 x 756": lambda: loop(small, rung),
    }
    names = list(calls)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for call in calls.values():
        call()
    order = orders(len(names), seed)
    for _ in range(repeats):
        for i in next(order):
            start = time.perf_counter()
            calls[names[i]]()
            seconds[names[i]].append(time.perf_counter() - start)
    m = {name: float(np.median(s)) for name, s in seconds.items()}
    truth = trace(scene, rung)
    errors = {
        way: float(np.quantile(np.abs(speculate(scene, 8, rung, "numpy32", way)[0] - truth.mean), 0.999))
        for way in ("careful", "paper")
    }
    peak = float(truth.mean.max())
    ratios = [
        ("Dr.Jit trimmed frame / one fill", "at most 2", m["drjit32 trimmed"] / m["fill"]),
        ("Mitsuba direct / Dr.Jit trimmed frame", "at least 25", m["mitsuba direct"] / m["drjit32 trimmed"]),
        ("Mitsuba direct / Dr.Jit full frame", "at least 8", m["mitsuba direct"] / m["drjit32 full"]),
        ("Mitsuba direct / NumPy trimmed frame", "at least 4", m["mitsuba direct"] / m["numpy32 trimmed"]),
        ("Dr.Jit drawing in place / one fill", "about 0.25", m["drjit32 in place"] / m["fill"]),
        ("NumPy full frame / careful speculation, n = 8", "at least 3", m["numpy32 full"] / m["numpy32 careful n=8"]),
        ("careful speculation's p99.9 error / peak", "under 1e-3", errors["careful"] / peak),
        ("the paper's speculation's p99.9 error / peak", "", errors["paper"] / peak),
        ("Python loop / Dr.Jit, 1008 x 756", "", m["loop at 1008 x 756"] / m["drjit32 at 1008 x 756"]),
    ]
    return {
        "size": list(size),
        "rung": rung,
        "covered": float(truth.surface.mask.mean()),
        "seconds": seconds,
        "ratios": [{"what": w, "asked": a, "measured": r} for w, a, r in ratios],
    }


def trim_table(scene: Scene) -> list[dict]:
    """Per object and box: its pixels, the visible ones it wastes or cuts, and the microseconds that finding it takes.

    A visible pixel is one whose centre's ray meets the object, whatever stands before it. Columns: object, trim,
    pixels, wasted (share of the box that cannot see the object), cut (pixels that see it outside), microseconds.
    """
    rows = []
    for index, thing in enumerate(scene.objects):
        alone = Scene(scene.name, scene.camera, *(((thing,), ()) if index < len(scene.spheres) else ((), (thing,))))
        seen = trace(alone, "surface", trim="none").surface.mask
        for name, box_of in (("corners", corner_box), ("conic", trim_box)):
            start = time.perf_counter()
            for _ in range(20):
                x0, y0, x1, y1 = box_of(thing, scene.camera)
            spent = (time.perf_counter() - start) / 20
            inside = seen[y0:y1, x0:x1].sum()
            pixels = (x1 - x0) * (y1 - y0)
            rows.append(
                {
                    "object": index,
                    "trim": name,
                    "pixels": pixels,
                    "wasted": float(1 - inside / pixels) if pixels else 0.0,
                    "cut": int(seen.sum() - inside),
                    "microseconds": 1e6 * spent,
                }
            )
    return rows


def main() -> None:
    """`python -m raytwin.bench.limits [SCENE]`: the ratios, and the boxes of a scene's objects, as Markdown tables."""
    from raytwin.files import read_scene

    found = speed_limits()
    print("| ratio of medians | asked | measured |\n| --- | --- | --- |")
    for row in found["ratios"]:
        print(f"| {row['what']} | {row['asked']} | {row['measured']:.3g} |")
    print("\n| method | ms |\n| --- | --- |")
    for name, seconds in found["seconds"].items():
        print(f"| {name} | {1e3 * float(np.median(seconds)):.1f} |")
    print("\n| object | box | pixels | wasted | cut | microseconds |\n| --- | --- | --- | --- | --- | --- |")
    for row in trim_table(read_scene(sys.argv[1] if len(sys.argv) > 1 else "scenes/distorted")):
        share = f"{100 * row['wasted']:.0f} %"
        cells = row["object"], row["trim"], row["pixels"], share, row["cut"], round(row["microseconds"])
        print("| " + " | ".join(map(str, cells)) + " |")


if __name__ == "__main__":
    main()
