"""Compile the kernels of every motion model for the delays (s) given into numba's cache."""

import sys
from itertools import product

from headway.core.engine import Engine
from headway.core.estimation.registry import MODELS
from headway.core.types.config import DetectorConfig
from headway.edge.codec.decoder import Codec
from headway_schemas.keys import Keys

for model, delay_s in product(MODELS, sys.argv[1:]):
    Engine(DetectorConfig(model=model, delay_s=float(delay_s))).warm_up()
Codec(Keys("v2x", "site")).warm_up()
