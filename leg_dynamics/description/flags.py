"""Which joints are independent, written into a mechanism's text."""

from __future__ import annotations

from collections.abc import Collection
from xml.etree import ElementTree

from leg_dynamics.description.model import Description
from leg_dynamics.description.parse import build
from leg_dynamics.description.xml_reader import Document

__all__ = ["states_flags", "with_independent"]


def states_flags(description: Description) -> bool:
    """Whether the file itself says which joints are independent."""
    return any(joint.independent_is_stated for joint in description.joints)


def with_independent(description: Description, names: Collection[str]) -> Description:
    """Return the mechanism with exactly these joints independent.

    Parameters
    ----------
    description : Description
    names : collection of str
        Moving joints that mimic no other.
    """
    root = ElementTree.fromstring(description.urdf)
    for joint in root.findall("joint"):
        joint.set("independent", "true" if joint.get("name") in names else "false")
    document = Document(description.file, source=description.source, quiet=True)
    return build(ElementTree.tostring(root, encoding="unicode"), document, description.parameters)
