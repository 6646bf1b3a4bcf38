"""What is fuzzed. A target runs bytes and returns the outcomes of the records in them; what must not be, raises.

To add a decoder: a function that returns seeds, and a line in `TARGETS`.
"""

import json
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import msgpack
from edge.codec.messages import GATEWAY, KEYS, RECEIVED_US, as_map, record
from feeds.asn1_modules import encode_bsm, encode_cam, frame_of
from feeds.made_messages import bsm_core, cam
from feeds.test_cam_json import ITS_CLIENT, VANETZA
from feeds.test_j2735_json import ode, raw
from feeds.test_uper import WRAPPED
from fuzz.drives import drive, drive_seeds
from fuzz.recordings import FUZZED, reader_of, seeds

from headway.core.estimation.registry import MODELS
from headway.core.types.outcome import Outcome
from headway.edge.codec.decoder import Codec
from headway.edge.transport.message import ReceivedMessage
from headway_schemas import encodings
from headway_schemas.frames import Frame, pack

_CODEC = Codec(KEYS)


@dataclass(frozen=True, slots=True)
class Target:
    """Seeds, and what runs some inputs at once."""

    seeds: Callable[[], list[bytes]]
    run: Callable[[list[bytes]], Counter[Outcome]]
    at_once: int
    """Inputs of one run: as many as the loop may drain, or one."""


def decode(payloads: list[bytes], encoding: str) -> Counter[Outcome]:
    """Decode messages of a vehicle and of a gateway; each has at least one outcome, and each record exactly one."""
    senders = ("a", GATEWAY)
    messages = [
        ReceivedMessage(KEYS.bsm(senders[len(payload) % 2]), payload, encoding, True, RECEIVED_US, 0)
        for payload in payloads
    ]
    decoded = _CODEC.decode(messages)
    outcomes = Counter(rejection.reason.outcome for rejection in decoded.rejections for _ in range(rejection.count))
    outcomes[Outcome.SCORED] = len(decoded.batch)
    named = set(decoded.sources.tolist())
    rejected = {id(rejection.message) for rejection in decoded.rejections}
    for place, message in enumerate(messages):
        assert place in named or id(message) in rejected, f"no outcome: {message}"
    places = [(id(r.message), r.index) for r in decoded.rejections]
    assert len(places) == len(set(places)), "two outcomes for one record"
    return outcomes


def codec(encoding: str, seeds: Callable[[], list[bytes]]) -> Target:
    """Return the target of an encoding."""
    return Target(seeds, lambda payloads: decode(payloads, encoding), at_once=50)


def engine(model: str) -> Target:
    """Return the target of a motion model: bytes are read as a drive of many vehicles."""
    return Target(drive_seeds, lambda inputs: sum((drive(model, one) for one in inputs), Counter()), at_once=1)


def records() -> list[list[object]]:
    """Return compact records, sparse and full."""
    full = {"elev_m": 260.0, "accel_mps2": -0.5, "accuracy_m": 1.5, "length_m": 4.6, "width_m": 1.9}
    return [record(), record(**full, leader=["b", 20.0, 0.0]), record(speed_mps=0, lat=-90.0, lon=180.0)]


def msgpack_seeds() -> list[bytes]:
    """Return records, maps and bundles in msgpack."""
    forms = [*records(), *map(as_map, records()), records(), list(map(as_map, records()))]
    return [msgpack.packb(form) for form in forms]


def json_seeds() -> list[bytes]:
    """Return the same in JSON."""
    forms = [*records(), *map(as_map, records()), records(), list(map(as_map, records()))]
    return [json.dumps(form).encode() for form in forms]


def raw_seeds() -> list[bytes]:
    """Return J2735 in JSON, with its integers."""
    return [json.dumps(form).encode() for form in (raw(), [raw(), raw(msgCnt=96)], raw(speed=8191))]


def ode_seeds() -> list[bytes]:
    """Return J2735 in the JSON of the Operational Data Environment."""
    return [json.dumps(form).encode() for form in (ode(), [ode(), ode(msgCnt=96)], ode(speed=None))]


def bsm_uper_seeds() -> list[bytes]:
    """Return J2735 in unaligned PER, alone and in bundles of a gateway."""
    rng = random.Random(1)
    frames = [encode_bsm(bsm_core(rng)) for _ in range(8)]
    return [*frames, *WRAPPED.values(), *_bundles([*frames, *WRAPPED.values(), frame_of(bytes(90), 31)])]


def cam_uper_seeds() -> list[bytes]:
    """Return CAM in unaligned PER, alone and in bundles of a gateway."""
    rng = random.Random(1)
    frames = [encode_cam(cam(rng)) for _ in range(8)]
    return [*frames, *_bundles(frames)]


def cam_json_seeds() -> list[bytes]:
    """Return CAM in the JSON of two systems."""
    return [json.dumps(form).encode() for form in (VANETZA, ITS_CLIENT, [VANETZA, ITS_CLIENT])]


def _bundles(frames: list[bytes]) -> list[bytes]:
    return [pack([Frame(frame, RECEIVED_US, "10.0.0.7") for frame in frames[:n]]) for n in (1, 2, len(frames))]


ENCODED: dict[str, tuple[str, Callable[[], list[bytes]]]] = {
    encodings.BSM_MSGPACK: ("msgpack", msgpack_seeds),
    encodings.BSM_JSON: ("json", json_seeds),
    encodings.J2735_RAW: ("j2735.raw", raw_seeds),
    encodings.J2735_ODE: ("j2735.ode", ode_seeds),
    encodings.J2735_UPER: ("j2735 uper", bsm_uper_seeds),
    encodings.CAM_UPER: ("cam uper", cam_uper_seeds),
    encodings.CAM_JSON: ("cam json", cam_json_seeds),
}
"""Name and seeds of the target of each encoding."""
TARGETS: dict[str, Target] = {
    **{name: codec(encoding, seeds_of) for encoding, (name, seeds_of) in ENCODED.items()},
    **{f"file {word}": Target(partial(seeds, word), reader_of(word), at_once=10) for word in FUZZED},
    **{f"engine {model}": engine(model) for model in MODELS},
}
