"""Misbehaviour reports in canonical OER, a line of hex digits each.

An observation has no value of its own: its open type is NULL, which has no octets.
"""

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import IO, Any, Final

from headway.cli.run.misbehaviour.report import reports
from headway.errors import UserError

MODULE: Final = Path(__file__).with_name("report.asn")


@cache
def _types() -> Any:  # noqa: ANN401 - of a package without types
    try:
        import asn1tools
    except ImportError:
        raise UserError("--format mr-coer needs asn1tools: pip install 'headway[reports]'") from None
    return asn1tools.compile_files(str(MODULE), "oer")


def encode(report: dict[str, Any]) -> bytes:
    """Return a report in canonical OER; what stands under `headway` has no place in it."""
    types, content = _types(), report["report"]["content"]
    encoded = {
        "observations": [
            {
                "tgtId": target["tgtId"],
                "observations": [
                    types.encode("Observation", {"obsId": one["obsId"], "obs": b""}) for one in target["observations"]
                ],
            }
            for target in content["observations"]
        ],
        "v2xPduEvidence": [
            {**stream, "v2xPdus": list(map(bytes.fromhex, stream["v2xPdus"]))} for stream in content["v2xPduEvidence"]
        ],
        "nonV2xPduEvidence": [],
    }
    inner = {"aid": report["report"]["aid"], "content": types.encode("Content", encoded)}
    octets: bytes = types.encode("Report", {**report, "report": inner})
    return octets


def write_coer(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write a report for each onset and update. Return how many.

    Raises
    ------
    UserError
        asn1tools is not installed.
    """
    return sum(1 for report in reports(stored) if to.write(encode(report).hex().encode() + b"\n"))
