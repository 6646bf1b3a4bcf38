"""Cost of reading the messages of other systems, in batches of 250, beside the obvious library."""

import json
import random
from typing import Any

import numpy as np
import pytest
from edge.codec.messages import GATEWAY, KEYS, RECEIVED_US, received
from feeds.asn1_modules import BSM, CAM, compiled, encode_bsm, encode_cam
from feeds.made_messages import bsm_core, cam
from feeds.test_cam_json import ITS_CLIENT
from feeds.test_j2735_json import ODE, RAW
from pytest_benchmark.fixture import BenchmarkFixture

from headway.edge.codec.decoder import Codec
from headway.feeds.uper import read_bsms, read_cams
from headway_schemas.encodings import BSM_MSGPACK, CAM_JSON, CAM_UPER, J2735_ODE, J2735_RAW, J2735_UPER
from headway_schemas.frames import Frame, pack

pytestmark = pytest.mark.bench
COUNT = 250
RNG = random.Random(1)
CORES = [
    bsm_core(RNG) | {"secMark": 14_300, "lat": 423_000_001 + i, "long": -837_000_002, "speed": 675}
    for i in range(COUNT)
]  # fmt: skip
CAMS = [cam(RNG) for _ in range(COUNT)]
for message in CAMS:
    parameters = message["cam"]["camParameters"]
    parameters["basicContainer"]["referencePosition"] |= {"latitude": 406_283_493, "longitude": -86_543_904}
    parameters["highFrequencyContainer"][1]["speed"]["value"] = 870
BSM_FRAMES, CAM_FRAMES = [encode_bsm(core) for core in CORES], [encode_cam(message) for message in CAMS]
SIGNED = [b"\x03\x81\x00\x40\x03\x80" + bytes([len(f)]) + f + b"\x40\x01\x20" + bytes(100) for f in BSM_FRAMES]
HEX = [frame.hex().encode() for frame in BSM_FRAMES]
TIMES_US = np.full(COUNT, RECEIVED_US)


@pytest.mark.parametrize("form", ["bsm", "bsm signed", "bsm hex", "cam"])
def test_columns_of_uper(benchmark: BenchmarkFixture, form: str) -> None:
    frames = {"bsm": BSM_FRAMES, "bsm signed": SIGNED, "bsm hex": HEX, "cam": CAM_FRAMES}[form]
    benchmark.extra_info["readings"] = COUNT
    assert not benchmark(read_cams if form == "cam" else read_bsms, frames, TIMES_US).refusals


@pytest.mark.parametrize("form", ["bsm", "cam"])
def test_asn1tools(benchmark: BenchmarkFixture, form: str) -> None:
    coder, name = (compiled(BSM), "BasicSafetyMessage") if form == "bsm" else (compiled(CAM), "CAM")
    values = [frame[3:] for frame in BSM_FRAMES] if form == "bsm" else CAM_FRAMES

    def decode() -> list[Any]:
        return [coder.decode(name, value) for value in values]

    benchmark.extra_info["readings"] = COUNT
    assert len(benchmark(decode)) == COUNT


@pytest.mark.parametrize("form", ["msgpack", "bsm uper", "cam uper", "ode", "raw", "cam json"])
def test_codec_of_a_bundle(benchmark: BenchmarkFixture, form: str) -> None:
    record = [1, "a", 7, RECEIVED_US, 42.3, -83.7, 13.5, 90.0]
    payload, encoding = {
        "msgpack": ([record] * COUNT, BSM_MSGPACK),
        "bsm uper": (bundle(BSM_FRAMES), J2735_UPER),
        "cam uper": (bundle(CAM_FRAMES), CAM_UPER),
        "ode": (bundle([json.dumps(ODE).encode()] * COUNT), J2735_ODE),
        "raw": (bundle([json.dumps(RAW).encode()] * COUNT), J2735_RAW),
        "cam json": (bundle([json.dumps(ITS_CLIENT).encode()] * COUNT), CAM_JSON),
    }[form]
    codec, messages = Codec(KEYS, payload_max_bytes=1 << 20), [received(payload, GATEWAY, encoding)]
    benchmark.extra_info["readings"] = COUNT
    assert len(benchmark(codec.decode, messages).batch) == COUNT


def bundle(frames: list[bytes]) -> bytes:
    return pack([Frame(frame, RECEIVED_US, "10.0.0.7:1516") for frame in frames])
