from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from headway.feeds.instants import instant_us

NOON_US = round(datetime(2024, 8, 12, 12, 0, tzinfo=UTC).timestamp() * 1e6)


@pytest.mark.parametrize(
    "text",
    [
        "2024-08-12T12:00:00Z",
        "2024-08-12T12:00:00.000Z[UTC]",
        "2024-08-12T12:00:00.000[UTC]",
        "2024-08-12T05:00:00-07:00",
        "2024-08-12T06:00:00-06:00[America/Denver]",
        "2024-08-12T06:00:00[America/Denver]",
        "2024-08-12T08:00:00.000 [ET]",
        "2024-08-12T05:00 [PT]",
        "2024-08-12 12:00:00.000000 +0000",
        "2024-08-12T14:00:00+02:00[Nowhere/Known]",
        "08/12/2024 12:00:00.000 PM +0000",
        " 2024-08-12T12:00:00.000000000Z ",
    ],
)
def test_every_spelling_of_a_zone(text: str) -> None:
    assert instant_us(text) == NOON_US


@pytest.mark.parametrize(
    "text", ["", "Z", "2024-08-12T12:00:00", "2024-13-12T12:00:00Z", "2024-08-12T12:00 [Mars]", "[ET]"]
)
def test_what_is_no_instant(text: str) -> None:
    assert instant_us(text) is None


@given(st.datetimes(timezones=st.timezones()))
def test_it_reads_what_python_writes(instant: datetime) -> None:
    read_us = instant_us(f"{instant.isoformat()}[{instant.tzinfo}]")
    assert read_us is None or abs(read_us - instant.timestamp() * 1e6) < 64


@given(st.text())
def test_it_reads_or_refuses_any_text(text: str) -> None:
    assert type(instant_us(text)) in (int, type(None))
