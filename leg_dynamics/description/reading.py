"""`read`: a shipped name, a file or XML text to a description."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from leg_dynamics.description.assembling import assembly_parameters
from leg_dynamics.description.mjcf_reader import build_mjcf, is_mjcf
from leg_dynamics.description.model import Description, Parameter
from leg_dynamics.description.modules import is_assembly
from leg_dynamics.description.parameters import parameters_of, shown_overrides
from leg_dynamics.description.parse import build
from leg_dynamics.description.render import read_text, render, rendered_name
from leg_dynamics.description.robot_data import PREFIX, robot_data_file, with_group_states
from leg_dynamics.description.shipped import existing_file, shipped_urdf, shipped_xacro
from leg_dynamics.description.toolbox import is_toolbox, sidecar_of, toolbox_text
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
        Where a parameter does not exist, is no finite number, or cannot apply to this kind of source.
    """
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
    if (pair := _toolbox_pair(path)) is not None:
        _refuse_parameters(parameters, f"the plain file {path}")
        urdf, sidecar = pair
        document = Document(str(urdf))
        tree = build(read_text(urdf, document), document)
        if not (tree.loops or tree.couplings or tree.transmissions):
            return build(toolbox_text(sidecar, tree), Document(f"{urdf} with {sidecar.name}", quiet=True))
        if path == sidecar:
            raise document.error(f"the file has loops or transmissions of its own: load it without {sidecar.name}")
        return tree
    if path.name.endswith(".xacro") or is_assembly(path):
        text = render(path, parameters)
        document = Document(rendered_name(path), source=str(path), overrides=shown_overrides(parameters))
        return build(text, document, _parameters(path, parameters))
    _refuse_parameters(parameters, f"the plain file {path}")
    document = Document(str(path))
    text = read_text(path, document)
    if is_mjcf(text):
        return build_mjcf(text, document, path)
    return build(with_group_states(path, text), document)


def _toolbox_pair(path: Path) -> tuple[Path, Path] | None:
    """A URDF file and the YAML file beside it, by the path of either."""
    if path.name.endswith(".urdf"):
        sidecar = sidecar_of(path)
        return None if sidecar is None else (path, sidecar)
    if not is_toolbox(path):
        return None
    urdf = path.with_suffix(".urdf")
    if not urdf.is_file():
        raise LegNotFoundError(f"{path} names the loops and motors of {urdf.name}, and there is no such file beside it")
    return urdf, path


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
