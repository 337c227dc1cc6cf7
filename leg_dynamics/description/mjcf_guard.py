"""What an MJCF file may ask of MuJoCo: checked before MuJoCo sees it, whose compiler cannot be stopped."""

from __future__ import annotations

import math
import os
import posixpath
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from leg_dynamics.description.parameters import read_text
from leg_dynamics.description.xml_reader import MAX_WORD, Document, Node, read_root

__all__ = ["check_mjcf"]

# MuJoCo's time grows with the square of the bodies: these take it a second, the replicas four.
_MOST_BODIES = 2000
_MOST_REPLICAS = 10_000
_MOST_CELLS = 1 << 22
"""Of all height fields together, and pixels of all textures."""
_MOST_BYTES = 1 << 30
_MOST_ENTRIES = 100_000
_MOST_FOLDERS = 16
# MuJoCo calls itself for each file within a file, and reads a file again each time it is named.
_MOST_NESTED = 16
# Of a joint, and beyond, in a model with few joints: constraints that can bind what is not bound.
_MOST_A_JOINT = 2
_FEW = 50
_MOST_FILES = 200
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
# What the text made from the model would be refused for, where its line is no longer known.
_LARGEST = 1e100
_COMPUTED_WITH = ("pos", "fromto", "size", "mass", "diaginertia", "fullinertia", "density", "anchor", "relpose", "qpos")
_MAYBE_LARGE = re.compile(r"[eE]\+?0*[1-9]\d\d|\d{100}")
_NOT_NEGATIVE = ("armature", "damping", "frictionloss")
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
    _Guard(folder, above).check(root, document, folder, 1.0, () if path is None else (path.resolve(),))


class _Guard:
    """Counts over the model and all that it includes."""

    def __init__(self, folder: Path, above: Path) -> None:
        self.folder = folder
        self.above = posixpath.normpath(above.as_posix())
        self.bodies = 0
        self.cells = 0.0
        self.folders = {""}
        self.checked: set[tuple[str, str]] = set()
        self.trees: dict[Path, Node] = {}
        self.files = 0
        self.joints = 0.0
        self.equalities: list[Node] = []

    def check(self, root: Node, document: Document, here: Path, times: float, chain: tuple[Path, ...]) -> None:
        """The whole model, and that its constraints are not many times more than its joints."""
        self._check_model(root, document, here, times, chain)
        most = int(_MOST_A_JOINT * self.joints) + _FEW
        if len(self.equalities) > most:
            raise self.equalities[most].error(
                f"{len(self.equalities)} constraints in <equality> on {self.joints:.0f} joints, the most is {most}, "
                f"{_MOST_A_JOINT} a joint and {_FEW}: the rest can bind nothing that is not bound; delete repeated ones"
            )

    def _check_model(self, root: Node, document: Document, here: Path, times: float, chain: tuple[Path, ...]) -> None:
        """A model with all that it includes, then the models it names, as often as it attaches them.

        `here` is the model's folder, `times` how often it is attached, `chain` the files that lead to it, itself last.
        """
        parts: list[tuple[Node, float]] = []
        models: list[tuple[Node, tuple[Path, ...]]] = []
        attached: dict[str, float] = {}
        pending = [(root, here, times, chain)]
        while pending:
            tree, own, copies, trail = pending.pop()
            parts.append((tree, copies))
            for node, replicas in _replicas(tree, copies):
                self._learn_folders(node)
                if node.tag == "include":
                    for base in dict.fromkeys((here, own)):
                        self._check_places(node, base)
                    # MuJoCo looks in the model's folder first, then in that of the file which includes.
                    places = [base / node.attributes.get("file", "").replace("\\", "/") for base in (here, own)]
                    if (place := next((each for each in places if each.is_file()), None)) is not None:
                        inner = self._opened(node, place, document, trail)
                        pending.append((inner, place.parent, replicas, (*trail, place.resolve())))
                elif node.tag == "model":
                    models.append((node, trail))
                elif node.tag == "attach":
                    name = node.attributes.get("model", "")
                    attached[name] = attached.get(name, 0.0) + replicas
        for tree, copies in parts:
            for node, replicas in _replicas(tree, copies):
                _check_numbers(node)
                self._check_sizes(node, replicas)
                self._count_constraints(node, replicas)
                for base in dict.fromkeys((self.folder, here)):
                    self._check_places(node, base)
        for node, trail in models:
            place = here / node.attributes.get("file", "").replace("\\", "/")
            if place.is_file():
                # Without a name it has that of the model in it, which may be any that is attached.
                named = "name" in node.attributes
                often = attached.get(node.attributes["name"], 0.0) if named else sum(attached.values())
                inner = self._opened(node, place, document, trail)
                self._check_model(inner, document, place.parent, max(times, often), (*trail, place.resolve()))

    def _opened(self, node: Node, place: Path, document: Document, chain: tuple[Path, ...]) -> Node:
        """The root of a file that an element names, unless it leads back to one that leads to it."""
        if (found := place.resolve()) in chain:
            circle = (*chain[chain.index(found) :], found)
            raise node.error(
                f"{node.label} closes a circle of files, {' -> '.join(each.name for each in circle)}: a file cannot "
                "contain itself; delete it"
            )
        if len(chain) > _MOST_NESTED:
            raise node.error(f"files within files are nested more than {_MOST_NESTED} deep: put them into fewer files")
        self.files += 1
        if self.files > _MOST_FILES:
            raise node.error(
                f"the model is made of more than {_MOST_FILES} files, each counted as often as it is named: put them "
                "into fewer files"
            )
        if found not in self.trees:
            inner = replace(document, file=str(place))
            self.trees[found] = read_root(read_text(place, inner), inner)
        return self.trees[found]

    def _learn_folders(self, node: Node) -> None:
        if node.tag != "compiler":
            return
        self.folders |= {node.attributes[name] for name in _FOLDERS if name in node.attributes}
        if len(self.folders) > _MOST_FOLDERS:
            raise node.error(f"the model names more than {_MOST_FOLDERS} folders of files: name one of each kind")

    def _check_places(self, node: Node, base: Path) -> None:
        """Of the files that an element names, wherever MuJoCo may look for them from this folder."""
        for attribute, name in node.attributes.items():
            if not (attribute.startswith("file") or attribute in _FOLDERS) or not name.strip():
                continue
            folders = {""} if node.tag in ("include", "model", "compiler") else self.folders
            for folder in sorted(folders):
                key = (f"{base}/{folder}", name)
                if key not in self.checked:
                    self.checked.add(key)
                    self._check_place(node, attribute, name, base, folder)

    def _check_place(self, node: Node, attribute: str, name: str, base: Path, folder: str) -> None:
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

    def _count_constraints(self, node: Node, replicas: float) -> None:
        if node.tag == "equality":
            self.equalities += node.children
        elif node.tag in ("joint", "freejoint") and "joint1" not in node.attributes:
            self.joints += replicas * (6 if node.tag == "freejoint" else 1)

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


def _check_numbers(node: Node) -> None:
    """Names and numbers that MuJoCo takes and a mechanism cannot have."""
    if len(node.attributes.get("name", "")) > MAX_WORD:
        node.required("name")
    for name in _COMPUTED_WITH:
        if not _MAYBE_LARGE.search(value := node.attributes.get(name, "")):
            continue
        largest = max(map(abs, _numbers(value)), default=0.0)
        if _LARGEST < largest < math.inf:
            raise node.error(
                f"{name} of {node.label} is {largest:g}, too large to compute with, the most is {_LARGEST:g}: check "
                "the unit"
            )
    if node.tag == "joint":
        for name in _NOT_NEGATIVE:
            if (values := _numbers(node.attributes.get(name, ""))) and values[0] < 0.0:
                raise node.error(f"negative {name} {values[0]:g} of {node.label}")


def _numbers(text: str) -> list[float]:
    """The numbers of a text; none where MuJoCo will say that they are none."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


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
    numbers = _numbers(node.attributes.get(attribute, "0"))
    return math.prod(numbers) if numbers else 0.0


def _bytes(text: str) -> float:
    """A size such as 10M."""
    text = text.strip().lower()
    shift = _UNITS.get(text[-1:], 0)
    try:
        return float(text[:-1] if shift else text) * 2.0**shift
    except ValueError:
        return 0.0
