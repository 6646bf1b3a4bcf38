"""Reports in COER: octets that the encoding rules give by hand, and the same report read back."""

import io
import json
from typing import Any

import asn1tools
import pytest
from cli.run.misbehaviour.test_report import event, report

from headway.cli.run.misbehaviour.coer import MODULE, encode, write_coer
from headway_schemas.event import Observation, Phase

TYPES = asn1tools.compile_files(str(MODULE), "oer")


def decoded(octets: bytes) -> dict[str, Any]:
    """Return the report in the JSON form, without the names of observations."""
    found = TYPES.decode("Report", octets)
    content = TYPES.decode("Content", found["report"]["content"])
    for target in content["observations"]:
        target["observations"] = [TYPES.decode("Observation", one)["obsId"] for one in target["observations"]]
    for stream in content["v2xPduEvidence"]:
        stream["v2xPdus"] = [pdu.hex().upper() for pdu in stream["v2xPdus"]]
    return {**found, "report": {"aid": found["report"]["aid"], "content": content}}


@pytest.mark.parametrize(
    "observations",
    [(), (Observation.ACCELERATION,), (Observation.POSITION_CHANGE, Observation.SPEED_CHANGE, Observation.IDENTITY)],
)
@pytest.mark.parametrize("messages", [(), (b"\x00\x14\x01",), (bytes(300), b"\x03\x81\x00")])
def test_what_is_read_back_is_the_report(observations: tuple[Observation, ...], messages: tuple[bytes, ...]) -> None:
    made = report(*observations, messages=messages)
    octets = encode(made)
    del made["headway"]
    for target in made["report"]["content"]["observations"]:
        target["observations"] = [one["obsId"] for one in target["observations"]]
    assert decoded(octets) == made


def test_the_octets_are_those_of_the_encoding_rules() -> None:
    made = report(Observation.ACCELERATION, messages=[b"\x00\x14\x01"])
    observation = "0101050101020400"  # one target, 5; one observation of two octets: 4, NULL
    stream = "0101000201010603800300140100"  # no extension, no certificate; type 2; one message; 0
    content = observation + stream + "0100"
    size = len(bytes.fromhex(content))
    assert encode(made).hex() == (f"01{made['generationTime']:016x}35a4e9016b49d201f0000120{size:02x}" + content)


def test_a_report_is_a_line_of_hex() -> None:
    lines = [event(Observation.INTERVAL, phase=phase).model_dump_json().encode() for phase in Phase]
    out = io.BytesIO()
    assert write_coer(lines, out) == 2
    first, second = out.getvalue().split()
    assert first == second
    assert decoded(bytes.fromhex(first.decode()))["report"]["content"]["observations"] == [
        {"tgtId": 0, "observations": [1]}
    ]
    assert json.loads(lines[0])["phase"] == "onset"
