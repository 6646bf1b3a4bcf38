"""Readers of recordings under fuzz: whatever bytes a file has, each row is a record or refused, and nothing raises."""

import bz2
import gzip
import io
import json
import lzma
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import zstandard
from gateways.recordings.made_files import MADE

from headway.core.types.outcome import Outcome
from headway.gateways.recordings.bsm_lines import read_lines
from headway.gateways.recordings.columns import read_csv
from headway.gateways.recordings.formats import BSM, FORMATS, Located, Rows, format_of, open_recordings
from headway.gateways.recordings.reader import RecordingError, Row, Source, named_errors
from headway.gateways.recordings.tables.published import read_mapped

_OUTCOMES = {outcome.label: outcome for outcome in Outcome}
_ROWS = 6
_MAPPING = "id=id,t=t_s,lat=lat,lon=lon,speed=speed_mps[mph]"
_FILES = {
    "ode": ("ode.json",), "thea": ("thea.csv",), "pcap": ("rsu.pcap", "rsu.pcapng", "cam.pcap"),
    "cam": ("vanetza.json", "its-client.json"), "bsmp1": ("bsmp1.csv",),
    "veremi": ("veremi.json", "nextgen.json"), "fcd": ("fcd-geo.xml", "fcd-local.xml"), "ngsim": ("ngsim.csv",),
    "highd": ("highd.csv",), "openacc": ("openacc.csv",), "wydot": ("wydot.csv",), "gnss": ("gnss.csv",),
}  # fmt: skip
_BSM: dict[str, Rows] = {
    "bsm lines": lambda source: chain.from_iterable(read_lines(source)),
    "bsm csv": lambda source: chain.from_iterable(read_csv(source)),
}
_BSM_CSV = (
    b"id,msg_cnt,t_us,lat,lon,speed_mps\na,1,1700000000000000,42.3,-83.7,13.5\nb,2,1700000000100000,42.3,-83.7,\n"
)
_SEEDS = {
    "datawsu": b"Device,Trip,GpsValidWsu,GpsTimeWsu,LatitudeWsu,LongitudeWsu,SpeedWsu\n1,5,1,5000,42,-83,52\n",
    "bsm csv": _BSM_CSV,
    "bsm lines": b'{"v":1,"id":"a","msg_cnt":1,"t_us":1700000000000000,"lat":42.3,"lon":-83.7,"speed_mps":13.5}\n' * 3,
}
_NESTED = {
    "id": "a", "msg_cnt": 1, "t_us": 1700000000000000, "lat": 42.3, "lon": -83.7, "speed_mps": 13.5,
    "leader": {"id": "b", "range_m": 20.0, "range_rate_mps": 0.5},
}  # fmt: skip
_PARQUET_FORMS: tuple[dict[str, Any], ...] = (
    {"compression": "zstd"},
    {"data_page_version": "2.0", "compression": "gzip"},
    {"use_dictionary": False, "compression": "none", "write_statistics": False, "store_schema": False},
)
_WHOLE = ("compressed", "parquet")
"""Files that are opened by their name, so that decompression and the process that reads Parquet are under fuzz too."""
FUZZED = (*_FILES, "columns", *_SEEDS, *_WHOLE)
_COMPRESSIONS: tuple[Callable[[bytes], bytes], ...] = (gzip.compress, bz2.compress, lzma.compress, zstandard.compress)


@cache
def seeds(word: str) -> list[bytes]:
    """Return the beginnings of valid files of a format."""
    if word in _SEEDS:
        return [_SEEDS[word]]
    if word == "compressed":
        return [*(compress(_SEEDS["bsm lines"]) for compress in _COMPRESSIONS), _zipped(_SEEDS["bsm lines"])]
    if word == "parquet":
        tables = [pl.read_csv(_SEEDS[table]).to_arrow() for table in ("bsm csv", "datawsu")]
        tables.append(pa.Table.from_pylist([_NESTED]))
        return [_parquet(pa.concat_tables([table] * 20), **form) for table in tables for form in _PARQUET_FORMS]
    with TemporaryDirectory() as folder:
        return [_beginning(Path(folder) / name) for name in _FILES.get(word, ("gnss.csv",))]


def _beginning(path: Path) -> bytes:
    MADE[path.name].write(path)
    content = path.read_bytes()
    if path.suffix == ".xml":
        return b"</timestep>".join(content.split(b"</timestep>")[: _ROWS // 2]) + b"</timestep></fcd-export>"
    if content.startswith(b"["):
        return json.dumps(json.loads(content)[:_ROWS]).encode()
    if path.suffix.startswith(".pcap"):
        return content[: len(content) * _ROWS // 120]
    return b"".join(content.splitlines(keepends=True)[: _ROWS + 3])


def _zipped(content: bytes) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.jsonl", content)
    return archive.getvalue()


def _parquet(table: pa.Table, **form: Any) -> bytes:
    file = io.BytesIO()
    pq.write_table(table, file, **form)
    return file.getvalue()


def reader_of(word: str) -> Callable[[list[bytes]], Counter[Outcome]]:
    """Return what reads files of a format and counts the outcomes of their rows."""
    if word in _WHOLE:
        return lambda inputs: sum((_open(one) for one in inputs), Counter())
    read = read_mapped if word == "columns" else _BSM.get(word) or FORMATS[word].read
    return lambda inputs: sum((_read(read, one) for one in inputs), Counter())


def _read(read: Rows, content: bytes) -> Counter[Outcome]:
    assert format_of(content[:65_536]) in (None, BSM, *FORMATS)
    source = Source("fuzz", "", io.BufferedReader(io.BytesIO(content)), head=content[:65_536], columns=_MAPPING)

    def rows() -> Iterator[Row]:
        with named_errors("fuzz"):
            yield from read(source)

    return _outcomes(rows(), is_typed=read not in _BSM.values())


def _open(content: bytes) -> Counter[Outcome]:
    with NamedTemporaryFile(suffix=".jsonl") as file:
        file.write(content)
        file.flush()

        def rows() -> Iterator[Located]:
            with open_recordings([file.name]) as recordings:
                yield from chain.from_iterable(recordings.chunks)

        return _outcomes(rows(), is_typed=False)


def _outcomes(rows: Iterator[Row] | Iterator[Located], *, is_typed: bool) -> Counter[Outcome]:
    outcomes: Counter[Outcome] = Counter()
    try:
        for row in rows:
            if row.refusal is not None:
                outcomes[_OUTCOMES[row.refusal.reason]] += 1
            elif row.record:
                assert not is_typed or type(row.record["t_us"]) is int
                outcomes[Outcome.SCORED] += 1
    except RecordingError:
        outcomes[Outcome.MALFORMED] += 1
    return outcomes
