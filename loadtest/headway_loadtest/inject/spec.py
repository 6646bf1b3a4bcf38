"""The words of `--inject`: text to a checked `Spec`."""

import difflib
from collections.abc import Collection

from headway_loadtest.inject.faults import BY_LABEL, Kind, Spec, SpecError

KEYS = ("c", "p", "kinds", "d", "share")


def parse_spec(text: str) -> Spec:
    """Read a spec such as `c=1,p=0.005,kinds=noise+bias+drift,d=1..20,share=0.01`; what is left out has its default.

    Raises
    ------
    SpecError
        Names the word that is wrong, and the nearest right one.
    """
    given: dict[str, str] = {}
    for word in filter(None, (part.strip() for part in text.split(","))):
        key, equals, value = word.partition("=")
        if not equals:
            raise SpecError(f"'{word}' must be written key=value, for example c=1,p=0.005,kinds=noise+bias")
        if key not in KEYS:
            raise SpecError(f"'{key}' is not a key of an injection{_nearest(key, KEYS)}")
        if key in given:
            raise SpecError(f"'{key}' is given twice")
        given[key] = value
    defaults = Spec()
    return Spec(
        c=_number("c", given.get("c"), defaults.c),
        p=_number("p", given.get("p"), defaults.p),
        kinds=_kinds(given["kinds"]) if "kinds" in given else defaults.kinds,
        samples=_samples(given["d"]) if "d" in given else defaults.samples,
        share=_number("share", given.get("share"), defaults.share),
    )


def _number(key: str, text: str | None, default: float) -> float:
    if text is None:
        return default
    try:
        return float(text)
    except ValueError:
        raise SpecError(f"{key} must be a number, not '{text}'") from None


def _kinds(text: str) -> tuple[Kind, ...]:
    names = [name.strip() for name in text.split("+")]
    for name in names:
        if name not in BY_LABEL:
            raise SpecError(f"'{name}' is not a kind of anomaly{_nearest(name, BY_LABEL)}")
    return tuple(dict.fromkeys(BY_LABEL[name] for name in names))


def _samples(text: str) -> tuple[int, int]:
    shortest, dots, longest = text.partition("..")
    try:
        return int(shortest), int(longest) if dots else int(shortest)
    except ValueError:
        raise SpecError(f"d must be a range of samples such as 1..20, not '{text}'") from None


def _nearest(word: str, known: Collection[str]) -> str:
    close = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean '{close[0]}'?" if close else f"; choose from {', '.join(known)}"
