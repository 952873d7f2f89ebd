"""A submission's folders: what is copied, what is too much, and that all of it goes."""

import os
from pathlib import Path

import pytest
from attacks import goes

from raytwin.errors import InputError
from raytwin.teach.sandbox import work_folder
from raytwin.teach.sandbox.work_folder import copy_files, excess, remove

pytestmark = pytest.mark.skipif(os.name != "posix", reason="tries what POSIX has")


def nested(folder: Path, depth: int) -> None:
    home = os.open(".", os.O_RDONLY)
    try:
        os.chdir(folder)
        for _ in range(depth):
            Path("d").mkdir()
            os.chdir("d")
        Path("deepest").write_text("x")
    finally:
        os.fchdir(home)
        os.close(home)


def test_a_folder_is_removed_however_deep_whatever_its_rights_and_links_in_it_are_not_followed(tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "mine").write_text("mine")
    folder = tmp_path / "work"
    for i in range(3):
        (folder / str(i) / "a" / "b").mkdir(parents=True)
        (folder / str(i) / "file").write_text("x")
        (folder / str(i) / "link").symlink_to(tmp_path / "outside")
    (folder / "link").symlink_to(tmp_path / "outside")
    (folder / "broken").symlink_to(tmp_path / "nowhere")
    os.mkfifo(folder / "pipe")
    nested(folder, 2100)  # longer than any path may be
    (folder / "1" / "a").chmod(0)
    (folder / "2").chmod(0o500)
    remove(folder)
    assert goes(folder)
    assert (tmp_path / "outside" / "mine").read_text() == "mine"
    remove(folder)  # which is gone


def test_what_is_too_much_is_said_and_links_are_not_followed(tmp_path, monkeypatch):
    (tmp_path / "large").write_bytes(bytes(3_000_000))
    work = tmp_path / "work"
    (work / "a").mkdir(parents=True)
    (work / "a" / "b").write_bytes(bytes(300_000))
    (work / "a" / "link").symlink_to(tmp_path / "large")
    (work / "up").symlink_to(tmp_path)
    assert excess(work, 400_000) == ""
    assert excess(work, 250_000) == "it wrote more than 0 MB: ended"
    (work / "c").write_bytes(bytes(2_000_000))
    assert excess(work, 2_000_000) == "it wrote more than 2 MB: ended"
    monkeypatch.setattr(work_folder, "MOST_FILES", 5)
    assert excess(work, 4_000_000) == ""
    monkeypatch.setattr(work_folder, "MOST_FILES", 4)
    assert excess(work, 4_000_000) == "it wrote more than 10 000 files: ended"


def test_a_copy_has_the_files_without_links_devices_and_hidden_folders_up_to_a_limit(tmp_path, monkeypatch):
    folder = tmp_path / "in"
    (folder / "sub" / "deeper").mkdir(parents=True)
    (folder / ".git").mkdir()
    (folder / ".git" / "config").write_text("x")
    (folder / "run").write_text("#!")
    (folder / "run").chmod(0o711)
    (folder / "sub" / "deeper" / "data").write_bytes(b"\0\1")
    (folder / "sub" / "deeper" / "data").chmod(0o600)
    (folder / "link").symlink_to("/etc/passwd")
    (folder / "folder-link").symlink_to("/etc")
    os.mkfifo(folder / "pipe")
    (tmp_path / "to").mkdir()
    copy_files(folder, tmp_path / "to", 1000)
    found = {str(p.relative_to(tmp_path / "to")) for p in (tmp_path / "to").rglob("*")}
    assert found == {"run", "sub", "sub/deeper", "sub/deeper/data"}
    assert (tmp_path / "to" / "sub" / "deeper" / "data").read_bytes() == b"\0\1"
    assert [oct((tmp_path / "to" / p).stat().st_mode & 0o777) for p in ("run", "sub/deeper/data")] == ["0o755", "0o644"]
    copy_files(folder, tmp_path / "to", 4)
    with pytest.raises(InputError, match="in: expected a submission of at most 0 MB and 10 000 files"):
        copy_files(folder, tmp_path / "to", 3)
    monkeypatch.setattr(work_folder, "MOST_FILES", 3)
    with pytest.raises(InputError):
        copy_files(folder, tmp_path / "to", 1000)
