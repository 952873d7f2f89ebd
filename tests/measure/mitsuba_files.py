"""Verdicts on Mitsuba files: false alarms among right renders, and whether a missing bounce is seen.

    python -m measure.mitsuba_files [COUNT [box|glass]]    in tests/

COUNT (100) right renders with seeds of their own are compared with another render of each scene, then a few that stop
a bounce early. The scenes: a Cornell box, and the shipped `glass` with its mesh and glass.
"""

import sys
import tempfile
from pathlib import Path

import msgspec

from raytwin import files, twin
from raytwin.compare import compare
from raytwin.scene import MitsubaScene

SAMPLES, SIZE, SHORT = 64, (64, 48), 5
WALLS = {
    "floor": ("0.7 0.7 0.7", '<rotate x="1" angle="-90"/><translate y="-1"/>'),
    "ceiling": ("0.7 0.7 0.7", '<rotate x="1" angle="90"/><translate y="1"/>'),
    "back": ("0.7 0.7 0.7", '<translate z="-1"/>'),
    "left": ("0.6 0.05 0.05", '<rotate y="1" angle="90"/><translate x="-1"/>'),
    "right": ("0.1 0.5 0.1", '<rotate y="1" angle="-90"/><translate x="1"/>'),
}


def cornell_box() -> str:
    """Two boxes in a box with a lamp, after Goral and others 1984."""
    walls = "".join(
        f'<shape type="rectangle" id="{name}"><transform name="to_world">{place}</transform>{matt(colour)}</shape>'
        for name, (colour, place) in WALLS.items()
    )
    boxes = "".join(
        f'<shape type="cube" id="{name}"><transform name="to_world">{place}</transform>{matt("0.7 0.7 0.7")}</shape>'
        for name, place in (
            ("small", '<scale value="0.3"/><rotate y="1" angle="-17"/><translate x="0.35" y="-0.7" z="0.3"/>'),
            (
                "tall",
                '<scale x="0.3" y="0.6" z="0.3"/><rotate y="1" angle="18"/><translate x="-0.35" y="-0.4" z="-0.3"/>',
            ),
        )
    )
    lamp = (
        '<shape type="rectangle" id="lamp"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="90"/>'
        '<translate y="0.99"/></transform><emitter type="area"><rgb name="radiance" value="15 12 8"/></emitter></shape>'
    )
    return (
        '<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="8"/></integrator>'
        '<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">'
        '<lookat origin="0, 0, 3.9" target="0, 0, 0" up="0, 1, 0"/></transform>'
        '<film type="hdrfilm"><rfilter type="box"/></film></sensor>'
        f"{walls}{boxes}{lamp}</scene>"
    )


def matt(colour: str) -> str:
    return f'<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{colour}"/></bsdf></bsdf>'


def to_depth(scene: MitsubaScene, depth: int) -> MitsubaScene:
    return msgspec.structs.replace(
        scene, text=scene.text.replace('name="max_depth" value="8"', f'name="max_depth" value="{depth}"')
    )


def main(count: int = 100, *names: str) -> None:
    twin.activate()
    with tempfile.TemporaryDirectory() as folder:
        box = Path(folder) / "box.xml"
        box.write_text(cornell_box())
        for name, path in (("box", box), ("glass", files.find_scene("glass"))):
            if names and name not in names:
                continue
            scene = files.with_film(files.read_mitsuba(path), width=SIZE[0], height=SIZE[1])
            reference = twin.render_mitsuba(scene, 4 * SAMPLES, 1_000_000, cache=False)
            verdicts: list[str] = []
            for seed in range(count):
                made = twin.render_mitsuba(scene, SAMPLES, seed, cache=False)
                verdicts.append(compare(made, reference).verdict)
                if verdicts[-1] != "pass":
                    print(f"  seed {seed}: {compare(made, reference).reasons[0]}")
            told = {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))}
            print(f"{scene.name}: {count} right renders: {told}", flush=True)
            for depth in (7, 6, 5, 4, 3):
                less = [
                    twin.render_mitsuba(to_depth(scene, depth), SAMPLES, seed, cache=False) for seed in range(SHORT)
                ]
                seen = [compare(made, reference).verdict for made in less].count("fail")
                print(f"{scene.name}: max_depth {depth} for 8 is seen in {seen} of {SHORT}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]), *sys.argv[2:])
