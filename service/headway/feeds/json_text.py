"""JSON of other systems, parsed by orjson: a message of the ODE takes a third of the time that it takes otherwise.

What orjson refuses and the standard library reads, such as NaN, is read by the latter: its values are refused later, by
name. orjson keeps the last of two equal fields, so for strict parsing the fields in the text are counted.
"""

import json
from typing import Any, Final

import orjson

_BLANKS: Final = b" \t\r\n"
_FIELD: Final = b'":'


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
    if value is None or not _has_each_field_once(text, value):
        return json.loads(text.decode("utf-8"), object_pairs_hook=without_duplicates)
    return value


def _has_each_field_once(text: bytes, value: Any) -> bool:
    """Whether no field of a text is lost in its value; False too where that is not known.

    Without escapes, `":` is the end of a field's name, or the beginning of a string. Neither is rarer in the text than
    in what is written of the value, so both are as many where the sums are.
    """
    return b"\\" not in text and text.translate(None, _BLANKS).count(_FIELD) == orjson.dumps(value).count(_FIELD)


def without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of its fields; two of one name are a ValueError."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field twice")
    return fields
