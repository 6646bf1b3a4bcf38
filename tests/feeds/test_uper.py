"""The kernels against an independent coder, and every wrapping of a frame."""

import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from feeds.asn1_modules import encode_bsm, encode_cam, frame_of
from feeds.made_messages import NOW_US, bsm_core, cam, part_ii, si_of_cam, si_of_core

from headway.feeds.uper import NAMES, UperRecords, bsm_record, read_bsms, read_cams

RANDOM = random.Random(7)
CORES = [bsm_core(RANDOM) for _ in range(10_000)]
GOOD = bsm_core(random.Random(2)) | {"secMark": 14_300, "lat": 423_000_001, "long": -837_000_002, "speed": 675}
FRAME = encode_bsm(GOOD, [{"id": 1, "content": b"\x00\x14" * 20}])


def references(count: int) -> np.ndarray:
    return np.full(count, NOW_US, np.int64)


def assert_equal(read: UperRecords, expected: list[dict[str, float] | str]) -> None:
    for i, values in enumerate(expected):
        if isinstance(values, str):
            assert read.refusals[i].reason == values
            continue
        assert i not in read.refusals, read.refusals[i]
        found = [read.numbers[name][i] for name in NAMES]
        np.testing.assert_allclose(found, [values[name] for name in NAMES], rtol=1e-12, atol=1e-9, equal_nan=True)


def test_ten_thousand_bsms_are_those_of_the_oracle() -> None:
    frames = [encode_bsm(core, part_ii(RANDOM)) for core in CORES]
    times_us = np.array([NOW_US + RANDOM.randrange(10**9) for _ in CORES])
    read = read_bsms(frames, times_us)
    assert_equal(read, [si_of_core(core, int(at_us)) for core, at_us in zip(CORES, times_us, strict=True)])
    assert read.ids.tolist() == [core["id"].hex().upper().encode() for core in CORES]
    assert 0.3 < len(read.refusals) / len(frames) < 0.9


def test_ten_thousand_cams_are_those_of_the_oracle() -> None:
    messages = [cam(RANDOM) for _ in range(10_000)]
    times_us = np.array([NOW_US + RANDOM.randrange(10**9) for _ in messages])
    read = read_cams([encode_cam(message) for message in messages], times_us)
    assert_equal(read, [si_of_cam(message, int(at_us)) for message, at_us in zip(messages, times_us, strict=True)])
    assert read.ids.tolist() == [str(message["header"]["stationID"]).encode() for message in messages]


def cover(octets: bytes) -> bytes:
    """Return the length of COER and the octets."""
    size = len(octets)
    return (bytes([size]) if size < 128 else b"\x81" + bytes([size])) + octets


def wsmp(octets: bytes) -> bytes:
    """Return a WAVE short message of the BSM's PSID."""
    size = len(octets)
    return b"\x03\x00\x20" + (bytes([size]) if size < 128 else (0x8000 | size).to_bytes(2, "big")) + octets


UNSECURED = b"\x03\x80" + cover(FRAME)
SIGNED = b"\x03\x81\x00\x40" + UNSECURED + b"\x40\x01\x20" + bytes(range(70))
WRAPPED: dict[str, bytes] = {
    "bare": FRAME,
    "short": encode_bsm(GOOD),
    "unsecured": UNSECURED,
    "signed": SIGNED,
    "wsmp": wsmp(FRAME),
    "wsmp, unsecured": wsmp(UNSECURED),
    "wsmp, signed": wsmp(SIGNED),
    "wsmp with elements": b"\x0b\x01\x04\x01\xac\x01\x20\x02\x10\x01\x0c\x04\x01\x00" + cover(FRAME),
    "wsmp, PSID of two octets": b"\x03\x00\x80\x0b" + cover(FRAME),
    "hex": FRAME.hex().encode(),
    "hex, upper": b" 0x" + FRAME.hex().upper().encode() + b"\r\n",
    "hex with blanks": FRAME.hex(" ").encode(),
    "hex, signed": SIGNED.hex().encode(),
    "immediate forward": b"Version=0.7\nType=BSM\nPSID=0x20\nPriority=7\nTxMode=CONT\nTxChannel=183\nTxInterval=0\n"
    b"DeliveryStart=\nDeliveryStop=\nSignature=True\nEncryption=False\nPayload=" + FRAME.hex().encode() + b"\n",
    "vendor header": bytes(range(1, 23)) + FRAME,
    "vendor header with zeros": b"\x00\x14\x00\x00\x01\x00\x14\x80" * 3 + FRAME,
    "vendor header and signed": b"\xff\xee\x00" * 7 + SIGNED,
    "trailer": FRAME + bytes(9),
}  # fmt: skip


@pytest.mark.parametrize("name", WRAPPED)
def test_the_frame_is_found_behind(name: str) -> None:
    assert_equal(read_bsms([WRAPPED[name]], references(1)), [si_of_core(GOOD, NOW_US)])


def test_frames_of_all_kinds_in_one_batch() -> None:
    frames = [*WRAPPED.values(), b"", *WRAPPED.values()]
    read = read_bsms(frames, references(len(frames)))
    assert list(read.refusals) == [len(WRAPPED)]
    assert len(set(read.ids.tolist()) - {b"00000000"}) == 1


LONG = FRAME[4:] if FRAME[2] & 0x80 else FRAME[3:]


@pytest.mark.parametrize(
    ("frame", "reason", "said"),
    [
        (b"", "malformed", "no message"),
        (b"\x00", "malformed", "no message"),
        (b"\x00\x14", "malformed", "no message"),
        (b"nothing of ours", "malformed", "no message"),
        (b"0014abc", "malformed", "no message"),
        (FRAME[:30], "malformed", "cut"),
        (b"\x00\x14\x10" + bytes(16), "malformed", "cut"),
        (b"\x00\x14\xc1" + bytes(70), "malformed", "fragmented"),
        (frame_of(bytes(60), 31), "other_message", "a TravelerInformation"),
        (frame_of(bytes(200), 19), "other_message", "a SPAT"),
        (b"\x03\x80" + cover(frame_of(bytes(20), 18)), "other_message", "a MapData"),
        (b"\xaa\xbb\xcc\xdd\xee" + frame_of(bytes(200), 32), "other_message", "a PersonalSafetyMessage"),
        (b"\x03\x82" + bytes(80), "other_message", "IEEE 1609.2"),
        (b"\x03\x81\x00\x20" + bytes(80), "malformed", "no message"),
    ],
)
def test_what_is_no_bsm_is_named(frame: bytes, reason: str, said: str) -> None:
    refusal = read_bsms([frame], references(1)).refusals[0]
    assert refusal.reason == reason
    assert refusal.detail.startswith((said, "the message is " + said, "a " + said))


def test_a_frame_of_two_octets_of_length() -> None:
    frame = encode_bsm(GOOD, [{"id": 1, "content": bytes(100)}] * 2)
    assert frame[2] & 0xC0 == 0x80
    assert_equal(read_bsms([frame], references(1)), [si_of_core(GOOD, NOW_US)])


def test_a_frame_of_the_road() -> None:
    """A BSM of a test ground, as the documentation of several tools prints it: core data alone, no speed."""
    hex_text = "0014251d59d162dad7de266e9a7d1ea6d4220974ffffffff8ffff080fdfa1fa1007fff0000640fa0"
    read = read_bsms([hex_text.encode()], references(1))
    assert read.refusals[0].detail == "speed_mps is unavailable"
    assert read.ids[0] == b"67458B6B"
    assert (read.numbers["lat"][0], read.numbers["lon"][0]) == (38.9565434, -77.1500475)
    assert (read.numbers["length_m"][0], read.numbers["width_m"][0]) == (5.0, 2.0)


def test_one_in_hex_is_a_record() -> None:
    record = bsm_record(FRAME.hex(), NOW_US)
    expected = si_of_core(GOOD, NOW_US)
    assert isinstance(record, list)
    assert isinstance(expected, dict)
    assert record[:2] == [1, GOOD["id"].hex().upper()]
    np.testing.assert_allclose(np.array(record[2:], float), [expected[name] for name in NAMES])


def test_cams_of_others_are_named() -> None:
    message = cam(random.Random(1))
    as_rsu = message | {"cam": message["cam"] | {"camParameters": message["cam"]["camParameters"] | {
        "highFrequencyContainer": ("rsu", {"zones": bytes(40)})}}}  # fmt: skip
    denm = b"\x02\x01" + bytes(60)
    behind = b"\x11\x00\x05\x01" * 9 + b"\x07\xd1\x00\x00" + encode_cam(message)
    read = read_cams([encode_cam(as_rsu), denm, behind, b"", b"\x02\x02" + bytes(20)], references(5))
    assert [read.refusals[i].reason for i in (0, 1, 3, 4)] == [
        "other_message",
        "other_message",
        "malformed",
        "malformed",
    ]
    assert read.ids[2] == str(message["header"]["stationID"]).encode()


@pytest.mark.parametrize("read", [read_bsms, read_cams])
def test_any_octets_are_read_or_refused(read: Callable[..., UperRecords]) -> None:
    rng = random.Random(5)
    seeds = [*WRAPPED.values(), encode_cam(cam(rng))]
    frames = [mutated(rng.choice(seeds), rng) for _ in range(20_000)]
    found = read(frames, references(len(frames)))
    assert len(found.ids) == len(frames)


def mutated(octets: bytes, rng: random.Random) -> bytes:
    """Change, cut or repeat some octets."""
    changed = bytearray(octets)
    for _ in range(rng.randrange(1, 4)):
        if changed and rng.random() < 0.7:
            changed[rng.randrange(len(changed))] = rng.choice([0, 3, 0x14, 0x7F, 0x80, 0xC0, 0xFF, rng.randrange(256)])
    start = rng.randrange(len(changed) + 1) if rng.random() < 0.1 else 0
    return bytes(changed[start : rng.randrange(len(changed) + 1) if rng.random() < 0.3 else None])


def test_no_array_is_indexed_beyond_its_bounds(tmp_path: Path) -> None:
    """A kernel does not check its indices, so the same tests run where numba does."""
    if os.environ.get("NUMBA_BOUNDSCHECK"):
        pytest.skip("this is that run")
    environment = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    run = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", __file__]
    done = subprocess.run(
        run, env=environment, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:]
