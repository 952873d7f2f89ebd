"""What changed between two written scenes is named."""

import msgspec

from raytwin.scene import Sphere
from raytwin.scene.scene_changes import changes, summary
from raytwin.scene.scene_files import read_scene


def test_each_changed_value_is_named_by_its_key(scenes):
    old = read_scene(scenes / "single")
    assert not list(changes(old, old))
    new = msgspec.structs.replace(
        old,
        sun=msgspec.structs.replace(old.sun, irradiance=(3.2, 3.2, 3.2), to_light=(0.0, 1.0, 0.0)),
        camera=msgspec.structs.replace(old.camera, dist=(0.125,)),
        spheres=(msgspec.structs.replace(old.spheres[0], radius=2.5), *old.spheres[1:], Sphere((0, 0, 1), 1.0)),
    )
    found = list(changes(old, new))
    before = f"[{', '.join(f'{x:g}' for x in old.sun.to_light)}]"
    assert found == [
        "camera.dist [] -> [0.125]",
        f"spheres[0].radius {old.spheres[0].radius:g} -> 2.5",
        f"spheres[{len(old.spheres)}] added",
        f"sun.to_light {before} -> [0, 1, 0]",
        f"sun.irradiance {old.sun.irradiance[0]:g} -> 3.2",
    ]
    assert summary(old, new) == ", ".join(found[:4]) + ", and 1 more"
