from pathlib import Path

import pytest
from dashboard.pageclient import PageClient
from fake_service import FakeFeed

from headway.dashboard.access import COOKIE, is_loopback, read_token
from headway.dashboard.app import create_app
from headway.dashboard.broadcast import Broadcaster
from headway.dashboard.server import serve
from headway.errors import UserError

TOKEN = "correct-horse-battery"


def client(host: str = "127.0.0.1", token: str | None = None, base: str = "http://127.0.0.1:8080") -> PageClient:
    app = create_app(Broadcaster(FakeFeed(), ["local"]), host=host, token=token, names=["board.example"])
    return PageClient(app, base)


@pytest.mark.parametrize(
    "base", ["http://127.0.0.1:8080", "http://localhost", "http://[::1]:9", "http://board.example"]
)
def test_known_names_pass_on_loopback(base: str) -> None:
    assert client(base=base).get("/").status_code == 200


@pytest.mark.parametrize("base", ["http://evil.example:8080", "http://10.0.0.7", "http://localhost.evil.example"])
def test_foreign_names_are_turned_away_on_loopback(base: str) -> None:
    assert client(base=base).get("/").status_code == 421


def test_elsewhere_addresses_pass_and_foreign_names_do_not() -> None:
    bearer = {"authorization": f"Bearer {TOKEN}"}
    assert client("0.0.0.0", TOKEN, "http://10.0.0.7:8080").get("/", headers=bearer).status_code == 200
    assert client("0.0.0.0", TOKEN, "http://evil.example").get("/", headers=bearer).status_code == 421


@pytest.mark.parametrize("path", ["/", "/stream", "/history", "/event/a", "/static/main.js"])
def test_nothing_is_given_without_the_token(path: str) -> None:
    guarded = client(token=TOKEN)
    assert guarded.get(path).status_code == 401
    assert guarded.get(path, headers={"authorization": "Bearer wrong"}).status_code == 401
    assert guarded.get(path, headers={"cookie": f"{COOKIE}={TOKEN}"}).status_code == 401
    assert guarded.get(path, params={"token": TOKEN + "x"}).status_code == 401


def test_the_token_in_an_address_becomes_a_cookie_that_scripts_cannot_read() -> None:
    guarded = client(token=TOKEN)
    answer = guarded.get("/", params={"token": TOKEN, "kind": "bias"})
    assert (answer.status_code, answer.headers["location"]) == (303, "/?kind=bias")
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    assert TOKEN not in cookie
    assert guarded.get("/").status_code == 200


@pytest.mark.parametrize(
    ("base", "headers", "secure"),
    [
        ("http://127.0.0.1:8080", {}, False),
        ("https://board.example", {}, True),
        ("http://board.example", {"x-forwarded-proto": "https"}, True),
    ],
)
def test_the_cookie_is_secure_behind_tls(base: str, headers: dict[str, str], secure: bool) -> None:
    answer = client(token=TOKEN, base=base).get("/", params={"token": TOKEN}, headers=headers)
    assert ("Secure" in answer.headers["set-cookie"]) == secure


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:8081", "http://127.0.0.1"])
def test_a_page_of_another_origin_is_turned_away(origin: str) -> None:
    assert client().get("/history", headers={"origin": origin}).status_code == 421
    assert client().get("/history", headers={"origin": "http://127.0.0.1:8080"}).status_code == 200


def test_a_path_cannot_send_the_browser_elsewhere() -> None:
    answer = client(token=TOKEN).get("http://localhost//evil.example/", params={"token": TOKEN})
    assert answer.headers["location"].startswith("/evil")


def test_the_token_as_a_header() -> None:
    assert client(token=TOKEN).get("/", headers={"authorization": f"Bearer {TOKEN}"}).status_code == 200


def test_only_reading() -> None:
    answer = client().ask("POST", "/")
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD")


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/nowhere", "/history?kind=none"])
def test_every_answer_tells_the_browser_what_it_may_do(path: str) -> None:
    headers = client().get(path).headers
    assert headers["content-security-policy"].startswith("default-src 'self';")
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False)],
)
def test_what_is_reached_from_this_machine_only(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


def test_elsewhere_without_a_token_does_not_start() -> None:
    with pytest.raises(UserError, match="--token-file"):
        serve(host="0.0.0.0", port=0)


@pytest.mark.parametrize("text", ["", "short\n", "\n" + TOKEN, "pässword-pässword\n"])
def test_a_token_that_keeps_nobody_out_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "token"
    file.write_text(text)
    with pytest.raises(UserError, match="at least 16"):
        read_token(file)


def test_the_token_is_the_first_line(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\nrest\n")
    assert read_token(file) == TOKEN
    with pytest.raises(UserError, match="No such file"):
        read_token(tmp_path / "none")


@pytest.mark.parametrize(("connect", "sites"), [(["tcp/127.0.0.1:7447"], ["a/b"]), (["nonsense"], ["a"]), ([], [])])
def test_unfit_options_are_one_line(connect: list[str], sites: list[str]) -> None:
    with pytest.raises(UserError) as refusal:
        serve(connect=connect, sites=sites, port=0)
    assert "\n" not in str(refusal.value)
