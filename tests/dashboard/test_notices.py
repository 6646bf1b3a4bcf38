"""A faulty vehicle is notified once when it begins and once when it is over, whatever its events do in between."""

from fake_service import START_US, event

from headway.dashboard.event_summary import EventSummary
from headway.dashboard.notices import LAPSE_US, QUIET_US, Notice, Notices, alertmanager_body, webhook_body
from headway_schemas import Event, Phase
from headway_schemas.handling import Action, Handling

S = 1_000_000


class Road:
    """Events of vehicles, and the notices of each step in seconds."""

    def __init__(self) -> None:
        self.notices, self.events, self.handlings = Notices(), {}, []  # type: ignore[var-annotated]
        self.sites = {"local"}

    def at(self, s: float, *updates: Event) -> list[tuple[str, bool]]:
        for update in updates:
            if update.event_id in self.events:
                self.events[update.event_id].add(update)
            else:
                self.events[update.event_id] = EventSummary.of(update)
        now_us = START_US + round(s * S)
        self.last = self.notices.update(self.events.values(), self.handlings, self.sites, now_us)
        return [(notice.vehicle, notice.until_us is None) for notice in self.last]


def update(n: int, s: float, phase: Phase = Phase.UPDATE, suspect: str = "car") -> Event:
    return event(n, phase, t_us=START_US + round(s * S), suspect=suspect).model_copy(update={"event_id": f"e{n}"})


def test_one_at_the_onset_and_one_when_it_is_over() -> None:
    road = Road()
    assert road.at(0, update(1, 0, Phase.ONSET)) == [("car", True)]
    assert [road.at(s, update(1, s)) for s in range(1, 20)] == [[]] * 19
    assert road.at(20, update(1, 20, Phase.CLEARED)) == []
    assert [road.at(20 + s) for s in (1, 2, 13)] == [[]] * 3
    assert road.at(19 + QUIET_US / S) == [("car", False)]
    assert road.last[0].until_us == START_US + 19 * S
    assert road.at(90) == []


def test_a_fault_that_comes_and_goes_and_one_of_many_events_are_one_matter() -> None:
    road = Road()
    found = [road.at(0, update(1, 0, Phase.ONSET), update(2, 0, Phase.ONSET))]
    found += [road.at(1, update(1, 1, Phase.CLEARED))]
    found += [road.at(2, update(2, 2, Phase.CLEARED)), road.at(5, update(3, 5, Phase.ONSET))]
    assert found == [[("car", True)], [], [], []]


def test_an_event_without_updates_lapses() -> None:
    road = Road()
    road.at(0, update(1, 0, Phase.ONSET))
    assert road.at(LAPSE_US / S - 1) == []
    assert road.at((LAPSE_US + QUIET_US) / S) == [("car", False)]


def test_nothing_ends_at_a_site_that_is_silent() -> None:
    road = Road()
    road.at(0, update(1, 0, Phase.ONSET))
    road.sites = set()
    assert [road.at(s, update(2, 0, suspect="other")) for s in (100, 200)] == [[], []]
    road.sites = {"local"}
    assert road.at(300) == [("car", False)]


def test_another_suspect_is_another_matter() -> None:
    road = Road()
    road.at(0, update(1, 0, Phase.ONSET, "a"))
    assert road.at(1, update(1, 1, suspect="b")) == [("b", True)]
    assert road.at(17, update(1, 17, suspect="b")) == [("a", False)]


def mute(until_s: float | None) -> Handling:
    until_us = None if until_s is None else START_US + round(until_s * S)
    return Handling(site="local", vehicle="car", action=Action.MUTE, by="anna", t_us=START_US - S, until_us=until_us)


def test_a_muted_vehicle_has_no_notice_until_the_mute_is_over() -> None:
    road = Road()
    road.handlings = [mute(10)]
    assert road.at(0, update(1, 0, Phase.ONSET)) == []
    assert road.at(9, update(1, 9, Phase.CLEARED)) == []
    assert road.at(9.5, update(2, 9.5, Phase.ONSET)) == []
    assert road.at(11, update(2, 11)) == [("car", True)]


def test_what_was_notified_before_a_mute_is_ended() -> None:
    road = Road()
    road.at(0, update(1, 0, Phase.ONSET))
    road.handlings = [mute(100)]
    assert road.at(2, update(1, 2, Phase.CLEARED)) == []
    assert road.at(19) == [("car", False)]


def test_the_bodies_name_the_vehicle_and_end_at_the_end() -> None:
    summary = EventSummary.of(update(1, 0, Phase.ONSET))
    onset, end = Notice("local", "car", summary, START_US), Notice("local", "car", summary, START_US, START_US + 9 * S)
    hook = webhook_body(end, "http://wiki/headway")
    assert (hook["status"], hook["since"], hook["until"]) == (
        "resolved", "2023-11-14T22:13:20.000Z", "2023-11-14T22:13:29.000Z"
    )  # fmt: skip
    assert (hook["vehicle"], hook["kind"], hook["deviation_mps"]) == ("car", "bias", 4.0)
    [first], [last] = alertmanager_body(onset, None), alertmanager_body(end, "http://wiki/headway")
    assert first["labels"] == last["labels"]
    assert first["startsAt"] == last["startsAt"] < last["endsAt"] < first["endsAt"]
    assert last["annotations"]["runbook_url"] == "http://wiki/headway"
    assert "runbook_url" not in first["annotations"]
