"""Each example runs, and shows what it says."""

import importlib.util
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib as mpl
import nbformat
import pytest
import zenoh
from fake_service import START_US, bus, event, free_port, service

from headway import Detector, sample_recording
from headway_schemas import Phase
from headway_schemas.bsm import Bsm, from_map
from headway_schemas.encodings import BSM_JSON

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_listed_and_tested() -> None:
    files = {path.name for path in EXAMPLES.iterdir() if path.suffix in {".py", ".ipynb"}}
    listed = {
        line.split("`")[1] for line in (EXAMPLES / "README.md").read_text().splitlines() if line.startswith("| `")
    }
    assert listed == files
    tested = Path(__file__).read_text()
    assert [name for name in files if f'"{name.removesuffix(".py")}"' not in tested] == []


def test_the_sample_is_what_its_example_makes(tmp_path: Path) -> None:
    load("make_sample").main(str(tmp_path / "sample.csv.gz"))
    shipped = EXAMPLES.parent / "service" / "headway" / "sample.csv.gz"
    assert (tmp_path / "sample.csv.gz").read_bytes() == shipped.read_bytes()
    assert shipped.stat().st_size < 10_000


def test_the_sample_has_one_event_of_the_second_car_while_its_speed_is_false() -> None:
    records = sample_recording()
    first, last = (START_US + round(1e6 * s) for s in load("make_sample").FAULT_S)
    detector = Detector()
    events = detector.process(records).events + detector.finish().events
    assert {event.suspect for event in events} == {"car-2"}
    onsets = [event for event in events if event.phase is Phase.ONSET]
    assert onsets[0].sensor.value == "speed"
    assert all(first <= event.t_us < last + 100_000 for event in onsets)


def test_data_frame(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    load("data_frame").main(str(tmp_path / "picture.png"))
    assert "onset" in capsys.readouterr().out
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_evaluate_model(capsys: pytest.CaptureFixture[str]) -> None:
    load("evaluate_model").main("headway", "ekf")
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split()[:2] == ["model", "recall"]
    assert [row.split()[0] for row in rows] == ["headway", "ekf"]
    assert all(float(row.split()[1]) > 0.1 and float(row.split()[3]) < 1.0 for row in rows)


def test_own_model(capsys: pytest.CaptureFixture[str]) -> None:
    load("own_model").main()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "onset speed car-2 alpha-beta"
    assert {line.split()[2] for line in lines} == {"car-2"}
    with pytest.raises(Exception, match=r"model = 'beta-alpha'.*alpha-beta"):
        Detector(model="beta-alpha")


def test_subscriber(capsys: pytest.CaptureFixture[str]) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with service(endpoint) as running:
        running.journal.append(event(1))
        listening = threading.Thread(target=load("subscriber").main, args=(endpoint, 2.0))
        listening.start()
        while "onset" not in (lines := capsys.readouterr().out) and listening.is_alive():
            running.publish(event(2))
            listening.join(0.1)
        listening.join()
    assert "onset bias speed veh-0002 p = " in lines


def test_own_gateway() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    received: list[tuple[str, str, Bsm]] = []
    lines = ["a;1700000000.0;42.5;-83.5;36", "b;1700000000.0;42.6;-83.5;72", "a;1700000000.1;42.5;-83.5;36"]

    def take(sample: zenoh.Sample) -> None:
        bsm = from_map(json.loads(sample.payload.to_string()))
        received.append((str(sample.key_expr), str(sample.encoding), bsm))

    with bus("peer", listen=endpoint) as session:
        session.declare_subscriber("v2x/**", take)
        load("own_gateway").main(endpoint, lines)
        until(lambda: len(received) == 3)
    assert {key for key, _, _ in received} == {"v2x/local/bsm/gw-example"}
    assert {encoding for _, encoding, _ in received} == {BSM_JSON}
    assert [(bsm.id, bsm.msg_cnt, bsm.speed_mps) for _, _, bsm in received] == [
        ("a", 0, 10.0),
        ("b", 0, 20.0),
        ("a", 1, 10.0),
    ]


def until(done: Callable[[], bool]) -> None:
    give_up_s = time.monotonic() + 20
    while not done():
        assert time.monotonic() < give_up_s
        time.sleep(0.02)


def test_detector_notebook() -> None:
    mpl.use("agg")
    notebook = nbformat.read(EXAMPLES / "detector.ipynb", as_version=4)
    nbformat.validate(notebook)
    names: dict[str, Any] = {}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            exec(cell.source, names)
    assert len(names["judged"]) == 800
    assert "car-2" in {event.suspect for event in names["events"]}
