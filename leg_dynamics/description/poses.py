"""A named pose written into a mechanism's text."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

from leg_dynamics.description.model import Description
from leg_dynamics.description.parse import build
from leg_dynamics.description.xml_reader import Document

__all__ = ["set_home", "with_home"]


def with_home(description: Description, values: Mapping[str, float]) -> Description:
    """Return the mechanism with another ``home``; its other configurations stay.

    Parameters
    ----------
    description : Description
    values : mapping of str to float
        Joint coordinates, rad or m.
    """
    root = ElementTree.fromstring(description.urdf)
    set_home(root, values)
    document = Document(description.file, source=description.source, quiet=True)
    return build(ElementTree.tostring(root, encoding="unicode"), document, description.parameters)


def set_home(root: ElementTree.Element, values: Mapping[str, float]) -> None:
    """Give a <robot> another ``home``: joint coordinates, rad or m."""
    for found in root.findall("configuration"):
        if found.get("name") == "home":
            root.remove(found)
    # First, so that it is the default branch of the inverse kinematics too.
    places = [place for place, child in enumerate(root) if child.tag == "configuration"]
    home = ElementTree.Element("configuration", name="home")
    root.insert(places[0] if places else len(root), home)
    for joint, value in values.items():
        ElementTree.SubElement(home, "joint", name=joint, value=repr(float(value)))
