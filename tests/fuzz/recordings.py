"""Readers of recordings under fuzz: whatever bytes a file has, each row is a record or refused, and nothing raises."""

import io
import json
from collections import Counter
from collections.abc import Callable
from functools import cache
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

from gateways.recordings.made_files import MADE

from headway.core.types.outcome import Outcome
from headway.gateways.recordings.bsm_lines import read_lines
from headway.gateways.recordings.columns import read_csv
from headway.gateways.recordings.formats import BSM, FORMATS, Rows, format_of
from headway.gateways.recordings.reader import RecordingError, Source, named_errors
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
FUZZED = (*_FILES, "columns", *_SEEDS)


@cache
def seeds(word: str) -> list[bytes]:
    """Return the beginnings of valid files of a format."""
    if word in _SEEDS:
        return [_SEEDS[word]]
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


def reader_of(word: str) -> Callable[[list[bytes]], Counter[Outcome]]:
    """Return what reads files of a format and counts the outcomes of their rows."""
    read = read_mapped if word == "columns" else _BSM.get(word) or FORMATS[word].read
    return lambda inputs: sum((_read(read, one) for one in inputs), Counter())


def _read(read: Rows, content: bytes) -> Counter[Outcome]:
    assert format_of(content[:65_536]) in (None, BSM, *FORMATS)
    source = Source("fuzz", "", io.BufferedReader(io.BytesIO(content)), head=content[:65_536], columns=_MAPPING)
    outcomes: Counter[Outcome] = Counter()
    try:
        with named_errors("fuzz"):
            for row in read(source):
                if row.refusal is not None:
                    outcomes[_OUTCOMES[row.refusal.reason]] += 1
                elif row.record:
                    assert read in _BSM.values() or type(row.record["t_us"]) is int
                    outcomes[Outcome.SCORED] += 1
    except RecordingError:
        outcomes[Outcome.MALFORMED] += 1
    return outcomes
