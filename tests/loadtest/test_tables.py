import polars as pl

from headway_loadtest.sources.tables import batches, runs


def frame(*values):
    return pl.DataFrame({"key": [value[0] for value in values], "n": [int(value[1:]) for value in values]})


def told(frames):
    return ["".join(f"{key}{n}" for key, n in each.rows()) for each in frames]


def test_runs_reach_across_chunks():
    chunks = [frame("a1", "a2", "b3"), frame("b4"), frame("b5", "a6")]
    assert told(runs(chunks, ["key"])) == ["a1a2", "b3b4b5", "a6"]


def test_no_chunks_no_runs():
    assert list(runs([], ["key"])) == []


def test_batches_hold_at_least_so_many_rows_save_the_last():
    frames = [frame("a1", "a2"), frame("b1"), frame("c1"), frame("d1")]
    assert [told(batch) for batch in batches(frames, 3)] == [["a1a2", "b1"], ["c1", "d1"]]
