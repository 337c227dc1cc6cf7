"""Where the shipped mechanisms are: beside the package in a checkout, inside it in a wheel."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from leg_dynamics.description.xml_reader import nearest
from leg_dynamics.errors import LegNotFoundError

__all__ = ["existing_file", "shipped_folder", "shipped_names", "shipped_urdf", "shipped_xacro"]

_PACKAGE = Path(__file__).resolve().parents[1]
_XACRO_SUFFIX = ".urdf.xacro"
_ASSEMBLY_SUFFIX = ".yaml"


def shipped_folder(name: str) -> Path:
    """The folder ``xacro`` or ``urdf``; in a wheel the folder beside the package is somebody else's."""
    packaged = _PACKAGE / "_data"
    return (packaged if packaged.is_dir() else _PACKAGE.parent) / name


def shipped_names() -> tuple[str, ...]:
    """Names of the shipped mechanisms, sorted.

    Returns
    -------
    tuple of str
        The stems of ``urdf/*.urdf``.
    """
    return tuple(sorted(path.stem for path in shipped_folder("urdf").glob("*.urdf")))


def _shipped_sources() -> dict[str, Path]:
    """What the shipped files are rendered from, by name: xacro files and assemblies of modules."""
    folder = shipped_folder("xacro")
    found = {path.name.removesuffix(_XACRO_SUFFIX): path for path in folder.glob(f"*{_XACRO_SUFFIX}")}
    found |= {path.stem: path for path in (folder / "assemblies").glob(f"*{_ASSEMBLY_SUFFIX}")}
    return dict(sorted(found.items()))


def _require(name: str, known: Iterable[str]) -> None:
    known = tuple(known)
    if name not in known:
        raise LegNotFoundError(
            f"there is no shipped mechanism {name[:80]!r}{nearest(name[:80], known)} "
            f"(shipped: {', '.join(known) or 'none'}; a file needs its suffix .urdf, .xacro or .yaml)",
            name=name,
            known=known,
        )


def shipped_urdf(name: str) -> Path:
    """Path of a shipped mechanism's URDF+ file.

    Parameters
    ----------
    name : str
        One of `shipped_names`.

    Returns
    -------
    pathlib.Path
        An existing file.

    Raises
    ------
    LegNotFoundError
        For any other name; lists the names, nearest first.
    """
    _require(name, shipped_names())
    return shipped_folder("urdf") / f"{name}.urdf"


def shipped_xacro(name: str) -> Path:
    """Path of a shipped mechanism's source: a xacro file, or an assembly of modules.

    Parameters
    ----------
    name : str
        One of `shipped_names`.

    Returns
    -------
    pathlib.Path
        An existing file.

    Raises
    ------
    LegNotFoundError
        For any other name; lists the names, nearest first.
    """
    sources = _shipped_sources()
    _require(name, sources)
    return sources[name]


def existing_file(source: str | os.PathLike[str]) -> Path | None:
    """The file that `source` means, or None where it reads like a shipped name.

    Parameters
    ----------
    source : str or path-like
        A path object, a path with a folder or a suffix in it, or a bare name.

    Returns
    -------
    pathlib.Path or None
        An existing file.

    Raises
    ------
    LegNotFoundError
        Where it reads like a path and no file is there.
    """
    text = os.fspath(source)
    looks_like_path = not isinstance(source, str) or os.path.dirname(text) or os.path.splitext(text)[1]
    if not looks_like_path and (text in shipped_names() or text in _shipped_sources()):
        return None
    if os.path.isfile(text):
        return Path(text)
    if looks_like_path:
        reason = "no such file"
        if os.path.exists(text):
            reason = "it is a folder" if os.path.isdir(text) else "it is not a regular file, but a pipe or a device"
        raise LegNotFoundError(
            f"cannot read {text[:200]!r}: {reason} (shipped: {', '.join(shipped_names()) or 'none'})",
            name=text,
            known=shipped_names(),
        )
    return None
