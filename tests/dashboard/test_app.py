import hashlib
import json
import re
from pathlib import Path

import pytest
from dashboard.pageclient import PageClient
from fake_service import START_US, FakeFeed, event

from headway.dashboard import app
from headway.dashboard.app import EVIDENCE_FIRST, EVIDENCE_LAST, VIEWER_LIMIT, create_app
from headway.dashboard.broadcast import Broadcaster
from headway_schemas import Kind, Phase, Sensor
from headway_schemas.event import Observation

VENDOR = Path(app.__file__).parent / "static" / "vendor"
JOURNAL = [
    *(event(n, t_us=START_US + n) for n in range(5)),
    event(7, kind=Kind.DRIFT, t_us=START_US + 7, site="north"),
    *(event(9, Phase.UPDATE if n else Phase.ONSET, t_us=START_US + 10**6 * n) for n in range(1, 30)),
]


@pytest.fixture
def client() -> PageClient:
    return PageClient(create_app(Broadcaster(FakeFeed(JOURNAL), ["local", "north"])))


def test_the_page_and_its_parts_come_from_here(client: PageClient) -> None:
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "http:" not in page.text
    assert "https:" not in page.text
    assert client.get("/static/main.js").headers["content-type"].startswith("text/javascript")
    assert client.get("/static/../app.py").status_code == 404


def test_history_by_site_and_kind(client: PageClient) -> None:
    everywhere = client.get("/history", params={"kind": "drift"}).json()
    assert [s["event_id"] for s in everywhere["updates"]] == ["veh-0007-7"]
    assert everywhere["answers"] == 2
    assert client.get("/history", params={"kind": "drift", "site": "local"}).json()["updates"] == []


def test_history_of_events_as_they_are_known_now(client: PageClient) -> None:
    shown = client.get("/history", params={"newest": "true", "limit": 3}).json()
    assert [(row["event_id"], row["phase"]) for row in shown["events"]] == [
        ("veh-0009-9", "update"), ("veh-0007-7", "onset"), ("veh-0004-4", "onset")
    ]  # fmt: skip
    rest = client.get("/history", params={"newest": "true", "before_us": shown["before_us"]}).json()
    assert [row["event_id"] for row in rest["events"]] == [f"veh-{n:04d}-{n}" for n in (3, 2, 1, 0)]
    assert rest["before_us"] is None


def test_an_event_of_one_site_is_not_that_of_another(client: PageClient) -> None:
    assert client.get("/event/veh-0007-7", params={"site": "north"}).status_code == 200
    assert client.get("/event/veh-0007-7", params={"site": "local"}).status_code == 404
    assert client.get("/event/veh-0007-7", params={"site": "elsewhere"}).status_code == 404


@pytest.mark.parametrize(
    "queries", ["kind=none", "limit=0", "limit=1001", "vehicle=a%2Fb", "colour=red", "site=elsewhere"]
)
def test_a_question_that_makes_no_sense_is_named(client: PageClient, queries: str) -> None:
    answer = client.get(f"/history?{queries}")
    assert answer.status_code == 400
    assert answer.text.startswith(queries.partition("=")[0])


def test_an_event_with_its_evidence_and_without_what_only_a_replay_needs(client: PageClient) -> None:
    (update,) = client.get("/event/veh-0001-1").json()
    assert set(update["evidence"]) == {"columns", "readings"}
    assert client.get("/event/none").status_code == 404
    assert client.get("/event/%2A").status_code == 404


def test_a_long_event_carries_the_evidence_of_its_ends(client: PageClient) -> None:
    updates = client.get("/event/veh-0009-9").json()
    carried = ["evidence" in update for update in updates]
    assert carried == [True] * EVIDENCE_FIRST + [False] * (29 - EVIDENCE_FIRST - EVIDENCE_LAST) + [True] * EVIDENCE_LAST


def test_viewers_are_limited() -> None:
    broadcaster = Broadcaster(FakeFeed(), ["local"])
    broadcaster.viewers = VIEWER_LIMIT
    assert PageClient(create_app(broadcaster)).get("/stream").status_code == 503


@pytest.mark.parametrize("last", ["9" * 10_000, "\u0661", "-1", "1e9", ""])
def test_a_last_event_id_of_any_length_and_form_is_taken(last: str) -> None:
    broadcaster = Broadcaster(FakeFeed(), ["local"])
    broadcaster.closed = True
    headers = {"last-event-id": last.encode()}
    assert PageClient(create_app(broadcaster)).get("/stream", headers=headers).status_code == 200


MUTE = {"site": "local", "vehicle": "veh-0001", "action": "mute", "by": "anna"}


def test_a_handling_is_asked_of_the_service_and_shown_to_all() -> None:
    feed = FakeFeed([])
    broadcaster = Broadcaster(feed, ["local"])
    client = PageClient(create_app(broadcaster))
    answer = client.ask("POST", "/handling", json=MUTE)
    assert (answer.status_code, answer.json()["by"], len(feed.handled)) == (200, "anna", 1)
    broadcaster.refresh()
    frame = json.loads(broadcaster.frame(0).decode().partition("data: ")[2])
    assert [(one["vehicle"], one["action"]) for one in frame["handlings"]] == [("veh-0001", "mute")]


@pytest.mark.parametrize(
    ("changes", "named"),
    [({"action": "delete"}, "action"), ({"site": "elsewhere"}, "site"), ({"by": ""}, "by"), ({"colour": 1}, "colour")],
)
def test_a_handling_that_makes_no_sense_is_named(changes: dict[str, object], named: str) -> None:
    client = PageClient(create_app(Broadcaster(FakeFeed([]), ["local"])))
    answer = client.ask("POST", "/handling", json=MUTE | changes)
    assert (answer.status_code, answer.text.partition(":")[0]) == (400, named)


def test_a_handling_that_no_service_stores_says_why() -> None:
    client = PageClient(create_app(Broadcaster(FakeFeed(), ["local"])))
    answer = client.ask("POST", "/handling", json=MUTE)
    assert (answer.status_code, answer.text) == (503, "no journal\n")


def test_a_handling_comes_from_the_page_itself_as_json_of_bounded_size() -> None:
    feed = FakeFeed([])
    client = PageClient(create_app(Broadcaster(feed, ["local"])))
    assert client.ask("POST", "/handling", json=MUTE, headers={"Origin": "http://evil.example"}).status_code == 421
    assert client.ask("POST", "/handling", content=json.dumps(MUTE)).status_code == 415
    assert client.ask("POST", "/handling", json=MUTE | {"note": "x" * 5_000}).status_code == 413
    assert client.ask("POST", "/", json=MUTE).status_code == 405
    assert feed.handled == []


def test_the_page_has_words_for_every_kind_and_sensor() -> None:
    static = Path(app.__file__).with_name("static")
    words, store = (static / "words.js").read_text(), (static / "store.js").read_text()
    assert set(re.findall(r'"(\w+)"', store.partition("KINDS = ")[2].partition(";")[0])) == set(Kind)
    assert set(re.findall(r"^  (\w+): \"", words.partition("ADVICE")[2], re.MULTILINE)) == set(Kind)
    assert set(re.findall(r"(\w+): \"", words.partition("LIMITS")[2].partition("}")[0])) == set(Observation)
    assert set(re.findall(r"(\w+):", words.partition("SENSORS = {")[2].partition("}")[0])) == set(Sensor)


def test_each_file_has_its_hash_and_each_library_its_licence() -> None:
    stated = dict(line.split()[::-1] for line in (VENDOR / "SHA256SUMS").read_text().splitlines())
    found = {
        str(file.relative_to(VENDOR)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in VENDOR.rglob("*.*")
        if file.parent != VENDOR
    } | {
        str(file.relative_to(VENDOR)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in VENDOR.glob("*/LICENSE")
    }
    assert found == stated
    for library in (folder for folder in VENDOR.iterdir() if folder.is_dir()):
        assert any("Copyright" in licence.read_text() for licence in library.glob("LICENSE*"))
        assert library.name in (VENDOR / "README.md").read_text()
