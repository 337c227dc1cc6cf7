"""Named design parameters: the YAML files beside a xacro source, the arguments it declares, and new values for both.

A parameter's entry may say which values are possible, by a number or by a sum or product of other parameters:

    rod_diameter: {value: 0.03, unit: m, above: 0, most: "sleeve_diameter - 2*sleeve_wall"}

`above` and `below` exclude the bound itself, `least` and `most` include it.
"""

from __future__ import annotations

import ast
import codecs
import math
import operator
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

from leg_dynamics.description.model import Parameter
from leg_dynamics.description.xml_reader import MOST_BYTES, Document, Node, nearest, read_root
from leg_dynamics.errors import ParameterError, RenderError

__all__ = [
    "Bound",
    "Overrides",
    "check_bounds",
    "checked_values",
    "declared_arguments",
    "load_parameters",
    "parameter_bounds",
    "parameters_files",
    "parameters_of",
    "read_text",
    "shown_overrides",
]

_ARGUMENT = "parameters"  # the xacro argument that names the YAML files
_APART = ";"


_RELATIONS: dict[str, tuple[str, Callable[[float, float], bool], float]] = {
    "above": ("greater than", operator.gt, 1.0),
    "least": ("at least", operator.ge, 1.0),
    "most": ("at most", operator.le, -1.0),
    "below": ("less than", operator.lt, -1.0),
}
"""In words, as a comparison of value and bound, and on which side of the bound the value is."""

_ROUNDING = 1e-12
"""Relative: a bound that is a sum of parameters, in decimals, is met by the value that the sum has on paper."""

_OPERATIONS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


@dataclass(frozen=True)
class Bound:
    """A limit that a parameters file sets to a parameter.

    Attributes
    ----------
    parameter : str
    relation : str
        ``above``, ``least``, ``most`` or ``below``.
    limit : str
        A number, or an expression of parameters with + - * / and brackets.
    place : str
        File and line.
    """

    parameter: str
    relation: str
    limit: str
    place: str

    @property
    def names(self) -> frozenset[str]:
        """Every parameter that has a say."""
        return frozenset({self.parameter, *(n.id for n in ast.walk(self._tree()) if isinstance(n, ast.Name))})

    def _tree(self) -> ast.expr:
        return ast.parse(self.limit, mode="eval").body

    def value(self, values: Mapping[str, float]) -> float:
        """The limit for the values of all parameters.

        Raises
        ------
        ParameterError
            The expression is none, or names what is no parameter.
        """

        def evaluated(node: ast.expr) -> float:
            if isinstance(node, ast.Constant) and _is_finite_number(node.value):
                return float(node.value)  # type: ignore[arg-type]
            if isinstance(node, ast.Name) and node.id in values:
                return values[node.id]
            if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                return -evaluated(node.operand)
            if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
                return _OPERATIONS[type(node.op)](evaluated(node.left), evaluated(node.right))
            raise ValueError

        try:
            return evaluated(self._tree())
        except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError):
            raise ParameterError(
                f"{self.place}: {self.relation}: {self.limit!r} of {self.parameter!r} is neither a number nor "
                "a sum, difference, product or quotient of numbers and parameters",
                name=self.parameter,
            ) from None

    def holds(self, values: Mapping[str, float]) -> bool:
        """Whether the values of all parameters keep it."""
        _, compare, side = _RELATIONS[self.relation]
        value, limit = values[self.parameter], self.value(values)
        rounding = _ROUNDING * max(abs(value), abs(limit)) if self.relation in ("least", "most") else 0.0
        return compare(value, limit) or side * (value - limit) >= -rounding > 0.0

    def check(self, values: Mapping[str, float], unit: str = "") -> None:
        """Compare.

        Raises
        ------
        ParameterError
            The value is not possible; `value`, `limit` and `margin` (negative) are attributes.
        """
        if self.holds(values):
            return
        words, _, side = _RELATIONS[self.relation]
        value, limit = values[self.parameter], self.value(values)
        margin = side * (value - limit)
        shown = "" if unit in ("", "1") else f" {unit}"
        is_number = len(self.names) == 1
        bound = f"{limit:.6g}{shown}" if is_number else f"{self.limit} = {limit:.6g}{shown}"
        miss = f"it is {-margin:.3g}{shown} too {'small' if side > 0 else 'large'}" if margin else "it is just that"
        others = sorted(self.names - {self.parameter})
        remedy = f"change {' or '.join([self.parameter, *others])}" if others else "give another value"
        raise ParameterError(
            f"{self.parameter} = {value:.6g}{shown} must be {words} {bound}: {miss}; {remedy}",
            name=self.parameter,
            value=value,
            limit=limit,
            margin=margin,
        )


def read_text(path: Path, document: Document, most: int = MOST_BYTES) -> str:
    """A file's text.

    Parameters
    ----------
    path : pathlib.Path
        A file in UTF-8, or in UTF-16 with a byte order mark.
    document : Document
        Its name, for errors.
    most : int
        Bytes, beyond which it is refused.

    Returns
    -------
    str
        The decoded text.

    Raises
    ------
    DescriptionError
        Where the file cannot be read, with the line of the first bad byte where it is not so encoded, and with the line
        on which it becomes too large.
    """
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise document.error(f"the file cannot be read: {error.strerror}") from error
    if len(data) > most:
        line = data.count(b"\n") + 1
        raise document.error(
            f"the file has {size} bytes, the most is {most}, which this line reaches: delete comments, or what is not "
            "the mechanism",
            line,
        )
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if wide else "utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise document.error(
            f"the file is not UTF-{16 if wide else 8}: byte {data[error.start]:#04x} at offset {error.start}; "
            "save it as UTF-8",
            line,
        ) from None


def declared_arguments(path: Path) -> dict[str, Node]:
    """The ``<xacro:arg>`` elements of a xacro file and of the files it includes by a literal name.

    Parameters
    ----------
    path : pathlib.Path
        The xacro file.

    Returns
    -------
    dict of str to Node
        By argument name; the first declaration counts, as in xacro.

    Raises
    ------
    RenderError
        Where one of the files is malformed.
    UnsafeXmlError
        Where one of them has a document type.
    """
    arguments: dict[str, Node] = {}
    pending, seen = [path], set()
    while pending:
        file = pending.pop()
        seen.add(file.resolve())
        document = Document(str(file), kind=RenderError)
        for node in read_root(read_text(file, document), document).walk():
            if node.tag == "xacro:arg" and "name" in node.attributes:
                arguments.setdefault(node.attributes["name"], node)
            elif node.tag == "xacro:include":
                included = file.parent / node.attributes.get("filename", "")
                if included.is_file() and included.resolve() not in seen:  # else xacro says what is wrong
                    pending.append(included)
    return arguments


def parameters_files(arguments: Mapping[str, Node]) -> tuple[Path, ...]:
    """The YAML files that the argument ``parameters`` names by default, apart by semicolons; none without the argument.

    A source that names several must do with one that holds the entries of all: with new values it is given such a copy.

    Parameters
    ----------
    arguments : mapping of str to Node
        From `declared_arguments`.

    Returns
    -------
    tuple of pathlib.Path
        Existing files.

    Raises
    ------
    RenderError
        Where a file named there does not exist, or is named twice.
    """
    node = arguments.get(_ARGUMENT)
    default = "" if node is None else node.attributes.get("default", "")
    names = default.split(_APART)
    if node is None or "$" in default or not all(name.endswith((".yaml", ".yml")) for name in names):
        return ()
    files = [Path(node.document.file).parent / name for name in names]
    for name, file in zip(names, files, strict=True):
        if not file.is_file():
            raise node.error(f"the parameters file {name!r} does not exist beside the xacro file")
        if files.count(file) > 1:
            raise node.error(f"the parameters file {name!r} is named twice")
    return tuple(files)


def load_parameters(file: Path) -> tuple[dict[str, Any], dict[str, Parameter]]:
    """A parameters YAML file: one mapping a parameter, ``L1: {value: 0.15, unit: m, source: "Table 2", above: 0}``.

    Parameters
    ----------
    file : pathlib.Path
        The YAML file.

    Returns
    -------
    tuple of two dicts
        The YAML data as it stands, and the parameters by name.

    Raises
    ------
    ParameterError
        Where the file is malformed, names a parameter twice, or gives one no finite number; with file and line.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    text = read_text(file, Document(str(file)))
    try:
        top, data = yaml.compose(text, Loader=loader), yaml.load(text, Loader=loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{file}:{mark.line + 1}" if mark else str(file)
        raise ParameterError(f"{place}: malformed YAML: {getattr(error, 'problem', error)}", file=str(file)) from None
    if not isinstance(data, dict):
        raise ParameterError(f"{file}: the file must map parameter names to mappings", file=str(file))
    parameters: dict[str, Parameter] = {}
    for key_node, _ in top.value:
        name = str(key_node.value)
        place = f"{file}:{key_node.start_mark.line + 1}"
        if name in parameters:
            raise ParameterError(f"{place}: parameter {name!r} is defined twice", name=name, file=str(file))
        parameters[name] = _parameter(name, data.get(name), place)
    return data, parameters


def _parameter(name: str, entry: Any, place: str) -> Parameter:
    if not isinstance(entry, dict) or "value" not in entry:
        raise ParameterError(f"{place}: parameter {name!r} must be a mapping with a value", name=name)
    value = entry["value"]
    if not _is_finite_number(value):
        hint = "; YAML reads 1e-3 as text, write 1.0e-3" if isinstance(value, str) else ""
        raise ParameterError(f"{place}: parameter {name!r} is no finite number: {value!r}{hint}", name=name)
    texts = (str(entry.get(key) or "") for key in ("unit", "source", "description"))
    return Parameter(name, float(value), *texts)


def _listed(names: list[str], most: int = 20) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more


def _is_finite_number(value: object) -> bool:
    try:
        return not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
    except OverflowError:  # an int beyond the range of float
        return False


def _bounds(data: Mapping[str, Any], file: Path) -> Iterator[Bound]:
    """What the entries of a parameters file demand."""
    for name, entry in data.items():
        for relation in _RELATIONS:
            if relation in entry:
                yield Bound(name, relation, str(entry[relation]), str(file))


def check_bounds(bounds: Iterable[Bound], parameters: Mapping[str, Parameter]) -> None:
    """Compare every bound with the values of parameters.

    Raises
    ------
    ParameterError
        For the first that does not hold.
    """
    values = {name: each.value for name, each in parameters.items()}
    for bound in bounds:
        bound.check(values, parameters[bound.parameter].unit)


def parameter_bounds(path: Path) -> tuple[Bound, ...]:
    """Bounds that the parameters files of a xacro file set.

    Parameters
    ----------
    path : pathlib.Path
        The xacro file.

    Returns
    -------
    tuple of Bound

    Raises
    ------
    ParameterError, RenderError
        As `Overrides`.
    """
    return Overrides(path, None).bounds


def checked_values(values: Mapping[str, float] | None) -> dict[str, float]:
    """New parameter values as a dictionary; whether they exist and are numbers is seen where they apply.

    Raises
    ------
    ParameterError
        They are no mapping.
    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise ParameterError(
            f"parameters are a mapping of names to values, such as {{'L1': 0.2}}, got {type(values).__name__} "
            f"{str(values)[:80]!r}"
        )
    return dict(values)


class Overrides:
    """New parameter values for one xacro file, sorted into entries of its YAML files and xacro arguments.

    Parameters
    ----------
    path : pathlib.Path
        The xacro file.
    values : mapping of str to float or None
        New values by name.

    Raises
    ------
    ParameterError
        Where a name is neither in a YAML file nor a declared argument, a value is no finite number or breaks a bound
        that a file sets, or two files have a parameter of the same name.
    RenderError
        Where the xacro file is malformed.
    """

    def __init__(self, path: Path, values: Mapping[str, float] | None) -> None:
        arguments = declared_arguments(path)
        self.files = parameters_files(arguments)
        self.data: dict[str, Any] = {}
        self.parameters: dict[str, Parameter] = {}
        read: list[tuple[Path, dict[str, Any]]] = []
        for file in self.files:
            data, parameters = load_parameters(file)
            read.append((file, data))
            for name in parameters:
                if name in self.parameters:
                    others = ", ".join(each.name for each in self.files if each != file)
                    raise ParameterError(
                        f"{file}: parameter {name!r} is in {others} as well; keep it in one file",
                        name=name,
                        file=str(file),
                    )
            self.data |= data
            self.parameters |= parameters
        self.in_yaml: dict[str, float] = {}
        self.arguments: dict[str, str] = {}
        settable = [*self.parameters, *(name for name in arguments if name != _ARGUMENT or not self.files)]
        for name, value in (values or {}).items():
            if name not in settable:
                raise ParameterError(
                    f"{path.name} has no parameter {name!r}{nearest(str(name), settable)} (it has {_listed(settable)})",
                    name=name,
                    known=tuple(settable),
                )
            if not _is_finite_number(value):
                raise ParameterError(f"parameter {name!r} must be a finite number, got {value!r}", name=name)
            if name in self.parameters:
                self.in_yaml[name] = float(value)
            else:
                self.arguments[name] = repr(int(value) if float(value).is_integer() else float(value))
        self.bounds = tuple(bound for file, data in read for bound in _bounds(data, file))
        check_bounds(self.bounds, self.effective())

    def effective(self) -> dict[str, Parameter]:
        """The YAML files' parameters with the new values in place."""
        changed = {name: replace(self.parameters[name], value=value) for name, value in self.in_yaml.items()}
        return {**self.parameters, **changed}

    def write_yaml(self, folder: Path) -> Path:
        """Write one copy of the YAML files with the new values, under the first one's name.

        Parameters
        ----------
        folder : pathlib.Path
            Where to write it.

        Returns
        -------
        pathlib.Path
            The copy.
        """
        import yaml

        assert self.files
        data = dict(self.data)
        for name, value in self.in_yaml.items():
            # A count stays an int: xacro cannot range() over 3.0.
            counts = isinstance(data[name]["value"], int) and value.is_integer()
            data[name] = {**data[name], "value": int(value) if counts else value}
        copy = folder / self.files[0].name
        copy.write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), encoding="utf-8")
        return copy


def shown_overrides(values: Mapping[str, float] | None) -> str:
    """Say which values a caller gave, for messages on what came of them: `` with L1 = 0.2``, or nothing."""
    return f" with {', '.join(f'{name} = {value:.12g}' for name, value in values.items())}" if values else ""


def parameters_of(path: Path, values: Mapping[str, float] | None) -> dict[str, Parameter]:
    """The parameters of a xacro file after overrides; empty where it names no parameters file.

    Parameters
    ----------
    path : pathlib.Path
        The xacro file.
    values : mapping of str to float or None
        Overrides.

    Returns
    -------
    dict of str to Parameter
        In file order.

    Raises
    ------
    ParameterError, RenderError
        As `Overrides`.
    """
    return Overrides(path, values).effective()
