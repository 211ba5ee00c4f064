"""Reads XML as mapping programs really write it: undeclared prefixes, wrong encodings, HTML entities."""

import re
from html.entities import html5
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from auv_lse_common.mission_file.parameters import ParameterError

#: Maximum nesting of elements; no map needs more.
_MAX_DEPTH = 200


def read_xml(data: bytes, where: str) -> Element:
    """The root of an XML document; names have no prefix.

    A document that is not well formed because of its declared encoding, or of `&` and entities of HTML, is repaired.

    Raises:
        ParameterError: if it is not XML, or has a document type declaration.
    """
    data = data.lstrip(b"\xef\xbb\xbf \t\r\n") if data[:2] not in (b"\xff\xfe", b"\xfe\xff") else data
    try:
        return _parsed(data, None, where)
    except expat.ExpatError as error:
        first = error
    for encoding in ("utf-8", "utf-16", "cp1252"):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        try:
            return _parsed(_without_entities(text).encode(), "utf-8", where)
        except expat.ExpatError:
            continue
    raise ParameterError(f"{where} is not valid XML: {first}. Export it again") from first


def _without_entities(text: str) -> str:
    """XML with the entities of HTML as letters, and a bare & as text."""

    def letter(match: re.Match[str]) -> str:
        return html5.get(match[1] or "", f"&amp;{match[1] or ''}")

    return re.sub(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)(\w{1,32};)?", letter, text)


def _parsed(data: bytes, encoding: str | None, where: str) -> Element:
    builder = TreeBuilder()
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _MAX_DEPTH:
            raise ParameterError(f"{where}: elements are nested {depth} deep. This is not a map")
        builder.start(name.rpartition(":")[2], attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name.rpartition(":")[2])

    def doctype(*_: object) -> None:
        raise ParameterError(f"{where} has a document type declaration, which is not read. Remove the DOCTYPE")

    parser = expat.ParserCreate(encoding)
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = doctype
    parser.buffer_text = True
    parser.Parse(data, True)
    return builder.close()


def text_of(element: Element, name: str) -> str:
    """The text of a child; "" if there is none."""
    child = element.find(name)
    return "" if child is None else "".join(child.itertext()).strip()
