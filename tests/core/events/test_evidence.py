import numpy as np
import pytest

from headway.core.estimation import registry
from headway.core.events.evidence import EvidenceStore, store_readings
from headway.core.runtime import rows as banks
from headway.core.types.config import DetectorConfig

SEED = 20
ROWS = np.array([0])


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 15, 16, 17, 40])
def test_replayed_evidence_gives_the_same_verdict_bit_for_bit(count: int) -> None:
    model = registry.build(DetectorConfig(model="aekf", delay_s=0.5))
    bank = np.zeros(1, model.dtype)
    store = EvidenceStore(bank, 16)
    rng = np.random.default_rng(SEED)
    verdict = banks.verdicts(1)
    for k in range(count):
        reading = banks.readings(1)
        reading["t_s"], reading["x_m"], reading["v_mps"] = 1e9 + 0.1 * k, 2.0 * k + rng.normal(), 20 + rng.normal()
        verdict = banks.verdicts(1)
        store_readings(store.rings, bank, ROWS, reading, np.array([k]))
        model.step_batch(bank, ROWS, reading, model.params, verdict)

    evidence = store.of(0)

    again = np.array([evidence.checkpoint])
    assert min(count, 5) <= evidence.readings.size <= 16
    for k in range(evidence.readings.size):
        replayed = banks.verdicts(1)
        model.step_batch(again, ROWS, evidence.readings[k : k + 1], model.params, replayed)
    assert replayed.tobytes() == verdict.tobytes()
    assert again.tobytes() == bank.tobytes()


def test_a_ring_that_has_no_quarter_is_refused() -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        EvidenceStore(np.zeros(1, np.dtype([("count", "i8")])), 6)


def test_each_field_of_a_reading_is_kept() -> None:
    store = EvidenceStore(np.zeros(1, np.dtype([("count", "i8")])), 4)
    reading = banks.readings(1)
    for k, name in enumerate(reading.dtype.names):
        reading[name] = k + 0.5

    store_readings(store.rings, np.zeros(1, np.dtype([("count", "i8")])), ROWS, reading, np.array([7]))

    evidence = store.of(0)
    assert evidence.readings.tobytes() == reading.tobytes()
    assert evidence.leaders.tolist() == [7]


def test_rows_share_checkpoints_and_give_them_back() -> None:
    """Of 50 rows at 10 Hz, that began at any time, about a third have a second checkpoint at once."""
    rows, dtype = np.arange(50), np.dtype([("count", "i8")])
    bank, store = np.zeros(rows.size, dtype), EvidenceStore(np.zeros(rows.size, dtype), 32)
    began_s = 1e9 + np.random.default_rng(SEED).uniform(0, 10, rows.size).round(3)
    in_use = []
    for k in range(200):
        bank["count"] = k
        readings = banks.readings(rows.size)
        readings["t_s"] = began_s + 0.1 * k
        store_readings(store.rings, bank, rows, readings, rows)
        in_use.append(int((store.rings.places >= 0).sum()))
        assert all(store.of(row).checkpoint["count"] == k + 1 - store.of(row).readings.size for row in rows)

    assert 2 * rows.size - store.rings.free_count[0] == in_use[-1]
    assert np.mean(in_use) / rows.size == pytest.approx(1 + 8 / 24, abs=0.03)
    assert max(in_use) < 1.6 * rows.size

    store.clear(rows)
    store_readings(store.rings, bank, rows, readings, rows)
    assert 2 * rows.size - store.rings.free_count[0] == rows.size
