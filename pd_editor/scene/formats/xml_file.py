"""XML files of foreign formats: nothing is fetched, expanded or called."""

from pathlib import Path
from typing import Final

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import FormatError
from pd_editor.scene.formats.packed_file import read_unpacked

EDITOR: Final = "Path Diffuser Editor"
"""Author or vendor of exports."""


def parse_xml(path: Path, root: str | None) -> tuple["Place", bytes]:
    """Root of a file, which may be gzipped, without comments; the file's bytes.

    It has the name ``root``; None: any.

    Raises:
        FormatError: the file is no XML, has another root, or declares a document type,
            which could hold entities.
    """
    content, data = read_unpacked(path)
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
        huge_tree=False,
    )
    try:
        # Blanks before the declaration, which XML forbids, are passed over.
        content = content.lstrip()
        if _is_mislabelled(content):
            content = content.decode("latin-1").encode()
        found = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as error:
        raise FormatError(f"{path}: is no valid XML ({error.msg}).") from error
    document_type = found.getroottree().docinfo.internalDTD
    if document_type is not None and any(document_type.iterentities()):
        raise FormatError(f"{path}: declares entities in its DOCTYPE; expected none.")
    if found.tag != root and etree.QName(found).localname == root:
        for one in found.iter(etree.Element):
            one.tag = etree.QName(one).localname
    if root is not None and found.tag != root:
        raise FormatError(f"{path}: its root is <{found.tag}>; expected <{root}>.")
    return Place(path, found), data


def _is_mislabelled(content: bytes) -> bool:
    """Whether a text is said to be in UTF-8, which is the default, and is not."""
    head = content[:200].lower()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff") or (
        b"encoding" in head and b"utf-8" not in head
    ):
        return False
    try:
        content.decode()
    except UnicodeDecodeError:
        return True
    return False


def added(parent: etree._Element, tag: str, **attributes: object) -> etree._Element:
    """A new element below another one; numbers have ten digits."""
    texts = {
        name: f"{value + 0.0:.10g}" if isinstance(value, float) else str(value)
        for name, value in attributes.items()
    }
    return etree.SubElement(parent, tag, texts)


def told_of(element: etree._Element, *names: str) -> str:
    """What attributes, children and ``userData`` of some names tell; empty if nothing.

    Exports of this editor only tell what their source told.
    """
    if EDITOR in (element.get("author"), element.get("vendor")):
        names = ("source",)
    found: list[str] = []
    for name in names:
        child, data = element.find(name), element.find(f"userData[@code='{name}']")
        for text in (
            element.get(name),
            None if child is None else child.get("name") or child.text,
            None if data is None else data.get("value"),
        ):
            if text and text.strip() and text.strip() not in found:
                found.append(f"{name}: {text.strip()}")
    told = "; ".join(found)
    return told.removeprefix("source: ") if names == ("source",) else told


def as_file(root: etree._Element) -> bytes:
    """The bytes of a file of an element."""
    return etree.tostring(
        root, encoding="UTF-8", xml_declaration=True, pretty_print=True
    )


class Place:
    """An element with its file, for errors that name both and the line."""

    def __init__(self, path: Path, element: etree._Element) -> None:
        self.path, self.element = path, element

    def error(self, what: str) -> FormatError:
        """An error about the element."""
        name = self.element.get("id")
        about = f"<{self.element.tag}>" + (f" {name}" if name else "")
        return FormatError(
            f"{self.path}, line {self.element.sourceline}: {about} {what}"
        )

    def child(self, tag: str) -> "Place":
        """The only element of a name below this one.

        Raises:
            FormatError: there is none.
        """
        found = self.element.find(tag)
        if found is None:
            raise self.error(f"has no <{tag}>.")
        return Place(self.path, found)

    def children(self, tag: str) -> list["Place"]:
        """All elements of a name directly below this one, or of a path of names."""
        return [Place(self.path, one) for one in self.element.findall(tag)]

    def get(self, name: str, default: str = "") -> str:
        """An attribute; if it is missing or empty, a default."""
        return self.element.get(name) or default

    def text(self, tag: str) -> str:
        """What is in the first element of a name below this one; empty if none is."""
        return (self.element.findtext(tag) or "").strip()

    def attribute(self, name: str) -> str:
        """A required attribute.

        Raises:
            FormatError: it is missing.
        """
        text = self.element.get(name)
        if text is None:
            raise self.error(f"has no attribute {name!r}.")
        return text

    def number(self, name: str | None = None, default: float | None = None) -> float:
        """A finite number: an attribute's, or the element's text.

        Raises:
            FormatError: it is missing without a default, or no finite number.
        """
        if default is not None and name is not None and not self.get(name):
            return default
        text = (self.element.text or "") if name is None else self.attribute(name)
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        # Squares of larger ones may be infinite.
        if not abs(value) < 1e30:
            what = "its text" if name is None else name
            is_finite = abs(value) < float("inf")
            kind = "number below 1e30" if is_finite else "finite number"
            raise self.error(f"needs a {kind} for {what}, not {text.strip()[:40]!r}.")
        return value

    def integer(self, name: str | None = None) -> int:
        """A whole number of at most 18 digits: an attribute's, or the element's text.

        Raises:
            FormatError: it is missing, or no whole number.
        """
        value = self.number(name)
        if value != int(value) or abs(value) >= 1e18:
            raise self.error(f"needs a whole number, not {value:g}.")
        return int(value)
