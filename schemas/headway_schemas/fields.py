"""Field types shared by the messages: identifiers, instants, numbers that may be unknown, and bytes as base64."""

import base64
import binascii
import math
from typing import Annotated, Final

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, WithJsonSchema

from headway_schemas.keys import ID_PATTERN

T_US_MAX: Final = 2**53 - 1
"""Largest instant on the wire, in microseconds: a JSON reader that knows only doubles still reads it exactly."""


class Message(BaseModel):
    """What every message shares: immutable, no silent conversion between types, no unknown field."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", use_attribute_docstrings=True)


def _unknown_unless_finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _bytes_of(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return base64.b64decode(value, validate=True)
    except binascii.Error as error:
        raise ValueError("not base64") from error


Id = Annotated[str, Field(pattern=rf"^{ID_PATTERN}$")]
"""An identifier that is also one chunk of a key expression."""

TUs = Annotated[int, Field(ge=0, le=T_US_MAX, json_schema_extra={"unit": "us"})]
"""An instant: microseconds since 1970-01-01 UTC."""

Number = Annotated[float | None, BeforeValidator(_unknown_unless_finite)]
"""A number of ours, null where it is unknown; NaN and infinities are turned into null."""

Share = Annotated[Annotated[float, Field(ge=0.0, le=1.0)] | None, BeforeValidator(_unknown_unless_finite)]
"""A number of ours from 0 to 1, null where it is unknown."""

Blob = Annotated[
    bytes,
    BeforeValidator(_bytes_of),
    PlainSerializer(lambda value: base64.b64encode(value).decode("ascii"), return_type=str, when_used="json"),
    WithJsonSchema({"type": "string", "contentEncoding": "base64"}),
]
"""Bytes in memory, standard base64 on the wire."""
