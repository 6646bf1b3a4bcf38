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
    assert min(count, 9) <= evidence.readings.size <= 16
    for k in range(evidence.readings.size):
        replayed = banks.verdicts(1)
        model.step_batch(again, ROWS, evidence.readings[k : k + 1], model.params, replayed)
    assert replayed.tobytes() == verdict.tobytes()
    assert again.tobytes() == bank.tobytes()


def test_an_odd_ring_is_refused() -> None:
    with pytest.raises(ValueError, match="even"):
        EvidenceStore(np.zeros(1, np.dtype([("count", "i8")])), 7)
