import json
import tracemalloc

import msgpack
import pytest
from edge.codec.messages import RECEIVED_US, as_map, received, record

from headway.core.types.outcome import Outcome
from headway.edge.codec.payload import Reader, RejectedPayload
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, J2735_ODE, J2735_RAW

READER = Reader(bundle_max=20)
FIELDS = as_map(record())


def refusal(payload: bytes, encoding: str) -> RejectedPayload:
    result = READER.read(payload, encoding, RECEIVED_US)
    assert isinstance(result, RejectedPayload), result
    return result


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\xc0",
        b"\x07",
        b"\x90",
        msgpack.packb("text"),
        msgpack.packb(record())[:-1],
        msgpack.packb(record()) + b"\xc0",
        msgpack.packb({1: 2}),
        b"\x81\x90\x01",
        b"\x81\x81\xa1v\x01\x01",
        b"\x82" + 2 * (msgpack.packb("v") + b"\x01"),
        b"\xa4\xff\xff\xff\xff",
        b"\xd9\xff\x00",
        b"\xdb\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xdc\x00\x13" * 20_000,
        b"\x91" * 60_000,
        b"\xd6\xff\x00\x00\x00\x00",
        b"\xd4\xff\x00",
    ],
    ids=lambda payload: payload[:8].hex() or "empty",
)
def test_hostile_msgpack_is_malformed(payload: bytes) -> None:
    assert refusal(payload, BSM_MSGPACK).reason.outcome is Outcome.MALFORMED


def test_headers_that_announce_much_get_no_memory() -> None:
    payload = b"\xdc\xea\x60" * 20_000  # each an array of 60,000 that begins with the next
    tracemalloc.start()
    try:
        assert refusal(payload, BSM_MSGPACK).reason.outcome is not None
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("encoding", [BSM_JSON, J2735_RAW, J2735_ODE])
@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"[]",
        b"\xff\xfe{\x00}\x00",
        b"\xef\xbb\xbf{}",
        b'{"v": 1, "v": 2}',
        b'{"a": ' + b"9" * 5000 + b"}",
        b"[" * 60_000,
        b'{"a":' * 10_000,
        b'"\xed\xa0\x80"',
        b"[1] [2]",
    ],
    ids=lambda value: value[:8].decode("latin-1") if isinstance(value, bytes) else value,
)
def test_hostile_json_is_malformed(payload: bytes, encoding: str) -> None:
    assert refusal(payload, encoding).reason.outcome is Outcome.MALFORMED


def test_json_that_is_neither_message_nor_bundle() -> None:
    for payload in (b"null", b"7", b'"text"'):
        assert refusal(payload, BSM_JSON).reason.outcome is Outcome.MALFORMED


def test_an_array_of_what_are_no_records_is_one_record() -> None:
    assert READER.read(b'["x", []]', BSM_JSON, RECEIVED_US) == [["x", []]]


@pytest.mark.parametrize("encoding", [BSM_MSGPACK, BSM_JSON])
@pytest.mark.parametrize("message", [record(), FIELDS], ids=["record", "map"])
def test_a_bundle_larger_than_the_limit_counts_each_of_its_records(message: object, encoding: str) -> None:
    fitting, large = received([message] * 20, encoding=encoding), received([message] * 21, encoding=encoding)
    assert READER.read(fitting.payload, encoding, RECEIVED_US) == [record()] * 20
    assert refusal(large.payload, encoding).size == 21
    assert refusal(large.payload, encoding).reason.outcome is Outcome.BUNDLE_TOO_LARGE


def test_a_large_bundle_of_j2735_messages_is_refused_too() -> None:
    assert refusal(json.dumps([{}] * 21).encode(), J2735_RAW).reason.outcome is Outcome.BUNDLE_TOO_LARGE


def test_a_bundle_of_more_than_its_payload_can_hold_is_malformed() -> None:
    assert refusal(b"\xdc\xff\xff" + msgpack.packb(record()), BSM_MSGPACK) == RejectedPayload(
        refusal(b"\xc1", BSM_MSGPACK).reason, 1
    )


def test_a_bundle_limit_below_the_width_of_a_record_still_reads_records() -> None:
    assert Reader(bundle_max=1).read(msgpack.packb([record()]), BSM_MSGPACK, RECEIVED_US) == [record()]
    assert isinstance(
        Reader(bundle_max=1).read(msgpack.packb([record()] * 2), BSM_MSGPACK, RECEIVED_US), RejectedPayload
    )
