"""Numbers as people read them, the same in a terminal, a table of text and a page."""

from __future__ import annotations


def significant(value: float | None, digits: int = 4) -> str:
    """So many digits that count, and no exponent where people don't expect one."""
    if value is None:
        return ""
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"
