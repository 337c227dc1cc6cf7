"""`read`: a shipped name, a file or XML text to a description."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from leg_dynamics.description.assembling import assembly_parameters
from leg_dynamics.description.mjcf_reader import build_mjcf, is_mjcf
from leg_dynamics.description.model import Description, Parameter
from leg_dynamics.description.modules import is_assembly
from leg_dynamics.description.parameters import checked_values, parameters_of, shown_overrides
from leg_dynamics.description.parse import build
from leg_dynamics.description.render import read_text, render, rendered_name
from leg_dynamics.description.robot_data import PREFIX, robot_data_file, with_group_states
from leg_dynamics.description.shipped import existing_file, shipped_urdf, shipped_xacro
from leg_dynamics.description.toolbox import is_sidecar, is_toolbox, sidecar_of, toolbox_text
from leg_dynamics.description.xml_reader import Document
from leg_dynamics.errors import LegNotFoundError, ParameterError

__all__ = ["read"]


def read(source: str | os.PathLike[str], *, parameters: Mapping[str, float] | None = None) -> Description:
    """Read and validate a mechanism.

    Parameters
    ----------
    source : str or path-like
        A shipped name, a robot of example-robot-data such as ``example-robot-data:solo12`` (see
        `leg_dynamics.description.robot_data`), the path of a ``.urdf``, ``.xacro`` or ``.yaml`` file, or XML text (it
        starts with ``<``). An MJCF model, whose root element is ``<mujoco>``, is read by MuJoCo, see
        `leg_dynamics.description.mjcf_reader`. Plain URDF is data, and so is a ``.yaml`` file: an assembly of modules,
        or the loops and motors of the URDF file of the same name beside it, see `leg_dynamics.description.toolbox`;
        that URDF file's own path will do as well. A ``.xacro`` file runs the Python expressions in it, see `render`.
    parameters : mapping of str to float, optional
        New values of named parameters; only for a shipped name, a ``.xacro`` or a ``.yaml`` file, which is rendered
        with them.

    Returns
    -------
    Description
        The validated mechanism. `parameters` holds the values it was made with, where they are known.

    Raises
    ------
    LegNotFoundError
        Where there is no such name or file.
    DescriptionError
        Where the file is wrong, with file and line; `RenderError` and `UnsafeXmlError` are kinds of it.
    ParameterError
        Where parameters are no mapping, or one does not exist, is no finite number, or cannot apply to this kind of
        source.
    """
    parameters = checked_values(parameters)
    if isinstance(source, str) and source.removeprefix("\ufeff").lstrip().startswith("<"):
        _refuse_parameters(parameters, "XML text")
        return build_mjcf(source, Document()) if is_mjcf(source) else build(source, Document())
    if isinstance(source, str) and source.startswith(PREFIX):
        source = robot_data_file(source)
    path = existing_file(source)
    if path is None:
        name = os.fspath(source)
        if not parameters:
            return _read_shipped(name)
        path = shipped_xacro(name)
    asked = path
    if _is_sidecar(path):
        path = path.with_suffix(".urdf")
        if not path.is_file():
            raise LegNotFoundError(
                f"{asked} names the loops and motors of {path.name}, and there is no such file beside it"
            )
    if path.name.endswith(".xacro") or is_assembly(path):
        text = render(path, parameters)
        document = Document(rendered_name(path), source=str(path), overrides=shown_overrides(parameters))
        return build(text, document, _parameters(path, parameters))
    _refuse_parameters(parameters, f"the plain file {path}")
    document = Document(str(path))
    text = read_text(path, document)
    if is_mjcf(text):
        return build_mjcf(text, document, path)
    built = build(with_group_states(path, text), document)
    return _with_sidecar(built, path, asked) if path.suffix == ".urdf" else built


def _is_sidecar(path: Path) -> bool:
    """Whether a path is that of a YAML file which belongs to the URDF file of its name."""
    if path.suffix not in (".yaml", ".yml"):
        return False
    return is_toolbox(path) or (path.with_suffix(".urdf").is_file() and is_sidecar(path))


def _with_sidecar(tree: Description, urdf: Path, asked: Path) -> Description:
    """A tree with the loops and motors of the YAML file beside it, where there is one."""
    if not (tree.loops or tree.couplings or tree.transmissions):
        sidecar = asked if asked != urdf else sidecar_of(urdf)
        if sidecar is None:
            return tree
        return build(toolbox_text(sidecar, tree), Document(f"{urdf} with {sidecar.name}", quiet=True))
    document = Document(str(urdf))
    if asked != urdf:
        raise document.error(f"the file has loops or transmissions of its own: load it without {asked.name}")
    for suffix in (".yaml", ".yml"):
        if is_toolbox(beside := urdf.with_suffix(suffix)):
            document.warn(f"{beside.name} beside the file is not used: the file has loops or transmissions of its own")
    return tree


def _read_shipped(name: str) -> Description:
    """A shipped mechanism from its rendered file, which a test keeps equal to its source."""
    path = shipped_urdf(name)
    document = Document(str(path))
    return build(read_text(path, document), document, _shipped_parameters(name))


def _shipped_parameters(name: str) -> Mapping[str, Parameter]:
    try:
        source: Path = shipped_xacro(name)
    except LegNotFoundError:
        return {}
    return _parameters(source, None)


def _parameters(source: Path, values: Mapping[str, float] | None) -> Mapping[str, Parameter]:
    return assembly_parameters(source, values) if is_assembly(source) else parameters_of(source, values)


def _refuse_parameters(parameters: Mapping[str, float] | None, what: str) -> None:
    if parameters:
        raise ParameterError(
            f"parameters {', '.join(map(str, parameters))} cannot be set: {what} has none; use a shipped name, or a "
            ".xacro or .yaml file",
            parameters=dict(parameters),
        )
