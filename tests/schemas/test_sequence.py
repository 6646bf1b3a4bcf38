import pytest
from fake_service import START_US, event

from headway_schemas import Event
from headway_schemas.sequence import SequenceGaps


def numbered(sequence: int, after_s: float, instance: str = "i") -> Event:
    one = event(sequence, t_us=START_US + round(after_s * 1e6))
    return one.model_copy(update={"instance": instance, "sequence": sequence})


@pytest.mark.parametrize(
    ("sequences", "missing"),
    [
        ([5, 6, 7], [None, None, None]),
        ([5, 9, 10], [None, 5, None]),
        ([5, 7, 6, 8], [None, 5, None, None]),
        ([5, 5, 6], [None, None, None]),
    ],
)
def test_a_gap_is_told_once(sequences: list[int], missing: list[int | None]) -> None:
    gaps = SequenceGaps()
    assert [gaps.missing_after(numbered(n, 0.1 * i)) for i, n in enumerate(sequences)] == missing


def test_instances_count_for_themselves() -> None:
    gaps = SequenceGaps()
    assert [gaps.missing_after(numbered(n, 0.0, name)) for n, name in ((1, "a"), (5, "b"), (2, "a"))] == [None] * 3


def test_an_instance_without_its_journal_counts_again() -> None:
    gaps = SequenceGaps()
    counted = [(500, 0.0), (1, 9.0), (2, 9.1), (5, 9.2)]
    assert [gaps.missing_after(numbered(n, t)) for n, t in counted] == [None, None, None, 2]


def test_an_event_without_a_number_tells_nothing() -> None:
    assert SequenceGaps().missing_after(event(1)) is None
