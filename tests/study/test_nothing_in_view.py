"""A camera that sees no object compares the sky alone: undecided, in a line that says where the objects are."""

import numpy as np

from raytwin.scene import Camera, Scene, Sky, Sphere
from raytwin.study.compare_scene import compare_scene

TURNED = np.array([[0.0, 0, 1, 0.4], [1, 0, 0, 0.2], [0, 1, 0, 0.1], [0, 0, 0, 1]])
"""From the world to an OpenCV camera."""
BALL = np.array([1.0, 0.8, 4, 1])
"""To the right of that camera, below it and in front of it. A frame that begins at its axis sees this quarter alone."""


def scene_of(to_camera: np.ndarray, ball: np.ndarray = BALL) -> Scene:
    K = ((40.0, 0.0, -0.5), (0.0, 40.0, -0.5), (0.0, 0.0, 1.0))
    R, t = tuple(map(tuple, to_camera[:3, :3].tolist())), tuple(to_camera[:3, 3].tolist())
    center = (np.linalg.inv(TURNED) @ ball)[:3]
    return Scene("sky", Camera((32, 24), K, R, t), (Sphere(tuple(center.tolist()), 0.3),), sky=Sky((0.4, 0.6, 1.0)))


def file_of(folder, to_world: np.ndarray, ball: np.ndarray = BALL):
    """The same as a Mitsuba file."""
    center = (np.linalg.inv(TURNED) @ ball)[:3]
    numbers = " ".join(map(str, to_world.ravel()))
    (folder / "scene.xml").write_text(f"""<scene version="3.0.0"><integrator type="path"/>
    <emitter type="constant"/><shape type="sphere"><float name="radius" value="0.3"/>
    <point name="center" x="{center[0]}" y="{center[1]}" z="{center[2]}"/></shape>
    <sensor type="perspective"><float name="fov" value="77.32"/>
    <transform name="to_world"><matrix value="{numbers}"/></transform>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/>
    <integer name="crop_offset_x" value="32"/><integer name="crop_offset_y" value="24"/>
    <integer name="crop_width" value="32"/><integer name="crop_height" value="24"/></film></sensor></scene>""")
    return folder


def told(result) -> str:
    assert (result.comparison.verdict, result.comparison.exit_code) == ("undecided", 2)
    assert result.comparison.reasons[0].startswith("undecided: the camera sees no object")
    return result.comparison.reasons[0]


def flipped(axes: tuple[int, int, int]) -> np.ndarray:
    return np.diag((*axes, 1.0))


def test_a_camera_that_sees_no_object_is_undecided_and_told_where_they_are():
    assert compare_scene(scene_of(TURNED), rung="lambert").comparison.verdict == "pass"
    aside = np.array([50.0, 0.1, 1, 1])
    for rung, scene, place in (
        ("lambert", scene_of(flipped((1, -1, -1)) @ TURNED), "1 object is behind it"),
        ("surface", scene_of(TURNED, aside), "1 object is outside the frame"),
        ("path", scene_of(TURNED, aside), "1 object is outside the frame"),
    ):
        line = told(compare_scene(scene, rung=rung))
        assert f"compared: {place}. R_cam_board and t_cam_board must" in line


def test_a_mitsuba_file_whose_camera_looks_away_is_undecided(tmp_path):
    subject = {"subject": "twin-llvm-path-16", "samples": 16}
    right = np.linalg.inv(TURNED) @ flipped((-1, -1, 1))
    assert compare_scene(file_of(tmp_path, right), **subject).comparison.verdict == "pass"
    assert told(compare_scene(file_of(tmp_path, right @ flipped((-1, 1, -1))), **subject)).endswith("is compared")


def test_a_wrong_sky_still_fails_and_no_objects_at_all_still_pass(tmp_path):
    scene = scene_of(flipped((1, -1, -1)) @ TURNED)
    black = np.zeros((24, 32, 3), np.float32)
    found = compare_scene(scene, rung="path", subject=lambda told: black).comparison
    assert found.verdict == "fail"
    assert any(reason.startswith("the camera sees no object") for reason in found.reasons)
    assert compare_scene(scene.with_(objects=()), rung="lambert").comparison.verdict == "pass"
