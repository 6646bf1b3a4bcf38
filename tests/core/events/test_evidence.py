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
        store_readings(store.tables, ROWS, reading, np.array([k]))
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
        reading[name] = 1 if name in {"overlapped", "appeared"} else k if name == "contradictions" else k + 0.5

    store_readings(store.tables, ROWS, reading, np.array([7]))

    evidence = store.of(0)
    assert evidence.readings.tobytes() == reading.tobytes()
    assert evidence.leaders.tolist() == [7]
    assert store.newest(0)["x_m"] == reading["x_m"][0]


@pytest.mark.parametrize("words", [1, 63, 64, 65, 128, 600])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_a_checkpoint_is_kept_word_for_word(words: int, share: float) -> None:
    """Readings are appended to it and begin another one, with whatever share of its words is not zero."""
    rng = np.random.default_rng(SEED)
    bank = np.zeros(3, np.dtype([("words", "u8", (words,))]))
    store, states = EvidenceStore(bank, 8), dict[int, bytes]()
    rows = np.arange(bank.size)
    for count in range(40):
        bank["words"] = rng.integers(1, 2**63, (bank.size, words)) * (rng.random((bank.size, words)) < share)
        states[count] = bank[1].tobytes()
        readings = banks.readings(rows.size)
        readings["t_s"], readings["x_m"] = 1e9, count + rows / 10
        store_readings(store.tables, rows, readings, rows + count)

        evidence = store.of(1)

        first = count + 1 - evidence.readings.size
        assert evidence.checkpoint.tobytes() == states[first]
        assert evidence.readings["x_m"].tolist() == [k + 0.1 for k in range(first, count + 1)]
        assert evidence.leaders.tolist() == list(range(first + 1, count + 2))
        assert min(count + 1, 3) <= evidence.readings.size <= 8


def test_rows_share_blocks_and_give_them_back() -> None:
    """Of 50 rows at 10 Hz, that began at any time, a third have a second checkpoint, and no block is lost."""
    rows, dtype = np.arange(50), np.dtype([("count", "i8")])
    bank = np.zeros(rows.size, dtype)
    store = EvidenceStore(bank, 32)
    began_s = 1e9 + np.random.default_rng(SEED).uniform(0, 10, rows.size).round(3)
    checkpoints, kept = [], []
    for k in range(200):
        bank["count"] = k
        readings = banks.readings(rows.size)
        readings["t_s"] = began_s + 0.1 * k
        store_readings(store.tables, rows, readings, rows)
        evidence = [store.of(row) for row in rows]
        assert all(of.checkpoint["count"] == k + 1 - of.readings.size for of in evidence)
        checkpoints.append(int((store.tables.segments["blocks"] != 0).sum()))
        kept.append(sum(of.readings.size for of in evidence))

    assert np.mean(checkpoints) / rows.size == pytest.approx(1 + 8 / 24, abs=0.03)
    assert np.mean(kept[40:]) / rows.size == pytest.approx(20, abs=1)
    assert max(checkpoints) < 1.6 * rows.size
    assert _blocks(store) < 9 * rows.size

    store.clear(rows)
    store_readings(store.tables, rows, readings, rows)
    _blocks(store)
    assert (store.tables.segments["blocks"] != 0).sum(axis=0).tolist() == [rows.size, 0]


def _blocks(store: EvidenceStore) -> int:
    """Return how many blocks were ever used; each is in one list only, of a segment or of those that are free."""
    tables = store.tables
    held = [tables.places[row, k, : tables.segments["blocks"][row, k]] for row, k in np.ndindex(50, 2)]
    found = np.concatenate([*held, tables.free[: tables.free_count[0]]])
    assert sorted(found) == list(range(tables.free_count[1]))
    return int(found.size)
