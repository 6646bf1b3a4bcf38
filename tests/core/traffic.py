"""A platoon on a straight road to the north, as batches: a stand-in for senders, for tests of the engine."""

from collections.abc import Iterable

import numpy as np

from headway.core.types.batch import Batch
from headway.core.types.identifiers import id_column

START_US = 1_700_000_000_000_000
STEP_US = 100_000
LATENCY_US = 5_000
METRES_PER_DEGREE = 111_083.0  # of latitude at 42 degrees north (WGS84 meridian radius)
LAT_DEG, LON_DEG = 42.0, -83.0


def batch(
    ids: list[str],
    x_m: Iterable[float],
    v_mps: Iterable[float],
    t_us: Iterable[int],
    msg_cnt: Iterable[int] | int = 0,
    received_us: Iterable[int] | None = None,
    leader_ids: list[str | None] | None = None,
    range_m: Iterable[float] | None = None,
) -> Batch:
    """Records of vehicles at `x_m` metres north of a fixed place."""
    n = len(ids)
    t = np.array(list(t_us), np.int64)
    nothing = np.full(n, np.nan)
    return Batch(
        ids=id_column(ids),
        leader_ids=id_column([None] * n if leader_ids is None else leader_ids),
        msg_cnt=np.array(list(msg_cnt) if isinstance(msg_cnt, Iterable) else [msg_cnt] * n, np.int64),
        t_us=t,
        received_us=t + LATENCY_US if received_us is None else np.array(list(received_us), np.int64),
        lat_deg=LAT_DEG + np.array(list(x_m), float) / METRES_PER_DEGREE,
        lon_deg=np.full(n, LON_DEG),
        speed_mps=np.array(list(v_mps), float),
        heading_deg=np.zeros(n),
        accel_mps2=nothing,
        accuracy_m=nothing,
        length_m=np.full(n, 4.5),
        range_m=nothing if range_m is None else np.array(list(range_m), float),
        range_rate_mps=nothing,
    )


class Platoon:
    """`cars` vehicles 25 m apart at 20 m/s, the first one ahead; small seeded noise on location and speed."""

    def __init__(self, cars: int, seed: int = 1) -> None:
        self.ids = [f"car{i}" for i in range(cars)]
        self.rng = np.random.default_rng(seed)
        self.k = 0

    @property
    def t_us(self) -> int:
        """Event time of the next batch's first record."""
        return START_US + self.k * STEP_US

    def next(
        self,
        shift_m: dict[str, float] | None = None,
        silent: set[str] | None = None,
        rename: dict[str, str] | None = None,
    ) -> Batch:
        """Records of the next tenth of a second; `shift_m` falsifies locations, `silent` vehicles send nothing."""
        n = len(self.ids)
        x_m = 1000.0 - 25.0 * np.arange(n) + 2.0 * self.k + self.rng.normal(0, 0.01, n)
        v_mps = 20.0 + self.rng.normal(0, 0.02, n)
        t_us = self.t_us + 1000 * np.arange(n)
        count = self.k % 128
        self.k += 1
        sent = [i for i, name in enumerate(self.ids) if name not in (silent or set())]
        names = [(rename or {}).get(self.ids[i], self.ids[i]) for i in sent]
        false_m = [(shift_m or {}).get(self.ids[i], 0.0) for i in sent]
        return batch(names, x_m[sent] + false_m, v_mps[sent], t_us[sent], count)
