"""Own formulas from a Python file, for the command line: importing the file runs it."""

from __future__ import annotations

import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from leg_dynamics.errors import ParameterError

__all__ = ["read_own"]


def read_own(place: str) -> Any:
    """Run a Python file and return what is named in it.

    Parameters
    ----------
    place : str
        ``FILE.py:NAME``: a class, called without arguments, or an object; ``FILE.py``: the module itself, where
        the formulas are functions. The file is run, as by ``import``, with its folder first on the search path.

    Returns
    -------
    object

    Raises
    ------
    ParameterError
        The file does not exist or does not run, the name is not in it, or the class cannot be called so.
    """
    file, colon, name = place.rpartition(":")
    if not (colon and name.isidentifier()):
        file, name = place, ""
    path = Path(os.path.abspath(file))
    if path.suffix != ".py" or not path.is_file():
        raise ParameterError(f"{file!r} is no Python file: give FILE.py:NAME, such as my_leg.py:MyLeg", parameter="own")
    module_name = f"own_formulas_{path.stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses look their module up
    sys.path.insert(0, str(path.parent))
    try:
        with _said(path, "does not run"):
            spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(path.parent))
    if not name:
        return module
    if not hasattr(module, name):
        defined = [each for each, value in vars(module).items() if getattr(value, "__module__", "") == module_name]
        hint = f": it defines {', '.join(defined)}" if defined else ""
        raise ParameterError(f"{file} has no {name}{hint}", parameter="own")
    found = getattr(module, name)
    if not inspect.isclass(found):
        return found
    with _said(path, f"{name}() cannot be made"):
        return found()


@contextmanager
def _said(path: Path, what: str) -> Iterator[None]:
    """Turn whatever the file's code raises into one error with its line."""
    try:
        yield
    except (Exception, SystemExit) as error:
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else (lines[-1] if lines else None)
        place = str(path) if line is None else f"{path}:{line}"
        raise ParameterError(f"{place}: {what}: {type(error).__name__}: {error}", parameter="own") from error
