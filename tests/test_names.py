"""Names are the field's own: no identifier, file, metric, setting or wire field has a word that a term replaced."""

import io
import json
import keyword
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from headway.edge.telemetry.metrics import TABLE
from headway.settings import Settings

ROOT = Path(__file__).resolve().parents[1]
REPLACED = {
    "faulty, fault": "lie lies lied liar liars lying",
    "mode": "hypothesis hypotheses",
    "suspect, attribution": "accuse accused accuses acquit acquitted culprit blame blamed",
    "set_offset, add_jerk_noise, repair_covariance": "jolt mend mended mends",
    "reset_to_reading, fault_timeout": "relent relented doze dozing",
    "sensor_fault_probability": "suspicion",
    "clip, adapt_noise": "tamed",
    "response gain, explained, unexplained": "likeness announced unforeseen",
    "candidate, confirmations": "challenger challengers votes",
    "received, ReceptionMonitor, receiver outage": "ear deaf hear hears heard",
    "publish, sent": "tell tells told untold unsaid",
    "persistence, journal writer, event update": "keeper scribe statement statements",
    "liveness problem, readiness problem, health": "ailment hindrance vitals",
    "message": "arrival arrivals",
    "fake service, unknown vehicles, service process": "standin stranger strangers trials",
    "gate margin, log odds, motion surprise": "caution cautious doubt doubtful unusual",
    "published_before_commit, prune_debt": "hurried owed",
    "holdoff, speed sensitivity": "hush felt unfeel",
    "restore, insert, remove, ignore": "enrol excuse excused",
    "evict": "forget forgets forgotten",
    "iterate, StepResult, refresh, tick": "turns",
    "a term without feelings": "trust trusted trusting believe believed believes jealous",
}
"""Words that no identifier contains, by the term in their place."""
REPLACED_NAMES = {
    "update, step": "judge judges",
    "initialise": "begin begin_all",
    "add_speed_jump": "jump",
    "update_scalar, reset_likelihood": "unread",
    "moment_match": "merge fold",
    "repair_covariance": "guard",
    "load, store, save_prior": "take_out put_back remember",
    "set_leader, predict_acceleration": "meet ask",
    "speed bias, random-walk density": "slip walk",
    "path history": "trail",
    "find_leader, search": "look reach",
    "round, ingest, finalise, classify, build_readings": "wave enter conclude settle gather",
    "lane_reference": "witness",
    "generation, workspace": "serial room",
    "restore": "seat",
    "iterate, StepResult": "turn",
    "record, reconcile": "book",
    "propagate, accumulate": "hand_on weigh",
}
"""Names that nothing in the core has as a whole; elsewhere, and within longer names, they are ordinary words."""
KEPT = {
    "hypothesis": "the library for property tests",
    "SingleHypothesis": "of Stone Soup",
    "trust": "of TLS: whom a certificate authority vouches for",
    "tell": "the position in a file, of Python's streams",
    "forget": "forgetting factor of recursive least squares",
}
"""Names that stay, and why."""
CORE = ROOT / "service" / "headway" / "core"
FOLDERS = ("service", "schemas", "loadtest", "tests", "examples", "docker", "deploy")

WORDS = {word: term for term, words in REPLACED.items() for word in words.split()}
NAMES = {name: term for term, names in REPLACED_NAMES.items() for name in names.split()}


def words_of(name: str) -> list[str]:
    """Return the words of an identifier, in small letters."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name)]


def term_for(name: str, *, in_core: bool = False) -> str | None:
    """Return the term for a name that was replaced, None for a name that is right."""
    if name in KEPT:
        return None
    whole = NAMES.get(name) if in_core else None
    return whole or next((WORDS[word] for word in words_of(name) if word in WORDS), None)


def identifiers(source: str) -> Iterator[str]:
    """Yield the identifiers of a source text, those within f-strings too."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.NAME and not keyword.iskeyword(token.string):
            yield token.string
        elif token.type == tokenize.STRING and re.match("[rR]?[fF]", token.string):
            for expression in re.findall(r"\{([^{}]*)\}", token.string):
                yield from re.findall(r"[A-Za-z_]\w*", expression.partition(":")[0])


def wrong(names: set[str], *, in_core: bool = False) -> dict[str, str]:
    return {name: term for name in sorted(names) if (term := term_for(name, in_core=in_core)) is not None}


FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py") if path != Path(__file__).resolve())


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_identifiers_are_the_fields_own(path: Path) -> None:
    names = {name for name in identifiers(path.read_text(encoding="utf-8")) if not name.startswith("test_")}
    assert wrong(names | {path.stem}, in_core=CORE in path.parents) == {}


def test_metrics_and_settings_are_the_fields_own() -> None:
    labels = {label for metric in TABLE for label in metric.labels}
    assert wrong({metric.name for metric in TABLE} | labels | set(Settings.model_fields)) == {}


def test_wire_names_are_the_fields_own() -> None:
    def names(schema: object) -> Iterator[str]:
        if isinstance(schema, dict):
            yield from schema.get("properties", {})
            yield from (value for value in schema.get("enum", ()) if isinstance(value, str))
            for part in schema.values():
                yield from names(part)
        elif isinstance(schema, list):
            for part in schema:
                yield from names(part)

    found = {name for file in (ROOT / "schemas/json").glob("*.json") for name in names(json.loads(file.read_text()))}
    assert "sequence_gap_messages" in found
    assert wrong(found) == {}


@pytest.mark.parametrize(
    ("name", "is_right"),
    [
        ("tell_health", False), ("PATIENCE", True), ("_untold", False), ("LiarRows", False), ("told", False),
        ("believes", False), ("believable", True), ("turn_cos", True), ("turns", False)
    ],
)  # fmt: skip
def test_a_word_is_found_within_a_name(name: str, *, is_right: bool) -> None:
    assert (term_for(name) is None) == is_right


def test_a_whole_name_is_wrong_in_the_core_only() -> None:
    assert (term_for("begin", in_core=True), term_for("begin")) == ("initialise", None)
    assert term_for("begin_s", in_core=True) is None
