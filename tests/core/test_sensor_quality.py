"""The quality of sensors, as the engine learns it from the messages of ordinary receivers."""

import numpy as np
import pytest

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.sensor_quality import GOOD_LIMITS, USABLE_LIMITS, QualityLevel, QualityStates

STEP_S = 0.1


def learnt(config: DetectorConfig | None = None, seconds: float = 60.0, **defect: float) -> QualityStates | None:
    """What is known of a vehicle that drives north with a `defect` of its receiver."""
    rng, engine = np.random.default_rng(3), Engine(config or DetectorConfig(vehicle_capacity=4))
    t = np.arange(0.0, seconds, STEP_S)
    v = 15.0 + 4.0 * np.sin(0.4 * t)
    x = np.cumsum(STEP_S * v)
    x += rng.normal(0.0, defect.get("position_noise_m", 0.01), t.size)
    v = v / (1.0 + defect.get("speed_scale", 0.0)) + rng.normal(0.0, defect.get("speed_noise_mps", 0.01), t.size)
    step_mps = defect.get("speed_step_mps", 0.02)
    v = np.round(v / step_mps) * step_mps
    unknown = np.full(1, np.nan)
    for k in range(t.size):
        t_us = np.array([1_700_000_000_000_000 + round(t[k] * 1e6)])
        engine.step(
            Batch(
                ids=id_column(["a"]),
                leader_ids=id_column([None]),
                msg_cnt=np.array([k % 128]),
                t_us=t_us,
                received_us=t_us,
                lat_deg=np.array([48.0 + x[k] / 111_200.0]),
                lon_deg=np.array([11.0]),
                speed_mps=v[k : k + 1],
                heading_deg=np.zeros(1),
                accel_mps2=unknown,
                accuracy_m=unknown,
                length_m=unknown,
                range_m=unknown,
                range_rate_mps=unknown,
            ),
            int(t_us[0]),
        )
    return engine.qualities()


def test_a_sensor_of_centimetres_is_good() -> None:
    states = learnt()
    assert states is not None
    assert states.vehicles == ["a"]
    assert states.levels.tolist() == [QualityLevel.GOOD]


@pytest.mark.parametrize(
    ("name", "size"),
    [("position_noise_m", 1.0), ("speed_scale", 0.03), ("speed_noise_mps", 0.2), ("speed_step_mps", 0.25)],
)
def test_a_defect_of_a_receiver_is_learnt_and_degrades_it(name: str, size: float) -> None:
    states = learnt(**{name: size})
    assert states is not None
    assert getattr(states.qualities, name)[0] == pytest.approx(size, rel=0.4)
    assert states.levels.tolist() == [QualityLevel.DEGRADED]


def test_nothing_is_said_before_the_sensors_are_known() -> None:
    states = learnt(seconds=5.0)
    assert states is not None
    assert states.vehicles == []


def test_a_model_that_learns_nothing_of_sensors_has_no_quality() -> None:
    assert learnt(DetectorConfig(vehicle_capacity=4, model="ca"), seconds=1.0) is None


def test_every_property_has_a_limit_of_good_below_that_of_usable() -> None:
    assert list(GOOD_LIMITS) == list(USABLE_LIMITS)
    assert all(GOOD_LIMITS[name] < USABLE_LIMITS[name] for name in GOOD_LIMITS)
