"""`raytwin photo draw` on photos of the synthetic photographer, against photos with the spheres really there."""

import io
import json
import struct

import numpy as np
import pytest
from measure.draw_regions import codes_by_region
from PIL import Image as Pillow
from PIL import ImageCms
from program import raytwin

from raytwin.errors import InputError
from raytwin.images.photo_files import from_bytes, list_photos, read_photo, to_bytes, write_picture
from raytwin.photos import synthetic_photos
from raytwin.photos.augment import to_rec709
from raytwin.scene import Camera
from raytwin.scene.scene_files import read_scene, scene_and_photos, write_camera
from raytwin.scene.toml_json import read_toml, write_toml
from raytwin.study.augment_photos import augment_photos
from raytwin.study.photograph import photograph_board
from raytwin.tracer.lights import lighting

SIZE, COUNT = (504, 378), 2


@pytest.fixture(scope="module")
def taken(scenes, tmp_path_factory):
    """(photos without, photos with the spheres): the same poses and noise, small photos."""
    from raytwin import twin

    twin.activate()
    folder = tmp_path_factory.mktemp("taken")
    for name, really_there in (("without", False), ("with", True)):
        photograph_board(
            scenes / "desk" / "board.toml",
            folder / name,
            scene=scenes / "desk",
            count=COUNT,
            size=SIZE,
            samples=8,
            with_objects=really_there,
        )
    truth = synthetic_photos.read_truth(folder / "without" / "truth.toml")
    R, t = truth.photos["photo_00.jpg"]
    camera = Camera(truth.image_size, truth.K, R, t, truth.dist)
    write_camera(folder / "camera.toml", camera)
    return folder


@pytest.mark.nightly
def test_an_augmented_photo_is_near_the_true_one_in_every_region(taken, scenes, tmp_path):
    """Away from the corners, which the lens darkens. What is printed on the board is known by its mean alone."""
    (scene, _), truth = scene_and_photos(scenes / "desk"), synthetic_photos.read_truth(taken / "without" / "truth.toml")
    rows = augment_photos(list_photos(taken / "without"), scenes / "desk", tmp_path, camera=taken / "camera.toml")
    assert [row["photo"] for row in rows] == sorted(truth.photos)
    assert json.loads(json.dumps(rows)) == rows
    for name, (R, t) in truth.photos.items():
        drawn, plain, true = (read_photo(f / name) for f in (tmp_path, taken / "without", taken / "with"))
        here = scene.with_camera(Camera(truth.image_size, truth.K, R, t, truth.dist))
        codes = codes_by_region(drawn, plain, true, here)
        for region, most in (("rest", 4.0), ("shadows", 12.0), ("objects", 20.0)):
            assert codes[region] < most, (name, region)
        assert codes["all"] < 0.5 * np.abs(plain.astype(int) - true).mean()


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


def test_display_p3_becomes_linear_as_colour_management_does_it():
    """Against Pillow's ImageCms: P3 to sRGB, of colours that sRGB holds; to the rounding of 8 bits."""
    rng = np.random.default_rng(0)
    inside = rng.integers(60, 200, (500, 3), dtype=np.uint8)
    profile = ImageCms.ImageCmsProfile(io.BytesIO(apples_p3()))
    srgb = ImageCms.createProfile("sRGB")
    want = np.asarray(ImageCms.profileToProfile(Pillow.fromarray(inside[None]), profile, srgb, outputMode="RGB"))[0]
    found = from_bytes(inside) @ to_rec709(apples_p3()).T
    fit = ((found > 0.002) & (found < 0.98)).all(axis=1)
    assert fit.sum() > 100
    assert np.abs(to_bytes(found[fit]).astype(int) - want[fit]).max() <= 2
    assert np.abs(to_bytes(from_bytes(inside[fit])).astype(int) - want[fit]).max() > 10
    assert np.array_equal(to_rec709(None), np.eye(3))
    assert np.array_equal(to_rec709(ImageCms.ImageCmsProfile(srgb).tobytes()), np.eye(3))
    assert np.array_equal(to_rec709(b"no profile"), np.eye(3))


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_photos_profile_and_exif_are_kept_byte_for_byte(taken, scenes, tmp_path, suffix):
    """The pixels stay in the sensor's grid, so that the orientation still holds."""
    photo = Pillow.open(taken / "without" / "photo_00.jpg")
    exif = photo.getexif()
    exif[0x0112], exif[0x010F] = 6, "Maker"
    name = "photo_00" + suffix
    photo.save(tmp_path / name, exif=exif.tobytes(), icc_profile=apples_p3(), quality=95)
    augment_photos([tmp_path / name], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    with Pillow.open(tmp_path / name) as before, Pillow.open(tmp_path / "out" / name) as drawn:
        assert drawn.size == SIZE
        assert drawn.info["exif"] == before.info["exif"]
        assert drawn.info["icc_profile"] == before.info["icc_profile"] == apples_p3()
        assert drawn.getexif()[0x0112] == 6


def test_in_a_p3_photo_an_object_has_the_scenes_colour(taken, scenes, tmp_path):
    """Seen through its profile, what is drawn is what an sRGB photo shows."""
    shown = {}
    for kind, extras in (("srgb", {}), ("p3", {"icc_profile": apples_p3()})):
        write_picture(tmp_path / kind / "photo_00.png", read_photo(taken / "without" / "photo_00.jpg"), extras=extras)
        augment_photos(
            [tmp_path / kind / "photo_00.png"], scenes / "desk", tmp_path / f"{kind} out", camera=taken / "camera.toml"
        )
        pixels = read_photo(tmp_path / f"{kind} out" / "photo_00.png")
        shown[kind] = from_bytes(pixels) @ to_rec709(extras.get("icc_profile")).T
    plain = read_photo(taken / "without" / "photo_00.jpg").astype(int)
    drawn = np.abs(to_bytes(shown["srgb"]).astype(int) - plain).max(axis=-1) > 60
    assert drawn.mean() > 0.002
    assert np.median(np.abs(shown["p3"] - shown["srgb"])[drawn]) < 0.004


def test_a_photo_whose_pixels_were_turned_does_not_fit_the_camera_and_is_said_to_be_turned(taken, scenes, tmp_path):
    write_picture(tmp_path / "photo_00.jpg", np.rot90(read_photo(taken / "without" / "photo_00.jpg")))
    with pytest.raises(InputError, match=r"photo_00\.jpg: .* as the camera's, got .*: the same, turned by a quarter"):
        augment_photos([tmp_path / "photo_00.jpg"], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    assert not (tmp_path / "out").exists()


def test_the_pyramid_is_drawn(taken, scenes, tmp_path):
    photo = taken / "without" / "photo_00.jpg"
    augment_photos([photo], scenes / "desk" / "pyramid.toml", tmp_path, camera=taken / "camera.toml")
    changed = np.abs(read_photo(tmp_path / "photo_00.jpg").astype(int) - read_photo(photo)).max(axis=-1) > 40
    assert 0.005 < changed.mean() < 0.3


def test_trim_boxes_are_outlined_about_the_drawn_spheres(taken, scenes, tmp_path):
    photo, drawn = taken / "without" / "photo_00.jpg", {}
    for boxes in (False, True):
        options = {"camera": taken / "camera.toml", "boxes": boxes, "shadows": False}
        augment_photos([photo], scenes / "desk", tmp_path / str(boxes), **options)
        drawn[boxes] = read_photo(tmp_path / str(boxes) / "photo_00.jpg").astype(int)
    # JPEG smears an outline into its blocks of 8, and no farther.
    outlined = np.argwhere(np.abs(drawn[True] - drawn[False]).max(axis=-1) > 40)
    spheres = np.argwhere(np.abs(drawn[False] - read_photo(photo).astype(int)).max(axis=-1) > 40)
    assert (outlined.min(axis=0) <= spheres.min(axis=0) + 2).all()
    assert (outlined.max(axis=0) >= spheres.max(axis=0) - 2).all()
    assert (np.abs(outlined.min(axis=0) - spheres.min(axis=0)) < 16).all()
    assert len(outlined) < 0.05 * drawn[True][..., 0].size


def test_the_photos_own_folder_is_never_written_to(taken, scenes):
    photo = taken / "without" / "photo_00.jpg"
    before = photo.read_bytes()
    with pytest.raises(InputError, match="--out"):
        augment_photos([photo], scenes / "desk", photo.parent, camera=taken / "camera.toml")
    assert photo.read_bytes() == before


def test_a_photo_of_another_size_is_named(taken, scenes, tmp_path):
    write_picture(tmp_path / "small.jpg", read_photo(taken / "without" / "photo_00.jpg")[:300])
    with pytest.raises(InputError, match=r"small\.jpg: expected 504 x 378 pixels.*got 504 x 300"):
        augment_photos([tmp_path / "small.jpg"], scenes / "desk", tmp_path / "o", camera=taken / "camera.toml")


def test_a_batch_of_which_one_photo_fails_leaves_nothing(taken, scenes, tmp_path):
    whole = taken / "without" / "photo_00.jpg"
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "photo_00.jpg").write_text("of an earlier run")
    (tmp_path / "cut.jpg").write_bytes(whole.read_bytes()[:9000])
    with pytest.raises(InputError, match=r"cut\.jpg: expected a photo"):
        augment_photos([whole, tmp_path / "cut.jpg"], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    assert [p.read_text() for p in (tmp_path / "out").iterdir()] == ["of an earlier run"]


def test_a_tiff_is_drawn_into_and_written_as_png(taken, scenes, tmp_path):
    Pillow.open(taken / "without" / "photo_00.jpg").save(tmp_path / "photo.tiff")
    augment_photos([tmp_path / "photo.tiff"], scenes / "desk", tmp_path / "out", camera=taken / "camera.toml")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["photo.png"]


def test_augment_takes_a_folder_and_leaves_out_what_it_cannot_read(taken, scenes, tmp_path):
    (tmp_path / "photo_00.jpg").write_bytes((taken / "without" / "photo_00.jpg").read_bytes())
    (tmp_path / "._photo_00.jpg").write_bytes(b"Mac OS X")
    run = raytwin(
        "augment", tmp_path, "--scene", scenes / "desk", "--camera", taken / "camera.toml", "-o", tmp_path / "out"
    )
    assert run.returncode == 0, run.stderr
    assert "._photo_00.jpg was left out: a file of another kind" in run.stdout
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["photo_00.jpg"]


def test_under_the_photos_own_light_a_drawn_ball_is_as_the_real_one(scenes, tmp_path):
    """The true light of the shipped photos, in codes of 8 bits; the photos' own noise is in them."""
    lit = scenes / "desk" / "lit"
    scene = read_toml(scenes / "desk" / "lit.toml")
    sun = scene["sun"]
    level = np.array(lighting(read_scene(scenes / "desk" / "lit.toml")).sky.diffuse_irradiance((0.0, 0.0, 1.0)))
    E, z = np.array(sun["irradiance"]), sun["to_light"][2]
    paper = 0.85 * (E * z / np.pi + level)
    light = {"sun": sun, "sky": {"map": str(lit / "sky.exr")}, "paper": {"albedo": 0.85, "color": paper.tolist()}}
    write_toml(tmp_path / "light.toml", light)
    augment_photos(
        [lit / "photo_00.jpg"], scenes / "desk" / "lit.toml", tmp_path / "out", board=scenes / "desk" / "board.toml",
        camera=lit / "camera.toml", light=tmp_path / "light.toml",
    )  # fmt: skip
    pictures = (read_photo(folder / "photo_00.jpg") for folder in (tmp_path / "out", lit, lit / "with"))
    codes = codes_by_region(*pictures, read_scene(scenes / "desk" / "lit.toml"))
    assert codes["objects"] < 3.5
    assert codes["shadows"] < 4
    assert codes["all"] < 1.2
