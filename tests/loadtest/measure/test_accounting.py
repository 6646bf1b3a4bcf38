import pytest

from headway_loadtest.measure.accounting import TRANSPORT, Counters, reconcile


def counters(*, scored=0, warming=0, rejected=None, lost=None, sequence_gaps=0):
    return Counters(scored, warming, rejected or {}, lost or {}, sequence_gaps, queued=0)


NOTHING = counters()


def test_sent_is_the_sum_of_the_names():
    after = counters(scored=70, warming=20, rejected={"duplicate": 4, "too_old": 1}, lost={"shed": 5}, sequence_gaps=5)
    ledger = reconcile(100, {}, NOTHING, after)
    assert (ledger.scored, ledger.warming) == (70, 20)
    assert (ledger.rejected, ledger.lost) == ({"duplicate": 4, "too_old": 1}, {"shed": 5})
    assert ledger.unaccounted == 0


def test_only_the_difference_of_two_reports_counts():
    before = counters(scored=1000, warming=50, rejected={"duplicate": 7}, lost={"shed": 3})
    after = counters(scored=1090, warming=60, rejected={"duplicate": 7}, lost={"shed": 3})
    ledger = reconcile(100, {}, before, after)
    assert (ledger.scored, ledger.warming, ledger.rejected, ledger.lost) == (90, 10, {}, {})
    assert ledger.unaccounted == 0


@pytest.mark.parametrize(
    ("sequence_gaps", "transport", "unaccounted"), [(0, 0, 10), (6, 6, 4), (10, 10, 0), (50, 10, 0)]
)
def test_lost_in_transport_is_only_what_the_counters_prove(sequence_gaps, transport, unaccounted):
    ledger = reconcile(100, {}, NOTHING, counters(scored=90, sequence_gaps=sequence_gaps))
    assert ledger.lost.get(TRANSPORT, 0) == transport
    assert ledger.unaccounted == unaccounted


def test_gaps_that_the_service_made_itself_prove_nothing():
    ledger = reconcile(100, {}, NOTHING, counters(scored=80, lost={"shed": 10}, sequence_gaps=10))
    assert ledger.lost == {"shed": 10}
    assert ledger.unaccounted == 10


def test_what_could_not_be_put_is_lost_by_its_reason():
    ledger = reconcile(100, {"put_failed": 3}, NOTHING, counters(scored=97, sequence_gaps=3))
    assert ledger.lost == {"put_failed": 3}
    assert ledger.unaccounted == 0


def test_more_outcomes_than_messages_show_as_a_negative_rest():
    assert reconcile(100, {}, NOTHING, counters(scored=130)).unaccounted == -30


def test_counters_are_read_from_a_health_message():
    health = {
        "scored": 5,
        "warming": 4,
        "rejected": {"malformed": 3},
        "lost": {"shed": 2},
        "queue_depth": 7,
        "sequence_gap_messages": 1,
    }
    read = Counters.of(health)
    assert read == Counters(5, 4, {"malformed": 3}, {"shed": 2}, 1, 7)
    assert read.outcomes == 14
    del health["sequence_gap_messages"]
    assert Counters.of(health).sequence_gaps == 0
