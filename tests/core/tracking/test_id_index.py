"""The index of identifiers against Python's own dict."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.tracking.id_index import find, insert, new_id_index, remove
from headway.core.types.identifiers import id_column, id_words

CAPACITY = 8
IDS = st.one_of(st.sampled_from([f"car{n}" for n in range(12)]), st.text("ab-", min_size=1, max_size=64))


def rows_of(index: object, ids: list[str | None]) -> list[int]:
    rows = np.empty(len(ids), np.int64)
    find(index, id_words(id_column(ids)), rows)
    return rows.tolist()


@settings(max_examples=200)
@given(st.lists(st.tuples(st.integers(0, CAPACITY - 1), IDS), max_size=60))
def test_rows_are_found_by_name_whatever_comes_and_goes(changes: list[tuple[int, str]]) -> None:
    index, oracle = new_id_index(CAPACITY), dict[int, str]()
    for row, name in changes:
        if row in oracle:
            remove(index, row)
            del oracle[row]
        if name not in oracle.values():
            insert(index, row, id_words(id_column([name])), 0)
            oracle[row] = name
        known = {name: row for row, name in oracle.items()}
        asked = [*(name for _, name in changes), None]
        assert rows_of(index, asked) == [known.get(name, -1) for name in asked]


def test_identifiers_of_one_chain_or_prefix_are_distinguished() -> None:
    index = new_id_index(1_000)
    ids = [f"{'x' * (n % 61)}{n}" for n in range(1_000)]
    for row in range(1_000):
        insert(index, row, id_words(id_column(ids)), row)
    assert rows_of(index, ids) == list(range(1_000))
    assert rows_of(index, [name[:-1] + "y" for name in ids]) == [-1] * 1_000
