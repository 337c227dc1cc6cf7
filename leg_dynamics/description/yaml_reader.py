"""YAML files as nodes that know their line: plain data, reading one runs no code from it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from leg_dynamics.description.parameters import read_text
from leg_dynamics.description.xml_reader import MAX_DEPTH, Document, nearest
from leg_dynamics.errors import DescriptionError

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Entry", "compose"]

# A hundred times what a robot of many modules needs.
_MOST_CHARACTERS = 1_000_000
_MOST_BYTES = 4 * _MOST_CHARACTERS


class Entry:
    """A node of the file that knows its line and what it is called, and `evidence` for its errors and its entries'."""

    def __init__(self, node: Any, file: str, label: str, **evidence: Any) -> None:
        self.node = node
        self.file = file
        self.label = label
        self.evidence = evidence

    def about(self, **evidence: Any) -> Self:
        """The same node, whose errors carry this evidence too."""
        return type(self)(self.node, self.file, self.label, **self.evidence | evidence)

    @property
    def line(self) -> int:
        """Line of the file, from 1."""
        return int(self.node.start_mark.line) + 1

    def error(self, message: str, **evidence: Any) -> DescriptionError:
        """The error to raise, at this line."""
        return DescriptionError(message, file=self.file, line=self.line, **self.evidence | evidence)

    def mapping(self, allowed: Iterable[str] | None = None, required: Iterable[str] = ()) -> dict[str, Self]:
        """The entries of a mapping by key; of these keys only, where they are given."""
        if self.node.id != "mapping":
            raise self.error(f"{self.label} must be a mapping, such as {{key: value}}, got {self.shown()}")
        found: dict[str, Self] = {}
        for key_node, value in self.node.value:
            key = type(self)(key_node, self.file, f"a key of {self.label}", **self.evidence)
            name = key.text()
            if allowed is not None and name not in allowed:
                known = tuple(allowed)
                raise key.error(
                    f"{self.label} has an unknown key {name!r}{nearest(name, known)} (it may have {', '.join(known)})",
                    name=name,
                )
            if name in found:
                raise key.error(
                    f"{self.label} names {name!r} twice: the first is on line {found[name].line}", name=name
                )
            label = f"{name} of {self.label}" if self.label != "the file" else name
            found[name] = type(self)(value, self.file, label, **self.evidence)
        for name in required:
            if name not in found:
                raise self.error(f"{self.label} has no {name!r}, which it needs", name=name)
        return found

    def sequence(self, count: int | None = None) -> list[Self]:
        """The entries of a list; of so many, where a count is given."""
        if self.node.id != "sequence" or (count is not None and len(self.node.value) != count):
            many = "" if count is None else f" of {count}"
            raise self.error(f"{self.label} must be a list{many}, such as [a, b], got {self.shown()}")
        return [
            type(self)(node, self.file, f"entry {i} of {self.label}", **self.evidence)
            for i, node in enumerate(self.node.value, 1)
        ]

    def value(self) -> Any:
        """A single value as YAML understands it."""
        import yaml

        if self.node.id != "scalar":
            raise self.error(f"{self.label} must be one value, got {self.shown()}")
        try:
            return yaml.constructor.SafeConstructor().construct_object(self.node)
        except (ValueError, yaml.YAMLError) as error:
            raise self.error(f"{self.label} is not readable: {self.shown()}") from error

    def text(self) -> str:
        """A single value as it is written."""
        if self.node.id != "scalar" or not self.node.value.strip():
            raise self.error(f"{self.label} must be text, got {self.shown()}")
        return str(self.node.value)

    def number(self) -> float:
        """A finite number."""
        value = self.value()
        if isinstance(value, bool) or not isinstance(value, int | float):
            hint = "; YAML reads 1e-3 as text, write 1.0e-3" if "e" in str(value).lower() else ""
            raise self.error(f"{self.label} must be a number, got {self.shown()}{hint}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error(f"{self.label} must be a finite number, got {self.shown()}")
        return number

    def flag(self) -> bool:
        """True or false."""
        value = self.value()
        if not isinstance(value, bool):
            raise self.error(f"{self.label} must be true or false, got {self.shown()}")
        return value

    def choice(self, known: tuple[str, ...], **evidence: Any) -> str:
        """One of the known words."""
        text = self.text()
        if text not in known:
            raise self.error(
                f"{self.label} must be one of {', '.join(known)}, got {text!r}{nearest(text, known)}", **evidence
            )
        return text

    def shown(self) -> str:
        """The node in an error's words."""
        return repr(str(self.node.value)[:60]) if self.node.id == "scalar" else f"a {self.node.id}"


def compose(path: Path, contents: str) -> Any:
    """The root node of a file that should hold `contents`, in words for errors."""
    import yaml

    document = Document(str(path))
    text = read_text(path, document, _MOST_BYTES)
    if len(text) > _MOST_CHARACTERS:
        raise document.error(
            f"the file has {len(text)} characters, the most is {_MOST_CHARACTERS}, which this line reaches, for "
            f"{contents}",
            text.count("\n", 0, _MOST_CHARACTERS) + 1,
        )
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        # Composing calls itself for each level and overflows the stack: the events come one by one.
        depth = 0
        for event in yaml.parse(text, Loader=loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                line = event.start_mark.line + 1
                raise document.error(f"values are nested too deep for {contents}: more than {MAX_DEPTH} levels", line)
        node = yaml.compose(text, Loader=loader)
    except RecursionError:
        raise document.error(f"values are nested too deep for {contents}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = None if mark is None else mark.line + 1
        if isinstance(error, yaml.reader.ReaderError):
            line = text.count("\n", 0, error.position) + 1
            raise document.error(f"malformed YAML: {error.reason}", line) from None
        raise document.error(f"malformed YAML: {getattr(error, 'problem', None) or error}", line) from None
    if node is None:
        raise document.error(f"the file is empty: it should hold {contents}", 1)
    return node
