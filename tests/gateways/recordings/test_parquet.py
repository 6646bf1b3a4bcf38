"""A damaged Parquet file is one line of error, whatever its reader does; the values of a sound one are its own."""

import datetime as dt
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from headway.gateways.recordings import parquet
from headway.gateways.recordings.formats import open_recordings
from headway.gateways.recordings.parquet import Column, ParquetError, opened_table
from headway.gateways.recordings.reader import RecordingError

TABLE = {
    "id": [f"car{k % 3}" for k in range(300)],
    "msg_cnt": [k % 128 for k in range(300)],
    "t_us": [1_700_000_000_000_000 + 100_000 * k for k in range(300)],
    "lat": [42.3] * 300,
    "lon": [-83.7 + k * 1e-5 for k in range(300)],
    "speed_mps": [13.5] * 300,
}
FOOTER_LENGTH = slice(-8, -4)


@pytest.fixture
def a_process_of_its_own(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    process = parquet._Process()
    monkeypatch.setattr(parquet, "_PROCESS", process)
    yield process
    process.end()


def written(path: Path, columns: dict[str, Any] = TABLE, **form: Any) -> Path:
    pq.write_table(pa.table(columns), path, **{"compression": "none"} | form)
    return path


def values_of(path: Path) -> list[list[Any]]:
    with opened_table(path) as table:
        batches = [values for _, values in table.batches()]
    return [[value for part in parts for value in part] for parts in zip(*batches, strict=True)]


def message_of(path: Path) -> str:
    with pytest.raises(ParquetError) as raised:
        values_of(path)
    return str(raised.value)


def chunk(path: Path, name: str) -> Any:
    return pq.read_metadata(path).row_group(0).column(list(TABLE).index(name))


def with_bytes(path: Path, at: slice, content: bytes) -> None:
    data = bytearray(path.read_bytes())
    data[at] = content
    path.write_bytes(data)


def damage_header(path: Path) -> None:
    with_bytes(path, slice(0, None), b"PAR1" + bytes(64))


def damage_end(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def damage_footer_length(path: Path) -> None:
    with_bytes(path, FOOTER_LENGTH, (0x7FFFFFFF).to_bytes(4, "little"))


def damage_schema(path: Path) -> None:
    data = path.read_bytes()
    start = len(data) - 8 - int.from_bytes(data[FOOTER_LENGTH], "little")
    with_bytes(path, slice(start, start + 24), b"\xff" * 24)


def damage_page(path: Path) -> None:
    at = chunk(path, "lon").data_page_offset
    with_bytes(path, slice(at, at + 24), b"\xff" * 24)


def damage_page_content(path: Path) -> None:
    written(path, compression="zstd", use_dictionary=False)
    column = chunk(path, "lon")
    end = column.data_page_offset + column.total_compressed_size
    with_bytes(path, slice(end - 60, end), b"\xff" * 60)


def damage_dictionary(path: Path) -> None:
    column = chunk(path, "id")
    with_bytes(path, slice(column.dictionary_page_offset, column.data_page_offset), b"\xff" * 8)


def damage_indices(path: Path) -> None:
    end = chunk(path, "id").data_page_offset + chunk(path, "id").total_compressed_size
    dictionary = chunk(path, "id").data_page_offset - chunk(path, "id").dictionary_page_offset
    with_bytes(path, slice(end - dictionary - 40, end - dictionary), b"\xff" * 40)


def damage_text(path: Path) -> None:
    with_bytes(path, slice(0, None), path.read_bytes().replace(b"car1", b"c\xffr1"))


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (damage_header, "magic bytes not found"),
        (damage_end, "magic bytes not found"),
        (damage_footer_length, "footer"),
        (damage_schema, "thrift"),
        (damage_page, "thrift"),
        (damage_page_content, "ZSTD decompression failed"),
        (damage_dictionary, "thrift"),
        (damage_indices, ""),
        (damage_text, "column id: 'utf-8' codec"),
    ],
)
def test_a_damaged_file_is_a_line_of_error_and_the_next_one_is_read(
    tmp_path: Path, damage: Callable[[Path], None], words: str
) -> None:
    path, sound = written(tmp_path / "damaged.parquet"), written(tmp_path / "sound.parquet")
    damage(path)
    message = message_of(path)
    assert message.startswith("not readable as Parquet: ")
    assert words in message
    assert "\n" not in message
    assert values_of(sound) == list(TABLE.values())


def few_bytes_for_much_text(path: Path) -> None:
    places, texts = pa.array(np.zeros(20_000, np.int32)), pa.array(["x" * 2_000_000])
    column = pa.DictionaryArray.from_arrays(places, texts)
    written(path, {"id": column}, compression="zstd", store_schema=False, dictionary_pagesize_limit=1 << 30)


def few_bytes_for_one_long_text(path: Path) -> None:
    form = {"compression": "zstd", "use_dictionary": False, "write_statistics": False}
    written(path, {"id": pa.array([bytes(200_000_000)])}, **form)


def few_bytes_for_long_lists(path: Path) -> None:
    ends, numbers = pa.array([0, 50_000_000], pa.int32()), pa.array(np.zeros(50_000_000, np.int8))
    written(path, {"id": pa.ListArray.from_arrays(ends, numbers)}, compression="zstd")


@pytest.mark.parametrize("write", [few_bytes_for_much_text, few_bytes_for_one_long_text, few_bytes_for_long_lists])
def test_a_small_file_of_much_content_ends_within_the_memory_of_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, a_process_of_its_own: Any, write: Callable[[Path], None]
) -> None:
    monkeypatch.setattr(parquet, "_LIMIT_BYTES", 400 << 20)
    write(tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").stat().st_size < 1_000_000
    assert message_of(tmp_path / "a.parquet") == "not readable as Parquet: takes too much memory"
    assert values_of(written(tmp_path / "sound.parquet")) == list(TABLE.values())


def test_a_row_group_is_never_in_memory_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, a_process_of_its_own: Any
) -> None:
    monkeypatch.setattr(parquet, "_LIMIT_BYTES", 400 << 20)
    names = [f"c{k}" for k in range(8)]
    number = pa.array(np.arange(1_000_000.0))
    path = written(tmp_path / "a.parquet", dict.fromkeys(names, pa.chunked_array([number] * 8)), use_dictionary=False,
                   row_group_size=8_000_000)  # fmt: skip
    assert pq.read_metadata(path).num_row_groups == 1
    assert path.stat().st_size > parquet._LIMIT_BYTES
    with opened_table(path) as table:
        first, values = next(table.batches())
        assert (first, len(values), values[7]) == (0, 8, [float(k) for k in range(20_000)])
        assert table.share() == pytest.approx(20_000 / 8_000_000)


def test_a_reader_that_hangs_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, a_process_of_its_own: Any
) -> None:
    monkeypatch.setattr(parquet, "_LIMIT_S", 1)
    os.mkfifo(tmp_path / "a.parquet")  # to open it waits for a writer
    assert message_of(tmp_path / "a.parquet") == "damaged: no more rows within 1 s"
    assert values_of(written(tmp_path / "sound.parquet")) == list(TABLE.values())


@pytest.mark.parametrize("fatal", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_reader_that_ends_ends_its_files_only(
    tmp_path: Path, a_process_of_its_own: Any, fatal: signal.Signals
) -> None:
    path = written(tmp_path / "a.parquet")
    with opened_table(path) as table:
        os.kill(a_process_of_its_own._process.pid, fatal)
        with pytest.raises(ParquetError, match=rf"^damaged: the process that read it ended \({fatal.name}\)$"):
            list(table.batches())
        assert values_of(path) == list(TABLE.values())
        with pytest.raises(ParquetError, match="another file"):
            list(table.batches())


def test_no_process_is_left(tmp_path: Path, a_process_of_its_own: Any) -> None:
    values_of(written(tmp_path / "a.parquet"))
    process = a_process_of_its_own._process
    a_process_of_its_own.end()
    assert process.returncode is not None
    a_process_of_its_own.end()


def test_rows_that_are_missing_are_told(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet", row_group_size=100)
    stated, fewer = b"\x16\xd8\x04", b"\x16\xda\x04"  # 300 and 301 rows: field of the footer, zigzag
    assert path.read_bytes().count(stated) == 1
    with_bytes(path, slice(0, None), path.read_bytes().replace(stated, fewer))
    assert message_of(path) == "not readable as Parquet: 300 rows of 301"


def test_columns_and_values_are_those_of_the_file(tmp_path: Path) -> None:
    noon = dt.datetime(2024, 8, 12, 12, tzinfo=dt.UTC)
    bare = noon.replace(tzinfo=None)
    ns = int(noon.timestamp()) * 10**9 + 1
    columns = {
        "id": pa.array(["a", None]).dictionary_encode(),
        "leader": pa.array([{"id": "b", "range_m": 20.0}, None]),
        "bare": pa.array([ns, None], pa.timestamp("ns")),
        "zoned": pa.array([ns, None], pa.timestamp("ns", "America/Denver")),
        "after": pa.array([1_500_000_001, None], pa.duration("ns")),
        "valid": [True, False],
    }
    path = written(tmp_path / "a.parquet", columns)
    assert values_of(path) == [
        ["a", None], [{"id": "b", "range_m": 20.0}, None], [bare, None], [noon, None], [1_500_000_001, None],
        [True, False],
    ]  # fmt: skip
    with opened_table(path) as table:
        assert table.columns[0].is_text
        assert table.columns[-1] == Column("valid", "bool", is_text=False)
        assert table.share() == 0.0


def test_a_time_that_no_calendar_has_is_named_with_its_column(tmp_path: Path) -> None:
    path = written(tmp_path / "a.parquet", {"when": pa.array([2**62], pa.timestamp("us"))})
    assert message_of(path).startswith("not readable as Parquet: column when: ")


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({}, "no columns"),
        ({"id\x1b[2j": ["a"]}, "unknown column id\N{REPLACEMENT CHARACTER}[2j: "),
        ({**TABLE, "id": list(range(300))}, "column id is int64"),
        ({**TABLE, "lat": ["north"] * 300}, "column lat is string"),
        ({name: values[:0] for name, values in TABLE.items()}, "column id is null"),
    ],
)
def test_a_table_that_is_no_recording_is_named(tmp_path: Path, columns: dict[str, Any], words: str) -> None:
    path = written(tmp_path / "a.parquet", columns)
    with pytest.raises(RecordingError, match=r"a\.parquet: ") as raised, open_recordings([str(path)]) as recordings:
        list(recordings.chunks)
    assert words in str(raised.value)


def test_the_content_tells_parquet_whatever_the_name_says(tmp_path: Path) -> None:
    for name in ("a.jsonl", "a.csv", "a.txt", "a"):
        with open_recordings([str(written(tmp_path / name))]) as recordings:
            assert sum(map(len, recordings.chunks)) == 300


def test_pyarrow_is_named_where_it_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "find_spec", lambda _: None)
    assert "pip install 'headway[recordings]'" in message_of(tmp_path / "a.parquet")
