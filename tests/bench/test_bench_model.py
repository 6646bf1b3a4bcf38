"""Cost of judging a thousand vehicles once, each model on the same readings."""

import numpy as np
import pytest

from headway.core import models
from headway.core.bank import readings, verdicts
from headway.core.config import DetectorConfig

VEHICLES = 1_000


@pytest.mark.bench
@pytest.mark.parametrize("name", sorted(models.MODELS))
def test_a_batch_of_a_thousand(benchmark, name: str) -> None:
    model = models.build(DetectorConfig(model=name, vehicle_capacity=VEHICLES))
    rng = np.random.default_rng(0)
    bank, rows, judged = np.zeros(VEHICLES, model.dtype), rng.permutation(VEHICLES), verdicts(VEHICLES)
    now = {"k": 0}

    def prepare():
        now["k"] += 1
        t_s = 0.1 * now["k"]
        read = readings(VEHICLES)
        read["t_s"] = read["leader_t_s"] = t_s
        read["x_m"], read["leader_x_m"] = 10.0 * t_s + rng.normal(0.0, 0.01, VEHICLES), 10.0 * t_s + 25.0
        read["v_mps"], read["leader_v_mps"] = 10.0 + rng.normal(0.0, 0.01, VEHICLES), 10.0
        read["leader_length_m"] = 5.0
        return (bank, rows, read, model.params, judged), {}

    for _ in range(30):
        model.step_batch(*prepare()[0])
    benchmark.pedantic(model.step_batch, setup=prepare, rounds=300)
