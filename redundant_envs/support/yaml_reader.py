"""YAML text as plain data, within bounds, and the lines of what is in it."""

import re
from typing import Any

import yaml

from redundant_envs.support.values import DEEPEST, LONGEST, MAX_VALUES, shown


class _Mistake(Exception):
    """Something that a file must not have: its line, and the problem in words."""


class _Reader(yaml.SafeLoader):
    """Plain data only: no tags, no aliases, no keys twice; numbers as in YAML 1.2, so 1e-6 is one."""

    yaml_implicit_resolvers: dict[Any, Any] = {}
    depth = count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        line = _line(event)
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise _Mistake(line, "it has an anchor (&) or an alias (*); write the value out each time")
        if getattr(event, "tag", None) is not None:
            raise _Mistake(line, f"it has the tag {shown(event.tag)}; write plain values without tags")
        self.count += 1
        self.depth += 1
        if self.depth > DEEPEST:
            raise _Mistake(line, f"it is nested more than {DEEPEST} deep; write plain data")
        if self.count > MAX_VALUES:
            raise _Mistake(line, f"it holds more than {MAX_VALUES} values; write fewer")
        node = super().compose_node(parent, index)  # type: ignore[no-untyped-call]
        self.depth -= 1
        return node

    def table(self, node: yaml.MappingNode) -> dict[Any, Any]:
        """A mapping whose keys are plain and different."""
        table: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise _Mistake(_line(key_node), "a key is a list or a mapping; write a plain name")
            key = self.construct_object(key_node)  # type: ignore[no-untyped-call]
            if key in table:
                raise _Mistake(_line(key_node), f"the key {shown(key)} is there twice; keep one of them")
            table[key] = self.construct_object(value_node, deep=True)  # type: ignore[no-untyped-call]
        return table

    def number(self, node: yaml.ScalarNode) -> float:
        """A whole number, or a float, as the tag of the node says."""
        text = str(node.value).replace("_", "").lower()
        return int(text) if node.tag.endswith("int") else float(re.sub(r"\.(?=inf|nan)", "", text))


def _line(node_or_event: Any) -> int:
    return int(node_or_event.start_mark.line) + 1


_Reader.add_constructor("tag:yaml.org,2002:map", _Reader.table)
_Reader.add_constructor("tag:yaml.org,2002:int", _Reader.number)
_Reader.add_constructor("tag:yaml.org,2002:float", _Reader.number)
for _kind, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9][0-9_]*", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9][0-9_]*|[0-9][0-9_]*(\.[0-9_]*)?)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", list("-+.")),
):
    _Reader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(rf"(?:{_pattern})$"), _first)


def parsed(text: str, where: str) -> Any:
    """The content of YAML text; ``where`` names it in messages, which know the line of a mistake."""
    loader = None
    try:
        loader = _Reader(text)
        return loader.get_single_data()  # type: ignore[no-untyped-call]
    except _Mistake as mistake:
        line, problem = mistake.args
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        problem = f"it has the character {shown(chr(error.character))}, which YAML does not allow; remove it"  # type: ignore[arg-type]
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        parts = (" ".join(str(p).split()) for p in (error.context, error.problem) if p)
        problem = f"it is not valid YAML: {', '.join(parts)[: 2 * LONGEST]}"
    except Exception as error:  # PyYAML lets errors of int() and chr() through, as of "\\UFFFFFFFF"
        line = loader.line + 1 if loader else 1
        problem = f"it is not valid YAML: an escape or a number is out of range ({shown(str(error))})"
    raise ValueError(f"{where}, line {line}: {problem}")


def line_of(message: str, text: str) -> int | None:
    """The line of YAML text with the value that a message names first, such as effects[1].g or Gravity.g, or
    with the key in it that is unknown; None if there is none."""
    lines: dict[str, int] = {}
    _collect(yaml.compose(text, _Reader), {""}, lines)
    name = re.split(r"[^\w.\[\]]", message, maxsplit=1)[0]
    unknown = re.search(r"has the unknown key '(.*?)'; valid", message)
    if unknown and (line := lines.get(f"{name}.{unknown[1]}", lines.get(unknown[1]))):
        return line
    while name and name not in lines:  # else what is around it
        name = name[: max(name.rfind("."), name.rfind("["), 0)]
    return lines.get(name)


def _collect(node: Any, names: set[str], lines: dict[str, int]) -> None:
    """Note the lines of what is in a node, which messages call by any of these names, or by its type."""
    if isinstance(node, yaml.MappingNode):
        names = names | {str(value.value) for key, value in node.value if key.value == "type"}
        inner = [({f"{n}.{key.value}".lstrip(".") for n in names}, key, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode):
        inner = [({f"{n}[{k}]" for n in names}, value, value) for k, value in enumerate(node.value)]
    else:
        return
    for called, at, value in inner:
        for name in called:
            lines.setdefault(name, _line(at))
        _collect(value, called, lines)
