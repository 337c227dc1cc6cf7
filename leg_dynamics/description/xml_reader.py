"""XML text to a small element tree with line numbers, refusing everything that a mechanism file has no need of."""

from __future__ import annotations

import difflib
import itertools
import math
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn
from xml.parsers import expat

from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, UnsafeXmlError

__all__ = ["MAX_DEPTH", "MOST_BYTES", "Document", "Node", "nearest", "read_root"]

MOST_BYTES = 16_000_000
"""Of a file, a hundred times what a robot's has: a larger one is refused before more of it is read."""
MAX_DEPTH = 64  # URDF+ itself needs 5
# A hundred times what a robot has: beyond, a file is an attack, or a mistake that would take minutes to name.
MAX_ELEMENTS = 100_000
MAX_ATTRIBUTES = 1000
# Characters of a tag with its attributes; a mesh can be one of them.
MAX_TAG = 4_000_000
MAX_OF_A_KIND = 10_000
"""Links, joints, configurations and all else below a mechanism's root: no route takes more links."""
MAX_WORD = 4096
"""Characters of a tag or a name."""
MAX_TEXT = 65_536
# Candidates for a hint, and characters of a name that one can be given for.
_CANDIDATES = 2000
_HINTED = 200
_CHUNK = 1 << 18


def nearest(name: str, known: Iterable[str]) -> str:
    """A ``; did you mean ...?`` clause for the names closest to `name`, or an empty string."""
    if len(name) > _HINTED:
        return ""
    candidates = [each for each in itertools.islice(known, _CANDIDATES) if len(each) <= _HINTED]
    matches = difflib.get_close_matches(name, candidates, n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(map(repr, matches))}?" if matches else ""


@dataclass(frozen=True, slots=True)
class Document:
    """Where a text comes from, for its errors and warnings."""

    file: str = "<string>"
    source: str | None = None
    kind: type[DescriptionError] = DescriptionError
    overrides: str = ""
    """The parameter values that a caller gave, as `shown_overrides` says them."""
    quiet: bool = False
    """Whether all warnings were given before, of the text that this one was made from."""
    lines: Mapping[int, int] | None = None
    """For a text that was made from the file: the file's own lines by those of the text, as far as they are known."""

    def own_line(self, line: int | None) -> int | None:
        """The line of the file for one of the text, None where there is none."""
        return line if self.lines is None or line is None else self.lines.get(line)

    def _suffix(self) -> str:
        if self.lines is not None:
            return " (of the model as URDF+)"
        return f" (rendered from {self.source}{self.overrides})" if self.source else ""

    def error(
        self, message: str, line: int | None = None, *, kind: type[DescriptionError] | None = None
    ) -> DescriptionError:
        """The error to raise, naming file and line."""
        line = self.own_line(line)
        return (kind or self.kind)(f"{message}{self._suffix()}", file=self.file, line=line, source=self.source)

    def warn(self, message: str, line: int | None = None) -> None:
        """Warn, naming file and line."""
        if self.quiet:
            return
        line = self.own_line(line)
        place = self.file if line is None else f"{self.file}:{line}"
        warnings.warn(f"{place}: {message}{self._suffix()}", LegDynamicsWarning, stacklevel=2)


class Node:
    """An XML element that knows its line."""

    __slots__ = ("attributes", "children", "document", "line", "tag", "text")

    def __init__(self, tag: str, attributes: dict[str, str], line: int, document: Document) -> None:
        self.tag = tag
        self.attributes = attributes
        self.line = line
        self.document = document
        self.children: Sequence[Node] = ()
        self.text = ""

    def error(self, message: str) -> DescriptionError:
        """A DescriptionError at this element's line."""
        return self.document.error(message, self.line)

    def all(self, tag: str) -> list[Node]:
        """The children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def at_most_one(self, tag: str) -> Node | None:
        """The child of that tag, or None; an error where there are several."""
        found = None
        for child in self.children:
            if child.tag == tag:
                if found is not None:
                    raise child.error(f"{self.label} has a second <{tag}>: one is allowed")
                found = child
        return found

    def exactly_one(self, tag: str) -> Node:
        """The child of that tag; an error where there is none or several."""
        found = self.at_most_one(tag)
        if found is None:
            raise self.error(f"{self.label} has no <{tag}>")
        return found

    @property
    def label(self) -> str:
        """How messages call this element: its tag, and its name where it has one."""
        name = self.attributes.get("name")
        return f"<{self.tag}>" if name is None else f"<{self.tag}> {name[:_HINTED]!r}"

    def required(self, attribute: str) -> str:
        """A non-empty attribute's text."""
        value = self.attributes.get(attribute)
        if value is None:
            raise self.error(f"{self.label} has no {attribute}")
        if not value or value.isspace():
            raise self.error(f"{attribute} of <{self.tag}> is empty")
        if len(value) > MAX_WORD:
            raise self.error(
                f"{attribute} of <{self.tag}> has {len(value)} characters, the most is {MAX_WORD}: {value[:80]!r}..."
            )
        return value

    def number(self, attribute: str, default: float | None = None) -> float:
        """A finite decimal attribute; `default` where it is absent, and an error where there is no default."""
        if default is not None and attribute not in self.attributes:
            return default
        text = self.required(attribute)
        try:  # the usual case, quickly; whatever is odd about the text, the slow way says it
            value = float(text)
            if math.isfinite(value) and text.isascii() and "_" not in text:
                return value
        except ValueError:
            pass
        return self.parse_numbers(text, attribute, 1)[0]

    def vector(self, attribute: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Three finite decimals; `default` where the attribute is absent."""
        if attribute not in self.attributes:
            return default
        x, y, z = self.parse_numbers(self.attributes[attribute], attribute, 3)
        return x, y, z

    def parse_numbers(self, text: str, what: str, count: int) -> tuple[float, ...]:
        """`count` finite decimal numbers, separated by blanks."""
        parts = text.split()
        if len(parts) != count:
            raise self.error(
                f"{what} of <{self.tag}> must be {count} number{'s' * (count != 1)}, got {len(parts)} in {text[:80]!r}"
            )
        # float() also reads "1_0", other scripts' digits, "nan" and "inf": none of them is a URDF number.
        try:
            if not text.isascii() or "_" in text:
                raise ValueError
            values = tuple(map(float, parts))
        except ValueError:
            raise self.error(f"{what} of <{self.tag}> is not decimal: {text[:80]!r}") from None
        if not all(map(math.isfinite, values)):
            raise self.error(f"{what} of <{self.tag}> must be finite, got {text[:80]!r}")
        return values

    def walk(self) -> Iterator[Node]:
        """This element and everything in it, in document order."""
        stack = [self]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(reversed(node.children))


class _TreeBuilder:
    """The expat handlers that build the tree."""

    def __init__(self, document: Document, keep: Collection[str] | None) -> None:
        self.document = document
        self.keep = keep
        self.root: Node | None = None
        self.open: list[Node] = []
        self.skipped_depth = 0
        self.unwanted: set[str] = set()
        self.count = 0
        self.of_a_kind: dict[str, int] = {}
        self.parser = expat.ParserCreate("UTF-8")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.StartDoctypeDeclHandler = self.refuse_doctype
        # Nothing but a document type can declare these; refused again in case an expat reports them first.
        self.parser.EntityDeclHandler = self.refuse_doctype
        self.parser.ExternalEntityRefHandler = self.refuse_doctype

    def refuse_doctype(self, *_: object) -> NoReturn:
        raise self.document.error(
            "the file has a document type (DOCTYPE), which can define entities: refused; delete that declaration",
            self.parser.CurrentLineNumber,
            kind=UnsafeXmlError,
        )

    def refusal(self, problem: str) -> DescriptionError:
        """The error for what no mechanism needs, at this line."""
        return self.document.error(f"{problem}: refused", self.parser.CurrentLineNumber, kind=UnsafeXmlError)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        parents = self.open
        depth = len(parents) + self.skipped_depth
        if depth >= MAX_DEPTH:
            raise self.refusal(f"elements are nested more than {MAX_DEPTH} deep")
        if self.skipped_depth:
            self.skipped_depth += 1
            return
        unwanted = depth == 1 and self.keep is not None and tag not in self.keep
        if unwanted:
            self.skipped_depth = 1
            if tag in self.unwanted:
                return
            self.unwanted.add(tag)
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise self.refusal(f"the file has more than {MAX_ELEMENTS} elements")
        if len(tag) > MAX_WORD:
            raise self.refusal(f"a tag has {len(tag)} characters, the most is {MAX_WORD}: <{tag[:80]}...")
        if len(attributes) > MAX_ATTRIBUTES:
            raise self.refusal(f"<{tag}> has {len(attributes)} attributes, the most is {MAX_ATTRIBUTES}")
        node = Node(tag, attributes, self.parser.CurrentLineNumber, self.document)
        if self.keep is not None and tag.startswith("xacro:"):
            raise node.error(f"<{tag}> is xacro, not URDF: render it first, or name the file *.xacro")
        if depth == 0:
            self.root = node
        else:
            parent = parents[-1]
            if depth == 1 and self.keep is not None and not unwanted:
                many = self.of_a_kind[tag] = self.of_a_kind.get(tag, 0) + 1
                if many > MAX_OF_A_KIND:
                    raise self.refusal(f"the file has more than {MAX_OF_A_KIND} <{tag}> elements below its root")
            if parent.children:
                parent.children.append(node)  # type: ignore[attr-defined]
            else:
                parent.children = [node]
        if unwanted:
            return
        parents.append(node)
        if tag == "transmission":  # the only element whose text matters
            self.parser.CharacterDataHandler = self.characters

    def end(self, tag: str) -> None:
        if self.skipped_depth:
            self.skipped_depth -= 1
            return
        self.open.pop()
        if tag == "transmission":
            self.parser.CharacterDataHandler = None

    def characters(self, data: str) -> None:
        node = self.open[-1]
        node.text += data
        if len(node.text) > MAX_TEXT:
            raise self.refusal(f"the text of <{node.tag}> has more than {MAX_TEXT} characters")


def read_root(text: str, document: Document, *, keep: Collection[str] | None = None) -> Node:
    """Parse XML text into its root element.

    Parameters
    ----------
    text : str
        The whole document.
    document : Document
        Its file name, for errors.
    keep : collection of str, optional
        Tags wanted directly below the root; of each other tag the first element is returned, without its children,
        and xacro elements are refused.

    Returns
    -------
    Node
        The root element.

    Raises
    ------
    UnsafeXmlError
        For any document type declaration (and so any entity), before anything is expanded, for nesting deeper than
        `MAX_DEPTH`, and for more or longer elements than any mechanism has.
    DescriptionError
        For malformed, truncated or empty text.
    """
    text = text.removeprefix("\ufeff")
    if not text.strip():
        raise document.error("the file is empty")
    if text.startswith("\ufeff"):
        raise document.error("malformed XML: the text begins with two byte order marks; delete one", 1)
    try:
        data = text.encode()
    except UnicodeEncodeError as error:
        line = text.count("\n", 0, error.start) + 1
        raise document.error(f"the text holds a lone surrogate {text[error.start]!a}", line) from None
    if len(data) > MOST_BYTES:
        line = data.count(b"\n", 0, MOST_BYTES) + 1
        raise document.error(f"the text has {len(data)} bytes, the most is {MOST_BYTES}, which this line reaches", line)
    if (nul := data.find(b"\0")) >= 0:
        # expat would take the text for UTF-16, other readers would not.
        line = data.count(b"\n", 0, nul) + 1
        raise document.error("malformed XML: the text holds a NUL character; save it as UTF-8", line)
    builder = _TreeBuilder(document, keep)
    try:
        for start in range(0, len(data), _CHUNK):
            builder.parser.Parse(data[start : start + _CHUNK], False)
            # A tag is reported when it ends: how far the parser waits for its end.
            begun = builder.parser.CurrentByteIndex
            if start + _CHUNK - begun > MAX_TAG and data[begun + 1 : begun + 2] not in b"!?" and begun >= 0:
                line = data.count(b"\n", 0, begun) + 1
                raise document.error(f"a tag has more than {MAX_TAG} characters: refused", line, kind=UnsafeXmlError)
        builder.parser.Parse(b"", True)
    except expat.ExpatError as error:
        message = f"malformed XML: {expat.ErrorString(error.code)}"
        if builder.open:
            innermost = builder.open[-1]
            message += f", inside <{innermost.tag}> of line {innermost.line}"
            if expat.ErrorString(error.code) in (
                expat.errors.XML_ERROR_NO_ELEMENTS,
                expat.errors.XML_ERROR_UNCLOSED_TOKEN,
            ):
                message += "; the file seems truncated"
        raise document.error(message, error.lineno) from None
    finally:
        # The handlers are bound methods of the builder that holds the parser: a cycle that would keep the tree alive.
        builder.parser.StartElementHandler = builder.parser.EndElementHandler = None
    assert builder.root is not None
    return builder.root
