"""Write `schemas/json/*.schema.json` and `schemas/asyncapi.yaml` from the models: `python -m headway_schemas.generate`.

With `--check` nothing is written; files that differ from what would be written are named, and the exit code is 1.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import BaseModel

from headway_schemas import encodings
from headway_schemas.bsm import NEEDED, Bsm, Leader
from headway_schemas.event import Event, Kind
from headway_schemas.handling import Handling, HandlingRequest
from headway_schemas.keys import ID_PATTERN, Keys
from headway_schemas.state import Health, PairState, RejectedCopy, SensorQuality

SCHEMAS: Final = Path(__file__).resolve().parents[1]
_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_PARAMETERS: Final[dict[str, dict[str, Any]]] = {
    "prefix": {"description": "Setting of the deployment.", "default": "v2x"},
    "site": {"description": "Coverage of one roadside unit; a pair lives within one site."},
    "sender": {"description": f"Id of the vehicle ({ID_PATTERN}), or of a gateway if it begins with gw-."},
    "kind": {"description": "What the anomaly looks like.", "enum": [kind.value for kind in Kind]},
    "suspect": {"description": "Id of the vehicle whose reading is faulty."},
    "follower": {"description": "Id of the follower."},
    "vehicle": {"description": "Id of the vehicle."},
    "reason": {"description": "Why the message was rejected."},
    "instance": {"description": "Id of one running service."},
    "origin": {"description": "Site that a vehicle comes from."},
    "epoch": {"description": "Number of the service among those of its site; the highest publishes."},
}
_QUERY: Final = {"title": "Query", "description": "Parameters are in the selector.", "payload": {"type": "null"}}


def documents() -> dict[Path, str]:
    """Return the text of every generated file by its path under `schemas/`."""
    files = {
        Path("json") / f"{name}.schema.json": json.dumps(
            {"$schema": _DIALECT, "$id": f"{name}.schema.json", **schema}, indent=2
        )
        + "\n"
        for name, schema in _json_schemas().items()
    }
    files[Path("asyncapi.yaml")] = yaml.safe_dump(_asyncapi(), sort_keys=False, allow_unicode=True, width=120)
    return files


def _json_schemas() -> dict[str, dict[str, Any]]:
    return {
        "bsm": _read(Bsm),
        "bsm_record": _record(),
        "bsm_payload": _payload(),
        "event": _written(Event),
        "events": _list_of("event"),
        "pair_state": _written(PairState),
        "pair_states": _list_of("pair_state"),
        "handling_request": _read(HandlingRequest),
        "handling": _written(Handling),
        "handlings": _list_of("handling"),
        "sensor_quality": _written(SensorQuality),
        "health": _written(Health),
        "rejected": _written(RejectedCopy),
    }


def _read(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema(mode="validation")


def _written(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema(mode="serialization")


def _record() -> dict[str, Any]:
    fields, leader = _read(Bsm)["properties"], _read(Leader)["properties"]
    return {
        "title": "Compact record",
        "description": "The fields of a Bsm in declared order, trailing nulls cut.",
        **_row({**fields, "leader": {"anyOf": [_row(leader, 1), {"type": "null"}]}}, len(NEEDED)),
    }


def _row(fields: dict[str, Any], needed: int) -> dict[str, Any]:
    return {"type": "array", "prefixItems": list(fields.values()), "minItems": needed, "items": False}


def _payload() -> dict[str, Any]:
    messages = [{"$ref": "bsm.schema.json"}, {"$ref": "bsm_record.schema.json"}]
    bundle = {"title": "Bundle", "type": "array", "minItems": 1, "items": {"anyOf": messages}}
    return {"title": "Payload", "description": "One message or a bundle of them.", "anyOf": [*messages, bundle]}


def _list_of(name: str) -> dict[str, Any]:
    return {"type": "array", "items": {"$ref": f"{name}.schema.json"}}


_FOREIGN = ("j2735Raw", "j2735Ode", "j2735Uper", "camUper", "camJson")


def _asyncapi() -> dict[str, Any]:
    keys = Keys("prefix", "site")
    messages = {
        "bsmMsgpack": _message("Basic safety messages, msgpack", encodings.BSM_MSGPACK, "bsm_payload"),
        "bsmJson": _message("Basic safety messages, JSON", encodings.BSM_JSON, "bsm_payload"),
        "j2735Raw": _foreign("SAE J2735 JSON with its integers and sentinels", encodings.J2735_RAW),
        "j2735Ode": _foreign("JSON of the USDOT Operational Data Environment", encodings.J2735_ODE),
        "j2735Uper": _foreign("SAE J2735 MessageFrame in unaligned PER", encodings.J2735_UPER),
        "camUper": _foreign("ETSI CAM in unaligned PER", encodings.CAM_UPER),
        "camJson": _foreign("ETSI CAM in JSON", encodings.CAM_JSON),
        "event": _message("One update of an anomaly", encodings.EVENT_JSON, "event"),
        "events": _message("History of events", encodings.EVENTS_JSON, "events"),
        "pairState": _message("State of a pair", encodings.PAIR_STATE_JSON, "pair_state"),
        "pairStates": _message("State of every pair", encodings.PAIR_STATES_JSON, "pair_states"),
        "sensorQuality": _message(
            "Quality of the sensors of a vehicle", encodings.SENSOR_QUALITY_JSON, "sensor_quality"
        ),
        "health": _message("Health of one instance", encodings.HEALTH_JSON, "health"),
        "rejected": _message("Copy of a rejected message", encodings.REJECTED_JSON, "rejected"),
        "handling": _message("How a person handles a vehicle", encodings.HANDLING_JSON, "handling"),
        "handlings": _message("How people handle vehicles", encodings.HANDLINGS_JSON, "handlings"),
        "handlingRequest": _message("What a person asks for", encodings.HANDLING_JSON, "handling_request"),
        "vehicleState": _foreign("State of a vehicle, for the same version alone", encodings.VEHICLE_STATE),
        "query": _QUERY,
    }
    channels = {
        "bsm": _channel(keys.bsm("sender"), "bsmMsgpack", "bsmJson", *_FOREIGN),
        "alert": _channel(keys.alert("kind", "suspect"), "event"),
        "pairState": _channel(keys.pair_state("follower"), "pairState"),
        "quality": _channel(keys.quality("vehicle"), "sensorQuality"),
        "rejected": _channel(keys.rejected("reason"), "rejected"),
        "health": _channel(keys.health("instance"), "health"),
        "liveliness": _channel(keys.liveliness("instance")),
        "epoch": _channel(keys.epoch(0, "instance").replace("/0/", "/epoch/")),
        "alerts": _channel(keys.alerts, "query", "events"),
        "pairs": _channel(keys.pairs, "query", "pairStates"),
        "handled": _channel(keys.handled("vehicle"), "handling"),
        "handover": _channel(keys.handover("origin", "vehicle"), "vehicleState"),
        "handling": _channel(keys.handling, "query", "handlingRequest", "handlings"),
    }
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "headway",
            "version": "1.0.0",
            "description": "What the detector reads and publishes over Eclipse Zenoh. A channel's address is a key "
            "expression, a message's content type the encoding of its payload.",
        },
        "channels": channels,
        "operations": {
            "readMessages": _operation("receive", "bsm", channels),
            "publishEvent": _operation("send", "alert", channels),
            "publishPairState": _operation("send", "pairState", channels),
            "publishSensorQuality": _operation("send", "quality", channels),
            "publishRejected": _operation("send", "rejected", channels),
            "publishHealth": _operation("send", "health", channels),
            "publishHandling": _operation("send", "handled", channels),
            "declareLiveliness": _operation("send", "liveliness", channels),
            "declareEpoch": _operation("send", "epoch", channels),
            "answerAlerts": _answer("alerts", "events"),
            "answerPairs": _answer("pairs", "pairStates"),
            "answerHandling": _answer("handling", "handlings", "handlingRequest"),
        },
        "components": {"messages": messages},
    }


def _message(title: str, encoding: str, schema: str) -> dict[str, Any]:
    return {"title": title, "contentType": encoding, "payload": {"$ref": f"./json/{schema}.schema.json"}}


def _foreign(title: str, encoding: str) -> dict[str, Any]:
    return {"title": title, "contentType": encoding, "payload": {"type": ["object", "array"]}}


def _channel(key: str, *messages: str) -> dict[str, Any]:
    chunks = key.split("/")
    return {
        "address": "/".join(f"{{{chunk}}}" if chunk in _PARAMETERS else chunk for chunk in chunks),
        "messages": {name: {"$ref": f"#/components/messages/{name}"} for name in messages},
        "parameters": {chunk: dict(_PARAMETERS[chunk]) for chunk in chunks if chunk in _PARAMETERS},
    }


def _operation(action: str, channel: str, channels: dict[str, Any]) -> dict[str, Any]:
    return {
        "action": action,
        "channel": {"$ref": f"#/channels/{channel}"},
        "messages": [{"$ref": f"#/channels/{channel}/messages/{name}"} for name in channels[channel]["messages"]],
    }


def _answer(channel: str, reply: str, *requests: str) -> dict[str, Any]:
    at = f"#/channels/{channel}"
    return {
        "action": "receive",
        "channel": {"$ref": at},
        "messages": [{"$ref": f"{at}/messages/{name}"} for name in ("query", *requests)],
        "reply": {"channel": {"$ref": at}, "messages": [{"$ref": f"{at}/messages/{reply}"}]},
    }


def main(arguments: list[str] | None = None, folder: Path = SCHEMAS) -> int:
    """Write or check the files under `folder`; return the exit code."""
    parser = argparse.ArgumentParser(prog="headway_schemas.generate", description="Write the schemas from the models.")
    parser.add_argument("--check", action="store_true", help="write nothing, name the files that differ")
    check: bool = parser.parse_args(arguments).check
    wanted = {folder / path: text for path, text in documents().items()}
    stale = [path for path, text in wanted.items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    if check:
        for path in stale:
            sys.stderr.write(f"{path} differs from the models: run `python -m headway_schemas.generate`\n")
        return 1 if stale else 0
    for path in stale:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(wanted[path], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
