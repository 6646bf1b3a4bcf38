"""What deployment files say of the service, held against the service."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer

from headway.cli.app import app
from headway.settings import ENV_PREFIX, Settings, load

ROOT = Path(__file__).resolve().parents[2]


def parse_command(arguments: Sequence[str]) -> None:
    """Parse the arguments of `headway` without running it; raises `click.UsageError` when it would refuse them."""
    group = typer.main.get_command(app)
    with group.make_context("headway", list(arguments[:1]), resilient_parsing=True) as context:
        command = group.get_command(context, arguments[0])
        assert command is not None, f"no command {arguments[0]}"
        command.make_context(arguments[0], list(arguments[1:]), parent=context)


def settings_of(environment: Mapping[str, str], monkeypatch: pytest.MonkeyPatch, file: Path | None = None) -> Settings:
    """Load the settings as the service would with this environment; raises `SettingsError` when it would refuse."""
    with monkeypatch.context() as patch:
        for name, value in environment.items():
            if name.startswith(ENV_PREFIX):
                patch.setenv(name, str(value))
        return load(file).settings


def names_no_registry(image: str) -> bool:
    """Whether an image is named plainly, as whoever pulls it may find it."""
    first, slash, _ = image.partition("/")
    return not slash or not set(".:") & set(first)


def require_confined(pod: Mapping[str, Any], container: Mapping[str, Any]) -> None:
    """Assert that a pod runs as nobody in particular, without the API of the cluster, and its container read-only."""
    assert pod["securityContext"]["runAsNonRoot"]
    assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
    assert pod["automountServiceAccountToken"] is False
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    assert names_no_registry(container["image"])
