"""`headway config`: the settings of a service."""

import json

import typer

from headway.cli.options import AsJson, ConfigFile

app = typer.Typer(no_args_is_help=True, help="Settings: effective values, a check, their schema.")


@app.command()
def show(config: ConfigFile = None, as_json: AsJson = False) -> None:
    """Print the effective settings and where each comes from.

    Example: headway config show --config headway.toml
    """
    from headway.settings import load

    loaded = load(config)
    values = loaded.settings.model_dump(mode="json")
    if as_json:
        typer.echo(json.dumps({name: {"value": v, "origin": loaded.origins[name]} for name, v in values.items()}))
        return
    width = max(map(len, values))
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {json.dumps(value):<24}  {loaded.origins[name]}")


@app.command()
def check(config: ConfigFile = None) -> None:
    """Say whether the service would start with these settings.

    Example: headway config check --config headway.toml
    """
    from headway.settings import Origin, load

    origins = list(load(config).origins.values())
    typer.echo("settings are right: " + ", ".join(f"{origins.count(o)} from {o}" for o in Origin))


@app.command()
def schema() -> None:
    """Print the JSON Schema of the settings.

    Example: headway config schema > headway.schema.json
    """
    from headway.settings import Settings

    typer.echo(json.dumps(Settings.model_json_schema(), indent=2))
