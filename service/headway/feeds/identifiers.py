"""Temporary ids of senders, in all their spellings, as identifiers of the bus.

A J2735 id is four octets. Hex digits in either case, with blanks, colons, hyphens or `0x`, integers, and lists of four
integers all become eight hex digits in upper case. Decimal text is an integer unless it has eight digits, which are
hex. Any other text keeps its letters; a character that an identifier cannot have becomes `~` and the two hex digits of
each of its UTF-8 octets. So two ids that differ never become one.
"""

import re
from typing import Any, Final

_HEX: Final = re.compile(
    r"(?:0[xX])?([0-9A-Fa-f]{2})[ :-]?([0-9A-Fa-f]{2})[ :-]?([0-9A-Fa-f]{2})[ :-]?([0-9A-Fa-f]{2})"
)
_DECIMAL: Final = re.compile(r"\d{1,10}")
_NOT_KEPT: Final = re.compile(r"[^A-Za-z0-9_.-]")
_OCTETS: Final = 4
_UINT32: Final = 0xFFFF_FFFF


def temporary_id(value: Any) -> Any:
    """Return the identifier; a value that cannot be one as it is, for the model to reject."""
    if isinstance(value, str):
        return _of_text(value)
    if type(value) is int and -(_UINT32 >> 1) - 1 <= value <= _UINT32:
        return f"{value & _UINT32:08X}"
    if isinstance(value, list) and len(value) == _OCTETS and all(type(o) is int and -128 <= o <= 255 for o in value):  # noqa: PLR2004 - a signed or unsigned octet
        return bytes(octet & 0xFF for octet in value).hex().upper()
    return value


def folded(sender: str) -> str:
    """Return the sender of a key as its messages name it: hex digits in upper case."""
    octets = _HEX.fullmatch(sender)
    return "".join(octets.groups()).upper() if octets else sender


def _of_text(text: str) -> str:
    text = text.strip()
    if _HEX.fullmatch(text):
        return folded(text)
    if _DECIMAL.fullmatch(text) and int(text) <= _UINT32:
        return f"{int(text):08X}"
    return _NOT_KEPT.sub(lambda found: "".join(f"~{octet:02X}" for octet in _utf8(found[0])), text)


def _utf8(character: str) -> bytes:
    return character.encode("utf-8", "surrogatepass")
