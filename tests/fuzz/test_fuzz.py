"""A short form of `make fuzz`, the same at each run: 200,000 records through codec and engine."""

import pytest
from fuzz.campaign import Campaign
from fuzz.recordings import FUZZED
from fuzz.targets import ENCODED, TARGETS

from headway.core.types.outcome import Outcome
from headway.edge.codec.payload import UPER_FEEDS, Reader
from headway.gateways.recordings.formats import FORMATS

CODECS = [name for name in TARGETS if not name.startswith("engine")]
ENGINES = [name for name in TARGETS if name.startswith("engine")]


def test_each_encoding_and_each_reader_has_a_target() -> None:
    assert set(ENCODED) == {*Reader(1)._readers, *UPER_FEEDS}
    assert set(FORMATS) | {"columns", "bsm lines", "bsm csv", "parquet", "compressed"} == set(FUZZED)


def test_whatever_bytes_come_each_record_has_one_outcome() -> None:
    campaign = Campaign(seed=1)
    campaign.run(CODECS, records=193_000)
    assert campaign.failures == []
    assert all(counts[Outcome.SCORED] and counts[Outcome.MALFORMED] for counts in campaign.outcomes.values())


@pytest.mark.parametrize("name", ENGINES)
def test_whatever_records_come_the_others_are_judged_the_same_and_a_later_fault_is_found(name: str) -> None:
    campaign = Campaign(seed=1)
    campaign.run([name], records=1_700)
    assert campaign.failures == []
