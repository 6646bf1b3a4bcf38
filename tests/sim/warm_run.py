"""A process that warms up, runs a few seconds of everything, and fails if it compiled a kernel meanwhile."""

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
from sim.world import SimWorld

import headway
from headway.edge.transport.ports import Channel

FAULTY, SILENT, FAULT_FROM = 1, 3, 60
KINDS = 2
"""A miss, and a kind of the sensor's."""


def compiled() -> set[tuple[str, str, str]]:
    """Return every signature of every kernel of the service."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith(headway.__name__)]
    kernels = [kernel for module in modules for kernel in vars(module).values() if hasattr(kernel, "signatures")]
    return {
        (kernel.__module__, kernel.__name__, str(signature)) for kernel in kernels for signature in kernel.signatures
    }


class Troubled(SimWorld):
    """One vehicle's speed is faulty for a second, and another falls silent."""

    def _record(self, vehicle: int, k: int, at_s: float) -> list[Any]:
        record = super()._record(vehicle, k, at_s)
        if vehicle == FAULTY and FAULT_FROM <= k < FAULT_FROM + 10:
            record[6] += 3.0
        return record

    def _send(self, vehicle: int, k: int, at_s: float) -> None:
        if vehicle != SILENT or k < FAULT_FROM:
            super()._send(vehicle, k, at_s)


def main() -> None:
    world = Troubled(1)
    world.rig.engine.warm_up()
    world.rig.codec.warm_up()
    warm = compiled()
    world.drive(vehicles=8, seconds=12.0)
    for _ in range(40):
        world.rig.clock.sleep(1.0)
        world.rig.loop.iterate()
    kinds = {alert["kind"] for alert in world.published(Channel.ALERT)}
    if world.rig.engine.vehicles or not warm or len(kinds) < KINDS:
        raise SystemExit(f"no vehicle was evicted, nothing was warmed up, or a kind is missing: {kinds}")
    late = sorted({f"{module}.{name}" for module, name, _ in compiled() - warm})
    if late:
        raise SystemExit(f"compiled while messages waited: {', '.join(late)}")


if __name__ == "__main__":
    main()
