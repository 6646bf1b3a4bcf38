import math

import pytest
from pydantic import ValidationError

from headway_schemas import Bsm, Leader
from headway_schemas.bsm import FIELDS, NEEDED, from_map, from_record, to_map, to_record

LEAST = {"v": 1, "id": "a", "msg_cnt": 0, "t_us": 0, "lat": 42.3, "lon": -83.7, "speed_mps": 13.5}
FULL = LEAST | {
    "heading_deg": 90.0,
    "elev_m": 260.0,
    "accel_mps2": -0.5,
    "accuracy_m": 1.5,
    "length_m": 4.6,
    "width_m": 1.9,
    "leader": {"id": "b", "range_m": 22.0, "range_rate_mps": -0.3},
}


def test_the_compact_record_has_the_declared_order() -> None:
    assert FIELDS == (
        "v", "id", "msg_cnt", "t_us", "lat", "lon", "speed_mps",
        "heading_deg", "elev_m", "accel_mps2", "accuracy_m", "length_m", "width_m", "leader",
    )  # fmt: skip
    assert FIELDS[:7] == NEEDED


@pytest.mark.parametrize("fields", [LEAST, FULL, FULL | {"leader": {"id": "b"}}, LEAST | {"width_m": 1.9}])
def test_map_and_compact_record_say_the_same(fields: dict[str, object]) -> None:
    bsm = Bsm.model_validate(fields)

    assert to_map(bsm) == fields
    assert from_map(to_map(bsm)) == from_record(to_record(bsm)) == bsm


def test_trailing_nulls_are_cut() -> None:
    assert to_record(Bsm.model_validate(LEAST)) == list(LEAST.values())
    declared = Bsm.model_validate(LEAST | {"leader": {"id": "b"}})
    assert to_record(declared)[-7:] == [None] * 6 + [["b"]]


@pytest.mark.parametrize(
    ("field", "inside", "outside"),
    [
        ("msg_cnt", (0, 127), (-1, 128)),
        ("t_us", (0, 2**53 - 1), (-1, 2**53)),
        ("lat", (-90.0, 90.0), (-90.0000001, 90.0000001)),
        ("lon", (-180.0, 180.0), (-180.0000001, 180.0000001)),
        ("speed_mps", (0.0, 8190 * 0.02), (-0.02, 8191 * 0.02)),
        ("heading_deg", (0.0, 28799 * 0.0125), (-0.0125, 28800 * 0.0125)),
        ("elev_m", (-409.5, 6143.9), (-409.6, 6144.0)),
        ("accel_mps2", (-20.0, 20.0), (-20.01, 20.01)),
        ("accuracy_m", (0.0, 12.7), (-0.05, 12.75)),
        ("length_m", (0.01, 40.95), (0.0, 40.96)),
        ("width_m", (0.01, 10.23), (0.0, 10.24)),
    ],
)
def test_ranges_are_those_of_j2735_and_a_converted_sentinel_lies_outside(
    field: str, inside: tuple[float, float], outside: tuple[float, float]
) -> None:
    for value in inside:
        Bsm.model_validate(LEAST | {field: value})
    for value in outside:
        with pytest.raises(ValidationError):
            Bsm.model_validate(LEAST | {field: value})


@pytest.mark.parametrize(
    "change",
    [
        {"v": 2},
        {"v": True},
        {"v": 1.0},
        {"v": None},
        {"msg_cnt": True},
        {"t_us": 1.5},
        {"lat": "42.3"},
        {"lat": None},
        {"lat": math.nan},
        {"elev_m": math.inf},
        {"id": "a/b"},
        {"id": "a*"},
        {"id": "@a"},
        {"id": "a\n"},
        {"id": ""},
        {"id": "a" * 65},
        {"leader": {}},
        {"leader": {"id": "a"}},
        {"leader": {"id": "b", "range_m": -1.0}},
        {"colour": "red"},
    ],
)
def test_nothing_is_converted_or_ignored(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Bsm.model_validate(LEAST | change)


def test_a_record_with_too_many_fields_is_refused() -> None:
    with pytest.raises(ValueError, match="15 fields where 14 are the most"):
        from_record([*FULL.values(), None])


@pytest.mark.parametrize("leader", [{"id": "b"}, "b", 7, ["b", 1.0, 1.0, None]])
def test_the_leader_of_a_record_is_an_array_of_three_at_most(leader: object) -> None:
    with pytest.raises(ValueError, match=r"array is meant|3 are the most"):
        from_record([*list(FULL.values())[:-1], leader])


def test_messages_are_values() -> None:
    bsm = Bsm.model_validate(FULL)
    assert bsm.leader == Leader(id="b", range_m=22.0, range_rate_mps=-0.3)
    with pytest.raises(ValidationError, match="frozen"):
        bsm.speed_mps = 0.0  # type: ignore[misc]  # what mypy refuses as well is what is tried
