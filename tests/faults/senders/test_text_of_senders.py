"""Ids with markup, control characters and formulas: they end as text wherever they come out, or not at all."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import httpx
import msgpack
import zenoh
from browser.serving import dashboard
from e2e.serving import KEYS, without_headway
from faults.harness.fleet_process import record
from faults.harness.processes import Fleet
from sim.loopback import session
from sim.until import until

from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK

TEXTS = (
    "<img src=x onerror=alert(1)>", "</script><script>alert(1)</script>", "\x1b[31mred\x1b[2J", "a\nlevel=error",
    "a\r\ndata: {}\r\n\r\n", "=HYPERLINK(1)", "@SUM(1)", "+1+1", "\u202eevil", 'a"} 1\nheadway_ready 0', "\0", "{}",
)  # fmt: skip
FORMULA = "-1"
"""An id of letters, digits and `_ . ~ -` may begin as a formula does: a car of this name is judged, and has a fault."""


def test_it_ends_as_text(start, measured, tmp_path: Path) -> None:
    service = start()
    with dashboard([service.endpoint], [KEYS.site]) as page, session("client", connect=(service.endpoint,)) as sender:
        with (
            httpx.stream("GET", f"{page}/stream", timeout=30.0) as stream,
            Fleet(service.endpoint, KEYS.site, cars=2, seconds=8.0, faulty=1, fault_s=5.0, prefix=FORMULA) as fleet,
        ):
            frames, refused = stream.iter_lines(), sum(send(sender, text) for text in TEXTS)
            fleet.sent()
            until(lambda: sum(service.metric("headway_records_total").values()) >= refused + 2 * 80)
            shown = ""
            while f"{FORMULA}-1" not in shown or "copies" not in shown:
                shown += next(frames)
        pages = [shown, httpx.get(page).text, httpx.get(f"{page}/history?limit=100").text]
        metrics = httpx.get(f"{service.url}/metrics").text
    out = tmp_path / "alerts.csv"
    command = [sys.executable, "-m", "headway", "alerts", "export", str(out)]
    subprocess.run(
        [*command, "--journal", str(tmp_path / "state" / "journal.sqlite")], env=without_headway(), check=True
    )
    rows = list(csv.reader(out.read_text(encoding="utf-8").splitlines()))
    judged = service.metric("headway_records_total")
    log = json.dumps(service.log(), ensure_ascii=False)
    refused_by_name = sum(judged.values()) - judged["scored"] - judged["warming"]
    measured(
        "ids as markup, control characters, formulas",
        f"{refused_by_name:.0f} refused by name, {len(rows)} rows",
        "text",
    )
    assert refused_by_name == refused
    assert service.metric("headway_ready")[""] == 1
    for text in TEXTS:
        assert text not in log
        assert text not in metrics
    assert all(one.isprintable() or one in "\n\r\t" for one in "".join(pages))
    assert any(f"'{FORMULA}-1" in row for row in rows)
    assert [cell for row in rows for cell in row if cell.startswith(tuple("=+-@\t\r")) and not number(cell)] == []


def send(sender: zenoh.Session, text: str) -> int:
    """Put records that hold a text wherever a sender may write one; return how many."""
    block = zenoh.CongestionControl.BLOCK
    sent = 0
    for key, content, encoding in forms(text):
        sender.put(key, content, encoding=encoding, congestion_control=block)
        sent += 1
    return sent


def forms(text: str):
    good = list(record("a", 0, 0, 1_700_000_000_000_000, 0.0, Still()))
    bad = [good[0], text, *good[2:]]
    yield KEYS.bsm("a"), msgpack.packb(bad), BSM_MSGPACK
    yield KEYS.bsm("a"), json.dumps(bad).encode(), BSM_JSON
    yield KEYS.bsm("gw-a"), msgpack.packb(bad), BSM_MSGPACK
    yield KEYS.bsm("a"), msgpack.packb(good), text.encode("ascii", "ignore").decode() or "text/plain"
    if not set(text) & set("*$?#/@"):  # a chunk that begins with @ is matched by no subscription
        yield f"{KEYS.prefix}/{KEYS.site}/bsm/{text}", msgpack.packb(bad), BSM_MSGPACK


def number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


class Still:
    """Noise of none."""

    def normal(self, mean: float, _std: float) -> float:
        return mean
