"""What holds for everything a plugin offers: names, titles, options, and what loading it costs."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel, ValidationError

from vrbench.plugin.manager import BUILTIN
from vrbench.plugin.testing.child import check_registration
from vrbench.plugin.testing.verdicts import (
    Conformance,
    NonconformityError,
    NotCheckedError,
    require,
)

NAME = re.compile(r"[a-z0-9]+([-_][a-z0-9]+)*")
UNKNOWN = "no_such_option"


class Offered(Conformance):
    """What every kind is held to."""

    def test_name_and_title(self) -> None:
        """Its name is one that YAML files and folders can bear, and it has a title."""
        spec = self.thing()
        require(
            NAME.fullmatch(self.name),
            f"{self.name!r} is no good name",
            "Lower-case letters and digits, joined by hyphens: quest-2.",
        )
        require(
            getattr(spec, "title", " ").strip() or self.kind == "suite",
            "it has no title",
            "Say in `title` what it is, for people.",
        )

    def test_its_plugin_is_whole(self) -> None:
        """Every hook of its plugin gives what it should, and nobody else offers this name."""
        self.thing()
        info = self.plugins().offered_by(self.kind, self.name)
        require(
            not info.broken,
            f"plugin {info.name}: {info.broken}",
            "Mend that hook; docs/plugins.md says what each returns.",
        )
        others = ", ".join(self.plugins().passed_by(self.kind, self.name))
        require(
            not others,
            f"{others} offers a {self.kind} called {self.name!r} too",
            "Take another name: which of the two is used is a matter of the alphabet.",
        )

    def test_registering_imports_no_vendor_sdk(self) -> None:
        """Listing plugins loads none of the libraries that only this plugin needs."""
        self.thing()
        info = self.plugins().offered_by(self.kind, self.name)
        if info.name != BUILTIN:
            check_registration(info.name)


class WithOptions(Offered):
    """What a kind is held to that has options."""

    def test_options_reject_unknown_keys(self) -> None:
        """An option that is misspelt in a rig is told, and not passed by."""
        check_options(self.thing().options)

    def test_options_are_described(self) -> None:
        """Every option has a description: editors and `vrbench schema` show it."""
        model: type[BaseModel] = self.thing().options
        bare = [
            name
            for name, field in model.model_fields.items()
            if not field.description and name not in (model.__doc__ or "")
        ]
        require(
            not bare,
            f"options without a description: {', '.join(bare)}",
            'Write Field(..., description="what it is [unit]").',
        )


class WithStandIn(WithOptions):
    """What a kind is held to whose devices a stand-in can play."""

    @classmethod
    def stand_in(cls, rehearsal: Any) -> Any:
        """The stand-in of the device spec."""
        stand_in = cls.thing().stand_in
        if stand_in is None:
            raise NotCheckedError(
                f"{cls.name} has no stand-in",
                "write one: stand_in=... in the spec, see docs/plugins.md",
            )
        return stand_in(rehearsal)


def check_options(model: Any) -> None:
    """That a model of options is one, and closed.

    Raises:
        NonconformityError: it isn't.
    """
    require(
        isinstance(model, type) and issubclass(model, BaseModel),
        f"options is {model!r}",
        "It is a pydantic model: class Options(BaseModel).",
    )
    try:
        model.model_validate({UNKNOWN: 1})
    except ValidationError as error:
        if any(problem["type"] == "extra_forbidden" for problem in error.errors()):
            return
    raise NonconformityError(
        f"options take the unknown key {UNKNOWN!r}",
        'Write model_config = ConfigDict(extra="forbid") in the options.',
    )
