from __future__ import annotations

import importlib.metadata
import os
import stat
import sys
import textwrap
import warnings

import pytest

from leg_dynamics.errors import LegDynamicsWarning
from leg_dynamics.kernels import cache

KEYS = [cache.key_of(str(number)) for number in range(5)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "deep" / "cache"
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(place))
    monkeypatch.setattr(cache, "_REFUSED", set())
    return place


def test_what_was_written_is_read_again(folder):
    assert cache.read(KEYS[0]) is None
    for payload in (b"", b"a", bytes(range(256)) * 1000):
        assert cache.write(KEYS[0], payload)
        assert cache.read(KEYS[0]) == payload
    assert cache.read(KEYS[1]) is None
    assert [path.name for path in folder.iterdir()] == [KEYS[0]]


def test_folder_and_entries_are_the_owners_only(folder):
    previous = os.umask(0)
    try:
        cache.write(KEYS[0], b"x")
    finally:
        os.umask(previous)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE((folder / KEYS[0]).stat().st_mode) == 0o600


def test_where_one_part_ends_and_the_next_begins_counts():
    assert len({cache.key_of(*parts) for parts in (("ab", "c"), ("a", "bc"), ("abc",), ("abc", ""), ())}) == 5
    assert cache.key_of("a", "b") == cache.key_of(b"a", "b")


@pytest.mark.parametrize("position", [0, 3, 15, 20, 46, 47, 60, -1])
def test_a_changed_byte_is_seen_and_the_entry_removed(folder, position):
    cache.write(KEYS[0], b"some payload of many bytes")
    data = bytearray((folder / KEYS[0]).read_bytes())
    data[position] ^= 0x10
    (folder / KEYS[0]).write_bytes(data)
    assert cache.read(KEYS[0]) is None
    assert not (folder / KEYS[0]).exists()


@pytest.mark.parametrize("length", [1, 14, 15, 30, 46, 47, 50])
def test_a_truncated_entry_is_seen(folder, length):
    cache.write(KEYS[0], b"some payload of many bytes")
    (folder / KEYS[0]).write_bytes((folder / KEYS[0]).read_bytes()[:length])
    assert cache.read(KEYS[0]) is None
    assert cache.write(KEYS[0], b"new")
    assert cache.read(KEYS[0]) == b"new"


def test_an_intact_entry_under_the_name_of_another_is_seen(folder):
    for key in KEYS[:2]:
        cache.write(key, key.encode())
    (folder / KEYS[0]).replace(folder / KEYS[2])
    (folder / KEYS[1]).replace(folder / KEYS[0])
    assert cache.read(KEYS[0]) is None
    assert cache.read(KEYS[2]) is None


def test_an_empty_entry_does_not_stay(folder):
    cache.write(KEYS[0], b"payload")
    (folder / KEYS[0]).write_bytes(b"")
    assert cache.read(KEYS[0]) is None
    assert cache.write(KEYS[0], b"payload")
    assert cache.read(KEYS[0]) == b"payload"


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757, 0o1777], ids=oct)
def test_a_folder_that_others_write_to_is_not_used(folder, mode):
    """Entries are run: whoever can put one there runs code as this user."""
    cache.write(KEYS[0], b"payload")
    folder.chmod(mode)
    with pytest.warns(LegDynamicsWarning, match=rf"{folder} is not used as a cache.*mode {mode:o}.*chmod 700"):
        assert cache.read(KEYS[0]) is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cache.read(KEYS[0]) is None
        assert not cache.write(KEYS[1], b"payload")
    assert [path.name for path in folder.iterdir()] == [KEYS[0]]
    folder.chmod(0o755)
    assert cache.read(KEYS[0]) == b"payload"


def test_a_folder_of_somebody_else_is_not_used(folder, monkeypatch):
    cache.write(KEYS[0], b"payload")
    owner = folder.stat().st_uid
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    if owner == 0:  # the administrator's folder is as good as one's own
        assert cache.read(KEYS[0]) == b"payload"
        os.chown(folder, 12345, -1)
        owner = 12345
    with pytest.warns(LegDynamicsWarning, match=rf"owner {owner}"):
        assert cache.read(KEYS[0]) is None
    assert not cache.write(KEYS[1], b"payload")


def test_the_cache_is_switched_off_by_an_empty_name(monkeypatch, tmp_path):
    monkeypatch.setenv(cache.FOLDER_VARIABLE, "")
    monkeypatch.chdir(tmp_path)
    assert cache.cache_folder() is None
    assert not cache.write(KEYS[0], b"x")
    assert cache.read(KEYS[0]) is None
    assert cache.clear() == 0
    assert not list(tmp_path.iterdir())


def test_without_the_variable_it_is_the_users_cache_folder(lab, tmp_path):
    code = f"""
    import os, pathlib
    os.environ.pop({cache.FOLDER_VARIABLE!r})
    from leg_dynamics.kernels import cache
    home = pathlib.Path(os.environ["HOME"])
    assert home in cache.cache_folder().parents and cache.cache_folder().name == "leg_dynamics"
    assert cache.write("ab" * 32, b"x") and cache.read("ab" * 32) == b"x"
    """
    environment = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "caches")}
    result = lab.python(textwrap.dedent(code), **environment)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("below", ["file", "file/cache", "/proc/leg_dynamics", "/dev/null"])
def test_a_place_that_cannot_be_written_is_no_error(tmp_path, monkeypatch, below):
    (tmp_path / "file").write_text("text")
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / below))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        assert not cache.write(KEYS[0], b"x")
        assert cache.read(KEYS[0]) is None
        assert cache.clear() == 0
    assert (tmp_path / "file").read_text() == "text"


def test_a_full_disk_leaves_nothing_behind(folder, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    cache.write(KEYS[0], b"old")
    monkeypatch.setattr(os, "replace", full)
    assert not cache.write(KEYS[0], b"new")
    assert cache.read(KEYS[0]) == b"old"
    assert [path.name for path in folder.iterdir()] == [KEYS[0]]


def test_entries_unused_for_longest_go_first(folder, monkeypatch):
    for number, key in enumerate(KEYS[:4]):
        cache.write(key, bytes(1000))
        os.utime(folder / key, (1000 + number, 1000 + number))
    assert cache.read(KEYS[0]) is not None  # now the youngest
    monkeypatch.setattr(cache, "_LARGEST_FOLDER", 4000)
    cache.write(KEYS[4], bytes(1000))
    assert {path.name for path in folder.iterdir()} == {KEYS[0], KEYS[3], KEYS[4]}


def test_other_files_in_the_folder_are_never_touched(folder, monkeypatch):
    """The variable may name a folder that holds other things, a home for example."""
    folder.mkdir(parents=True, mode=0o700)
    others = [folder / name for name in ("thesis.tex", ".profile", "a" * 64 + ".txt", "A" * 64, "b" * 63)]
    for path in others:
        path.write_bytes(bytes(5000))
        os.utime(path, (1, 1))
    (folder / ("c" * 64)).mkdir()
    monkeypatch.setattr(cache, "_LARGEST_FOLDER", 1500)
    cache.write(KEYS[0], bytes(1000))
    os.utime(folder / KEYS[0], (10, 10))
    cache.write(KEYS[1], bytes(1000))
    assert {path.name for path in folder.iterdir() if path.is_file()} == {KEYS[1], *(path.name for path in others)}
    assert cache.clear() == 1
    assert {path.name for path in folder.iterdir() if path.is_file()} == {path.name for path in others}


def test_what_an_interrupted_process_left_is_cleared(folder):
    cache.write(KEYS[0], b"x")
    (folder / ".leg_dynamics-abc").write_bytes(b"half")
    assert cache.clear() == 2
    assert not list(folder.iterdir())


def test_the_fingerprint_of_a_package_follows_every_file(lab, tmp_path):
    package = tmp_path / "fresh"
    (package / "inner").mkdir(parents=True)
    files = [package / "__init__.py", package / "inner" / "__init__.py", package / "inner" / "deep.py"]
    for file in files:
        file.write_text("")
    (tmp_path / "single.py").write_text("")

    def fingerprint(name="fresh"):
        code = f"from leg_dynamics.kernels.cache import source_fingerprint; print(source_fingerprint({name!r}))"
        result = lab.python(
            code, PYTHONPATH=os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
        )
        assert result.returncode == 0, result.stderr
        return result.stdout

    seen = {fingerprint()}
    assert fingerprint() in seen
    files[2].write_text("x = 1")
    seen.add(fingerprint())
    files[2].rename(package / "deeper.py")
    seen.add(fingerprint())
    assert len(seen) == 3
    alone = fingerprint("single")
    (tmp_path / "single.py").write_text("y = 2")
    assert fingerprint("single") != alone
    with pytest.raises(ModuleNotFoundError):
        cache.source_fingerprint("leg_dynamics_of_nobody")


@pytest.mark.parametrize("name", ["casadi", "llvmlite", "numpy", "scipy"])
def test_versions_of_packages(name):
    assert cache.package_version.__wrapped__(name) == importlib.metadata.version(name)


@pytest.mark.parametrize("folders", [[], ["first-1.0.dist-info"], ["made-1.0.dist-info", "made-2.0.dist-info"]])
def test_version_of_a_package_without_metadata(monkeypatch, tmp_path, folders):
    package = tmp_path / "made"
    package.mkdir()
    (package / "__init__.py").write_text("__version__ = '2.0+own'\n")
    for folder in folders:
        (tmp_path / folder).mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert cache.package_version.__wrapped__("made") == "2.0+own"
    monkeypatch.delitem(sys.modules, "made")
