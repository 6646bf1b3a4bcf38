"""A process that warms up, judges a few seconds of everything, and fails if it compiled a kernel meanwhile."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from sim.world import SimWorld

import headway


def compiled() -> set[tuple[str, str, str]]:
    """Return every signature of every kernel of the service."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith(headway.__name__)]
    kernels = [kernel for module in modules for kernel in vars(module).values() if hasattr(kernel, "signatures")]
    return {
        (kernel.__module__, kernel.__name__, str(signature)) for kernel in kernels for signature in kernel.signatures
    }


def main() -> None:
    world = SimWorld(1)
    world.rig.engine.warm_up()
    world.rig.codec.warm_up()
    warm = compiled()
    world.drive(vehicles=8, seconds=8.0)
    for _ in range(40):
        world.rig.clock.sleep(1.0)
        world.rig.shell.turn()
    if world.rig.engine.vehicles or not warm:
        raise SystemExit("nobody was forgotten, or nothing was warmed up")
    late = sorted({f"{module}.{name}" for module, name, _ in compiled() - warm})
    if late:
        raise SystemExit(f"compiled while messages waited: {', '.join(late)}")


if __name__ == "__main__":
    main()
