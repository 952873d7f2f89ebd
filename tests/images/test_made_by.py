"""The hash of what computes: it changes with every byte of the source named, with a package's version, with no more."""

from importlib import metadata

from raytwin.images.cache import installed, made_by


def test_other_source_another_name_or_another_version_is_another_hash_and_nothing_else_is(tmp_path, monkeypatch):
    room, lone = tmp_path / "room", tmp_path / "lone.py"
    (room / "deep").mkdir(parents=True)
    for file in (lone, room / "a.py", room / "deep" / "b.py", room / "notes.txt"):
        file.write_text(f"# {file.name}\n")

    def fresh(packages=("numpy", "a-package-that-no-one-has")):
        made_by.cache_clear()
        return made_by((room, lone), packages)

    known = [fresh()]
    (room / "notes.txt").write_text("other notes")
    (tmp_path / "beside.py").write_text("")
    assert fresh() == known[0]
    for change in (
        lambda: lone.write_text("x = 1\n"),
        lambda: (room / "deep" / "b.py").write_text("x = 1\n"),
        lambda: (room / "a.py").rename(room / "c.py"),
        lambda: (room / "empty.py").write_text(""),
        lambda: monkeypatch.setattr(metadata, "version", lambda name: "another"),
    ):
        change()
        known.append(fresh())
    known.append(fresh(("numpy",)))
    assert len(set(known)) == len(known)


def test_packages_that_are_not_installed_are_left_out():
    assert set(installed(("numpy", "a-package-that-no-one-has"))) == {"python", "numpy"}
