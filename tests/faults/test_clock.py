"""The system clock leaps for six seconds: nothing is deleted, and vehicles that leave are forgotten as ever."""

import shutil
import subprocess
import time
from pathlib import Path

import pytest
from e2e.serving import KEYS
from faults.harness.processes import Fleet, Subscriber
from sim.until import until

DAY_S = 86_400
LEAPS_S = {"+1 h": 3_600, "-1 h": -3_600, "+31 d": 31 * DAY_S, "-31 d": -31 * DAY_S, "+20 y": 7_305 * DAY_S,
           "-20 y": -7_305 * DAY_S}  # fmt: skip
EVICTED_S, LEAP_S = 35.0, 6.0
SOURCE = Path(__file__).parent / "harness" / "wall_clock.c"


@pytest.fixture
def clock(tmp_path: Path):
    """A file that says how many seconds the system clock of a service is off, and the variables that make it so."""
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler (Debian: apt-get install gcc)")
    library, file = tmp_path / "wall_clock.so", tmp_path / "clock"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
    file.write_text("0")
    return file, {"LD_PRELOAD": str(library), "CLOCK_OFFSET_FILE": str(file)}


@pytest.mark.parametrize("leap", LEAPS_S)
def test_a_leap(start, history, measured, clock, monkeypatch, leap: str) -> None:
    file, variables = clock
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    service = start()
    for name in variables:
        monkeypatch.delenv(name)
    with (
        Subscriber(service.endpoint, KEYS.site) as bus,
        Fleet(service.endpoint, KEYS.site, cars=6, seconds=22.0, faulty=1, fault_every_s=14.0) as fleet,
    ):
        until(lambda: any(a["phase"] == "cleared" for a in bus.alerts))
        before = len(history(service.endpoint))
        file.write_text(str(LEAPS_S[leap]))
        time.sleep(LEAP_S)
        file.write_text("0")
        fleet.sent()
        ended_s = time.monotonic()
        until(lambda: sum(a["phase"] == "onset" for a in bus.alerts) >= 2)
    outcomes = service.metric("headway_records_total")
    until(lambda: service.metric("headway_vehicles")[""] == 0, EVICTED_S + 10.0)
    evicted_s = time.monotonic() - ended_s
    pruned, kept = service.metric("headway_journal_pruned_total")[""], len(history(service.endpoint))
    refused = outcomes["too_old"] + outcomes["from_the_future"]
    got = f"{pruned:.0f} pruned, forgotten after {evicted_s:.1f} s; {refused:.0f} refused meanwhile"
    measured(f"clock {leap} for {LEAP_S:.0f} s", got, "0 pruned, <= 35 s")
    assert refused > 0, "the clock did not leap"
    assert pruned == 0
    assert kept >= before
    assert evicted_s <= EVICTED_S
