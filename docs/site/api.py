"""The API: a page for each topic, with all its names in a table."""

from __future__ import annotations

import enum
import inspect
import re
from typing import Any

from topics import HOOKS, TOPICS, Topic

import redundant_envs as rde
from redundant_envs.effects import Effect
from redundant_envs.effects.hooks import snake_case
from redundant_envs.support.tables import markdown

MOST_ARGUMENTS = 8
"""Functions of more are those of the equations, which find each other by the names of their arguments."""


def pages() -> dict[str, str]:
    """All pages by their places in the site, and one that lists them."""
    made = {f"reference/api/{name}.md": page(topic) for name, topic in TOPICS.items()}
    rows = [
        (
            f"[{topic.title}](api/{name}.md)",
            ", ".join(f"`{n}`" for names in topic.names.values() for n in names),
        )
        for name, topic in TOPICS.items()
    ]
    table, order = markdown(("topic", "names"), rows, formatted=True), [f"api/{name}" for name in TOPICS]
    below = "\n".join(["```{toctree}", ":hidden:", "", *order, "```"])
    return {"reference/api.md": f"# API\n\n{table}\n\n{below}\n", **made}


def page(topic: Topic) -> str:
    """A page: what it is about, an example, a table of its names, and their docstrings."""
    named = [
        (f"{module}.{name}", found(module, name)) for module in topic.names for name in topic.names[module]
    ]
    rows = [(_link(path, value), summary(value)) for path, value in named]
    parts = [f"# {topic.title}", topic.about]
    parts.append(f"```python\n{topic.example.strip()}\n```")
    parts.append(markdown(("name", ""), rows, formatted=True))
    parts += [described(path, value) for path, value in named if not own_page(value)]
    return "\n\n".join(parts) + "\n"


def found(module: str, name: str) -> Any:
    return getattr(__import__(module, fromlist=[name]), name)


def summary(value: Any) -> str:
    """The first sentence of its own docstring."""
    text = " ".join(inspect.cleandoc(vars(value).get("__doc__") or value.__doc__).split())
    return re.split(r"(?<=[.:;]) ", text)[0].rstrip(".:;").replace("``", "`") + "."


def own_page(value: Any) -> str | None:
    """The page of an effect, or of the protocol of tasks; others have none."""
    if value is rde.Task:
        return "../../tasks/Task.md"
    effect = inspect.isclass(value) and issubclass(value, Effect) and value.__name__ not in HOOKS
    return f"../../effects/{snake_case(value.__name__)}.md" if effect else None


def _link(path: str, value: Any) -> str:
    return f"[`{path.rpartition('.')[2]}`]({own_page(value) or f'#{path}'})"


def described(path: str, value: Any) -> str:
    """The directive that takes a docstring, under a title."""
    title = f"## {path.rpartition('.')[2]}"
    kind = "class" if inspect.isclass(value) else "function"
    members = ""
    if kind == "class":
        named = methods(value)
        members = f"\n   :members: {', '.join(named)}" if named else ""
        if issubclass(value, enum.Enum):
            members = "\n   :members:\n   :undoc-members:"
    return f"{title}\n\n```{{eval-rst}}\n.. auto{kind}:: {path}{members}\n```"


def methods(kind: type) -> list[str]:
    """Names of the methods and properties that users call, of a class and its bases in the package; not of
    bases that some page describes."""
    every = {
        found(module, name) for topic in TOPICS.values() for module, ns in topic.names.items() for name in ns
    }
    elsewhere = {name for base in kind.__mro__[1:] if base in every for name in dir(base)}
    names: dict[str, Any] = {}
    for one in kind.__mro__:
        if one.__module__.startswith("redundant_envs"):
            names = {**vars(one), **names}
    own = (name for name in names if not name.startswith("_") and name not in elsewhere)
    return [name for name in own if _called(names[name])]


def _called(value: Any) -> bool:
    if isinstance(value, property):
        return bool(value.__doc__)
    value = value.__func__ if isinstance(value, classmethod) else value
    return (
        inspect.isfunction(value)
        and bool(value.__doc__)
        and len(inspect.signature(value).parameters) <= MOST_ARGUMENTS
    )
