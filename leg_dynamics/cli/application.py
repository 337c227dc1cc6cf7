"""The application: its commands' exit codes, and how errors and warnings become lines."""

from __future__ import annotations

import codecs
import contextlib
import errno
import functools
import os
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import typer

from leg_dynamics.cli.output import ascii_substitute, complain
from leg_dynamics.errors import CrosscheckError, LegDynamicsError, LegDynamicsWarning

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
EXIT_CODES = (
    "Exit codes: 0 done; 1 a check failed or two routes disagree; 2 bad usage, bad input or unwritable output, said "
    "in one line; 130 interrupted."
)

app = typer.Typer(
    name="leg-dynamics",
    help="Torques, Jacobians and design maps of closed-loop robot legs. "
    "LEG is a shipped name (see `list`) or a path to a .urdf, .urdf.xacro or .xacro file, or to the .yaml file of an "
    "assembly of modules; an xacro file can run Python code, so render only files that you trust.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def add_command(name: str, function: Callable[..., None], **settings: Any) -> None:
    """Make a function a command, whose failures are told in one line."""
    app.command(name, epilog=EXIT_CODES, **settings)(_reported(function))


def _reported(command: Callable[..., None]) -> Callable[..., None]:
    """Turn errors of this package into one line and an exit code, and its warnings into one line each."""

    @functools.wraps(command)
    def wrapper(*args: Any, **kwargs: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("always", LegDynamicsWarning)
            show, said = warnings.showwarning, set[str]()

            def showwarning(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
                if issubclass(category, LegDynamicsWarning):
                    # Each route that reads a file finds the same things.
                    if str(message) not in said:
                        said.add(str(message))
                        complain(f"warning: {_as_options(str(message), kwargs)}")
                else:
                    show(message, category, *place, **more)

            warnings.showwarning = showwarning
            try:
                try:
                    command(*args, **kwargs)
                finally:
                    # Here, where a failure still has a word in the exit code.
                    sys.stdout.flush()
            except KeyboardInterrupt:
                complain("interrupted")
                raise typer.Exit(INTERRUPTED) from None
            except CrosscheckError as error:
                complain(f"error: {_as_options(str(error), kwargs)}")
                raise typer.Exit(FAILED) from None
            except LegDynamicsError as error:
                complain(f"error: {_as_options(str(error), kwargs)}")
                raise typer.Exit(USAGE) from None
            except OSError as error:
                _report_os_error(error)
                raise typer.Exit(USAGE) from None

    return wrapper


def _as_options(text: str, given: Mapping[str, Any]) -> str:
    """A message whose advice to call `load` with a route names the option, where the command has it."""
    return re.sub(r"\broute='(\w+)'", r"--route \1", text) if "route" in given else text


def _report_os_error(error: OSError) -> None:
    """Say in one line which file, or that standard output, failed; raise again what is neither."""
    if error.filename is not None:
        complain(f"error: {error.filename}: {error.strerror}")
        return
    if error.errno not in (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF):
        raise error
    # What is still buffered would fail again when the interpreter ends.
    with contextlib.suppress(OSError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    # Nobody reads a broken pipe, as in `| head`: no reason to complain.
    if error.errno != errno.EPIPE:
        complain(f"error: the output cannot be written: {error.strerror}")


def _print_version(wanted: bool) -> None:
    if wanted:
        import leg_dynamics

        print(f"leg-dynamics {leg_dynamics.__version__}")
        raise typer.Exit(OK)


@app.callback()
def _global_options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None: ...


def main() -> None:
    """Run the command line; a terminal that lacks a letter gets an ASCII one in its place."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        complain("error: standard output is closed; redirect it to a file or to the null device")
        raise SystemExit(USAGE)
    codecs.register_error("leg_dynamics_ascii", ascii_substitute)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="leg_dynamics_ascii")
    try:
        try:
            app(prog_name="leg-dynamics")
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        # Before a command has begun.
        raise SystemExit(INTERRUPTED) from None
    except OSError as error:
        # Outside of any command: help and version.
        _report_os_error(error)
        raise SystemExit(USAGE) from None
