"""Third-party XML without entities, because a few lines of them can expand to gigabytes or read other files."""

from __future__ import annotations

from xml.etree import ElementTree


class _Builder(ElementTree.TreeBuilder):
    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ValueError("it has a DOCTYPE, which can define entities; remove that line")


def parsed(data: bytes | str) -> ElementTree.Element:
    """The root element of a document.

    Raises:
        ValueError: It is not XML, or has a document type.
    """
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_Builder()))
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from None
