"""Values as JSON and arrays, and back: dataclasses of vrbench's own, nothing that could run.

What comes back is the value with every array contiguous and every number a plain one, whether it
went through a file or not, so that what is computed from it is the same to the last digit.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel

Arrays = list[npt.NDArray[Any]]
KINDS = "biuf"


class UnpackableError(Exception):
    """A value holds something that can't be kept."""


def pack(value: Any, given: object = None) -> tuple[Any, Arrays]:
    """A value as what JSON can hold, and its arrays.

    Args:
        value: numbers, text, None, arrays, and collections and vrbench's dataclasses of them.
        given: a part of the value that isn't to be kept, for `unpack` will be given it.

    Raises:
        UnpackableError: there is something else in it.
    """
    packer = _Packer(given)
    return packer.tree(value), packer.arrays


class _Packer:
    def __init__(self, given: object) -> None:
        self._given = given
        self.arrays: Arrays = []
        self._known: dict[int, tuple[int, object]] = {}

    def tree(self, value: Any) -> Any:
        if self._given is not None and value is self._given:
            return {"given": 0}
        if value is None or isinstance(value, str | bool):
            return value
        if isinstance(value, int | float | np.generic):
            return _number(value)
        if isinstance(value, np.ndarray):
            return {"array": self._array(value)}
        if isinstance(value, BaseModel):
            return {"model": _name(type(value)), "json": value.model_dump_json()}
        if is_dataclass(value) and not isinstance(value, type):
            content = [self.tree(getattr(value, field.name)) for field in fields(value)]
            return {"class": _name(type(value)), "of": content}
        if isinstance(value, Mapping):
            return {"map": [[self.tree(k), self.tree(v)] for k, v in value.items()]}
        for kind, name in ((tuple, "tuple"), (list, "list")):
            if isinstance(value, kind):
                return {name: [self.tree(one) for one in value]}
        if isinstance(value, frozenset):
            return {"set": [self.tree(one) for one in sorted(value)]}
        raise UnpackableError(f"a {type(value).__name__}")

    def _array(self, value: npt.NDArray[Any]) -> int:
        if value.dtype.kind not in KINDS or not value.dtype.isnative:
            raise UnpackableError(f"an array of {value.dtype}")
        if id(value) not in self._known:
            # the array itself is held, or another could come to have its id
            self._known[id(value)] = len(self.arrays), value
            self.arrays.append(np.ascontiguousarray(value).reshape(value.shape))
        return self._known[id(value)][0]


def _number(value: Any) -> bool | int | float:
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, bool):
        return plain
    if isinstance(plain, int):
        return int(plain)
    if isinstance(plain, float):
        return float(plain)
    raise UnpackableError(f"a {type(value).__name__}")


def _name(kind: type) -> str:
    if not kind.__module__.startswith("vrbench.") or "<" in kind.__qualname__:
        raise UnpackableError(f"a {kind.__name__}")
    return f"{kind.__module__}:{kind.__qualname__}"


def unpack(tree: Any, arrays: Sequence[npt.NDArray[Any]], given: object = None) -> Any:
    """The value of a tree and its arrays.

    Raises:
        ValueError: it isn't what `pack` makes.
    """
    if not isinstance(tree, dict):
        return tree
    match tree:
        case {"given": 0}:
            return given
        case {"array": int(index)}:
            return arrays[index]
        case {"model": str(name), "json": str(text)}:
            return _class(name, BaseModel).model_validate_json(text)
        case {"class": str(name), "of": list(content)}:
            return _class(name, object)(*(unpack(one, arrays, given) for one in content))
        case {"map": list(items)}:
            return {unpack(k, arrays, given): unpack(v, arrays, given) for k, v in items}
        case {"tuple": list(content)}:
            return tuple(unpack(one, arrays, given) for one in content)
        case {"list": list(content)}:
            return [unpack(one, arrays, given) for one in content]
        case {"set": list(content)}:
            return frozenset(unpack(one, arrays, given) for one in content)
    raise ValueError(f"no such node: {list(tree)}")


def _class(name: str, base: type) -> Any:
    module, _, qualified = name.partition(":")
    if not module.startswith("vrbench."):
        raise ValueError(f"not of vrbench: {name}")
    found = getattr(importlib.import_module(module), qualified, None)
    wanted = isinstance(found, type) and issubclass(found, base)
    if not wanted or (base is object and not is_dataclass(found)):
        raise ValueError(f"no such class: {name}")
    return found
