"""`headway gateway`: other feeds onto the bus, and alerts to their brokers."""

from typing import Annotated

import typer

from headway.cli.options import ConfigFile, ConnectOne, Site

app = typer.Typer(no_args_is_help=True, help="Other feeds onto the bus: UDP, Kafka, MQTT; and alerts to brokers.")

Name = Annotated[str, typer.Option(help="Name on the bus, behind gw-.")]
Form = Annotated[str, typer.Option(help="What comes: j2735-uper, j2735-json, ode, cam-uper or cam-json.")]
HttpPort = Annotated[int, typer.Option(min=0, max=65_535, help="Port of /metrics and /readyz; 0 takes a free one.")]


@app.command()
def udp(
    host: Annotated[str, typer.Option(help="Address to receive on.")] = "0.0.0.0",  # noqa: S104
    port: Annotated[
        list[int] | None, typer.Option(help="Port; may be repeated. By default 1516, 46800 and 44990.")
    ] = None,
    form: Form = "j2735-uper",
    name: Name = "udp",
    site: Site = None,
    connect: ConnectOne = None,
    config: ConfigFile = None,
    http_port: HttpPort = 9465,
) -> None:
    """Forward packets of roadside units: UPER, bare or behind headers, or as immediate forward text.

    Example: headway gateway udp --port 1516 --name rsu-1 --site crossing
    """
    from headway.cli.run.gateway import process as run
    from headway.gateways.udp import PORTS, UdpReceiver

    options = run.GatewayOptions(name, form, "127.0.0.1", http_port)
    run.forward(lambda queue: UdpReceiver(queue, host, port or PORTS), options, run.access(config, connect, site))


@app.command()
def mqtt(
    broker: Annotated[str, typer.Option(help="Host of the broker, or host:port.")] = "localhost",
    topic: Annotated[
        list[str] | None, typer.Option(help="Topic, + and # allowed; may be repeated. With --alerts, where they go.")
    ] = None,
    alerts: Annotated[bool, typer.Option("--alerts", help="The other way: alerts of the site to the broker.")] = False,
    form: Form = "cam-json",
    name: Name = "mqtt",
    site: Site = None,
    connect: ConnectOne = None,
    config: ConfigFile = None,
    http_port: HttpPort = 9466,
) -> None:
    """Forward messages of an MQTT broker to the bus, or alerts from the bus to the broker.

    Example: headway gateway mqtt --broker broker.example --topic "vanetza/out/cam" --site crossing
    """
    from headway.cli.run.gateway import process as run
    from headway.gateways.mqtt import MqttClient

    options, bus = run.GatewayOptions(name, form, "127.0.0.1", http_port), run.access(config, connect, site)
    if alerts:
        below = topic[0] if topic else "headway"
        run.forward_alerts(lambda queue: MqttClient(queue, broker, f"headway-{name}", topic=below), options, bus)
    else:
        topics = topic or ["vanetza/out/cam"]
        run.forward(lambda queue: MqttClient(queue, broker, f"headway-{name}", topics), options, bus)


@app.command()
def kafka(
    broker: Annotated[str, typer.Option(help="host:port, several joined by commas.")] = "localhost:9092",
    topic: Annotated[
        list[str] | None, typer.Option(help="Topic; may be repeated. With --alerts, where they go.")
    ] = None,
    alerts: Annotated[bool, typer.Option("--alerts", help="The other way: alerts of the site to the broker.")] = False,
    form: Form = "ode",
    name: Name = "kafka",
    site: Site = None,
    connect: ConnectOne = None,
    config: ConfigFile = None,
    http_port: HttpPort = 9467,
) -> None:
    """Forward messages of Kafka topics to the bus, or alerts from the bus to a topic.

    Example: headway gateway kafka --broker ode.example:9092 --topic topic.OdeBsmJson --site crossing
    """
    from headway.cli.run.gateway import process as run
    from headway.gateways.kafka import TOPICS, KafkaAlerts, KafkaConsumer

    options, bus = run.GatewayOptions(name, form, "127.0.0.1", http_port), run.access(config, connect, site)
    if alerts:
        into = topic[0] if topic else "headway.alerts"
        run.forward_alerts(lambda _: KafkaAlerts(broker, into), options, bus)
    else:
        topics = topic or list(TOPICS)
        run.forward(lambda queue: KafkaConsumer(queue, broker, f"headway-{name}", topics), options, bus)
