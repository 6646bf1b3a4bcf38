"""The image and the trial stack, as far as they can be judged without a container engine."""

import fnmatch
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path, PurePosixPath

import pytest
import yaml
from compose_spec import PyCompose
from deploy.dockerfile import BUILD, FINAL, environment, said
from deploy.manifest import ROOT, names_no_registry, parse_command, settings_of

from headway.core.types.config import MODEL_NAMES, DetectorConfig
from headway.settings import Settings

DOCKER = ROOT / "docker"
COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text())
SERVICES = COMPOSE["services"]
OURS = {name: service for name, service in SERVICES.items() if service["image"] == "headway"}


def copied() -> list[str]:
    sources = []
    for rest in said("COPY"):
        if "--from=" not in rest:
            sources += [word for word in rest.split()[:-1] if not word.startswith("--")]
    return sources


def test_the_linter_has_no_complaint() -> None:
    hadolint = Path(sys.executable).with_name("hadolint")
    result = subprocess.run([hadolint, DOCKER / "Dockerfile"], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "")


def test_what_is_copied_exists_and_is_sent_to_the_builder() -> None:
    allowed = [
        line[1:] for line in (DOCKER / "Dockerfile.dockerignore").read_text().splitlines() if line.startswith("!")
    ]
    for source in copied():
        assert (ROOT / source).exists()
        assert any(PurePosixPath(source).is_relative_to(entry) for entry in allowed)
    for entry in allowed:
        assert any(PurePosixPath(source).is_relative_to(entry) for source in copied())


def test_the_packages_of_the_distribution_are_all_in_the_image() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for package in project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert any(PurePosixPath(package).is_relative_to(source) for source in copied())
    assert project["project"]["readme"] in copied()


def test_the_image_runs_as_nobody_in_particular_and_serves_where_the_settings_say(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert said("USER", FINAL) == ["10001:10001"]
    settings = settings_of(environment(), monkeypatch)
    assert settings.http_host == "0.0.0.0"
    assert said("VOLUME", FINAL) == [str(settings.state_dir)]
    assert said("EXPOSE", FINAL) == [str(settings.http_port)]
    [check] = said("HEALTHCHECK", FINAL)
    assert f"http://127.0.0.1:{settings.http_port}/livez" in check
    compile(json.loads(check.partition("CMD")[2])[-1], "healthcheck", "exec")


def test_base_images_are_named_plainly() -> None:
    images = [rest.split()[0] for rest in said("FROM")] + [s["image"] for s in SERVICES.values()]
    assert all(names_no_registry(image) for image in images)


def test_kernels_are_compiled_as_they_are_run() -> None:
    building = environment(BUILD)
    for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        assert building[name] == environment()[name]
    assert f"cp -R {building['NUMBA_CACHE_DIR']}/." in (DOCKER / "entrypoint.sh").read_text()
    assert said("ARG") == ['EXTRAS="dashboard"', f'DELAYS_S="{DetectorConfig().delay_s}"']


DETECTOR = """
import os, pathlib, runpy, sys
import headway.edge.codec.decoder

class Detector:
    def __init__(self, model, delay_s):
        print(model, delay_s)
    def process(self, recording):
        kernels = pathlib.Path(os.environ["NUMBA_CACHE_DIR"])
        (kernels / "step.nbc").open("a+").close()
        self.events = []
        return self

class Codec:
    def __init__(self, keys):
        pass
    def warm_up(self):
        pass

headway.Detector = Detector
headway.edge.codec.decoder.Codec = Codec
sys.argv.pop(0)
runpy.run_path(sys.argv[0])
"""


def compile_kernels(kernels: Path) -> list[str]:
    """Run the script with a detector whose only kernel is `step`; return what it was made for."""
    command = [sys.executable, "-c", DETECTOR, str(DOCKER / "compile_kernels.py"), "0.5", "1.5"]
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    return subprocess.run(command, env=variables, capture_output=True, text=True, check=True).stdout.splitlines()


def test_kernels_of_every_model_and_delay_are_compiled_and_those_that_nothing_reads_deleted(tmp_path: Path) -> None:
    assert compile_kernels(tmp_path) == [f"{model} {delay_s}" for model in MODEL_NAMES for delay_s in (0.5, 1.5)]
    assert {file.name for file in tmp_path.glob("*.nbc")} == {"step.nbc"}
    (tmp_path / "inner.nbc").touch()
    compile_kernels(tmp_path)
    assert {file.name for file in tmp_path.glob("*.nbc")} == {"step.nbc"}


def test_the_entry_brings_the_kernels_to_where_they_may_be_written(tmp_path: Path) -> None:
    kernels, writable, commands = tmp_path / "kernels", tmp_path / "tmp" / "kernels", tmp_path / "bin"
    (kernels / "core").mkdir(parents=True)
    (kernels / "core" / "step.nbi").write_text("compiled")
    commands.mkdir()
    (commands / "headway").write_text('#!/bin/sh\necho "$@"\n')
    (commands / "headway").chmod(0o755)
    script = (DOCKER / "entrypoint.sh").read_text().replace("/opt/headway/kernels", str(kernels))
    result = subprocess.run(
        [shutil.which("sh") or "/bin/sh", "-c", script, "entrypoint", "serve", "--config", "a b"],
        env={"PATH": f"{commands}:/usr/bin:/bin", "NUMBA_CACHE_DIR": str(writable)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout == "serve --config a b\n"
    assert (writable / "core" / "step.nbi").read_text() == "compiled"


def test_compose_follows_its_specification() -> None:
    PyCompose.from_json(json.dumps(COMPOSE)).validate()
    with pytest.raises(ValueError, match="prots"):
        PyCompose.from_json(json.dumps({"services": {"a": {"image": "i", "prots": []}}}))


def test_what_compose_refers_to_exists() -> None:
    for service in SERVICES.values():
        assert set(service.get("depends_on", ())) <= set(SERVICES)
        for volume in service.get("volumes", ()):
            source = volume.split(":")[0]
            exists = (DOCKER / source).exists() if "/" in source else source in COMPOSE["volumes"]
            assert exists, volume
        assert all((DOCKER / file).is_file() for file in service.get("env_file", ()))
        if "build" in service:
            assert (DOCKER / service["build"]["context"] / service["build"]["dockerfile"]).is_file()


def test_the_router_goes_on_while_connections_to_machines_that_are_gone_close() -> None:
    assert SERVICES["router"]["env_file"] == ["../deploy/zenoh/router.env"]
    assert SERVICES["router"]["sysctls"] == {"net.ipv4.tcp_retries2": 3}


def test_compose_opens_ports_to_this_machine_only() -> None:
    published = [port for service in SERVICES.values() for port in service.get("ports", ())]
    assert published
    assert all(port.startswith("127.0.0.1:") for port in published)


@pytest.mark.parametrize("name", OURS)
def test_compose_runs_what_the_command_line_knows(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    service = OURS[name]
    parse_command(service["command"])
    settings = settings_of({**environment(), **service.get("environment", {})}, monkeypatch)
    if service["command"] == ["serve"]:
        assert service["volumes"] == [f"state:{settings.state_dir}"]
    assert service["read_only"]
    assert any(mount.startswith("/tmp:") for mount in service["tmpfs"])


def test_compose_gives_the_service_time_to_stop() -> None:
    assert float(SERVICES["service"]["stop_grace_period"].removesuffix("s")) > Settings().stop_timeout_s


def test_compose_has_prometheus_scrape_the_service() -> None:
    scrape = yaml.safe_load((ROOT / "deploy/prometheus/prometheus.yml").read_text())
    targets = scrape["scrape_configs"][0]["static_configs"][0]["targets"]
    assert targets == [f"service:{Settings().http_port}"]
    sources = yaml.safe_load((ROOT / "deploy/grafana/provisioning/datasources/prometheus.yml").read_text())
    assert sources["datasources"][0]["url"] == "http://prometheus:9090"


def test_the_router_is_of_the_version_of_the_client() -> None:
    pinned = [
        line for line in (ROOT / "constraints.txt").read_text().splitlines() if fnmatch.fnmatch(line, "*zenoh==*")
    ]
    assert pinned == [f"eclipse-zenoh=={SERVICES['router']['image'].partition(':')[2]}"]
