"""The service: its parts made and joined, run until it is told to stop, and closed in order."""

import gc
import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import structlog

from headway import kernel_cache
from headway.core.engine import Engine
from headway.core.estimation.registry import build
from headway.core.tracking.cells import Lattice
from headway.edge.cells.cell_engines import CellEngines
from headway.edge.cells.engine_process import EngineStart
from headway.edge.clock import SystemClock
from headway.edge.codec.decoder import Codec
from headway.edge.codec.evidence import parameters
from headway.edge.codec.messages import encode
from headway.edge.context import ServiceContext
from headway.edge.fence import Fence, SupersededError
from headway.edge.handover import Handover, read_config
from headway.edge.identity import Identity
from headway.edge.loop import LoopConfig, ServiceLoop
from headway.edge.message_history import MessageHistory
from headway.edge.storage.journal import Resumed
from headway.edge.storage.persistence import Persistence, PersistenceConfig
from headway.edge.telemetry import logging_setup
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import HealthState
from headway.edge.telemetry.http_server import HttpServer
from headway.edge.telemetry.latency import Latencies
from headway.edge.telemetry.metrics import CONTENT_TYPE, Metrics
from headway.edge.telemetry.process import release_pages
from headway.edge.telemetry.reporter import ReportConfig, Reporter
from headway.edge.telemetry.service_manager import ServiceManager
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import ReceiveQueue
from headway.edge.transport.zenoh_bus import ZenohBus
from headway.edge.transport.zenoh_config import BusConfig
from headway.errors import UserError
from headway.kernel_cache import core_digest
from headway.settings import Loaded, Origin, Settings
from headway.version import version
from headway_schemas.keys import Keys

_log = structlog.get_logger(__name__)


def stand_by(settings: Settings) -> None:
    """Load the kernels of a service, then read variables of the environment as a line of JSON on standard input.

    Raises
    ------
    SystemExit
        Standard input ended: nobody needs the service.
    """
    codec = Codec(Keys(settings.prefix, settings.site))
    _warm_up(Engine(settings.detector()), codec, threading.Event())
    sys.stdout.write("standing by\n")
    sys.stdout.flush()
    line = sys.stdin.readline()
    if not line:
        sys.exit(0)
    os.environ.update(json.loads(line))


def serve(loaded: Loaded) -> None:
    """Run until SIGTERM or SIGINT, then judge what is queued, report, and sign off.

    Raises
    ------
    UserError
        An address or an option cannot be had.
    """
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    settings = loaded.settings
    logging_setup.configure(settings.log_level, settings.log_format)
    structlog.contextvars.bind_contextvars(site=settings.site, instance=settings.instance)

    clock = SystemClock()
    keys = Keys(settings.prefix, settings.site)
    identity = Identity(
        site=settings.site,
        instance=settings.instance,
        version=version(),
        model=settings.model,
        config_hash=settings.config_hash,
        epoch=settings.epoch or None,
        parameters=parameters(settings.detector(), version(), core_digest()),
    )
    health, ledger, latencies = HealthState(clock), Ledger(), Latencies()
    codec = Codec(keys, payload_max_bytes=settings.payload_bytes_limit, bundle_max=settings.bundle_limit)
    receive_queue = ReceiveQueue(
        settings.queue_limit, settings.queue_bytes_limit, int(settings.queue_age_limit_s * 1e9), codec.records_in,
        settings.sender_rate_hz,
    )  # fmt: skip
    fence = _fence(settings, clock, stop.set)
    bus = ZenohBus(_bus_config(loaded), keys, clock, receive_queue, fence)
    engine = _engine(settings, identity, clock, health)
    persistence = None
    if settings.state_dir is not None:
        persistence = Persistence(
            _persistence_config(settings, settings.state_dir),
            identity,
            engine,
            clock,
            lambda update: bus.publish(Channel.ALERT, update.key, update.payload),
            lambda handling: bus.publish(Channel.HANDLING, keys.handled(handling.vehicle), encode(handling)),
            fence,
        )
    context = ServiceContext(
        identity=identity,
        keys=keys,
        clock=clock,
        codec=codec,
        engine=engine,
        bus=bus,
        health=health,
        ledger=ledger,
        latencies=latencies,
        history=MessageHistory(round(settings.history_mb * 1e6), settings.evidence_messages_bytes),
        vehicle_capacity=settings.vehicle_capacity,
        queue_limit=settings.queue_limit,
        alarm_budget_per_hour=settings.alarm_budget_per_hour,
        persistence=persistence,
        handover=_handover(settings, identity, engine),
    )
    manager = ServiceManager(clock, os.environ)

    def stopping() -> bool:
        manager.tell(is_ready=health.ready)
        return stop.is_set()

    loop = ServiceLoop(_loop_config(settings), context, Reporter(_report_config(settings), context))
    metrics = Metrics(context)
    with _http(settings, metrics, health) as http:
        _log.info("starting", version=identity.version, config_hash=identity.config_hash, http_port=http.port)
        _warm_up(engine, codec, stop)
        health.warm = True
        try:
            if bus.open(lambda seconds: not stop.wait(seconds)):
                # Messages wait on the bus while a service before this one stops and the snapshot is loaded.
                resumed = Resumed() if persistence is None else persistence.start()
                bus.declare_epoch()
                try:
                    loop.resume(resumed)
                    _log.info("ready", connect=settings.connect, listen=settings.listen)
                    loop.run(stopping)
                    manager.stopping()
                    left = loop.drain(settings.stop_timeout_s)
                    _log.info("stopping", scored=ledger.scored, warming=ledger.warming, rejected=ledger.rejected,
                        sequence_gap_messages=ledger.sequence_gap_messages, left=left)  # fmt: skip
                finally:
                    _write_last(persistence, engine)
        finally:
            bus.close()
            if fence is not None:
                fence.release()
    if fence is not None and fence.is_replaced:
        sys.exit(SupersededError.status)


def _warm_up(engine: Engine | CellEngines, codec: Codec, stop: threading.Event) -> None:
    """Load the kernels; where some had to be compiled, start the process anew."""
    with kernel_cache.alone():
        kept = kernel_cache.kept()
        engine.warm_up()
        codec.warm_up()
        compiled = kernel_cache.kept() - kept
    if compiled and not stop.is_set():
        # A compiler keeps some 400 MB to itself for good, and who finds its work done never starts one.
        _log.info("starting anew", compiled=compiled)
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606
    kernel_cache.release_bitcode()
    gc.collect()  # a tenth of a second, before a lease runs
    gc.freeze()
    release_pages()  # most of LLVM, which only compiles and loads kernels, and what else only starts the service


def _write_last(persistence: Persistence | None, engine: Engine | CellEngines) -> None:
    """Write the journal and the last snapshot, and end the processes of the engines."""
    if persistence is not None:
        persistence.close()
    if isinstance(engine, CellEngines):
        engine.close()


def _engine(settings: Settings, identity: Identity, clock: SystemClock, health: HealthState) -> Engine | CellEngines:
    """Return the engine, or with several workers the engines of the site."""
    workers, folder = settings.workers, settings.state_dir and (settings.snapshot_dir or settings.state_dir)
    if not build(settings.detector()).linear_algebra:
        kernel_cache.without_blas()
    if workers == 1:
        return Engine(settings.detector())
    name = f"{settings.site}-{settings.instance}"
    starts = [
        EngineStart(
            config=settings.detector(),
            identity=identity,
            clock=clock,
            snapshot_folder=folder and folder / f"{name}-{k + 1}of{workers}.snapshot",
            snapshot_interval_s=settings.snapshot_interval_s,
            log_level=settings.log_level,
            log_format=settings.log_format,
        )
        for k in range(workers)
    ]
    return CellEngines(starts, Lattice(workers, settings.cell_m, 2.0 * settings.pairing_range_m), health)


def _handover(settings: Settings, identity: Identity, engine: Engine | CellEngines) -> Handover | None:
    if settings.handover is None or isinstance(engine, CellEngines):
        return None
    return Handover(read_config(settings.handover), settings.detector(), identity, engine)


def _fence(settings: Settings, clock: SystemClock, replaced: Callable[[], None]) -> Fence | None:
    if not settings.epoch or settings.state_dir is None:
        return None
    return Fence(settings.state_dir / f"{settings.site}.epoch", settings.epoch, settings.lease_s, clock, replaced)


def _http(settings: Settings, metrics: Metrics, health: HealthState) -> HttpServer:
    try:
        return HttpServer(
            settings.http_host,
            settings.http_port,
            metrics=metrics.text,
            content_type=CONTENT_TYPE,
            liveness_problem=lambda: health.liveness_problem,
            readiness_problem=lambda: health.readiness_problem,
        )
    except OSError as error:
        where = f"http://{settings.http_host}:{settings.http_port}"
        raise UserError(f"{where}: {error.strerror}; set http_host or http_port") from None


def _bus_config(loaded: Loaded) -> BusConfig:
    settings = loaded.settings
    options = None
    if settings.zenoh_config is not None:
        try:
            options = settings.zenoh_config.read_text(encoding="utf-8")
        except OSError as error:
            raise UserError(f"zenoh_config {settings.zenoh_config}: {error.strerror}") from None

    def unless_left_to_file(name: str) -> bool:
        return options is None or loaded.origins[name] is not Origin.DEFAULT

    return BusConfig(
        instance=settings.instance,
        mode=settings.mode if unless_left_to_file("mode") else None,
        connect=settings.connect if unless_left_to_file("connect") else None,
        listen=settings.listen if unless_left_to_file("listen") else None,
        options=options,
        connect_timeout_s=settings.connect_timeout_s,
        block_timeout_s=settings.block_timeout_s,
        alert_limit=settings.alert_queue_limit,
        payload_max_bytes=settings.payload_bytes_limit,
        lease_s=settings.lease_s if settings.epoch else None,
        history=settings.state_dir is not None,
        handover=settings.handover is not None,
    )


def _persistence_config(settings: Settings, folder: Path) -> PersistenceConfig:
    return PersistenceConfig(
        folder=folder,
        snapshot_folder=settings.snapshot_dir or folder,
        journal_days=settings.journal_days,
        journal_mb=settings.journal_mb,
        snapshot_interval_s=settings.snapshot_interval_s,
    )


def _report_config(settings: Settings) -> ReportConfig:
    return ReportConfig(
        state_rate_hz=settings.state_rate_hz,
        state_budget_hz=settings.state_budget_hz,
        health_interval_s=settings.health_interval_s,
    )


def _loop_config(settings: Settings) -> LoopConfig:
    return LoopConfig(
        batch_limit=settings.batch_limit,
        batch_bytes_limit=settings.batch_bytes_limit,
        idle_sleep_s=settings.idle_sleep_s,
        rejected_rate_hz=settings.rejected_rate_hz,
        rejected_bytes_limit=settings.rejected_bytes_limit,
        suspect_burst=settings.suspect_burst,
        suspect_refill_s=settings.suspect_refill_s,
    )
