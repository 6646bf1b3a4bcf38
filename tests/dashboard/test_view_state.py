from fake_service import START_US, Traffic, event, health

from headway.client import SiteMessage
from headway.dashboard.view_state import PAIR_COLUMNS, PAIR_TTL_US, SILENT_US, UPDATE_LIMIT, Table, ViewState
from headway_schemas import Event, Health, PairState, Phase, RejectedCopy
from headway_schemas.state import Standing


def view_state(*messages: Event | PairState | Health | RejectedCopy, revision: int = 1) -> ViewState:
    made = ViewState()
    for message in messages:
        made.apply(SiteMessage("local", message), revision)
    return made


def states(n: int, t_us: int = START_US) -> list[PairState]:
    return list(Traffic(n).states(0.0, t_us))


def test_a_table_gives_way_at_its_stalest() -> None:
    table: Table[str, int] = Table(2)
    table.put("a", 1, 1)
    table.put("b", 2, 2)
    table.put("a", 3, 3)
    table.put("c", 4, 4)
    assert list(table) == [3, 4]
    assert table.get("b") is None


def test_a_table_tells_what_changed_since_stalest_first() -> None:
    table: Table[str, int] = Table(9)
    for revision, key in enumerate("abcab", start=1):
        table.put(key, revision, revision)
    assert table.since(0) == [3, 4, 5]
    assert table.since(3) == [4, 5]
    assert table.since(5) == []


def test_a_pair_that_changed_often_is_told_once_and_newest() -> None:
    known = ViewState()
    for revision in range(1, 11):
        for state in states(3, START_US + revision):
            known.apply(SiteMessage("local", state), revision)
    rows = known.delta(0)["pairs"]["rows"]
    assert [dict(zip(PAIR_COLUMNS, row, strict=True))["t_us"] for row in rows] == [START_US + 10] * 3


def test_a_quiet_pair_is_forgotten() -> None:
    known = view_state(*states(3), revision=1)
    known.evict(1 + PAIR_TTL_US - 1)
    assert len(known.pairs) == 3
    known.evict(1 + PAIR_TTL_US)
    assert len(known.pairs) == 0


def test_statements_are_bounded_and_each_is_kept_once() -> None:
    known = view_state(event(1), event(1))
    assert len(known.updates) == 1
    for n in range(UPDATE_LIMIT + 5):
        known.apply_event(event(n, t_us=START_US + n), 2)
    assert len(known.updates) == UPDATE_LIMIT


def test_a_known_statement_gains_evidence_and_never_loses_it() -> None:
    bare = event(1).model_copy(update={"evidence": None})
    known = view_state(bare)
    known.apply_event(event(1), 2)
    known.apply_event(bare, 3)
    (kept,) = known.updates
    assert kept.evidence is not None
    assert [row["has_evidence"] for row in known.delta(1)["updates"]] == [True]


def test_a_figure_that_only_the_evidence_gives_is_shown_whichever_came_first() -> None:
    full = event(1).model_copy(update={"deviation": None})
    bare = full.model_copy(update={"evidence": None})
    for order in ((bare, full), (full, bare)):
        known = view_state(order[0])
        known.apply_event(order[1], 2)
        (row,) = known.delta(0)["events"]
        assert (row["updates"], round(row["deviation_mps"], 9), row["fast"]) == (1, 4.0, True)


def test_phases_are_statements_of_their_own() -> None:
    known = view_state(event(1), event(1, Phase.CLEARED, t_us=START_US + 1_000_000))
    assert [row["phase"] for row in known.delta(0)["updates"]] == ["onset", "cleared"]
    assert "evidence" not in known.delta(0)["updates"][0]


def test_rates_are_between_two_reports_of_one_instance() -> None:
    known = view_state(health(100.0, START_US))
    known.apply(SiteMessage("local", health(102.0, START_US + 2_000_000)), 2)
    (row,) = known.delta(0)["instances"]
    assert row["rates_hz"] == {"scored": 970.0, "warming": 30.0, "rejected": 1.0, "lost": 0.0}


def test_a_site_reports_as_long_as_one_of_its_instances_does() -> None:
    known = view_state(health(1.0, START_US), revision=START_US)
    known.apply(SiteMessage("north", health(1.0, START_US, site="north")), START_US + SILENT_US)
    assert known.reporting_sites(START_US + SILENT_US - 1) == {"local", "north"}
    assert known.reporting_sites(START_US + SILENT_US) == {"north"}


def test_a_restart_is_an_arrival_and_no_negative_rate() -> None:
    known = view_state(health(100.0, START_US))
    known.apply(SiteMessage("local", health(101.0, START_US + 1_000_000)), 2)
    assert known.instance_starts == 1
    known.apply(SiteMessage("local", health(0.5, START_US + 2_000_000)), 3)
    assert known.instance_starts == 2
    assert known.delta(2)["instances"][0]["rates_hz"] == {}


def test_copies_are_told_without_their_payload() -> None:
    copy = RejectedCopy.of(
        reason="malformed", detail="not a map", key="v2x/local/bsm/a", sender="a", encoding="", payload=b"\xff",
        received_us=START_US, payload_max=10,
    )  # fmt: skip
    known = view_state(copy, copy)
    row = {"reason": "malformed", "detail": "not a map", "sender": "a", "received_us": START_US, "count": 1}
    assert known.delta(0)["copies"] == [{"site": "local", **row}] * 2


def test_a_standing_is_told_by_its_word() -> None:
    state = states(1)[0].model_copy(update={"standing": Standing.SILENT})
    assert "silent" in view_state(state).delta(0)["pairs"]["rows"][0]
