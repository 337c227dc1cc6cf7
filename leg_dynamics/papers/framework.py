"""Verdicts on a paper: what they are made of, what computes them, and the report that holds them.

A module of a paper offers any of

* ``VERDICTS``, a tuple of functions ``(context) -> Verdict``, in the order of the paper;
* ``CHECKS``, a tuple of functions ``(context) -> Check``: what must hold, or the reproduction fails;
* ``plots(context) -> tuple[Plot, ...]`` and ``sections(context) -> tuple[Section, ...]``.

`reproduce` runs them on one `Context` and returns a `PaperReport`.
"""

from __future__ import annotations

import importlib.metadata
import io
import json
import math
import os
import platform
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import OutputError, ParameterError

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.leg import Leg

__all__ = [
    "Check",
    "Context",
    "Figure",
    "PaperReport",
    "Plot",
    "Progress",
    "Section",
    "Status",
    "Verdict",
    "find_verdict",
    "reproduce",
]

Progress = Callable[[str, float], None]
"""Told what begins and which share of the work is done."""

KINDS = ("equation", "table", "figure", "claim")


class Status(str, Enum):
    """What became of an item of the paper."""

    CONFIRMED = "confirmed"
    CORRECTED = "corrected"
    NOT_REPRODUCIBLE = "not reproducible from the paper"
    OUT_OF_REACH = "out of reach here"


@dataclass(frozen=True)
class Figure:
    """A computed number.

    Attributes
    ----------
    name : str
    value : float
    unit : str
        Empty for a pure number.
    of : str
        What it measures, and over which states.
    """

    name: str
    value: float
    unit: str
    of: str

    def __post_init__(self) -> None:
        # Plain floats: they are what JSON knows, and they print the same everywhere.
        object.__setattr__(self, "value", float(self.value))

    def __str__(self) -> str:
        return f"{self.value:.6g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Verdict:
    """What became of one item of the paper, and the numbers that show it.

    Attributes
    ----------
    item : str
        As the paper names it: ``"(9)"``, ``"Table 2"``, ``"Fig. 11"``; or ``"claim: ..."``.
    kind : {"equation", "table", "figure", "claim"}
    title : str
        What it is.
    status : Status
    finding : str
        One or two sentences with the computed numbers.
    figures : tuple of Figure
    printed, corrected : str
        The two forms, as short Unicode mathematics; empty where there is nothing to correct.
    """

    item: str
    kind: str
    title: str
    status: Status
    finding: str
    figures: tuple[Figure, ...] = ()
    printed: str = ""
    corrected: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.item}: a verdict is about one of {', '.join(KINDS)}, not {self.kind!r}")
        object.__setattr__(self, "status", Status(self.status))
        object.__setattr__(self, "figures", tuple(self.figures))

    @property
    def anchor(self) -> str:
        """Name of its place on the page: ``eq-9``, ``table-2``, ``fig-11``, ``claim-inverse-kinematics``."""
        text = self.item.strip()
        if self.kind == "equation":
            text = f"eq {text.strip('()')}"
        letters = "".join(letter if letter.isalnum() and letter.isascii() else " " for letter in text.lower())
        return "-".join(letters.split()) or self.kind

    def to_dict(self) -> dict[str, Any]:
        """The verdict as JSON-ready values."""
        return {
            "item": self.item,
            "kind": self.kind,
            "title": self.title,
            "status": self.status.value,
            "finding": self.finding,
            "figures": [
                {"name": f.name, "value": _finite_or_none(f.value), "unit": f.unit, "of": f.of} for f in self.figures
            ],
            "printed": self.printed,
            "corrected": self.corrected,
        }


@dataclass(frozen=True)
class Check:
    """Something that must hold for the reproduction to count.

    Attributes
    ----------
    name : str
    value : float or None
        The error; NaN fails. None where it was not run, for want of an optional extra.
    tolerance : float
    unit : str
    of : str
        What is compared, over which states.
    """

    name: str
    value: float | None
    tolerance: float
    unit: str = ""
    of: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", None if self.value is None else float(self.value))
        object.__setattr__(self, "tolerance", float(self.tolerance))

    @property
    def state(self) -> str:
        """``holds``, ``fails`` or ``not run``."""
        if self.value is None:
            return "not run"
        return "holds" if self.value <= self.tolerance else "fails"

    @property
    def passed(self) -> bool | None:
        """Whether the error is within the tolerance; None where it was not run."""
        return None if self.value is None else self.state == "holds"

    def to_dict(self) -> dict[str, Any]:
        """The check as JSON-ready values."""
        return {
            "name": self.name,
            "value": None if self.value is None else _finite_or_none(self.value),
            "tolerance": self.tolerance,
            "unit": self.unit,
            "of": self.of,
            "state": self.state,
            "passed": self.passed,
        }


@dataclass(frozen=True)
class Plot:
    """A drawing, built when it is asked for.

    Attributes
    ----------
    name : str
        Of its file, without the ending: ``"fig11"``.
    title, caption : str
    build : callable
        Returns a new matplotlib figure.
    items : tuple of str
        The verdicts that it illustrates.
    """

    name: str
    title: str
    caption: str
    build: Callable[[], Drawing]
    items: tuple[str, ...] = ()

    def svg(self) -> str:
        """The drawing as SVG text, the same at every call."""
        return self.saved("svg")[0].decode("utf-8")

    def png(self, dpi: float = 150.0) -> bytes:
        """The drawing as a PNG file's bytes."""
        return self.saved("png", dpi=dpi)[0]

    def saved(self, *kinds: str, dpi: float = 150.0) -> tuple[bytes, ...]:
        """The drawing, built once, as files of these kinds, ``svg`` or ``png``."""
        import matplotlib as mpl

        results = []
        # Text as paths: the page looks the same on every machine. A salt, so that identifiers do not change.
        with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": self.name}):
            drawing = self.build()
            for kind in kinds:
                stream = io.BytesIO()
                metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
                drawing.savefig(stream, format=kind, dpi=dpi, metadata=metadata)
                results.append(stream.getvalue())
        return tuple(results)


@dataclass(frozen=True)
class Section:
    """A block of text and, perhaps, a table.

    Attributes
    ----------
    name : str
        Of its place on the page.
    title : str
    paragraphs : tuple of str
        Plain text.
    header : tuple of str
        Of the table; empty where there is none.
    rows : tuple of tuple of str
        Cells of the table.
    plots : tuple of str
        Names of the plots that follow the text.
    note : str
        Below the table.
    """

    name: str
    title: str
    paragraphs: tuple[str, ...] = ()
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    plots: tuple[str, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.header):
                raise ValueError(f"{self.title}: {len(row)} cells under {len(self.header)} headings: {row}")

    def to_dict(self) -> dict[str, Any]:
        """The section as JSON-ready values."""
        return {
            "name": self.name,
            "title": self.title,
            "paragraphs": list(self.paragraphs),
            "header": list(self.header),
            "rows": [list(row) for row in self.rows],
            "plots": list(self.plots),
            "note": self.note,
        }


def whole(what: str, value: Any, least: int) -> int:
    """Return a whole number that is not below `least`.

    Raises
    ------
    ParameterError
        It is something else.
    """
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer) or value < least:
        raise ParameterError(f"{what} must be a whole number, at least {least}, not {value!r}", name=what, value=value)
    return int(value)


@dataclass(eq=False)
class Context:
    """What verdicts are computed from; built lazily, the same for all of them.

    Parameters
    ----------
    name : str
        Name of the shipped leg.
    seed : int
        Of every random number.
    samples : int
        States in `q`.

    Raises
    ------
    ParameterError
        The seed or the number of samples is no such number.
    """

    name: str
    seed: int = 0
    samples: int = 2000
    shared: dict[str, Any] = field(default_factory=dict, repr=False)
    """Results that several verdicts use, by name: see `once`."""

    def __post_init__(self) -> None:
        self.seed = whole("seed", self.seed, 0)
        self.samples = whole("samples", self.samples, 1)

    @cached_property
    def leg(self) -> Leg:
        """The leg, by its default route."""
        import leg_dynamics

        return leg_dynamics.load(self.name)

    @cached_property
    def pinocchio(self) -> Leg:
        """The same leg by the numeric route, which shares no formula with the other."""
        from leg_dynamics.routes import sibling

        return sibling(self.leg, "pinocchio")

    @cached_property
    def formulas(self) -> Any:
        """Module of the leg's formulas, as corrected."""
        from leg_dynamics import closed_form

        return closed_form.find(self.name)

    @cached_property
    def numbers(self) -> Any:
        """The leg's lengths, bodies and gravity, as the formulas take them."""
        return self.formulas.from_urdf(self.leg.description)

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper joint limits, each of shape (n,), rad or m."""
        return np.asarray(self.leg.limits.lower), np.asarray(self.leg.limits.upper)

    def rng(self, stream: int = 0) -> np.random.Generator:
        """A new generator of random numbers, the same for the same `stream`; independent of who asked before."""
        return np.random.default_rng([self.seed, stream])

    @cached_property
    def q(self) -> np.ndarray:
        """Random states inside the joint limits, shape (samples, n); they keep 1 % of the range from each limit."""
        lower, upper = self.limits
        share = 0.01 + 0.98 * self.rng(1).random((self.samples, lower.size))
        return lower + share * (upper - lower)

    @cached_property
    def v(self) -> np.ndarray:
        """Random rates to go with `q`, shape (samples, n), within 1 rad/s or m/s."""
        return self.rng(2).uniform(-1.0, 1.0, self.q.shape)

    @cached_property
    def a(self) -> np.ndarray:
        """Random accelerations to go with `q`, shape (samples, n), within 1 rad/s² or m/s²."""
        return self.rng(3).uniform(-1.0, 1.0, self.q.shape)

    def grid(self, count: int = 9) -> np.ndarray:
        """A regular grid of the box of joint limits, ends included, shape (count^n, n)."""
        lower, upper = self.limits
        axes = [np.linspace(low, high, count) for low, high in zip(lower, upper, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, lower.size)

    def once(self, name: str, compute: Callable[[], Any]) -> Any:
        """Return the result called `name`, computed at the first call."""
        if name not in self.shared:
            self.shared[name] = compute()
        return self.shared[name]


@dataclass(frozen=True)
class PaperReport:
    """All that was found about one paper.

    Attributes
    ----------
    name : str
        The leg's name.
    paper : str
        Citation.
    title : str
        Heading of the page.
    verdicts : tuple of Verdict
    plots : tuple of Plot
    sections : tuple of Section
    checks : tuple of Check
    versions : mapping of str to str
        Of what computed it.
    seed, samples : int
        Of the random states.
    """

    name: str
    paper: str
    title: str
    verdicts: tuple[Verdict, ...]
    plots: tuple[Plot, ...] = ()
    sections: tuple[Section, ...] = ()
    checks: tuple[Check, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    seed: int = 0
    samples: int = 0

    def __post_init__(self) -> None:
        for what, names in (
            ("item", [verdict.item for verdict in self.verdicts]),
            ("place", [verdict.anchor for verdict in self.verdicts]),
            ("plot", [plot.name for plot in self.plots]),
        ):
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise ValueError(f"{self.name}: the same {what} twice: {', '.join(twice)}")

    @property
    def passed(self) -> bool:
        """Whether no check fails; a corrected equation is a finding, and a check that was not run is neither."""
        return all(check.state != "fails" for check in self.checks)

    def held(self) -> str:
        """How many of the checks that were run hold, and how many were not run, in words."""
        states = Counter(check.state for check in self.checks)
        left_out = f", {states['not run']} not run" if states["not run"] else ""
        return f"{states['holds']} of {len(self.checks) - states['not run']} hold{left_out}"

    def counts(self) -> dict[Status, int]:
        """How many verdicts have each status, in the order of `Status`."""
        return {status: sum(verdict.status is status for verdict in self.verdicts) for status in Status}

    def counts_by_kind(self) -> dict[str, dict[Status, int]]:
        """The counts of each kind that occurs."""
        return {
            kind: {s: sum(v.status is s and v.kind == kind for v in self.verdicts) for s in Status}
            for kind in KINDS
            if any(verdict.kind == kind for verdict in self.verdicts)
        }

    def verdict(self, item: str) -> Verdict:
        """Return the verdict on an item.

        Raises
        ------
        KeyError
            There is none.
        """
        return find_verdict(self.verdicts, item)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values; drawings by name only."""
        return {
            "name": self.name,
            "paper": self.paper,
            "title": self.title,
            "passed": self.passed,
            "counts": {status.value: count for status, count in self.counts().items()},
            "checks": [check.to_dict() for check in self.checks],
            "verdicts": [verdict.to_dict() for verdict in self.verdicts],
            "sections": [section.to_dict() for section in self.sections],
            "plots": [{"name": p.name, "title": p.title, "caption": p.caption} for p in self.plots],
            "seed": self.seed,
            "samples": self.samples,
            "versions": dict(self.versions),
        }

    def to_json(self) -> str:
        """The report as JSON text; a number that is NaN or infinite is written as null."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False)

    def __rich__(self) -> Any:
        from leg_dynamics.papers.table import report_table

        return report_table(self)

    def write(self, folder: str | os.PathLike[str], progress: Progress | None = None) -> tuple[Path, ...]:
        """Write the page, the JSON and the drawings.

        Parameters
        ----------
        folder : path
            Made where it does not exist; files of the same names in it are replaced.
        progress : callable, optional
            Told each drawing's name and the share that is done.

        Returns
        -------
        tuple of Path
            ``index.html`` (self-contained), ``report.json`` and one ``plots/*.png`` a drawing.

        Raises
        ------
        OutputError
            The folder or a file cannot be written.
        """
        from leg_dynamics.papers.page import render_page

        folder = Path(folder)
        _make_room(folder, ("index.html", "report.json", *(f"plots/{plot.name}.png" for plot in self.plots)))
        pictures = {}
        written = []
        for number, plot in enumerate(self.plots):
            _tell(progress, f"drawing {plot.name}", number / (len(self.plots) + 1))
            svg, png = plot.saved("svg", "png")
            pictures[plot.name] = svg.decode("utf-8")
            written.append(_write(folder / "plots" / f"{plot.name}.png", png))
        _tell(progress, "page", len(self.plots) / (len(self.plots) + 1))
        page = _write(folder / "index.html", render_page(self, pictures).encode("utf-8"))
        data = _write(folder / "report.json", (self.to_json() + "\n").encode("utf-8"))
        _tell(progress, "done", 1.0)
        return (page, data, *written)


def find_verdict(verdicts: Sequence[Verdict], item: str) -> Verdict:
    """Return the verdict on `item`.

    Raises
    ------
    KeyError
        There is none.
    """
    for verdict in verdicts:
        if verdict.item == item:
            return verdict
    raise KeyError(item)


def reproduce(
    context: Context, modules: Sequence[ModuleType], *, paper: str, title: str, progress: Progress | None = None
) -> PaperReport:
    """Run everything that the modules of a paper offer.

    Parameters
    ----------
    context : Context
    modules : sequence of module
        In the order of the page; see the head of this module for what they offer.
    paper, title : str
        Citation, and heading of the page.
    progress : callable, optional
        Told what begins and the share that is done.

    Returns
    -------
    PaperReport
        Verdicts are sorted by kind (equations, tables, figures, claims) and keep their order within each.
    """
    verdict_functions = [function for module in modules for function in getattr(module, "VERDICTS", ())]
    check_functions = [function for module in modules for function in getattr(module, "CHECKS", ())]
    builders = [module for module in modules if hasattr(module, "plots") or hasattr(module, "sections")]
    total = max(1, len(verdict_functions) + len(check_functions) + len(builders))
    done = 0

    def step(what: str) -> None:
        nonlocal done
        _tell(progress, what.strip("_").replace("_", " "), done / total)
        done += 1

    verdicts: list[Verdict] = []
    checks: list[Check] = []
    plots: list[Plot] = []
    sections: list[Section] = []
    for function in verdict_functions:
        step(function.__name__)
        verdicts.append(function(context))
    for module in builders:
        step(module.__name__.rpartition(".")[2])
        plots += module.plots(context) if hasattr(module, "plots") else ()
        sections += module.sections(context) if hasattr(module, "sections") else ()
    for function in check_functions:
        step(function.__name__)
        checks.append(function(context))
    _tell(progress, "done", 1.0)
    return PaperReport(
        name=context.name,
        paper=paper,
        title=title,
        verdicts=tuple(sorted(verdicts, key=lambda verdict: KINDS.index(verdict.kind))),
        plots=tuple(plots),
        sections=tuple(sections),
        checks=tuple(checks),
        versions=_versions(),
        seed=context.seed,
        samples=context.samples,
    )


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in ("leg-dynamics", "numpy", "scipy", "pin", "casadi", "mujoco"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    if "leg-dynamics" not in found:
        import leg_dynamics

        found["leg-dynamics"] = leg_dynamics.__version__
    return dict(sorted(found.items()))


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _tell(progress: Progress | None, what: str, share: float) -> None:
    if progress is not None:
        progress(what, share)


def _make_room(folder: Path, names: Sequence[str]) -> None:
    """Make the folders of files to come, and find what is in their way before anything is written."""
    targets = [folder / name for name in names]
    for parent in dict.fromkeys(place for target in targets for place in (folder, target.parent)):
        # A link that leads nowhere does not exist, and yet nothing can be made in its place.
        if not parent.is_dir() and (parent.exists() or parent.is_symlink()):
            what = "a link that leads nowhere" if parent.is_symlink() and not parent.exists() else "a file"
            raise OutputError(
                f"{parent} is {what} where a folder is needed; move it away, or choose another output folder",
                path=str(parent),
            )
    for target in targets:
        if target.is_dir():
            raise OutputError(
                f"{target} is a folder where a file is to be written; move it away, or choose another output folder",
                path=str(target),
            )
    for parent in dict.fromkeys(target.parent for target in targets):
        try:
            parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"the folder {parent} cannot be made: {error.strerror or error}; choose another output folder",
                path=str(parent),
            ) from error


def _write(path: Path, content: bytes) -> Path:
    """Write beside the target, then put in place in one step."""
    temporary: Path | None = None
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
        temporary = Path(name)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
        # mkstemp's files are private; a result gets the permissions of any new file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}", path=str(path)) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path
