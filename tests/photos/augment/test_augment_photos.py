"""`raytwin photo draw` on photos of the synthetic photographer, against photos with the spheres really there."""

import struct

import numpy as np
import pytest
from PIL import Image as Pillow
from PIL import ImageCms
from program import raytwin

from raytwin.errors import InputError
from raytwin.fast import trace, trim_boxes
from raytwin.images.photo_files import from_bytes, read_photo, to_bytes, write_picture
from raytwin.photos import synthetic_photos
from raytwin.scene import Camera
from raytwin.scene.scene_files import read_camera, read_scene, scene_and_photos
from raytwin.scene.toml_json import read_toml, write_toml
from raytwin.study.augment_photos import augment_photos
from raytwin.study.photograph import photograph_board
from raytwin.tracer.lights import lighting

SIZE = 504, 378


@pytest.fixture(scope="module")
def taken(scenes, tmp_path_factory):
    """A folder with a small photo of the board, photo.jpg, and its camera.toml."""
    from raytwin import twin

    twin.activate()
    folder = tmp_path_factory.mktemp("taken")
    board = scenes / "desk" / "board.toml"
    photograph_board(board, folder / "all", scene=scenes / "desk", count=1, size=SIZE, samples=8)
    truth = synthetic_photos.read_truth(folder / "all" / "truth.toml")
    R, t = truth.photos["photo_00.jpg"]
    write_toml(folder / "camera.toml", Camera(truth.image_size, truth.K, R, t, truth.dist).to_dict())
    (folder / "all" / "photo_00.jpg").rename(folder / "photo.jpg")
    return folder


@pytest.fixture
def draw(taken, scenes, tmp_path):
    """Draw `desk` into a photo by the camera of `taken`; return the drawn photo's path."""

    def draw(photo, out="out", scene="desk", **options):
        rows = augment_photos([photo], scenes / scene, tmp_path / out, camera=taken / "camera.toml", **options)
        assert [row["photo"] for row in rows] == [photo.name]
        return next((tmp_path / out).iterdir())

    return draw


def apples_p3() -> bytes:
    """A Display P3 profile of the smallest kind, built here: sRGB's curve, the primaries of SMPTE EG 432-1 under
    D50."""

    def fixed(*numbers: float) -> bytes:
        return b"".join(struct.pack(">i", round(n * 65536)) for n in numbers)

    xyz = {b"rXYZ": (0.515121, 0.241196, -0.001053), b"gXYZ": (0.291977, 0.692245, 0.041885),
           b"bXYZ": (0.157104, 0.066574, 0.784073), b"wtpt": (0.964203, 1.0, 0.824905)}  # fmt: skip
    curve = b"para" + bytes(4) + struct.pack(">HH", 3, 0) + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
    text = b"desc" + bytes(4) + struct.pack(">I", 3) + b"P3\0" + bytes(78 + 1)
    parts = {tag: b"XYZ " + bytes(4) + fixed(*v) for tag, v in xyz.items()}
    parts |= {b"rTRC": curve, b"gTRC": curve, b"bTRC": curve, b"desc": text, b"cprt": b"text" + bytes(4) + b"none\0"}
    at, table, data = 128 + 4 + 12 * len(parts), b"", b""
    for tag, part in parts.items():
        part += bytes(-len(part) % 4)
        table += tag + struct.pack(">II", at + len(data), len(part))
        data += part
    head = struct.pack(">I4sI4s4s4s", at + len(data), bytes(4), 0x02400000, b"mntr", b"RGB ", b"XYZ ")
    head += struct.pack(">6H", 2020, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + fixed(0.964203, 1.0, 0.824905) + bytes(48)
    return head + struct.pack(">I", len(parts)) + table + data


def test_a_display_p3_photo_is_read_as_srgb_and_no_other_profile_changes_a_code(tmp_path):
    """Linear P3 to linear sRGB by the matrix that their primaries give, of colours that sRGB holds."""
    pixels = np.random.default_rng(0).integers(60, 200, (20, 25, 3), dtype=np.uint8)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    found = {}
    for name, profile in (
        ("p3", apples_p3()), ("srgb", srgb), ("grey", srgb[:16] + b"GRAY" + srgb[20:]), ("broken", b"no profile"),
    ):  # fmt: skip
        Pillow.fromarray(pixels).save(tmp_path / f"{name}.png", icc_profile=profile)
        found[name] = read_photo(tmp_path / f"{name}.png")
    to_srgb = [[1.22494, -0.22494, 0.0], [-0.04206, 1.04206, 0.0], [-0.01964, -0.07864, 1.09827]]
    want = from_bytes(pixels) @ np.transpose(to_srgb)
    held = (want > 0.002).all(axis=-1)
    assert held.mean() > 0.5
    assert np.abs(found.pop("p3").astype(int) - to_bytes(want))[held].max() <= 2
    assert np.abs(pixels.astype(int) - to_bytes(want))[held].max() > 10
    assert all(np.array_equal(codes, pixels) for codes in found.values())


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_photos_exif_is_kept_byte_for_byte_and_its_colours_become_srgb(taken, draw, tmp_path, suffix):
    """The pixels stay in the sensor's grid, so that the orientation still holds."""
    photo = Pillow.open(taken / "photo.jpg")
    exif = photo.getexif()
    exif[0x0112], exif[0x010F] = 6, "Maker"
    source = tmp_path / f"photo{suffix}"
    photo.save(source, exif=exif.tobytes(), icc_profile=apples_p3(), quality=95)
    with Pillow.open(source) as before, Pillow.open(draw(source)) as drawn:
        assert drawn.size == SIZE
        assert drawn.info["exif"] == before.info["exif"]
        assert "icc_profile" not in drawn.info


def test_a_photo_of_another_size_is_named_and_said_to_be_turned(taken, draw, tmp_path):
    whole = read_photo(taken / "photo.jpg")
    for pixels, got in ((whole[:300], "504 x 300$"), (np.rot90(whole), "378 x 504: the same, turned by a quarter")):
        write_picture(tmp_path / "odd.jpg", pixels)
        with pytest.raises(InputError, match=rf"odd\.jpg: expected 504 x 378 pixels, as the camera's, got {got}"):
            draw(tmp_path / "odd.jpg")
        assert not (tmp_path / "out").exists()


def test_the_pyramid_is_drawn(taken, draw):
    drawn = read_photo(draw(taken / "photo.jpg", scene="desk/pyramid.toml"))
    changed = np.abs(drawn.astype(int) - read_photo(taken / "photo.jpg")).max(axis=-1) > 40
    assert 0.005 < changed.mean() < 0.3


def test_trim_boxes_are_outlined_about_the_drawn_spheres(taken, scenes, draw):
    with_boxes, without = (
        read_photo(draw(taken / "photo.jpg", str(boxes), boxes=boxes)).astype(int) for boxes in (True, False)
    )
    # JPEG smears an outline into its blocks of 8, and no farther.
    outlined = np.argwhere(np.abs(with_boxes - without).max(axis=-1) > 40)
    spheres = scene_and_photos(scenes / "desk")[0].spheres
    boxes = np.array(trim_boxes(spheres, read_camera(taken / "camera.toml")))[:, ::-1]
    assert (np.abs(outlined.min(axis=0) - boxes[:, 2:].min(axis=0)) < 9).all()
    assert (np.abs(outlined.max(axis=0) - boxes[:, :2].max(axis=0)) < 9).all()
    assert len(outlined) < 0.05 * without[..., 0].size


def test_the_photos_own_folder_is_never_written_to(taken, scenes):
    photo = taken / "photo.jpg"
    before = photo.read_bytes()
    with pytest.raises(InputError, match="--out"):
        augment_photos([photo], scenes / "desk", photo.parent, camera=taken / "camera.toml")
    assert photo.read_bytes() == before


def test_a_batch_of_which_one_photo_fails_leaves_nothing(taken, scenes, tmp_path):
    whole, out = taken / "photo.jpg", tmp_path / "out"
    out.mkdir()
    (out / "photo.jpg").write_text("of an earlier run")
    (tmp_path / "cut.jpg").write_bytes(whole.read_bytes()[:9000])
    with pytest.raises(InputError, match=r"cut\.jpg: expected a photo"):
        augment_photos([whole, tmp_path / "cut.jpg"], scenes / "desk", out, camera=taken / "camera.toml")
    assert [p.read_text() for p in out.iterdir()] == ["of an earlier run"]


def test_augment_takes_a_folder_leaves_out_what_it_cannot_read_and_writes_a_tiff_as_png(taken, scenes, tmp_path):
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    Pillow.open(taken / "photo.jpg").save(photos / "photo.tiff")
    (photos / "._photo.jpg").write_bytes(b"Mac OS X")
    run = raytwin("augment", photos, "--scene", scenes / "desk", "--camera", taken / "camera.toml", "-o", out)
    assert run.returncode == 0, run.stderr
    assert "._photo.jpg was left out: a file of another kind" in run.stdout
    assert [p.name for p in out.iterdir()] == ["photo.png"]


def test_under_the_photos_own_light_a_drawn_ball_is_as_the_real_one(scenes, tmp_path):
    """The true light of the shipped photos; codes of 8 bits, in which the photos' own noise is."""
    lit, board = scenes / "desk" / "lit", scenes / "desk" / "board.toml"
    scene, sun = read_scene(scenes / "desk" / "lit.toml"), read_toml(scenes / "desk" / "lit.toml")["sun"]
    level = np.array(lighting(scene).sky.diffuse_irradiance((0.0, 0.0, 1.0)))
    paper = 0.85 * (np.array(sun["irradiance"]) * sun["to_light"][2] / np.pi + level)
    light = {"sun": sun, "sky": {"map": str(lit / "sky.exr")}, "paper": {"albedo": 0.85, "color": paper.tolist()}}
    write_toml(tmp_path / "light.toml", light)
    options = {"board": board, "camera": lit / "camera.toml", "light": tmp_path / "light.toml"}
    augment_photos([lit / "photo_00.jpg"], scenes / "desk" / "lit.toml", tmp_path / "out", **options)
    drawn, photo, true = (read_photo(folder / "photo_00.jpg") for folder in (tmp_path / "out", lit, lit / "with"))
    ids = trace(scene, "surface", "numpy32").surface.ids
    over = np.array([*(not thing.in_photo for thing in scene.objects), False])[ids]
    # A code is 1e-3 of white or more: what JPEG changes in ink is no shadow.
    shadow = ~over & (from_bytes(drawn) + 0.02 < 0.9 * (from_bytes(photo) + 0.02)).any(axis=-1)
    off = np.abs(drawn.astype(int) - true).mean(axis=-1)
    assert off[over].mean() < 3.5
    assert off[shadow].mean() < 4
    assert off.mean() < 1.2
