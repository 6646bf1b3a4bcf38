import pytest

from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.identifiers import id_column


def test_a_vehicle_keeps_its_row_and_a_stranger_has_none() -> None:
    table = VehicleTable(4)
    [row] = table.admit(["a"])
    assert table.rows(id_column(["a", "b", None, "a"])).tolist() == [row, -1, -1, row]
    assert table.id_of[row] == "a"


def test_vehicles_get_rows_in_the_order_of_their_arrival() -> None:
    one, other = VehicleTable(3), VehicleTable(3)
    one.admit(["b", "a", "c"])
    for vehicle in ("b", "a", "c"):
        other.admit([vehicle])
    assert one.id_of == other.id_of


def test_a_full_table_leaves_the_rest_without_a_row() -> None:
    table = VehicleTable(2)
    assert len(table.admit(["a", "b", "c"])) == 2
    assert table.rows(id_column(["c"])).tolist() == [-1]


def test_a_freed_row_is_used_again_under_another_serial() -> None:
    table = VehicleTable(1)
    [row] = table.admit(["a"])
    first = int(table.generation[row])
    table.evict(row)
    assert len(table) == 0
    assert table.admit(["b"]) == [row]
    assert table.generation[row] > first


def test_a_free_row_cannot_be_freed() -> None:
    with pytest.raises(ValueError, match="not in use"):
        VehicleTable(1).evict(0)
