"""Two sites on a real bus: a vehicle that crosses their border keeps its event and does not warm up again."""

import time
from pathlib import Path

import msgpack
import numpy as np
from e2e.serving import BLOCK, Service
from sim.loopback import session
from sim.until import until

from headway_schemas import Event, Keys
from headway_schemas.encodings import BSM_MSGPACK
from headway_schemas.event import Phase

BORDER_DEG, CARS = 42.0, 4
FILE = 'secret = "of sixteen letters"\n[neighbours.{}]\nsouth = {}\nnorth = {}\nwest = -84.0\neast = -82.0\n'


def site(folder: Path, name: str, area: tuple[str, float, float], connect: str = "") -> Service:
    """Start the service of a site; `area` is its neighbour with its southern and northern edge."""
    folder.mkdir()
    (folder / "handover.toml").write_text(FILE.format(*area))
    more = {"HEADWAY_SITE": name, "HEADWAY_HANDOVER": str(folder / "handover.toml"), "HEADWAY_STATE_DIR": ""}
    return Service(folder, more | ({"HEADWAY_CONNECT": connect} if connect else {}))


def test_an_open_event_crosses_the_border_of_two_sites(tmp_path: Path) -> None:
    north = site(tmp_path / "north", "north", ("south", 41.0, BORDER_DEG))
    south = site(tmp_path / "south", "south", ("north", BORDER_DEG, 43.0), connect=north.endpoint)
    sessions = {name: session("client", connect=(of.endpoint,)) for name, of in (("south", south), ("north", north))}
    events: dict[str, list[Event]] = {"south": [], "north": []}
    for name, bus in sessions.items():
        bus.declare_subscriber(
            Keys("v2x", name).every_alert,
            lambda sample, into=events[name]: into.append(Event.model_validate_json(sample.payload.to_bytes())),
        )
    try:
        rng, start_us, sent_north = np.random.default_rng(1), time.time_ns() // 1000, 0
        for k in range(160):
            t_us = time.time_ns() // 1000
            for car in range(CARS):
                x_m = 20e-6 * (t_us - start_us) - 25.0 * car - 120.0 + rng.normal(0.0, 0.02)
                is_there = x_m > 1.0
                x_m += 9.0 if car == 1 and 65 <= k < 100 else 0.0  # it crosses after 7.25 s
                record = [1, f"car{car}", k % 128, t_us, BORDER_DEG + x_m / 111_083.0, -83.0,
                          20.0 + rng.normal(0.0, 0.02), 0.0]  # fmt: skip
                sites = ("south", "north") if is_there else ("south",)
                sent_north += is_there
                for name in sites:
                    key = Keys("v2x", name).bsm(f"car{car}")
                    sessions[name].put(key, msgpack.packb(record), encoding=BSM_MSGPACK, congestion_control=BLOCK)
            time.sleep(0.1)
        until(lambda: north.judged() == sent_north, 10.0)
        assert north.metric("headway_site_handovers_total")["adopted"] == CARS
        assert south.metric("headway_site_handovers_total")["sent"] == CARS
        assert north.metric("headway_records_total")["warming"] <= 2 * CARS
        until(lambda: any(event.phase is Phase.CLEARED for event in events["north"]), 10.0)
        onsets = [(name, e.event_id) for name, of in events.items() for e in of if e.phase is Phase.ONSET]
        ends = [(name, e.event_id) for name, of in events.items() for e in of if e.phase is Phase.CLEARED]
        assert [name for name, _ in onsets] == ["south"]
        assert ends == [("north", onsets[0][1])]
    finally:
        for bus in sessions.values():
            bus.close()
        codes = [service.stop() for service in (south, north)]
    assert codes == [0, 0]
