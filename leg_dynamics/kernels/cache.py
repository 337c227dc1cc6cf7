"""Files in the user's cache folder, found by everything that went into them, whole or not at all.

Entries are native code and data of this user's own processes. Whoever can write into the folder can run code in them,
so it is made accessible to its owner only, and one that others can write into is not used. It may be deleted at any
time.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import importlib.util
import os
import re
import tempfile
import warnings
from collections.abc import Iterable
from pathlib import Path

from leg_dynamics.errors import LegDynamicsWarning

__all__ = [
    "FOLDER_VARIABLE",
    "cache_folder",
    "clear",
    "key_of",
    "package_version",
    "read",
    "source_fingerprint",
    "write",
]

FOLDER_VARIABLE = "LEG_DYNAMICS_CACHE"
"""Environment variable that names another folder; an empty value switches the cache off."""

_MAGIC = b"leg_dynamics 2\n"
_DIGEST = hashlib.sha256().digest_size
# Beyond that size the entries that were not used for longest go.
_LARGEST_FOLDER = 256 * 2**20
_TEMPORARY = ".leg_dynamics-"
# Whatever else lies in the folder is somebody else's.
_OURS = rf"[0-9a-f]{{{2 * _DIGEST}}}|{re.escape(_TEMPORARY)}.*"
_REFUSED: set[Path] = set()


def cache_folder() -> Path | None:
    """Return the folder, which may not exist yet; None where the cache is switched off."""
    chosen = os.environ.get(FOLDER_VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    return _default_folder()


@functools.cache
def _default_folder() -> Path | None:
    import platformdirs

    try:
        return Path(platformdirs.user_cache_dir("leg_dynamics", appauthor=False))
    except RuntimeError:  # no home
        return None


def key_of(*parts: str | bytes) -> str:
    """Digest of a sequence of texts; where one ends and the next begins counts."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


@functools.cache
def source_fingerprint(package: str) -> str:
    """Digest of every source file of a package: changed code never meets what older code has stored.

    Parameters
    ----------
    package : str
        Importable name, for example ``"leg_dynamics.kernels"``.
    """
    spec = importlib.util.find_spec(package)
    if spec is None:
        raise ModuleNotFoundError(package)
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    files: Iterable[Path] = sorted(path for folder in folders for path in folder.rglob("*.py"))
    if not folders and spec.origin is not None:
        files = [Path(spec.origin)]
    return key_of(*(part for path in files for part in (path.name, path.read_bytes())))


@functools.cache
def package_version(name: str) -> str:
    """Version of an installed package, as a rule without importing it.

    `importlib.metadata` would bring the e-mail package with it, which costs more than loading a kernel does.
    """
    spec = importlib.util.find_spec(name)
    if spec is not None and spec.origin is not None:
        folder = Path(spec.origin).parents[1]
        # Remains of another version leave two.
        if len(found := list(folder.glob(f"{name}-*.dist-info"))) == 1:
            return found[0].name.removeprefix(f"{name}-").removesuffix(".dist-info")
    return str(importlib.import_module(name).__version__)


def _seal(key: str, payload: bytes) -> bytes:
    """Digest of an entry; an intact one under another's name is as good as damaged."""
    return hashlib.sha256(key.encode() + payload).digest()


def read(key: str) -> bytes | None:
    """Content of an entry; None where there is none, or where it is damaged."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / key
    try:
        data = path.read_bytes() if _is_private(folder) else b""
    except OSError:
        return None
    if not data:
        return None
    start = len(_MAGIC) + _DIGEST
    payload = data[start:]
    if not data.startswith(_MAGIC) or _seal(key, payload) != data[len(_MAGIC) : start]:
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return payload


def write(key: str, payload: bytes) -> bool:
    """Store an entry at once or not at all; whether it was stored. A folder that cannot be written to is no error."""
    folder = cache_folder()
    if folder is None:
        return False
    temporary: str | None = None
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(folder):
            return False
        descriptor, temporary = tempfile.mkstemp(dir=folder, prefix=_TEMPORARY)
        with os.fdopen(descriptor, "wb") as file:
            file.write(_MAGIC + _seal(key, payload) + payload)
        os.replace(temporary, folder / key)
    except OSError:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    _trim(folder)
    return True


def _is_private(folder: Path) -> bool:
    """Whether nobody but this user and the administrator can write into a folder; a warning, once, where others can."""
    if not hasattr(os, "geteuid"):
        return True
    status = folder.stat()
    if status.st_uid in (0, os.geteuid()) and not status.st_mode & 0o022:
        return True
    if folder not in _REFUSED:
        _REFUSED.add(folder)
        warnings.warn(
            f"{folder} is not used as a cache, because other users can write into it (owner {status.st_uid}, mode "
            f"{status.st_mode & 0o7777:o}) and its entries are run: make it this user's own and chmod 700 it, or name "
            f"another in {FOLDER_VARIABLE}",
            LegDynamicsWarning,
            stacklevel=3,
        )
    return False


def _entries(folder: Path) -> list[tuple[float, int, Path]]:
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if re.fullmatch(_OURS, entry.name) and entry.is_file(follow_symlinks=False):
                    status = entry.stat()
                    found.append((status.st_mtime, status.st_size, Path(entry.path)))
    return sorted(found)


def _trim(folder: Path) -> None:
    entries = _entries(folder)
    excess = sum(size for _, size, _ in entries) - _LARGEST_FOLDER
    for _, size, path in entries:
        if excess <= 0:
            return
        with contextlib.suppress(OSError):
            path.unlink()
            excess -= size


def clear() -> int:
    """Delete every entry; how many there were."""
    folder = cache_folder()
    entries = [] if folder is None else _entries(folder)
    for _, _, path in entries:
        with contextlib.suppress(OSError):
            path.unlink()
    return len(entries)
