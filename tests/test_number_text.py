"""Plain text of numbers: to the last digit, and only where it is plain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vrbench import number_text
from vrbench.number_text import read_plain

FORMATS = (repr, "{:.18e}".format, "{:.9f}".format, "{:.25f}".format, "{:.17g}".format)
finite = st.floats(allow_nan=False, allow_infinity=False)
words = st.one_of(
    st.tuples(finite, st.sampled_from(FORMATS)).map(lambda pair: pair[1](pair[0])),
    st.integers(-(10**25), 10**25).map(str),
)


@given(st.lists(st.lists(words, min_size=3, max_size=3), min_size=1, max_size=20), st.booleans())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_numbers_are_those_of_float(tmp_path: Path, rows: list[list[str]], ended: bool) -> None:
    path = tmp_path / "numbers.txt"
    path.write_text("\n".join(map(" ".join, rows)) + "\n" * ended)
    found = read_plain(path, 3)
    np.testing.assert_array_equal(found, [[float(word) for word in row] for row in rows])


@pytest.mark.parametrize(
    "text", ["# time x\n1 2\n3 4\n", "\ufeff1 2\n3 4\n", "# a\n# b\n1 2\r\n3 4\r\n", "1 2\n3 4"]
)
def test_comments_above_and_other_line_ends_are_plain(tmp_path: Path, text: str) -> None:
    path = tmp_path / "numbers.txt"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(read_plain(path, 2), [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "# nothing\n",
        "1 2 3\n4\n",
        "1\n2 3 4\n",
        "1  2\n3 4\n",
        "1 2 \n3 4\n",
        "1 2\n\n3 4\n",
        "1 2\n# between\n3 4\n",
        "1 nan\n3 4\n",
        "1 true\n3 null\n",
        '1 "2"\n3 4\n',
        "1 [2]\n3 4\n",
        "1 .5\n3 4\n",
        "1,2\n3,4\n",
        "1 2\n3",
        "one two\n",
    ],
)
def test_all_else_is_left_to_others(tmp_path: Path, text: str) -> None:
    path = tmp_path / "numbers.txt"
    path.write_text(text)
    assert read_plain(path, 2) is None


@pytest.mark.parametrize("chunk", [7, 8, 9, 100])
def test_chunks_end_between_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(number_text, "CHUNK_BYTES", chunk)
    rows = np.arange(60).reshape(-1, 2)
    path = tmp_path / "numbers.txt"
    path.write_text("".join(f"{a} {b}\n" for a, b in rows))
    np.testing.assert_array_equal(read_plain(path, 2), rows)
