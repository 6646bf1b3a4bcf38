"""JSON of other systems, parsed by orjson: a message of the ODE takes a third of the time that it takes otherwise.

What orjson refuses and the standard library reads, such as NaN, is read by the latter: its values are refused later, by
name. orjson keeps the last of two equal fields, so for strict parsing the fields in the text are counted.
"""

import json
import re
from typing import Any, Final

import orjson

_BLANK_BEFORE_COLON: Final = re.compile(rb'"\s+:')
_FIELD: Final = b'":'
_INTEGER_MAX: Final = 1 << 63
"""Integers beyond it become doubles in orjson, integers in the standard library."""


def parsed(text: bytes) -> Any:
    """Return the value of a JSON text; of a field that is there twice the last one counts.

    Raises
    ------
    ValueError
        It is no JSON, or no UTF-8.
    RecursionError
        It is nested too deeply.
    """
    try:
        return orjson.loads(text)
    except orjson.JSONDecodeError:
        return json.loads(text.decode("utf-8"))


def parsed_strictly(text: bytes) -> Any:
    """Return the value of a JSON text; a field that is there twice is a ValueError too."""
    try:
        value = orjson.loads(text)
    except orjson.JSONDecodeError:
        value = None
    # Without blanks before colons, the text has as many `":` as fields, and more where a string has one.
    if value is None or _BLANK_BEFORE_COLON.search(text) or text.count(_FIELD) != _fields_in(value):
        return json.loads(text.decode("utf-8"), object_pairs_hook=without_duplicates)
    return value


def _fields_in(value: Any) -> int:
    """Return the number of fields of all objects in a value; negative where orjson may have rounded an integer."""
    count = 0
    if type(value) is dict:
        count, value = len(value), value.values()
    elif type(value) is not list:
        value = (value,)
    for one in value:
        kind = type(one)
        if kind is dict or kind is list:
            count += _fields_in(one)
        elif kind is float and not -_INTEGER_MAX < one < _INTEGER_MAX:
            count -= _INTEGER_MAX
    return count


def without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of its fields; two of one name are a ValueError."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field twice")
    return fields
