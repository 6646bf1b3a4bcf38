import polars as pl
import pytest

from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.tables import batches, runs, stream


def frame(*values):
    return pl.DataFrame({"key": [value[0] for value in values], "n": [int(value[1:]) for value in values]})


def read(frames):
    return ["".join(f"{key}{n}" for key, n in each.rows()) for each in frames]


def test_runs_reach_across_chunks():
    chunks = [frame("a1", "a2", "b3"), frame("b4"), frame("b5", "a6")]
    assert read(runs(chunks, ["key"])) == ["a1a2", "b3b4b5", "a6"]


def test_no_chunks_no_runs():
    assert list(runs([], ["key"])) == []


def test_batches_hold_at_least_so_many_rows_save_the_last():
    frames = [frame("a1", "a2"), frame("b1"), frame("c1"), frame("d1")]
    assert [read(batch) for batch in batches(frames, 3)] == [["a1a2", "b1"], ["c1", "d1"]]


WANTED = {"a": pl.Int64, "b": pl.Float64}


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode(encoding))
    return path


def rows(path, *where, **options):
    return [row for block in stream(path, WANTED, *where, **options) for row in block.rows()]


def test_a_stream_is_the_table_whatever_the_block(tmp_path, monkeypatch):
    path = written(tmp_path, "x,a,b\n" + "".join(f"w,{i},{i / 4}\n" for i in range(1000)))
    whole = rows(path)
    assert whole == [(i, i / 4) for i in range(1000)]
    for size in (1, 7, 64):
        monkeypatch.setattr("headway_loadtest.sources.tables.BLOCK_BYTES", size)
        assert rows(path) == whole


def test_a_stream_is_read_as_it_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr("headway_loadtest.sources.tables.BLOCK_BYTES", 8)
    blocks = stream(written(tmp_path, "a,b\n1,1\n2,2\n3,3\n4,bad\n"), WANTED)
    assert next(blocks).rows() == [(1, 1.0), (2, 2.0), (3, 3.0)]
    with pytest.raises(SourceError):
        next(blocks)


def test_incomplete_and_unwanted_rows_are_left_out(tmp_path):
    path = written(tmp_path, "a,b\n1,NULL\n2,\n3,0.5\n4,1.5\n")
    assert rows(path, pl.col("b") > 1) == [(4, 1.5)]


def test_headers_marks_and_line_ends_of_all_sorts(tmp_path):
    assert rows(written(tmp_path, "a,b\r\n1,2\r\n", "utf-8-sig")) == [(1, 2.0)]
    assert rows(written(tmp_path, "1,2\n3,4"), header=["a", "b"]) == [(1, 2.0), (3, 4.0)]
    assert rows(written(tmp_path, "a,b\n")) == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a,c\n1,2\n", "row 1: no column b"),
        ("a,b\n1,fast\n", "fast"),
        ("a,b\n1,2,3\n", r"table\.csv: "),
        ("", "no column a, b"),
    ],
)
def test_bad_tables_are_one_line(tmp_path, text, problem):
    with pytest.raises(SourceError, match=problem) as caught:
        rows(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_an_absent_table_is_named(tmp_path):
    with pytest.raises(SourceError, match=r"nowhere\.csv: No such file"):
        rows(tmp_path / "nowhere.csv")
