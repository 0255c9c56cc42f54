"""YAML of other tools, read as plain mappings, lists and texts.

Scalars keep the text that the file has: YAML's own rules take ``1e5`` for a text and ``1:30`` for ninety.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from recon.errors import RescoreError


class _Loader(yaml.SafeLoader):
    """The safe loader without guesses about scalars, which refuses aliases and names that occur twice."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - as PyYAML declares it
    yaml_constructors = {  # noqa: RUF012 - as PyYAML declares it
        tag: make
        for tag, make in yaml.SafeLoader.yaml_constructors.items()
        if tag is None or tag.endswith((":str", ":seq", ":map"))
    }

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        # a few lines of aliases of aliases stand for more than any memory holds
        if self.check_event(yaml.AliasEvent):
            event = self.get_event()  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="an alias, which is not read", problem_mark=event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        found = super().construct_mapping(node, deep)
        if len(found) != len(node.value):
            raise yaml.MarkedYAMLError(problem="a name that occurs twice", problem_mark=node.start_mark)
        return found


def _opencv(loader: _Loader, suffix: str, node: yaml.Node) -> object:
    """What an OpenCV tag such as ``!!opencv-matrix`` marks, as if it were not there."""
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode) and suffix != "matrix":
        return loader.construct_sequence(node, deep=True)
    raise yaml.MarkedYAMLError(problem=f"an OpenCV {suffix} without entries", problem_mark=node.start_mark)


_Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", _opencv)


def read_yaml(path: Path, text: str) -> list[dict[str, object]]:
    """Each document of a YAML file that is a mapping, its names as texts.

    Raises:
        RescoreError: the text is no YAML, or uses aliases, other tags than OpenCV's, or a name twice.
    """
    # OpenCV's first line is none of YAML's
    text = re.sub(r"\A(\s*)%YAML:[^\n]*", r"\1", text)
    try:
        documents = list(yaml.load_all(text, Loader=_Loader))
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f" in line {error.problem_mark.line + 1}"
        raise RescoreError(
            f"{path}: expected YAML, got a mistake{line} ({error.problem}); mend it"
        ) from error
    except (yaml.YAMLError, RecursionError) as error:
        what = "lists too deep in each other" if isinstance(error, RecursionError) else str(error)
        raise RescoreError(f"{path}: expected YAML, got {' '.join(what.split())}; mend it") from error
    return [{str(k): v for k, v in d.items()} for d in documents if isinstance(d, dict)]
