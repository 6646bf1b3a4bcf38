"""Compile the kernels of every motion model for the delays (s) given into numba's cache.

Another run, which finds them there, deletes those that it does not read: their machine code is also in those that call
them.
"""

import os
import sys
from contextlib import nullcontext
from itertools import product
from pathlib import Path

from headway import Detector, kernel_cache, sample_recording
from headway.core.types.config import MODEL_NAMES
from headway.edge.codec.decoder import Codec
from headway.explain.compare import replayed
from headway_schemas.keys import Keys


def kernels() -> set[str]:
    """Return the files of machine code."""
    return set(map(str, Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*.nbc")))


opened: set[str] = set()
sys.addaudithook(lambda event, arguments: opened.add(str(arguments[0])) if event == "open" else None)
before = kernels()
kernel_cache.alone = nullcontext  # nothing else compiles here, and it reads every kernel
for model, delay_s in product(MODEL_NAMES, sys.argv[1:]):
    for event in Detector(model=model, delay_s=float(delay_s)).process(sample_recording()).events:
        replayed(event)
Codec(Keys("v2x", "site")).warm_up()
for unread in before - opened:
    Path(unread).unlink()
