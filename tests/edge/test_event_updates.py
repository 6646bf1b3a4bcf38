"""Updates are numbered without a gap, and no suspect fills journal and bus."""

import pytest
from edge.stub import event
from sim.rig import IDENTITY, KEYS

from headway.core.types.records import Kind
from headway.core.types.step_result import Phase
from headway.edge.codec.messages import Timing
from headway.edge.event_updates import AT_ONCE, QUIET_NS, EventUpdates
from headway.edge.message_history import MessageHistory

S = 1_000_000_000
BURST, REFILL_S = 3, 600.0


@pytest.fixture
def updates() -> EventUpdates:
    return EventUpdates(IDENTITY, KEYS, MessageHistory(0, 0), burst=BURST, refill_s=REFILL_S)


def of(updates: EventUpdates, at_s: float, *events) -> list:
    return [update.event for update in updates.of(events, round(at_s * S), Timing(1_000 + round(at_s * 1e6), 0, 0, 0))]


def short(n: int, suspect: str = "car1") -> tuple:
    return tuple(
        event(event_id=f"{suspect}-{n}", suspect=suspect, phase=phase) for phase in (Phase.ONSET, Phase.CLEARED)
    )


def test_numbers_have_no_gap_and_name_the_instance(updates) -> None:
    published = of(updates, 0.0, *short(1), *short(2, "car2"))
    assert [(one.instance, one.sequence) for one in published] == [("i", 1), ("i", 2), ("i", 3), ("i", 4)]
    updates.resume_after(40)
    assert [one.sequence for one in of(updates, 0.1, *short(3))] == [41, 42]


def test_the_evidence_goes_with_the_onset_alone(updates) -> None:
    of_event = [event(phase=phase) for phase in (Phase.ONSET, Phase.UPDATE, Phase.CLEARED)]
    assert [one.evidence is not None for one in of(updates, 0.0, *of_event)] == [True, False, False]


def test_beyond_its_quota_a_suspect_has_one_event_that_counts(updates) -> None:
    published = [one for n in range(600) for one in of(updates, n / 10, *short(n))]
    own = [one for one in published if one.count == 1 and one.event_id != "car1-3"]
    assert [one.event_id for one in own] == [f"car1-{n}" for n in range(BURST) for _ in range(2)]
    summary = [one for one in published if one.event_id == "car1-3"]
    assert [one.phase for one in summary] == [Phase.ONSET, *[Phase.UPDATE] * 5]
    assert summary[-1].count == pytest.approx(600 - BURST, abs=100)
    assert updates.summarised == 600 - BURST
    [end] = of(updates, 60.0 + QUIET_NS / S)
    assert (end.event_id, end.phase, end.count) == ("car1-3", Phase.CLEARED, 600 - BURST)
    assert of(updates, 200.0) == []


def test_the_first_event_beyond_the_quota_is_published_at_once(updates) -> None:
    for n in range(BURST):
        of(updates, n / 10, *short(n))
    [onset] = of(updates, 0.4, *short(BURST))
    assert (onset.event_id, onset.phase, onset.count) == (f"car1-{BURST}", Phase.ONSET, 1)


def test_a_summary_is_of_the_newest_known_kind_and_the_largest_deviation(updates) -> None:
    for n in range(BURST):
        of(updates, n / 10, *short(n))
    of(updates, 1.0, event(event_id="car1-a", kind=Kind.UNKNOWN, onset_us=7, deviation=(0.5, 0.0)))
    of(updates, 2.0, event(event_id="car1-a", phase=Phase.UPDATE, kind=Kind.DRIFT, deviation=(3.0, 0.1)))
    of(updates, 3.0, event(event_id="car1-b", kind=Kind.UNKNOWN, deviation=(1.0, 0.2)))
    [update] = of(updates, 12.0)
    assert (update.event_id, update.phase, update.kind, update.count) == ("car1-a", Phase.UPDATE, Kind.DRIFT.label, 2)
    assert update.deviation is not None
    assert (update.deviation.x_m, update.deviation.v_mps, update.onset_us) == (3.0, 0.2, 7)
    assert update.evidence is None


def test_another_suspect_beside_a_flood_is_published(updates) -> None:
    for n in range(100):
        of(updates, n / 10, *short(n))
    assert [one.suspect for one in of(updates, 10.05, *short(1, "car2"))] == ["car2", "car2"]


def test_a_quota_comes_back(updates) -> None:
    for n in range(BURST):
        of(updates, n, *short(n))
    assert [one.event_id for one in of(updates, REFILL_S + 10, *short(9))] == ["car1-9", "car1-9"]


def test_an_event_that_goes_on_is_not_cut_off(updates) -> None:
    of(updates, 0.0, event(event_id="long", phase=Phase.ONSET))
    for n in range(20):
        of(updates, 1 + n, *short(n))
    assert "long" in {one.event_id for one in of(updates, 30.5, event(event_id="long", phase=Phase.CLEARED))}


def test_what_was_left_open_is_ended(updates) -> None:
    [onset] = of(updates, 0.0, event())
    assert updates.end_others({onset.event_id}, 70) == []
    [ended] = [update.event for update in updates.end_others(set(), 77)]
    assert not updates.has_open
    assert (ended.phase, ended.detected_us, ended.sequence, ended.evidence) == (Phase.CLEARED, 77, 2, None)
    again = updates.again(onset)
    assert (again.event, again.key) == (onset, KEYS.alert(onset.kind, onset.suspect))


def test_what_a_process_before_left_open_is_ended(updates) -> None:
    [onset] = of(updates, 0.0, event())
    after = EventUpdates(IDENTITY, KEYS, MessageHistory(0, 0), burst=BURST, refill_s=REFILL_S)
    after.adopt([onset])
    assert [update.event.event_id for update in after.end_others(set(), 77)] == [onset.event_id]
    assert after.end_others(set(), 78) == []


def test_a_summary_ends_although_its_vehicle_left_without_an_end(updates) -> None:
    for n in range(BURST + 1):
        of(updates, n / 10, event(event_id=f"car1-{n}", phase=Phase.ONSET))
    of(updates, 2.0)
    [end] = of(updates, 3.0 + QUIET_NS / S)
    assert (end.event_id, end.phase, end.count) == (f"car1-{BURST}", Phase.CLEARED, 1)
    assert of(updates, 500.0) == []


def test_what_waits_goes_before_its_vehicle_and_nothing_ends_before_its_onset(updates) -> None:
    many = [event(event_id=f"car{n}-5", suspect=f"car{n}") for n in range(2 * AT_ONCE)]
    assert len(of(updates, 0.0, *many)) == AT_ONCE
    left = [many[-1].event_id, many[0].event_id]
    assert updates.end_others(set(), 1) == []
    assert [update.event.event_id for update in updates.release(left, 0)] == left[:1]
    assert updates.waiting == AT_ONCE - 1
    assert [one.suspect for one in of(updates, 0.1)] == [f"car{n}" for n in range(AT_ONCE, 2 * AT_ONCE - 1)]
    ended = {update.event.event_id for update in updates.end_others(set(), 1)}
    assert ended == {one.event_id for one in many} - set(left)
