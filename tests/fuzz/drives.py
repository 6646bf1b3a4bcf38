"""Adversarial drives of valid records through the whole engine, beside two honest cars.

Each byte of an input chooses one thing of one reading: how much time passes, where a vehicle is, how fast, which way,
at which count, how old its message is. Afterwards all drive normally, and then each jumps by 500 m.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from typing import TypeVar

import numpy as np

from headway.core.engine import Engine
from headway.core.pipeline.finiteness import SPEED_MAX_MPS
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import RecordVerdicts

START_US = 1_700_000_000_000_000
VEHICLES, WILD, SETTLING, JUMPED = 16, 24, 70, 3
JUMP_M = 500.0
M_PER_DEG = 111_083.0
HONEST = ["honest-0", "honest-1"]
HONEST_LAT, HONEST_LON, HONEST_GAP_M = 10.0, 20.0, 30.0
SPEED_MPS = 15.0

STEPS_US = [1, 2, 1_000, 99_999, 100_000, 100_000, 100_001, 600_000, 2_500_000, 4_990_000]
LATS = [0.0, 1e-7, 42.0, 42.01, 42.00001, -38.0, 89.9999999, 90.0, -90.0]
LONS = [0.0, -83.0, -83.0, -82.99, 97.0, 180.0, -180.0, 179.9999999]
SPEEDS = [0.0, 0.02, 15.0, 15.0, 60.0, 163.8]
HEADINGS = [0.0, 0.0, 90.0, 359.9, 360.0, np.nan]
COUNTS = [0, 1, 64, 127]
AGES_US = [5_000, 5_000, 5_000, 4_900_000, 300_000, -100_000, -900_000]
OPTIONAL = [np.nan, np.nan, 0.0, 12.7]

_FINITE = ("x_m", "v_mps", "x_std_m", "v_std_mps", "statistic", "gate", "nis")
_ACCEPTED = (Outcome.SCORED, Outcome.WARMING)

T = TypeVar("T")


class _Choices:
    """Chooses by the bytes of an input, again from the first when they are used up."""

    def __init__(self, data: bytes) -> None:
        self._bytes = data or b"\0"
        self._used = 0

    def one_of(self, values: Sequence[T]) -> T:
        self._used += 1
        return values[self._bytes[self._used % len(self._bytes)] % len(values)]


def drive_seeds() -> list[bytes]:
    """Return inputs of several lengths, none a multiple of another, so that they repeat in many ways."""
    rng = np.random.default_rng(7)
    return [rng.bytes(n) for n in (1, 7, 61, 509, 2_003)]


def drive(model: str, data: bytes) -> Counter[Outcome]:
    """Drive; raise where the engine does what it must not, and return the outcomes of all records."""
    choices, outcomes = _Choices(data), Counter[Outcome]()
    config = DetectorConfig(model=model, vehicle_capacity=32)
    beside, alone = Engine(config), Engine(config)
    cars = [f"wild-{n}" for n in range(VEHICLES)]
    now_us, k = START_US, 0
    for k in range(WILD):
        now_us += choices.one_of(STEPS_US)
        _step(beside, alone, _joined(_honest(now_us, k), _wild(cars, now_us, choices)), now_us, outcomes)
    now_us += 6_000_000
    for step in range(SETTLING + JUMPED):
        k, now_us = k + 1, now_us + 100_000
        jump_m = JUMP_M if step >= SETTLING else 0.0
        if step == SETTLING:
            assert not _suspects(beside, cars), "an event lasts although its vehicle drives normally"
        _step(beside, alone, _joined(_honest(now_us, k), _normal(cars, now_us, step, jump_m)), now_us, outcomes)
    missed = set(cars) - _suspects(beside, cars)
    assert not missed, f"a jump of {JUMP_M} m of {sorted(missed)} was not found"
    return outcomes


def _suspects(engine: Engine, cars: list[str]) -> set[str]:
    """Return the cars that have an open event."""
    return {car for car in cars if any(event_id.startswith(f"{car}-") for event_id in engine.open_event_ids)}


def _step(beside: Engine, alone: Engine, batch: Batch, now_us: int, outcomes: Counter[Outcome]) -> None:
    """Step both engines, one with the honest cars alone, and compare what they say of those."""
    n = len(HONEST)
    out, out_alone = RecordVerdicts.empty(len(batch)), RecordVerdicts.empty(n)
    result = beside.step(batch, now_us, out=out)
    expected = alone.step(
        Batch(**{name: column[:n] for name, column in _columns(batch).items()}), now_us, out=out_alone
    )
    assert result.failures == [], result.failures
    assert result.resets == 0, "a filter whose numbers are not finite"
    assert len(result.outcomes) == len(batch)
    assert result.outcomes[:n].tolist() == expected.outcomes.tolist()
    assert out.verdicts[:n].tobytes() == out_alone.verdicts.tobytes(), "an honest car is judged otherwise"
    accepted = np.isin(result.outcomes, [int(outcome) for outcome in _ACCEPTED])
    for name in _FINITE:
        assert np.isfinite(out.verdicts[name][accepted]).all(), f"{name} is not finite"
    assert (np.abs(out.verdicts["v_mps"][accepted]) < SPEED_MAX_MPS).all(), "an estimate that no vehicle can have"
    outcomes.update(map(Outcome, result.outcomes.tolist()))


def _columns(batch: Batch) -> dict[str, np.ndarray]:
    return {field.name: getattr(batch, field.name) for field in fields(batch)}


def _batch(ids: list[str], now_us: int, age_us: Sequence[int], **columns: Sequence[float]) -> Batch:
    n = len(ids)
    numbers = {name: np.array(values, float) for name, values in columns.items()}
    optional = ("accel_mps2", "accuracy_m", "length_m", "range_m", "range_rate_mps")
    return Batch(
        ids=id_column(ids), leader_ids=id_column([None] * n), msg_cnt=numbers.pop("msg_cnt").astype(np.int64),
        t_us=now_us - np.array(age_us, np.int64), received_us=np.full(n, now_us),
        **dict.fromkeys(optional, np.full(n, np.nan)) | numbers,
    )  # fmt: skip


def _joined(first: Batch, second: Batch) -> Batch:
    after = _columns(second)
    return Batch(**{name: np.concatenate([column, after[name]]) for name, column in _columns(first).items()})


def _honest(now_us: int, k: int) -> Batch:
    t_s = (now_us - START_US) / 1e6
    x_m = SPEED_MPS * t_s - HONEST_GAP_M * np.arange(2)
    lats = HONEST_LAT + x_m / M_PER_DEG
    return _batch(HONEST, now_us, [5_000] * 2, msg_cnt=[k % 128] * 2, lat_deg=lats, lon_deg=[HONEST_LON] * 2,
                  speed_mps=[SPEED_MPS] * 2, heading_deg=[0.0] * 2)  # fmt: skip


def _wild(cars: list[str], now_us: int, choices: _Choices) -> Batch:
    names = ("lat_deg", "lon_deg", "speed_mps", "heading_deg", "msg_cnt", "accel_mps2", "accuracy_m", "length_m")
    values = (LATS, LONS, SPEEDS, HEADINGS, COUNTS, OPTIONAL, OPTIONAL, OPTIONAL)
    columns = {
        name: [choices.one_of(some) for _ in cars] for name, some in zip(names, values, strict=True)
    }  # fmt: skip
    return _batch(cars, now_us, [choices.one_of(AGES_US) for _ in cars], **columns)


def _normal(cars: list[str], now_us: int, k: int, jump_m: float) -> Batch:
    n = np.arange(len(cars))
    rng = np.random.default_rng(k)
    x_m = SPEED_MPS * 0.1 * k + jump_m + rng.normal(0.0, 0.02, n.size)
    return _batch(cars, now_us, [5_000] * n.size, msg_cnt=[k % 128] * n.size, lat_deg=42.0 + x_m / M_PER_DEG,
                  lon_deg=-83.0 + 0.1 * n, speed_mps=SPEED_MPS + rng.normal(0.0, 0.02, n.size),
                  heading_deg=[0.0] * n.size)  # fmt: skip
