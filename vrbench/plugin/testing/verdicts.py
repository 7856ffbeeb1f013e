"""What a check says, and the base of all conformance tests."""

from __future__ import annotations

import unittest
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeVar

from vrbench.plugin.manager import Plugins

Result = TypeVar("Result")
Status = Literal["passed", "failed", "not checked"]


class NonconformityError(AssertionError):
    """A plugin doesn't do what its hook promises.

    Args:
        what: what was found, in a sentence.
        fix: what to do.
    """

    def __init__(self, what: str, fix: str) -> None:
        self.what, self.fix = what, fix
        super().__init__(f"{what}. {fix}")


class NotCheckedError(unittest.SkipTest):
    """A check that needs something which isn't there; pytest shows it as skipped.

    Args:
        why: what isn't there.
        fix: how to have it.
    """

    def __init__(self, why: str, fix: str) -> None:
        self.why, self.fix = why, fix
        super().__init__(f"{why}: {fix}")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one check found.

    Attributes:
        check: its name.
        title: what it is about, in a sentence.
        status: how it ended.
        what: what was found, where it didn't pass.
        fix: what to do then.
    """

    check: str
    title: str
    status: Status
    what: str = ""
    fix: str = ""


# What the tests of a class share, by class.
_KEPT: dict[type, dict[str, Any]] = {}


def require(holds: object, what: str, fix: str) -> None:
    """Passes where a condition holds.

    Raises:
        NonconformityError: it doesn't.
    """
    if not holds:
        raise NonconformityError(what, fix)


def given(make: Callable[[], Result], else_: str) -> Result:
    """What a check builds upon; where that is wrong itself, its own check tells.

    Raises:
        NotCheckedError: it is.
    """
    try:
        return make()
    except NotCheckedError:
        raise
    except Exception:
        raise NotCheckedError(else_, "mend what the failed check tells") from None


class Conformance:
    """Tests that every plugin of a kind passes; inherit one, and say `name`.

    Each method `test_...` is one check: pytest runs them where they are inherited, and
    `vrbench plugin check NAME` runs the same.

    Attributes:
        kind: `headset`, `mocap`, `robot`, `importer`, `metric` or `suite`.
        name: what rigs, recordings and suites call the thing that is tested.
    """

    kind: ClassVar[str]
    name: ClassVar[str] = ""

    @classmethod
    def kept(cls, what: str, make: Any) -> Any:
        """What `make()` gives, made once for all tests of the class."""
        store = _KEPT.setdefault(cls, {})
        if what not in store:
            store[what] = make()
        return store[what]

    @classmethod
    def plugins(cls) -> Plugins:
        """All that is installed."""
        plugins: Plugins = cls.kept("plugins", Plugins)
        return plugins

    @classmethod
    def thing(cls) -> Any:
        """What is tested, as its plugin offers it.

        Raises:
            NonconformityError: no plugin offers it; broken ones are named.
        """
        plugins = cls.plugins()
        things = plugins.things(cls.kind)
        broken = "; ".join(f"{info.name}: {info.broken}" for info in plugins.infos if info.broken)
        require(
            cls.name in things,
            f"no {cls.kind} is called {cls.name!r}: there are {', '.join(things) or 'none'}",
            broken
            or "Install the distribution, and name its module in the group `vrbench` of its "
            "entry points.",
        )
        return things[cls.name]

    @classmethod
    def checks(cls) -> Iterator[str]:
        """Names of the checks, in the order they are written in."""
        seen = dict.fromkeys(
            name for base in reversed(cls.__mro__) for name in vars(base) if name.startswith("test")
        )
        yield from seen

    @classmethod
    def run(cls) -> list[Outcome]:
        """Runs every check; one that fails stops no other."""
        return [cls._outcome(name) for name in cls.checks()]

    @classmethod
    def _outcome(cls, name: str) -> Outcome:
        method = getattr(cls(), name)
        title = (method.__doc__ or name).strip().splitlines()[0]
        check = name.removeprefix("test_")
        try:
            method()
        except NotCheckedError as error:
            return Outcome(check, title, "not checked", error.why, error.fix)
        except NonconformityError as error:
            return Outcome(check, title, "failed", error.what, error.fix)
        except Exception as error:  # a plugin may raise anything
            told = f"raises {type(error).__name__}: {error}"
            return Outcome(check, title, "failed", told, "Mend it, or raise a VrbenchError.")
        return Outcome(check, title, "passed")
