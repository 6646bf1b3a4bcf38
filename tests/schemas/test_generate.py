import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from referencing import Registry, Resource

from headway_schemas import encodings
from headway_schemas.bsm import from_map, to_map, to_record
from headway_schemas.generate import SCHEMAS, documents, main

FILES = sorted(path.name for path in documents() if path.suffix == ".json")
BSM = from_map(
    {"v": 1, "id": "a", "msg_cnt": 0, "t_us": 0, "lat": 42.3, "lon": -83.7, "speed_mps": 13.5, "leader": {"id": "b"}}
)


@pytest.fixture(scope="module")
def registry() -> Registry[Any]:
    resources = [Resource.from_contents(json.loads((SCHEMAS / "json" / name).read_text())) for name in FILES]
    return Registry().with_resources((resource.id() or "", resource) for resource in resources)


@pytest.fixture(scope="module")
def asyncapi() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((SCHEMAS / "asyncapi.yaml").read_text())
    return document


def test_the_files_are_in_step_with_the_models() -> None:
    assert main(["--check"]) == 0
    assert sorted(path.name for path in (SCHEMAS / "json").iterdir()) == FILES


def test_check_names_what_differs_and_writing_mends_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([], tmp_path) == 0
    assert main(["--check"], tmp_path) == 0
    (tmp_path / "json" / "event.schema.json").write_text("{}")

    assert main(["--check"], tmp_path) == 1
    assert "event.schema.json differs" in capsys.readouterr().err
    assert main([], tmp_path) == 0
    assert main(["--check"], tmp_path) == 0


@pytest.mark.parametrize("name", FILES)
def test_every_file_is_a_json_schema_whose_references_resolve(name: str, registry: Registry[Any]) -> None:
    schema = registry.contents(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    for reference in _references(schema):
        registry.resolver(base_uri=name).lookup(reference)


def test_the_payload_schema_takes_messages_and_bundles_and_nothing_else(registry: Registry[Any]) -> None:
    validator = jsonschema.Draft202012Validator(registry.contents("bsm_payload.schema.json"), registry=registry)
    fields, record = to_map(BSM), to_record(BSM)
    for good in (fields, record, [fields], [record, fields]):
        validator.validate(good)
    for bad in ([], {}, fields | {"v": 2}, fields | {"speed_mps": 163.82}, record[:6], [*record, None], [[*record, 1]]):
        assert not validator.is_valid(bad)


def test_every_reference_of_the_asyncapi_resolves(asyncapi: dict[str, Any]) -> None:
    references = list(_references(asyncapi))
    assert len(references) > 30
    for reference in references:
        if reference.startswith("#/"):
            target: Any = asyncapi
            for step in reference[2:].split("/"):
                target = target[step]
        else:
            assert (SCHEMAS / reference).is_file()


def test_the_parameters_of_a_channel_are_those_of_its_address(asyncapi: dict[str, Any]) -> None:
    for channel in asyncapi["channels"].values():
        named = [chunk[1:-1] for chunk in channel["address"].split("/") if chunk.startswith("{")]
        assert named == list(channel["parameters"])


def test_every_encoding_has_a_message(asyncapi: dict[str, Any]) -> None:
    messages = asyncapi["components"]["messages"].values()
    wanted = {value for name, value in vars(encodings).items() if name.isupper()}
    assert {message["contentType"] for message in messages if "contentType" in message} == wanted


def _references(node: Any) -> Any:
    if isinstance(node, dict):
        for name, child in node.items():
            if name == "$ref":
                yield child
            else:
                yield from _references(child)
    elif isinstance(node, list):
        for child in node:
            yield from _references(child)
