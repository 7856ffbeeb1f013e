"""How pages are made: templates whose texts are escaped, one style sheet, one script, no network.

A page of a site takes both from files beside it; a report of its own has them within, and its
policy names them by digest. Either way a browser loads nothing else and runs nothing else.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files
from secrets import token_hex
from typing import TYPE_CHECKING, Any

from vrbench.errors import ConfigError

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

SCRIPTS = ("chart.js", "space.js", "figures.js", "tables.js")
SCRIPT, STYLE = "vrbench.js", "vrbench.css"
# A character that no text holds but to part texts.
SEPARATOR = "\x1f"
# What turns the direction of what stands beside it: a name in a page would rewrite its neighbours.
TURNING = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
POLICY = (
    "default-src 'none'; script-src {script}; style-src {style}; img-src data:; "
    "base-uri 'none'; form-action 'none'"
)


def render(template: str, *, shared: bool, curves: str = "", **values: Any) -> str:
    """A page.

    Args:
        template: its file.
        shared: whether script and style lie beside the page, or within it.
        curves: JSON for the script, most of a page; the script itself minds what turns texts.
        values: what the template shows.

    Raises:
        ConfigError: jinja2 isn't installed.
    """
    if shared:
        policy = POLICY.format(script="'self'", style="'self'")
        values |= {"script": None, "style": None, "script_file": SCRIPT, "style_file": STYLE}
    else:
        policy = POLICY.format(script=_digest(script()), style=_digest(style()))
        values |= {"script": script(), "style": style()}
    place = token_hex(16)
    page = _environment().get_template(template).render(policy=policy, curves=place, **values)
    for character in TURNING:
        page = page.replace(character, "")
    return page.replace(place, curves)


@cache
def script() -> str:
    """The one script of all pages; each of its parts is a function's scope of its own."""
    parts = "\n".join(_asset(name) for name in SCRIPTS)
    return f"(() => {{\n{parts}}})();\n"


@cache
def style() -> str:
    """The style sheet of all pages."""
    return _asset("page.css")


def number(value: float | None, digits: int = 4) -> str:
    """A number as tables show it, with a true minus; nothing for None."""
    if value is None:
        return ""
    text = f"{value:.{digits}g}" if abs(value) < 1e4 else f"{value:.0f}"
    return text.replace("-", "\N{MINUS SIGN}")


def fixed(value: float | None, decimals: int) -> str:
    """A number of a column in which all have as many decimals; nothing for None."""
    return "" if value is None else f"{value:.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def sentence(text: str) -> str:
    """The text as a sentence begins; all else is left as it is, names too."""
    return text[:1].upper() + text[1:]


def three(value: float) -> str:
    """A number to three digits, noughts at its end too."""
    text = f"{value:#.3g}" if 1e-3 <= abs(value) < 1e3 else f"{value:.4g}"
    return text.rstrip(".").replace("-", "\N{MINUS SIGN}")


def cells(texts: Sequence[str]) -> Markup:
    """The cells of a row of a table, escaped, all at once: big tables have many."""
    from markupsafe import Markup, escape

    whole = str(escape(SEPARATOR.join(texts)))
    return Markup("<td>" + whole.replace(SEPARATOR, "</td><td>") + "</td>")


def json_text(text: str) -> Markup:
    """JSON as the content of a script element: nothing in it can end that element."""
    from markupsafe import Markup

    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


@cache
def _environment() -> Environment:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError:
        raise ConfigError(
            "pages of HTML need jinja2, which is not installed", fix="pip install 'vrbench[report]'"
        ) from None
    environment = Environment(
        loader=PackageLoader("vrbench.results.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(number=number, fixed=fixed, cells=cells, sentence=sentence)
    return environment


def _asset(name: str) -> str:
    return files("vrbench.results.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"
