"""The names and values of a calibration file, whatever it is written in: YAML, XML, JSON, INI or lines.

Values are texts, numbers, lists and mappings as the file nests them.
"""

import configparser
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree

from recon.errors import RescoreError
from recon.reading import read_text, reading
from rescore.formats.yaml_files import read_yaml

Named = dict[str, object]


def named_values(path: Path) -> list[Named]:
    """The names and values of each document of a calibration file; one document, but in YAML.

    Raises:
        RescoreError: no such file, no text, or not in the form that the end of its name says.
    """
    if not path.is_file():
        raise RescoreError(f"{path}: expected a calibration, found no file; check the path")
    form = FORMS.get(path.suffix.lower())
    if form is None:
        raise RescoreError(
            f"{path}: expected a calibration as {', '.join(FORMS)}, got {path.suffix!r}; convert it"
        )
    return form(path, read_text(path, "a calibration"))


def _of_lines(path: Path, text: str) -> list[Named]:
    """Lines of ``name: numbers`` or ``name=numbers``; messages that ROS prints are YAML."""
    if text.startswith(_TABLE):
        return [_of_table(text)]
    if re.search(r"^(distortion_model|camera_matrix)\s*:", text, re.MULTILINE):
        return read_yaml(path, text)
    pairs = (re.split(r"[=:]", line, maxsplit=1) for line in text.splitlines())
    return [{p[0].strip(): p[1].strip(" []").replace(";", " ") for p in pairs if len(p) == 2}]


_TABLE = "frame cameraID "
"""How a table of Virtual KITTI begins."""


def _of_table(text: str) -> Named:
    """The columns of each camera in the first frame: ``camera0`` and ``camera1``."""
    head, *lines = (line.split() for line in text.splitlines() if line.strip())
    rows = [dict(zip(head, line, strict=False)) for line in lines]
    return {f"camera{row.get('cameraID')}": row for row in rows if row["frame"] == rows[0]["frame"]}


def _of_xml(path: Path, text: str) -> list[Named]:
    """The entries of OpenCV's XML."""
    with reading(path, "OpenCV's XML", "write it again"):
        root = ElementTree.fromstring(text)
        if root.tag != "opencv_storage":
            raise RescoreError(
                f"{path}: expected OpenCV's XML (opencv_storage), got {root.tag[:40]!r}; convert it"
            )
        return [{element.tag: _value_of(element) for element in root}]


def _value_of(element: ElementTree.Element) -> object:
    if len(element):
        return {child.tag: _value_of(child) for child in element}
    return (element.text or "").strip()


def _of_json(path: Path, text: str) -> list[Named]:
    with reading(path, "a calibration as JSON", "write it again"):
        value = json.loads(text)
    if not isinstance(value, dict):
        raise RescoreError(
            f"{path}: expected a calibration as a JSON object, got a list or a value; name its parts"
        )
    return [value]


def _of_ini(path: Path, text: str) -> list[Named]:
    """The sections, each a mapping."""
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    # names keep their capitals
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    with reading(path, "sections of name=value", "check it"):
        parser.read_string(text)
    return [{name: dict(parser[name]) for name in parser.sections()}]


FORMS: Mapping[str, Callable[[Path, str], list[Named]]] = MappingProxyType(
    {
        ".yaml": read_yaml,
        ".yml": read_yaml,
        ".txt": _of_lines,
        ".xml": _of_xml,
        ".json": _of_json,
        ".conf": _of_ini,
    }
)
"""How a calibration file is read, by the end of its name."""
