"""The compiled reader of compact records, held against msgpack and the model: it reads what they read, or leaves it."""

import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from edge.codec.messages import KEYS, received, record
from hypothesis import given
from hypothesis import strategies as st

from headway.core.types.identifiers import ID_BYTES
from headway.edge.codec import msgpack_columns
from headway.edge.codec.decoder import Codec

FULL = record(elev_m=260.0, accel_mps2=-0.5, accuracy_m=1.5, length_m=4.6, width_m=1.9, leader=["b", 22.0, -0.3])


def read(*contents: Any) -> msgpack_columns.CompactRecords | None:
    payloads = [content if isinstance(content, bytes) else msgpack.packb(content) for content in contents]
    sizes = np.array([len(payload) for payload in payloads], np.int64)
    return msgpack_columns.read(b"".join(payloads), sizes, bytes(ID_BYTES * sizes.size), 20)


def with_field(place: int, packed: bytes) -> bytes:
    parts = [packed if i == place else msgpack.packb(value) for i, value in enumerate(FULL)]
    return bytes([0x90 | len(FULL)]) + b"".join(parts)


def test_messages_and_bundles_become_columns_in_their_order() -> None:
    made = read(FULL, [FULL, record()], record()[:7])
    assert made is not None
    assert made.sizes.tolist() == [1, 2, 1]
    numbers = dict(zip(msgpack_columns.NAMES, made.numbers, strict=True))
    assert numbers["lat"].tolist() == [42.3] * 4
    np.testing.assert_array_equal(numbers["range_m"], [22.0, 22.0, np.nan, np.nan])
    np.testing.assert_array_equal(numbers["width_m"], [1.9, 1.9, np.nan, np.nan])
    assert made.ids.tolist() == [b"a"] * 4
    assert made.leader_ids.tolist() == [b"b", b"b", b"", b""]


@pytest.mark.parametrize(
    ("packed", "value"),
    [
        (b"\x05", 5.0),
        (b"\xff", -1.0),
        (b"\xe0", -32.0),
        (b"\xcc\xc8", 200.0),
        (b"\xcd\x01\x00", 256.0),
        (b"\xce\x00\x00\x01\x00", 256.0),
        (b"\xcf" + (300).to_bytes(8, "big"), 300.0),
        (b"\xd0\x9c", -100.0),
        (b"\xd1\xff\x00", -256.0),
        (b"\xd2\xff\xff\xff\x00", -256.0),
        (b"\xd3" + (-300).to_bytes(8, "big", signed=True), -300.0),
        (b"\xca" + struct.pack(">f", -0.1), float(np.float32(-0.1))),
        (b"\xcb" + struct.pack(">d", 1e-3), 1e-3),
    ],
)
def test_every_form_of_a_number_is_read_as_msgpack_reads_it(packed: bytes, value: float) -> None:
    assert msgpack.unpackb(packed) == pytest.approx(value, abs=0.0)
    made = read(with_field(8, packed))
    assert made is not None
    assert made.numbers[msgpack_columns.NAMES.index("elev_m"), 0] == value


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x90",
        {"v": 1},
        [[]],
        [1],
        [*FULL, 1],
        [FULL] * 21,
        [FULL, 1],
        [FULL, {"v": 1}],
        msgpack.packb(FULL) + b"\xc0",
        with_field(0, b"\xcb" + struct.pack(">d", 1.0)),
        with_field(1, b"\xa0"),
        with_field(1, msgpack.packb("a" * 65)),
        with_field(2, b"\xc3"),
        with_field(3, b"\xc0"),
        with_field(4, msgpack.packb(91.0)),
        with_field(4, msgpack.packb(float("nan"))),
        with_field(5, msgpack.packb("1.0")),
        with_field(6, b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff"),
        with_field(13, b"\x90"),
        with_field(13, msgpack.packb(["b", 1.0, 1.0, 1.0])),
        with_field(13, msgpack.packb(["b", -1.0])),
        with_field(13, msgpack.packb("b")),
    ],
    ids=repr,
)
def test_all_else_is_left_to_others(content: Any) -> None:
    assert read(content) is None
    assert read(FULL, content) is None


def test_a_payload_cut_short_is_not_completed_by_the_next() -> None:
    whole = msgpack.packb(FULL)
    for cut in range(len(whole)):
        assert read(whole[:cut], whole[cut:]) is None


@given(st.lists(st.binary(max_size=40), max_size=4))
def test_whatever_bytes_come_nothing_breaks(payloads: list[bytes]) -> None:
    made = read(*payloads)
    assert made is None or made.sizes.sum() == len(made.ids)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([msgpack.packb(FULL), msgpack.packb([FULL, record()]), msgpack.packb(record()[:7])]),
            st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=4),
            st.integers(0, 400),
        ),
        min_size=1,
        max_size=3,
    )
)
def test_a_damaged_message_breaks_nothing(damaged: list[tuple[bytes, list[tuple[int, int]], int]]) -> None:
    payloads = []
    for whole, changes, size in damaged:
        payload = bytearray(whole)
        for place, byte in changes:
            payload[place % len(payload)] = byte
        payloads.append(bytes(payload[:size]))
    made = read(*payloads)
    assert made is None or made.sizes.sum() == len(made.ids)


def test_no_array_is_indexed_beyond_its_bounds(tmp_path: Path) -> None:
    """The kernel is compiled without bounds checks; here the tests above and the fuzz tests run with them."""
    if "NUMBA_BOUNDSCHECK" in os.environ:
        return
    tests = [__file__, Path(__file__).parents[2] / "property" / "test_codec_fuzz.py"]
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    checked = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", *map(str, tests)],
        env=environment, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stdout


def test_a_batch_with_an_odd_message_decodes_the_others_alike() -> None:
    codec, odd = Codec(KEYS), received(b"\xc1")
    usual = [received(record(f"car{n}"), f"car{n}") for n in range(5)]
    slow = codec.decode([*usual, odd])
    fast = codec.decode(usual)
    assert (len(slow.rejections), len(fast.rejections)) == (1, 0)
    np.testing.assert_array_equal(fast.batch.ids, slow.batch.ids)
    np.testing.assert_array_equal(fast.batch.t_us, slow.batch.t_us)
    np.testing.assert_array_equal(fast.batch.lat_deg, slow.batch.lat_deg)
