"""The controller as a detached actor on the head of the Ray cluster; Ray starts it again if it ends."""

import os
import threading
import time
import traceback
from pathlib import Path
from typing import Any, Final

from headway.edge import fence
from headway.errors import UserError
from headway.fleet.config import FleetConfig, bus_options, epoch_file
from headway.fleet.controller import FleetController, FleetState
from headway.fleet.epoch_watch import EpochWatch
from headway.fleet.ray_plane import RayPlane

_TICK_S: Final = 0.1
STATE_FILE: Final = "fleet.json"


class FolderEpochs:
    """`controller.Epochs` in the folder that all machines reach."""

    def __init__(self, state_dir: Path) -> None:
        self._state_dir = state_dir

    def newest(self, site: str) -> int:
        """Return the highest epoch so far."""
        return fence.newest_epoch(epoch_file(self._state_dir, site))

    def reserve(self, site: str, epoch: int) -> None:
        """End each lower epoch."""
        fence.reserve(epoch_file(self._state_dir, site), epoch)


class ControllerHost:
    """Runs a `FleetController`. Each request returns its answer, or the line of a `UserError`."""

    def __init__(self, config: str, release: str) -> None:
        wanted = FleetConfig.model_validate_json(config)
        self._file = wanted.state_dir / STATE_FILE
        self._changed = threading.Event()
        self._lock = threading.Lock()
        self._stored = ""
        state = FleetState(config=wanted, release=release)
        if self._file.exists():
            state = FleetState.model_validate_json(self._file.read_text(encoding="utf-8"))
        hosts = {of.host for site in state.sites.values() for of in (site.current, site.next) if of is not None}
        self._plane = RayPlane(state.config.cpus, state.config.spares, hosts)
        self._controller = FleetController(state, self._plane, FolderEpochs(wanted.state_dir))
        self._watch = EpochWatch(bus_options(state.config), self._changed.set)
        threading.Thread(target=self._run, name="fleet", daemon=True).start()

    def apply(self, config: str, release: str) -> str | None:
        """Take another wanted state."""
        return self._call(lambda: self._controller.apply(FleetConfig.model_validate_json(config), release))

    def drain(self, node: str) -> str | None:
        """Want no site on a node."""
        return self._call(lambda: self._controller.drain(node))

    def move(self, site: str, node: str | None) -> str | None:
        """Want a site on another node."""
        return self._call(lambda: self._controller.move(site, node))

    def status(self) -> dict[str, Any]:
        """Return rows for sites and nodes."""
        with self._lock:
            return self._controller.status()

    def release(self) -> str:
        """Return the release that is wanted."""
        return self._controller.state.release

    def stop(self) -> bool:
        """Stop each site in order; return whether all have ended."""
        with self._lock:
            self._controller.stop_all(time.monotonic())
            if self._controller.hosts:
                return False
            self._plane.close()
            self._file.unlink(missing_ok=True)
            self._stored = ""
            return True

    def _call(self, request: Any) -> str | None:  # noqa: ANN401 - any function without parameters
        with self._lock:
            try:
                request()
            except UserError as error:
                return str(error)
            self._store()
        self._changed.set()
        return None

    def _run(self) -> None:
        """Tick until the process ends; an error ends it, and Ray starts it again."""
        try:
            while True:
                self._changed.wait(_TICK_S)
                self._changed.clear()
                with self._lock:
                    now_s = time.monotonic()
                    sites = self._controller.state.sites
                    self._controller.tick(now_s, self._watch.held(sites, now_s))
                    self._store()
        except BaseException:  # noqa: BLE001 - shown, and the process ends
            traceback.print_exc()
            os._exit(1)

    def _store(self) -> None:
        text = self._controller.state.model_dump_json()
        if text != self._stored and self._controller.state.sites:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            new = self._file.with_suffix(".new")
            new.write_text(text, encoding="utf-8")
            new.replace(self._file)
            self._stored = text
