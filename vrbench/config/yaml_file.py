"""YAML read with care: every error names file, line and field, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Collection, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from vrbench.errors import ConfigError

Model = TypeVar("Model", bound=BaseModel)
SYNTAX = "each key once, as `key: value`; text that holds : # [ ] { } wants quotes"


class _Loader(yaml.SafeLoader):
    """YAML as people mean it: 12:30 and 2024-01-31 and `on` stay text, a key stands once."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(
                    problem="a key that is no text", problem_mark=key.start_mark
                )
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"the key {key.value!r} stands twice", problem_mark=key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_PLAIN = {f"tag:yaml.org,2002:{kind}" for kind in ("timestamp", "int", "float", "bool")}
_Loader.yaml_implicit_resolvers = {
    letter: [(tag, pattern) for tag, pattern in pairs if tag not in _PLAIN]
    for letter, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$"), list("-+0123456789")
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?$"),
    list("-+.0123456789"),
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|false|False)$"), list("tTfF")
)


def as_yaml(content: Mapping[str, Any]) -> str:
    """JSON's types as YAML text, keys in their order."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True)


def load_yaml(path: Path) -> tuple[dict[str, Any], yaml.Node]:
    """The mapping that a YAML file holds, and the tree that knows its lines.

    Raises:
        ConfigError: no such file, not text, not YAML, a key twice, not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError("no such file", file=path, fix="a path to a .yaml file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("can't be read as text", file=path, fix=str(error)) from None
    try:
        root = yaml.compose(text, _Loader)
        content = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigError(f"not YAML: {error.problem}", file=f"{path}{place}", fix=SYNTAX) from None
    except RecursionError:
        raise ConfigError("nests too deep", file=path) from None
    except yaml.YAMLError as error:
        raise ConfigError(f"not YAML: {error}", file=path, fix=SYNTAX) from None
    if root is None or not isinstance(content, dict):
        raise ConfigError("holds no fields", file=path, fix="the file is a YAML mapping")
    return content, root


def load_model(path: Path, model: type[Model]) -> Model:
    """The file's content as a validated model.

    Raises:
        ConfigError: as `load_yaml`, and for every field that is unknown, missing or wrong.
    """
    content, root = load_yaml(path)
    return validate(content, model, path, root)


def validate(
    content: object,
    model: type[Model],
    path: str | Path,
    root: yaml.Node | None = None,
    under: Sequence[int | str] = (),
    beside: Collection[str] = (),
) -> Model:
    """Content as a model; errors name the file `path`, and lines where `root` is given.

    Content that is a part of the file stands `under` these fields of it, but for the fields that
    stand `beside` the last of them.

    Raises:
        ConfigError: a field is unknown, missing or wrong.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        problems = _innermost(error.errors(include_url=False))
        # a field that is misspelt is both unknown and missing: the first says more
        first = min(problems, key=lambda problem: problem["type"] == "missing")
        loc = first["loc"]
        what, fix = _told(first, loc, model)
        place = [*(under[:-1] if loc and loc[0] in beside else under), *loc]
        more = f"; {len(problems) - 1} more besides" if len(problems) > 1 else ""
        raise ConfigError(
            what + more,
            file=f"{path}{line_of(root, place)}",
            field=".".join(str(part) for part in place) or None,
            fix=fix,
        ) from None


def _innermost(problems: Sequence[Any]) -> list[Any]:
    """Problems without those of lists that only lack what is wrong within them."""
    within = {p["loc"][:n] for p in problems for n in range(len(p["loc"]))}
    return [p for p in problems if p["type"] != "too_short" or p["loc"] not in within]


def _told(problem: Any, loc: Sequence[int | str], model: type[BaseModel]) -> tuple[str, str | None]:
    """What was found, and what would be right."""
    kind, found = problem["type"], problem["input"]
    right = problem["msg"].removeprefix("Value error, ").replace("Input should", "it should")
    if kind == "missing":
        last = loc[-1]
        return "is missing", f"write `{last}: ...`" if isinstance(last, str) else "one value more"
    if kind == "extra_forbidden":
        return "there is no such field", _fields(loc, model)
    if kind == "value_error" and isinstance(found, dict | BaseModel):
        # the fields are at odds with each other; the message says how, and what to do
        what, _, fix = right.partition(": ")
        return what, fix or None
    if kind == "string_type" and isinstance(found, int | float):
        right += f', in quotes: "{found}"'
    return "found nothing" if found is None else f"found {found!r}", right


def line_of(root: yaml.Node | None, loc: Sequence[int | str]) -> str:
    """`:line:column` of a field, or of the innermost thing on the way to it."""
    if root is None:
        return ""
    node, mark = root, root.start_mark
    for part in loc:
        if isinstance(node, yaml.MappingNode):
            found = next(((k, v) for k, v in node.value if k.value == str(part)), None)
            if found is None:
                break
            mark, node = found[0].start_mark, found[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int):
            if part >= len(node.value):
                break
            node = node.value[part]
            mark = node.start_mark
    return f":{mark.line + 1}:{mark.column + 1}"


def located(file: str | Path, field: str) -> str:
    """`file:line:column` of a field like `takes.0.case`; the file alone where it isn't YAML."""
    path = Path(file)
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return str(file)
    loc = [int(part) if part.isdecimal() else part for part in field.split(".")]
    return f"{file}{line_of(load_yaml(path)[1], loc)}"


def _fields(loc: Sequence[int | str], model: type[BaseModel]) -> str | None:
    """For an unknown field, the fields there are."""
    owner: Any = model
    for part in loc[:-1]:
        if isinstance(part, str) and isinstance(owner, type) and issubclass(owner, BaseModel):
            info = owner.model_fields.get(part)
            owner = _model_in(info.annotation) if info else None
    if isinstance(owner, type) and issubclass(owner, BaseModel):
        names = [info.alias or name for name, info in owner.model_fields.items()]
        return f"fields are {', '.join(names)}" if names else "it has none besides"
    return None


def _model_in(annotation: Any) -> Any:
    """The pydantic model in an annotation like `list[Case]` or `Gate | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _model_in(inner)
        if found is not None:
            return found
    return None
