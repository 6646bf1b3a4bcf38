"""What a PromQL expression asks for: metrics, labels, and values of labels that are closed sets."""

import re
from collections.abc import Iterator

from headway.core.types.outcome import Outcome
from headway.core.types.step_result import Phase
from headway.edge.telemetry.accounting import KINDS
from headway.edge.telemetry.latency import Stage
from headway.edge.telemetry.metrics import TABLE, Type

OF_PROMETHEUS = {"job", "instance"}
"""Labels that every scraped sample has."""
NOT_OURS = {
    "up": set(),
    "process_start_time_seconds": set(),
    "process_resident_memory_bytes": set(),
    "process_cpu_seconds_total": set(),
}
CLOSED = {
    "outcome": {outcome.label for outcome in Outcome},
    "stage": set(Stage),
    "phase": set(Phase),
    "kind": {kind.label for kind in KINDS},
    "band": {"below", "inside", "above"},
}

_METRIC = re.compile(r"\b(headway_\w+|process_\w+|up)\b(?:\{([^}]*)\})?")
_MATCHER = re.compile(r'(\w+)\s*(?:=~|!~|!=|=)\s*"([^"]*)"')
_GROUPING = re.compile(r"\b(?:by|on|without|ignoring)\s*\(([^)]*)\)")


def samples() -> dict[str, set[str]]:
    """Labels of every sample that can be asked for, by its name."""
    known = dict(NOT_OURS)
    for metric in TABLE:
        labels = set(metric.labels)
        if metric.type is Type.HISTOGRAM:
            known |= {f"{metric.name}_bucket": labels | {"le"}, f"{metric.name}_sum": labels}
            known[f"{metric.name}_count"] = labels
        else:
            known[metric.name] = labels
    return known


def asked(expression: str) -> set[str]:
    """Return the names of the samples in an expression."""
    return {found[1] for found in _METRIC.finditer(expression)}


def complaints(expression: str) -> Iterator[str]:
    """Yield what an expression asks for that does not exist."""
    known = samples()
    of_all = set(OF_PROMETHEUS)
    for name, matchers in _METRIC.findall(expression):
        if name not in known:
            yield f"no metric {name}"
            continue
        of_all |= known[name]
        for label, values in _MATCHER.findall(matchers):
            if label not in known[name] | OF_PROMETHEUS:
                yield f"{name} has no label {label}"
            for value in values.split("|"):
                if label in CLOSED and value not in CLOSED[label]:
                    yield f"{label} is never {value}"
    for labels in _GROUPING.findall(expression):
        for label in filter(None, map(str.strip, labels.split(","))):
            if label not in of_all:
                yield f"grouped by {label}, which nothing here has"
