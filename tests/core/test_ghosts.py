"""Senders that do not exist, and senders under the id of another: whom the events name."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from core.traffic import START_US, batch

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import Phase

METRES_PER_DEGREE_EAST = 82_850.0  # of longitude at 42 degrees north
LENGTH_M = 4.5
DELAY_US = 20_000
NOISE = 0.02
SECONDS = 130
FALSE_AT_S = 70.0
"""By then every driver is known."""


@dataclass
class Scene:
    """What came of a scene: the events by id, and the outcomes of each record by its sender."""

    suspects: dict[str, set[str]] = field(default_factory=dict)
    spans_s: dict[str, tuple[float, float]] = field(default_factory=dict)
    observations: dict[str, set[str]] = field(default_factory=dict)
    outcomes: dict[str, list[str]] = field(default_factory=dict)

    @property
    def named(self) -> set[str]:
        """Every id that an event named."""
        return set().union(*self.suspects.values()) if self.suspects else set()


Record = tuple[str, str, float, float, float, float]
"""True sender, id, place (m), speed (m/s), event time and receive time (s after the start)."""


def play(
    seed: int, rounds: Iterator[list[Record]], accuracy_m: float = np.nan, aside_m: float = 0.0, **declared: object
) -> Scene:
    """Take the records of each tenth of a second through an engine; the ghost is `aside_m` to the right."""
    rng, engine, scene = np.random.default_rng(seed), Engine(DetectorConfig(vehicle_capacity=16)), Scene()
    for k, records in enumerate(rounds):
        senders, ids, x_m, v_mps, t_s, received_s = zip(*records, strict=True)
        t_us, received_us = (START_US + np.round(1e6 * np.array(times)).astype(int) for times in (t_s, received_s))
        noisy_m, noisy_mps = (np.array(values) + rng.normal(0.0, NOISE, len(ids)) for values in (x_m, v_mps))
        ranges = {name: value(k, ids) for name, value in declared.items() if callable(value)}
        made = batch(list(ids), noisy_m, noisy_mps, t_us, k % 128, received_us, **ranges)
        made = replace(made, accuracy_m=np.full(len(ids), accuracy_m), lon_deg=made.lon_deg.copy())
        made.lon_deg[made.ids == b"ghost"] += aside_m / METRES_PER_DEGREE_EAST
        result = engine.step(made, int(received_us.max()))
        for sender, outcome in zip(senders, result.outcomes.tolist(), strict=True):
            scene.outcomes.setdefault(sender, []).append(Outcome(outcome).label)
        for event in result.events:
            at_s = 1e-6 * (event.t_us - START_US)
            scene.suspects.setdefault(event.event_id, set()).add(event.suspect)
            scene.observations.setdefault(event.event_id, set()).update(event.observations)
            first_s, _ = scene.spans_s.get(event.event_id, (at_s, at_s))
            scene.spans_s[event.event_id] = first_s, np.inf if event.phase is not Phase.CLEARED else at_s
    return scene


def platoon(seed: int, cars: int, apart_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and speeds (n, cars) of drivers who follow each other, the first ahead."""
    rng = np.random.default_rng([seed, cars])
    t_s = 0.1 * np.arange(10 * SECONDS)
    phase = rng.uniform(0.0, 6.0, 2)
    x_m, v_mps = np.zeros((t_s.size, cars)), np.zeros((t_s.size, cars))
    v_mps[:, 0] = 14.0 + 2.5 * np.sin(0.19 * t_s + phase[0]) + 1.5 * np.sin(0.53 * t_s + phase[1])
    x_m[:, 0] = np.cumsum(0.1 * v_mps[:, 0])
    x_m[0, 1:], v_mps[0] = -apart_m * np.arange(1, cars), v_mps[0, 0]
    for k in range(1, t_s.size):
        late = max(k - 4, 0)
        gap_m = x_m[late, :-1] - LENGTH_M - x_m[late, 1:]
        a_mps2 = 0.05 * (gap_m - 1.5 * v_mps[late, 1:]) + 0.5 * (v_mps[late, :-1] - v_mps[late, 1:])
        v_mps[k, 1:] = np.maximum(v_mps[k - 1, 1:] + 0.1 * (a_mps2 + rng.normal(0.0, 0.3, cars - 1)), 0.0)
        x_m[k, 1:] = x_m[k - 1, 1:] + 0.05 * (v_mps[k, 1:] + v_mps[k - 1, 1:])
    return x_m, v_mps


def feign_brakes(x_m: np.ndarray, v_mps: np.ndarray, car: int, depth_mps: float) -> None:
    """Let a car brake and recover every twelve seconds, in its messages alone."""
    t_s = 0.1 * np.arange(len(x_m))
    for start_s in np.arange(FALSE_AT_S, SECONDS - 12.0, 12.0):
        for at_s, depth in ((start_s, depth_mps), (start_s + 6.0, -depth_mps)):
            since_s = np.clip(t_s - at_s, 0.0, 4.0)
            dip_mps = -0.5 * depth * (1.0 - np.cos(0.5 * np.pi * since_s))
            v_mps[:, car] += dip_mps
            x_m[:, car] += np.cumsum(0.1 * dip_mps)


def row(ids: list[str], x_m: np.ndarray, v_mps: np.ndarray) -> Iterator[list[Record]]:
    """Yield the records of a platoon, ten times a second, each car a millisecond after the one ahead."""
    for k in range(len(x_m)):
        times = [0.1 * k + 0.001 * i for i in range(len(ids))]
        yield [(n, n, x, v, t, t + 0.02) for n, x, v, t in zip(ids, x_m[k], v_mps[k], times, strict=True)]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("honest", [1, 2])
@pytest.mark.parametrize("apart_m", [15.0, 30.0])
@pytest.mark.parametrize("behind_mps", [3.0, -3.0])
def test_an_honest_car_between_two_ghosts_is_not_named(
    seed: int, honest: int, apart_m: float, behind_mps: float
) -> None:
    """Both ghosts contradict it, and nobody supports them."""
    ids = ["ghost0", *(f"honest{i}" for i in range(honest)), "ghost1"]
    x_m, v_mps = platoon(seed, len(ids), apart_m)
    feign_brakes(x_m, v_mps, 0, 3.0)
    feign_brakes(x_m, v_mps, len(ids) - 1, behind_mps)
    assert not {name for name in play(seed, row(ids, x_m, v_mps)).named if name.startswith("honest")}


@pytest.mark.parametrize("seed", range(3))
def test_a_ghost_among_honest_cars_is_named(seed: int) -> None:
    ids = ["honest0", "honest1", "ghost", "honest2", "honest3"]
    x_m, v_mps = platoon(seed, len(ids), 25.0)
    feign_brakes(x_m, v_mps, 2, 4.0)
    assert play(seed, row(ids, x_m, v_mps)).named == {"ghost"}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("off_m", [3.0, -8.0])
def test_a_range_that_only_a_ghost_declares_names_the_ghost(seed: int, off_m: float) -> None:
    ids = ["honest", "ghost"]
    x_m, v_mps = platoon(seed, 2, 25.0)
    gap_m = x_m[:, 0] - LENGTH_M - x_m[:, 1] + off_m * (np.arange(len(x_m)) > 10 * FALSE_AT_S)
    scene = play(
        seed,
        row(ids, x_m, v_mps),
        range_m=lambda k, _ids: [np.nan, gap_m[k]],
        leader_ids=lambda _k, _ids: [None, "honest"],
    )
    assert scene.named == {"ghost"}


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("since_s", "aside_m", "named"), [(30.0, 0.3, {"ghost"}), (30.0, 3.2, set()), (0.0, 0.3, set())]
)
def test_a_ghost_that_comes_into_the_place_of_a_car_is_named(
    seed: int, since_s: float, aside_m: float, named: set[str]
) -> None:
    """One in the next lane, and one of which nobody knows whether it was there before, are not."""
    ids = ["honest0", "honest1", "ghost"]
    x_m, v_mps = platoon(seed, 2, 25.0)
    x_m, v_mps = x_m[:, [0, 1, 1]], v_mps[:, [0, 1, 1]]
    rounds = (records if k >= 10 * since_s else records[:2] for k, records in enumerate(row(ids, x_m, v_mps)))
    scene = play(seed, rounds, accuracy_m=0.3, aside_m=aside_m)
    assert scene.named == named
    assert set().union(*scene.observations.values()) == ({"overlap"} if named else set())


def one_id(
    seed: int, ahead_m: float, since_s: float, dated_s: float, sent_s: float, every: int = 1
) -> Iterator[list[Record]]:
    """Yield the records of a car and, `sent_s` later, those of a second sender under its id, dated `dated_s` later."""
    x_m, v_mps = platoon(seed, 2, 25.0)
    for k in range(len(x_m)):
        t = 0.1 * k
        records = [("honest", "car", x_m[k, 0], v_mps[k, 0], t, t + 0.02)]
        records.append(("other", "other", x_m[k, 1], v_mps[k, 1], t + 0.001, t + 0.021))
        if t >= since_s and k % every == 0:
            place_m = x_m[k, 0] + v_mps[k, 0] * dated_s + ahead_m
            records.append(("second", "car", place_m, v_mps[k, 0], t + dated_s, t + 0.02 + sent_s))
        yield records


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("since_s", [0.0, 20.0])
@pytest.mark.parametrize("ahead_m", [8.0, -8.0, 30.0])
@pytest.mark.parametrize("sent_s", [0.02, 0.05])
def test_two_senders_under_one_id_are_one_standing_event(
    seed: int, since_s: float, ahead_m: float, sent_s: float
) -> None:
    scene = play(seed, one_id(seed, ahead_m, since_s, sent_s, sent_s))
    [event] = scene.suspects
    first_s, last_s = scene.spans_s[event]
    assert first_s < since_s + 1.0
    assert last_s > SECONDS - 1.0
    assert scene.suspects[event] == {"car"}
    assert "identity" in scene.observations[event]


@pytest.mark.parametrize("sent_s", [0.05, 0.09])
def test_a_second_sender_whose_messages_are_dated_ahead_is_named_so(sent_s: float) -> None:
    """It sends as often as the car and takes its place. Then the car's own messages contradict it."""
    scene = play(1, one_id(1, 8.0, 20.0, 0.24, sent_s))
    assert scene.named == {"car"}
    assert "contradiction" in set().union(*scene.observations.values())


@pytest.mark.parametrize("ahead_m", [0.0, 8.0])
@pytest.mark.parametrize("sent_s", [0.01, 0.05, 0.09])
def test_an_accomplice_cannot_refuse_the_messages_of_a_car(ahead_m: float, sent_s: float) -> None:
    """Once a second it sends the car's id, dated 0.95 s ahead."""
    scene = play(1, one_id(1, ahead_m, 20.0, 0.95, sent_s, every=10))
    assert set(scene.outcomes["second"]) == {"from_the_future"}
    assert set(scene.outcomes["honest"][300:]) == {"scored"}
    assert scene.named == ({"car"} if ahead_m else set())


@pytest.mark.parametrize("every", [1, 10])
def test_an_accomplice_hides_no_fault(every: int) -> None:
    """The car's position is 40 m off for five seconds, four times. The accomplice sends its id, dated ahead."""
    starts_s = (30.0, 55.0, 80.0, 105.0)
    rounds = one_id(2, 0.0, 20.0, 0.95, 0.03, every)
    faulty = (
        [
            (who, name, x + 40.0 * (who == "honest" and any(0.0 <= t - start < 5.0 for start in starts_s)), v, t, at)
            for who, name, x, v, t, at in records
        ]
        for records in rounds
    )
    scene = play(2, faulty)
    found_s = [first_s for first_s, _ in scene.spans_s.values()]
    assert scene.named == {"car"}
    for start_s in starts_s:
        assert any(0.0 <= at_s - start_s < 0.3 for at_s in found_s)
