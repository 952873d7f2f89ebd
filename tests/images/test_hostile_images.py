"""No file can crash the reader, hang it, or make it take more than a gibibyte. RAYTWIN_FUZZ=N reads N files."""

import os

import hostile
import pytest

from raytwin.errors import InputError
from raytwin.images.limits import check_size

COUNT = int(os.environ.get("RAYTWIN_FUZZ", "900"))
SEED = int(os.environ.get("RAYTWIN_FUZZ_SEED", "1"))


def read(tmp_path, contents) -> dict[str, str]:
    """What came of each file, beside sound ones; nothing may be but an image or a clear error."""
    folder = tmp_path / "files"
    folder.mkdir()
    for name, data in hostile.sound_files().items():
        (folder / f"sound_{name}").write_bytes(data)
    for name, data in contents:
        (folder / name).write_bytes(data)
    found, peak = hostile.judge(folder, tmp_path / "results")
    bad = {k: v for k, v in found.items() if v.split()[0] not in ("image", "error")}
    assert not bad
    assert found.keys() == {p.name for p in folder.iterdir()}
    assert not [k for k, v in found.items() if k.startswith("sound") and not v.startswith("image")]
    assert peak < hostile.GIB // 1024
    return {k: v for k, v in found.items() if not k.startswith("sound")}


def test_damaged_files_are_images_or_clear_errors(tmp_path):
    found = read(tmp_path, hostile.hostile_files(COUNT, SEED))
    outcomes = [v.split()[0] for v in found.values()]
    print({kind: outcomes.count(kind) for kind in sorted(set(outcomes))})
    assert len(outcomes) == COUNT
    assert outcomes.count("error") > COUNT / 3


def test_a_large_picture_of_one_colour_is_read_and_a_larger_one_refused_by_its_length(tmp_path):
    """21 megapixels in some kilobytes are a legitimate picture; 50 in as few are a bomb."""
    (tmp_path / "x").write_bytes(bytes(100_000))
    check_size(tmp_path / "x", 4600, 4600, 8)
    for pixel_bytes, least in ((16, 3226240), (3, 2419680)):
        with pytest.raises(InputError, match=f"expected a file of at least {least} bytes for 7100 x 7100 pixels"):
            check_size(tmp_path / "x", 7100, 7100, pixel_bytes)


@pytest.mark.parametrize(("code", "word"), [("os.abort()", "CRASH"), ("raise ValueError", "RAISED")])
def test_the_harness_sees_a_crash_and_an_exception(tmp_path, monkeypatch, code, word):
    (tmp_path / "spoilt").mkdir()
    (tmp_path / "spoilt" / "sitecustomize.py").write_text(
        "import os\nfrom raytwin.images import image_formats\nreal = image_formats.read_image\n"
        f"def broken(path):\n    if 'bad' in path.name:\n        {code}\n    return real(path)\n"
        "image_formats.read_image = broken\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "spoilt"))
    with pytest.raises(AssertionError, match=word):
        read(tmp_path, [("bad.pfm", b"Pf\n1 1\n-1\n0000")])
