"""What an MJCF file may ask of MuJoCo: checked before MuJoCo sees it, whose compiler cannot be stopped."""

from __future__ import annotations

import math
import os
import posixpath
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from leg_dynamics.description.parameters import read_text
from leg_dynamics.description.xml_reader import Document, Node, read_root

__all__ = ["check_mjcf"]

# MuJoCo's time grows with the square of the bodies: these take it a second, the replicas four.
_MOST_BODIES = 2000
_MOST_REPLICAS = 10_000
_MOST_CELLS = 1 << 22
"""Of all height fields together, and pixels of all textures."""
_MOST_BYTES = 1 << 30
_MOST_ENTRIES = 100_000
_MOST_FOLDERS = 16
_UNITS = {"k": 10, "m": 20, "g": 30, "t": 40, "p": 50, "e": 60}
# Attributes that are sizes, by element; a product counts where there are several numbers.
_SIZES = {
    "size": ("njmax", "nconmax", "nstack", "nuserdata"),
    "composite": ("count",),
    "flexcomp": ("count",),
    "user": ("dim",),
    "general": ("actdim", "nsample"),
    "plugin": ("actdim",),
}
_FOLDERS = ("meshdir", "texturedir", "assetdir")


def check_mjcf(root: Node, document: Document, path: Path | None) -> None:
    """Refuse a model that would take MuJoCo minutes or gigabytes, or have it open files elsewhere.

    Files may lie in the model's folder, what is in it, and in the folder above (``mjcf`` beside ``meshes``).

    Parameters
    ----------
    root : Node
        The model.
    document : Document
        Its name, for errors.
    path : pathlib.Path, optional
        Where it lies; without it, in the current folder, where MuJoCo looks, and only there.

    Raises
    ------
    DescriptionError
        For the first thing found, with the file and line where it is said.
    UnsafeXmlError
        For an included file that `read_root` refuses.
    """
    folder = Path.cwd() if path is None else path.absolute().parent
    above = folder if path is None or folder.parent == folder.parent.parent else folder.parent
    _Guard(folder, above).check(root, document)


class _Guard:
    """Counts over the model and all that it includes."""

    def __init__(self, folder: Path, above: Path) -> None:
        self.folder = folder
        self.above = posixpath.normpath(above.as_posix())
        self.bodies = 0
        self.cells = 0.0
        self.folders = {""}
        self.checked: set[tuple[str, str]] = set()
        self.included: set[Path] = set()

    def check(self, root: Node, document: Document) -> None:
        pending = [(root, document, self.folder, 1.0)]
        while pending:
            tree, own, here, times = pending.pop()
            for node in tree.walk():
                self._learn_folders(node)
            for node, replicas in _replicas(tree, times):
                self._check_sizes(node, replicas)
                for place in self._files(node, here):
                    if node.tag not in ("include", "model") or not place.is_file() or place in self.included:
                        continue
                    self.included.add(place)
                    inner = replace(own, file=str(place))
                    found = read_root(read_text(place, inner), inner)
                    pending.append((found, inner, place.parent if node.tag == "model" else here, replicas))

    def _learn_folders(self, node: Node) -> None:
        if node.tag != "compiler":
            return
        self.folders |= {node.attributes[name] for name in _FOLDERS if name in node.attributes}
        if len(self.folders) > _MOST_FOLDERS:
            raise node.error(f"the model names more than {_MOST_FOLDERS} folders of files: name one of each kind")

    def _files(self, node: Node, here: Path) -> Iterator[Path]:
        """Where MuJoCo may look for the files that an element names."""
        for attribute, name in node.attributes.items():
            if not (attribute.startswith("file") or attribute in _FOLDERS) or not name.strip():
                continue
            folders = {""} if node.tag in ("include", "model", "compiler") else self.folders
            for base in dict.fromkeys((self.folder, here)):
                for folder in sorted(folders):
                    key = (f"{base}/{folder}", name)
                    if key not in self.checked:
                        self.checked.add(key)
                        yield self._place(node, attribute, name, base, folder)

    def _place(self, node: Node, attribute: str, name: str, base: Path, folder: str) -> Path:
        parts = (part.replace("\\", "/") for part in (base.as_posix(), folder, name))
        place = posixpath.normpath(posixpath.join(*parts))
        if not f"{place}/".startswith(f"{self.above.rstrip('/')}/"):
            raise node.error(
                f"{attribute} {name[:80]!r} of {node.label} is outside {self.above}: put the file into the model's "
                "folder and name it from there"
            )
        found = Path(place)
        if os.path.exists(place) and not (found.is_file() or found.is_dir()):
            raise node.error(f"{attribute} {name[:80]!r} of {node.label} is no regular file")
        return found

    def _check_sizes(self, node: Node, replicas: float) -> None:
        if replicas > _MOST_REPLICAS:
            raise node.error(
                f"{node.label} stands for {replicas:.6g} copies, nested replicas multiplied, the most is "
                f"{_MOST_REPLICAS}: lower the count of <replicate>"
            )
        if node.tag == "body":
            self.bodies += int(replicas)
            if self.bodies > _MOST_BODIES:
                raise node.error(
                    f"the model has more than {_MOST_BODIES} bodies, replicas counted: model a part of the mechanism"
                )
        for rows, columns in (("nrow", "ncol"), ("width", "height")):
            if rows in node.attributes:
                sides = 1 if node.tag == "hfield" or node.attributes.get("type") == "2d" else 6
                self.cells += _product(node, rows) * max(1.0, _product(node, columns)) * sides
        if self.cells > _MOST_CELLS * 6:
            raise node.error(
                f"height fields and textures up to {node.label} have {self.cells:.6g} cells (a cube six sides), the "
                f"most is {_MOST_CELLS * 6}: lower its "
                + ("nrow and ncol" if node.tag == "hfield" else "width and height")
            )
        names = [name for name in node.attributes if name in _SIZES.get(node.tag, ())]
        if node.tag == "size":
            names += [name for name in node.attributes if name.startswith("nuser_") or name == "nkey"]
        for name in names:
            most = 1000 if name == "nkey" or name.startswith("nuser_") else _MOST_ENTRIES
            if (value := _product(node, name)) > most:
                raise node.error(f"{name} of {node.label} is {value:.6g}, the most is {most}: lower it, or delete it")
        if node.tag == "size" and (value := _bytes(node.attributes.get("memory", ""))) > _MOST_BYTES:
            raise node.error(f"memory of {node.label} is {value:.6g} bytes, the most is {_MOST_BYTES}: delete it")


def _replicas(tree: Node, times: float) -> Iterator[tuple[Node, float]]:
    """Every element, and how many copies of it nested replicas make."""
    pending = [(tree, times)]
    while pending:
        node, copies = pending.pop()
        if node.tag == "replicate":
            copies *= max(1.0, _product(node, "count"))
        yield node, copies
        pending.extend((child, copies) for child in reversed(node.children))


def _product(node: Node, attribute: str) -> float:
    """The product of an attribute's numbers; zero where MuJoCo will say that they are none."""
    try:
        return math.prod(map(float, node.attributes.get(attribute, "0").split()))
    except ValueError:
        return 0.0


def _bytes(text: str) -> float:
    """A size such as 10M."""
    text = text.strip().lower()
    shift = _UNITS.get(text[-1:], 0)
    try:
        return float(text[:-1] if shift else text) * 2.0**shift
    except ValueError:
        return 0.0
