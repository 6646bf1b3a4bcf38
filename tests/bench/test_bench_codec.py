"""Cost of reading messages: 500 records in one turn."""

import msgpack
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from headway.edge.codec.decoder import Codec
from headway.edge.transport.message import ReceivedMessage
from headway_schemas import Keys
from headway_schemas.bsm import FIELDS
from headway_schemas.encodings import BSM_MSGPACK

pytestmark = pytest.mark.bench
KEYS = Keys("v2x", "s")
RNG = np.random.default_rng(1)
RECORDS = [
    [1, f"veh-{i}", i % 128, 1_700_000_000_000_000 + i, *RNG.uniform(0.0, 40.0, 4).tolist(), None, 0.5, None, 4.5, 1.9,
     [f"veh-{i + 1}", 25.0, -0.5]]
    for i in range(500)
]  # fmt: skip


def received(sender: str, content: object) -> ReceivedMessage:
    return ReceivedMessage(
        KEYS.bsm(sender), msgpack.packb(content), BSM_MSGPACK, is_put=True, received_us=0, received_ns=0
    )


@pytest.mark.parametrize("form", ["compact", "map", "bundles of 25"])
def test_decode_500_records(benchmark: BenchmarkFixture, form: str) -> None:
    if form == "compact":
        received_messages = [received(str(record[1]), record) for record in RECORDS]
    elif form == "map":
        received_messages = [
            received(str(record[1]), dict(zip(FIELDS, record[:-1], strict=False))) for record in RECORDS
        ]
    else:
        received_messages = [received("gw-1", RECORDS[i : i + 25]) for i in range(0, len(RECORDS), 25)]
    benchmark.extra_info["readings"] = len(RECORDS)
    decoded = benchmark(Codec(KEYS).decode, received_messages)
    assert len(decoded.batch) == len(RECORDS)
