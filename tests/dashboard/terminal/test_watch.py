import io
import json
import os
import pty
import termios
import threading
import time

import pytest
from fake_service import START_US, FakeFeed, Traffic, as_stored, event, health
from rich.console import Console

from headway.client import Connection
from headway.dashboard.terminal.keyboard import keyboard
from headway.dashboard.terminal.tables import Choice, screen
from headway.dashboard.terminal.watch import Watcher, json_lines, plain_lines, watch
from headway_schemas import Event, Phase, Sensor
from headway_schemas.event import Deviation
from headway_schemas.handling import Action, HandlingRequest


def watcher(feed: FakeFeed, since_us: int = 0) -> Watcher:
    return Watcher(feed, ["local"], since_us)


def test_lines_say_what_is_new_once() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    feed.deliver(event(1), health(3.0, START_US))
    alert, report = plain_lines(watching.refresh())
    assert alert.endswith("local onset bias speed veh-0001 behind veh-0002, statistic 66.89 gate 13.8")
    assert "health rsu-1 ready, 100 vehicles" in report
    assert "lost transport 2" in report
    assert list(plain_lines(watching.refresh())) == []


def test_a_leader_is_not_behind_itself() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    feed.deliver(event(1).model_copy(update={"suspect": "veh-0002"}))
    (line,) = plain_lines(watching.refresh())
    assert " veh-0002 ahead of veh-0001, " in line


def test_json_lines_say_their_type() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    feed.deliver(event(1), health(3.0, START_US))
    rows = [json.loads(line) for line in json_lines(watching.refresh())]
    assert [row["type"] for row in rows] == ["event", "health"]
    assert rows[0]["event_id"] == "veh-0001-1"


def test_history_is_asked_for_once_a_link() -> None:
    feed = FakeFeed([event(1)])
    watching = watcher(feed)
    assert len(watching.refresh()["updates"]) == 1
    watching.refresh()
    assert len(feed.queries) == 1
    feed.connection = Connection(connected=True, connections=2, dropped=0, unreadable=0)
    assert watching.refresh()["updates"] == []
    assert len(feed.queries) == 2


def test_history_from_the_start_on_where_only_news_is_wanted() -> None:
    feed = FakeFeed([event(1), event(2, t_us=START_US + 10)])
    assert [s["event_id"] for s in watcher(feed, START_US + 2_305).refresh()["updates"]] == ["veh-0002-2"]


def numbered(n: int, sequence: int) -> Event:
    return event(n, t_us=START_US + n).model_copy(update={"instance": "rsu-1", "sequence": sequence})


def test_updates_that_were_not_received_are_asked_for() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    feed.deliver(numbered(1, 1))
    watching.refresh()
    feed.journal = [numbered(2, 2), numbered(3, 3)]
    feed.deliver(numbered(4, 4))
    assert {row["event_id"] for row in watching.refresh()["updates"]} == {f"veh-000{n}-{n}" for n in (2, 3, 4)}
    assert [(q.instance, q.after_sequence) for q in feed.queries[1:]] == [("rsu-1", 1)]
    watching.refresh()
    assert len(feed.queries) == 2


def shown(watching: Watcher, height: int, width: int = 140, choice: Choice | None = None) -> str:
    console = Console(file=io.StringIO(), width=width, height=height, record=True)
    console.print(screen(watching.view_state, watching.feed.connection, watching.revision, height, "", choice))
    return console.export_text()


@pytest.mark.parametrize("width", [60, 80, 160])
def test_a_narrow_screen_leaves_out_columns_and_cuts_no_cell(width: int) -> None:
    feed = FakeFeed([event(1)])
    watching = watcher(feed)
    feed.deliver(*Traffic(20).states(0.0, START_US), health(3.0, START_US))
    watching.refresh()
    text = shown(watching, 40, width)
    assert "…" not in text
    assert "veh-0001" in text
    assert text.count("gate") == {60: 0, 80: 1, 160: 1}[width]


def test_the_screen_puts_what_is_urgent_first_and_fits() -> None:
    feed = FakeFeed([event(1), event(2, Phase.CLEARED, t_us=START_US + 9)])
    watching = watcher(feed)
    feed.deliver(*Traffic(200, anomalous={150}).states(0.0, START_US), health(3.0, START_US))
    watching.refresh()
    text = shown(watching, 40)
    lines = text.splitlines()
    assert len(lines) <= 40
    pairs = next(i for i, line in enumerate(lines) if "gap m" in line)
    vehicles = [line for line in lines[pairs:] if line.startswith("veh-")]
    assert vehicles[0].startswith("veh-0150")
    assert "silent" in vehicles[1]
    assert "more" in text
    assert "out_of_range 44" in text


def faulty(n: int, metres: float, **changes: object) -> Event:
    made = event(n, sensor=Sensor.LOCATION, t_us=time.time_ns() // 1000)
    return made.model_copy(update={"deviation": Deviation(x_m=metres, v_mps=0.0)} | changes)


def test_events_are_grouped_by_vehicle_and_keys_sort_switch_scroll_and_quit() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    known = [
        faulty(1, 1.0),
        faulty(2, 5.0),
        *(faulty(n, 0.1 * n, suspect="veh-0003", follower="veh-0003") for n in (3, 4, 5)),
        faulty(6, 9.0, phase=Phase.CLEARED),
    ]
    feed.deliver(*known)
    watching.refresh()
    choice = Choice()

    def first_column() -> list[str]:
        lines = shown(watching, 40, choice=choice).splitlines()
        return [line.split()[0] for line in lines if line.startswith("veh-")]

    assert first_column() == ["veh-0002", "veh-0001", "veh-0003", "veh-0006"]
    assert "sorted by worst" in shown(watching, 40, choice=choice)
    orders = []
    for _ in range(4):
        choice.press("s")
        orders.append((choice.order, first_column()[0]))
    assert orders[1:] == [("most events", "veh-0003"), ("name", "veh-0001"), ("worst", "veh-0002")]
    choice.press("j")
    assert first_column()[0] == "veh-0001"
    choice.press("v")
    assert shown(watching, 40, choice=choice).count("bias") == 6
    choice.press("q")
    assert choice.is_over


def test_a_muted_vehicle_is_the_last() -> None:
    feed = FakeFeed([])
    feed.handled.append(
        as_stored(
            "local",
            HandlingRequest(
                vehicle="veh-0002", action=Action.MUTE, by="anna", until_us=time.time_ns() // 1000 + 60_000_000
            ),
        )
    )
    watching = watcher(feed)
    feed.deliver(faulty(1, 1.0), faulty(2, 5.0))
    watching.refresh()
    lines = [line for line in shown(watching, 40).splitlines() if line.startswith("veh-")]
    assert lines[-1].startswith("veh-0002")
    assert "mute by anna" in lines[-1]


def test_a_key_is_read_without_enter_and_the_terminal_is_left_as_it_was() -> None:
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "r") as terminal:
        before = termios.tcgetattr(terminal)
        with keyboard(terminal) as keys:
            assert keys.pressed(0.0) == ""
            os.write(ours, b"sv")
            assert (keys.pressed(1.0), keys.pressed(1.0)) == ("s", "v")
        assert termios.tcgetattr(terminal) == before
    os.close(ours)


def test_the_screen_of_nothing() -> None:
    feed = FakeFeed()
    feed.connection = Connection(connected=False, connections=0, dropped=3, unreadable=0)
    text = shown(watcher(feed), 24)
    assert "no contact with the bus" in text
    assert "3 not shown" in text


def test_watching_needs_no_bus_and_ends_when_told(capsys: pytest.CaptureFixture[str]) -> None:
    ended = threading.Event()
    ended.set()
    watch(connect=["tcp/127.0.0.1:1"], stop=ended)
    assert capsys.readouterr().out == ""


def test_a_service_that_reports_no_more_is_silent_and_its_open_events_are_not_known() -> None:
    feed = FakeFeed([])
    watching = watcher(feed)
    now_us = time.time_ns() // 1000
    feed.deliver(event(1, t_us=now_us), health(3.0, now_us))
    watching.refresh()
    for elapsed_us, instance, vehicle in ((3_000_000, "ready", "open"), (7_000_000, "silent for 7 s", "not known")):
        watching.revision += elapsed_us
        lines = shown(watching, 40).splitlines()
        assert instance in next(line for line in lines if "rsu-1" in line)
        assert vehicle in next(line for line in lines if line.startswith("veh-0001"))
        watching.revision -= elapsed_us
