"""Files that commands write: refused before the computation, put in place in one step."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from leg_dynamics.errors import OutputError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a loop of symbolic links"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a character device"),
    (stat.S_ISBLK, "a block device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_writable(path: Path | None) -> Path | None:
    """Refuse an output path before the computation, not after it; return the file behind a symbolic link."""
    if path is None:
        return None
    try:
        return _output_target(path)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}", path=str(path)) from error


def check_folder(folder: Path, files: Iterable[Path] = ()) -> None:
    """Refuse a folder that is not one and cannot be made, by what stands in its place, and files that cannot be."""
    for place in (*reversed(folder.parents), folder):
        if place.is_dir() or not os.path.lexists(place):
            continue
        if place.is_symlink():
            what = f"a link to {os.readlink(place)}, which is no folder"
        else:
            what = next((kind for test, kind in _KINDS if test(place.lstat().st_mode)), "a file")
        raise OutputError(f"{place} is {what}, but a folder is needed there; move it or name another", path=str(place))
    for file in files:
        # What is not there yet comes with its folder.
        if file.is_dir():
            raise OutputError(
                f"{file} is a folder, but a file is written there; move it or name another", path=str(file)
            )
        if os.path.lexists(file):
            check_writable(file)


def _output_target(path: Path) -> Path:
    # Only a regular file may be replaced: anything else would be destroyed by it.
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    place = f"{path}" if target == path else f"{path} (a link to {target})"
    check_folder(target.parent)
    if not target.parent.is_dir():
        raise OutputError(f"the folder {target.parent} of {target.name} does not exist; make it first", path=str(path))
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return target
    if not stat.S_ISREG(mode):
        kind = next((kind for test, kind in _KINDS if test(mode)), "not a regular file")
        raise OutputError(f"{place} is {kind}; name a file", path=str(path))
    # The bits too, because root may write everything.
    if not (mode & 0o222 and os.access(target, os.W_OK)):
        raise OutputError(
            f"{place} is write-protected (mode {stat.S_IMODE(mode):o}); name another file or allow writing",
            path=str(path),
        )
    return target


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside the target, then put it in place in one step."""
    target = check_writable(path)
    assert target is not None
    temporary: Path | None = None
    try:
        descriptor, name = tempfile.mkstemp(dir=target.parent, prefix=f".{path.stem}.", suffix=path.suffix)
        os.close(descriptor)
        temporary = Path(name)
        write(temporary)
        # mkstemp's files are private; a result keeps the permissions of the old file, or gets those of any new one.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~mask)
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}", path=str(path)) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
