"""orjson and the standard library read the same; only the time differs."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from headway.feeds.json_text import parsed, parsed_strictly

NUMBERS = st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False, allow_infinity=False)
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(VALUES, st.booleans())
def test_it_reads_what_the_standard_library_reads(value: object, in_ascii: bool) -> None:
    text = json.dumps(value, ensure_ascii=in_ascii).encode("utf-8", "surrogatepass")
    try:
        expected = json.loads(text.decode("utf-8"))
    except UnicodeDecodeError:
        return
    assert parsed(text) == expected
    assert parsed_strictly(text) == expected


@pytest.mark.parametrize(
    ("text", "value"), [(b"1e999", math.inf), (b'"\\ud800"', "\ud800"), (b'{"a":1,"a":2}', {"a": 2})]
)
def test_it_reads_what_orjson_refuses(text: bytes, value: object) -> None:
    assert parsed(text) == value


@given(
    fields=st.lists(st.tuples(st.sampled_from('abc":'), VALUES), max_size=3),
    colon=st.sampled_from([":", " :", "\t:"]),
    beside=st.sampled_from(['":"', '" :"', '"\\u0022:"', '"\\":"', '""']),
)
def test_a_field_twice_is_an_error_where_it_is_strict(
    fields: list[tuple[str, object]], colon: str, beside: str
) -> None:
    """Whatever strings are beside, and however the text is written."""
    inner = ",".join(f"{json.dumps(name)}{colon}{json.dumps(value)}" for name, value in fields)
    text = f'[{{"x":{{{inner}}}}},{beside}]'.encode()
    if len({name for name, _ in fields}) < len(fields):
        with pytest.raises(ValueError, match="twice"):
            parsed_strictly(text)
    else:
        assert parsed_strictly(text) == json.loads(text)


def test_nan_is_a_number_to_be_refused_later() -> None:
    assert math.isnan(parsed(b"[NaN]")[0])


@pytest.mark.parametrize("text", [b"", b"{", b"\xff", b'"\xff"', b"1 2", b"\xef\xbb\xbf1"])
def test_anything_else_is_a_value_error(text: bytes) -> None:
    with pytest.raises(ValueError):
        parsed(text)


def test_a_text_nested_too_deeply_is_named() -> None:
    with pytest.raises((RecursionError, ValueError)):
        parsed(b"[" * 100_000)
