"""What a view shows of an event does not depend on the order of its updates."""

from itertools import permutations

from fake_service import START_US, event

from headway.dashboard.event_summary import EventSummary, deviation
from headway_schemas import Event, Innovation, Kind, Phase, Sensor
from headway_schemas.event import Deviation, Observation

S = 1_000_000


def life() -> list[Event]:
    """Return an event whose kind, sensor and suspect change, and whose last innovation is small."""
    changes = [
        {"phase": Phase.ONSET, "kind": Kind.UNKNOWN, "deviation": Deviation(x_m=0.3, v_mps=0.1)},
        {
            "phase": Phase.UPDATE,
            "observations": (Observation.JERK,),
            "deviation": Deviation(x_m=0.8, v_mps=0.1),
            "statistic": 90.0,
            "p_value": 1e-9,
        },
        {"phase": Phase.CLEARED, "suspect": "veh-0002", "deviation": Deviation(x_m=0.8, v_mps=0.2), "confidence": None},
    ]
    return [
        event(1, kind=Kind.DRIFT, sensor=Sensor.LOCATION, t_us=START_US + n * S).model_copy(
            update={"onset_us": START_US, "innovation": Innovation(x_m=-0.5 / (n + 1), v_mps=0.0)} | change
        )
        for n, change in enumerate(changes)
    ]


def summary(updates: tuple[Event, ...]) -> dict[str, object]:
    made = EventSummary.of(updates[0])
    for update in updates[1:]:
        made.add(update)
    return made.row()


def test_the_newest_update_and_the_largest_of_all_whatever_their_order() -> None:
    rows = [summary(order) for order in permutations(life())]
    assert all(row == rows[0] for row in rows)
    shown = {name: rows[0][name] for name in ("phase", "kind", "suspect", "first_us", "deviation_m", "deviation_mps")}
    assert shown == {
        "phase": "cleared", "kind": "drift", "suspect": "veh-0002", "first_us": START_US,
        "deviation_m": 0.8, "deviation_mps": 0.2,
    }  # fmt: skip
    assert (rows[0]["statistic"], rows[0]["p_value"], rows[0]["updates"]) == (90.0, 1e-9, 3)
    assert rows[0]["observations"] == ["jerk"]
    assert (rows[0]["ahead"], rows[0]["fast"], rows[0]["confidence"]) == (False, None, 0.93)


def test_without_the_field_the_deviation_is_that_of_the_reading() -> None:
    x_m, v_mps = deviation(event(1, sensor=Sensor.BOTH).model_copy(update={"deviation": None}))
    assert x_m is not None
    assert v_mps is not None
    assert (round(x_m, 9), round(v_mps, 9)) == (9.0, 4.0)
    assert deviation(event(1, kind=Kind.MISS, sensor=Sensor.LINK)) == (None, None)
    assert deviation(event(1, kind=Kind.RESPONSE, sensor=Sensor.LINK)) == (None, None)
