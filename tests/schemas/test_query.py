import pytest
from pydantic import ValidationError

from headway_schemas import Kind, Phase
from headway_schemas.query import AlertsQuery


def parameters(text: str) -> dict[str, str]:
    return dict(part.split("=") for part in text.split(";") if part)


@pytest.mark.parametrize(
    "query",
    [
        AlertsQuery(),
        AlertsQuery(from_us=1, to_us=9, before_us=7, kind=Kind.BIAS, phase=Phase.ONSET, vehicle="a", limit=5),
        AlertsQuery(event="a-1", evidence=True),
    ],
)
def test_a_query_survives_its_selector(query: AlertsQuery) -> None:
    assert AlertsQuery.from_parameters(parameters(query.to_parameters())) == query


def test_a_selector_says_only_what_is_asked() -> None:
    assert AlertsQuery().to_parameters() == ""
    assert AlertsQuery(kind=Kind.MISS, limit=5).to_parameters() == "kind=miss;limit=5"


@pytest.mark.parametrize(
    "asked",
    [{"kinds": "bias"}, {"kind": "odd"}, {"limit": "0"}, {"limit": "1001"}, {"from_us": "-1"}, {"vehicle": "a/b"}],
)
def test_what_makes_no_sense_is_refused(asked: dict[str, str]) -> None:
    with pytest.raises(ValidationError):
        AlertsQuery.from_parameters(asked)
