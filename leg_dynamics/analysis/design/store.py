"""A study's folder: a manifest with all inputs, and one file for every finished chunk of rows.

Files appear whole or not at all (written beside, flushed to the disk, renamed), each with a checksum of its own, so
that a process killed at any moment loses only the chunks that it was working on. The folder is locked while a process
writes into it; the lock ends with the process.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from leg_dynamics.analysis.design.study import Plan, Row, Study
from leg_dynamics.errors import LegDynamicsWarning, OutputError, StudyError

__all__ = ["Folder"]

_FORMAT = 1
MANIFEST, CHUNKS, LOCK = "manifest.json", "chunks", ".lock"


class Folder:
    """Where a study keeps its rows.

    Parameters
    ----------
    path : Path
    study : Study
    """

    def __init__(self, path: Path, study: Study) -> None:
        self.path, self.study = path, study
        self.inputs = study.inputs()
        self.digest = study.digest()

    @contextlib.contextmanager
    def opened(self, resume: bool) -> Iterator[None]:
        """Lock the folder, and write its manifest or compare it.

        Raises
        ------
        StudyError
            The folder holds a study and `resume` is False; or a study with other inputs; or another process works in
            it.
        OutputError
            It cannot be written.
        """
        try:
            (self.path / CHUNKS).mkdir(parents=True, exist_ok=True)
            with self._locked():
                self._check(resume)
                yield
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            raise OutputError(
                f"the study folder {self.path} cannot be written: {error.strerror or error}", path=str(self.path)
            ) from error

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        import fcntl

        with (self.path / LOCK).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise StudyError(
                    f"another process is at work on the study in {self.path}: wait for it, or choose another folder"
                ) from None
            yield

    def _check(self, resume: bool) -> None:
        path = self.path / MANIFEST
        if not path.exists():
            write_whole(path, {"format": _FORMAT, "digest": self.digest, "inputs": self.inputs})
            return
        if not resume:
            raise StudyError(
                f"{self.path} already holds a study: resume it (--resume), or choose another folder", path=str(path)
            )
        try:
            stored = json.loads(path.read_text(encoding="utf-8"))
            inputs, digest = stored["inputs"], stored["digest"]
        except (ValueError, KeyError, TypeError):
            raise StudyError(f"{path} is no manifest of a study: choose another folder", path=str(path)) from None
        if digest != self.digest:
            differing = [name for name in self.inputs if inputs.get(name) != self.inputs[name]]
            was = "; ".join(
                f"{name}: {_shown(inputs.get(name))} then, {_shown(self.inputs[name])} now" for name in differing[:3]
            )
            raise StudyError(
                f"the study in {self.path} has other inputs ({was or 'its manifest was changed'}): give the same ones "
                "to resume it, or choose another folder",
                path=str(path),
                differing=tuple(differing),
            )

    def read(self, number: int, chunk: int, chosen: dict[str, float]) -> list[Row] | None:
        """Rows of a finished chunk; None where it is missing, damaged, or started from another choice."""
        path = self._file(number, chunk)
        try:
            stored = json.loads(path.read_bytes())
            body = stored["body"]
            if stored["checksum"] != _checksum(body) or body["digest"] != self.digest or body["chosen"] != chosen:
                raise ValueError("wrong checksum")
            return [
                Row(index, design, status, reason, {name: _number(v) for name, v in values.items()}, accepted)
                for index, design, status, reason, values, accepted in body["rows"]
            ]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            warnings.warn(f"{path} is damaged: its rows are computed again", LegDynamicsWarning, stacklevel=3)
            return None

    def write(self, number: int, chunk: int, chosen: dict[str, float], rows: Sequence[Row]) -> None:
        """Keep the rows of a finished chunk."""
        body = {
            "digest": self.digest,
            "chosen": chosen,
            "rows": [
                [
                    row.index,
                    row.design,
                    row.status,
                    row.reason,
                    {k: _text(v) for k, v in row.values.items()},
                    row.accepted,
                ]
                for row in rows
            ],
        }
        write_whole(self._file(number, chunk), {"checksum": _checksum(body), "body": body})

    def describe(self, plan: Plan) -> None:
        """Say in the folder how rows are computed; nothing reads it back."""
        how = "one kernel for all designs" if plan.numbers is not None else f"each design by itself: {plan.why_single}"
        write_whole(
            self.path / "plan.json",
            {
                "evaluation": how,
                "checked_renderings": 0 if plan.numbers is None else plan.numbers.checked,
                "masses": plan.masses,
                "samples_a_design": plan.resolution.samples,
                "half_widths": plan.resolution.half_widths,
                "resolution": plan.resolution.justification if plan.resolution.samples else "",
            },
        )

    def _file(self, number: int, chunk: int) -> Path:
        return self.path / CHUNKS / f"{number}-{chunk:06d}.json"


def write_whole(path: Path, value: Any) -> None:
    """Write JSON so that the file is there whole or not at all, also after a power cut."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            json.dump(value, file, allow_nan=False)
            file.write("\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _checksum(body: Any) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _text(value: float) -> float | str:
    """JSON has neither NaN nor infinity; every other float comes back bit by bit."""
    return value if math.isfinite(value) else repr(value)


def _number(value: float | str) -> float:
    return float(value)


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 120 else f"{text[:117]}..."
