import pytest

from headway_loadtest.measure.accounting import TRANSPORT, Counters, settle


def counters(*, scored=0, warming=0, rejected=None, lost=None, missed=0):
    return Counters(scored, warming, rejected or {}, lost or {}, missed, queued=0)


NOTHING = counters()


def test_sent_is_the_sum_of_the_names():
    after = counters(scored=70, warming=20, rejected={"duplicate": 4, "too_old": 1}, lost={"shed": 5}, missed=5)
    ledger = settle(100, {}, NOTHING, after)
    assert (ledger.scored, ledger.warming) == (70, 20)
    assert (ledger.rejected, ledger.lost) == ({"duplicate": 4, "too_old": 1}, {"shed": 5})
    assert ledger.unaccounted == 0


def test_only_the_difference_of_two_reports_counts():
    before = counters(scored=1000, warming=50, rejected={"duplicate": 7}, lost={"shed": 3})
    after = counters(scored=1090, warming=60, rejected={"duplicate": 7}, lost={"shed": 3})
    ledger = settle(100, {}, before, after)
    assert (ledger.scored, ledger.warming, ledger.rejected, ledger.lost) == (90, 10, {}, {})
    assert ledger.unaccounted == 0


@pytest.mark.parametrize(("missed", "transport", "unaccounted"), [(0, 0, 10), (6, 6, 4), (10, 10, 0), (50, 10, 0)])
def test_lost_in_transport_is_only_what_the_counters_prove(missed, transport, unaccounted):
    ledger = settle(100, {}, NOTHING, counters(scored=90, missed=missed))
    assert ledger.lost.get(TRANSPORT, 0) == transport
    assert ledger.unaccounted == unaccounted


def test_gaps_that_the_service_made_itself_prove_nothing():
    ledger = settle(100, {}, NOTHING, counters(scored=80, lost={"shed": 10}, missed=10))
    assert ledger.lost == {"shed": 10}
    assert ledger.unaccounted == 10


def test_what_could_not_be_put_is_lost_by_its_reason():
    ledger = settle(100, {"put_failed": 3}, NOTHING, counters(scored=97, missed=3))
    assert ledger.lost == {"put_failed": 3}
    assert ledger.unaccounted == 0


def test_more_outcomes_than_messages_show_as_a_negative_rest():
    assert settle(100, {}, NOTHING, counters(scored=130)).unaccounted == -30


def test_counters_are_read_from_a_health_message():
    health = {
        "scored": 5,
        "warming": 4,
        "rejected": {"malformed": 3},
        "lost": {"shed": 2},
        "queue_depth": 7,
        "missed": 1,
    }
    read = Counters.of(health)
    assert read == Counters(5, 4, {"malformed": 3}, {"shed": 2}, 1, 7)
    assert read.outcomes == 14
    del health["missed"]
    assert Counters.of(health).missed == 0
