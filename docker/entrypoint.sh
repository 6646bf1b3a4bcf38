#!/bin/sh
# numba reads compiled kernels only from where it could also write; the image itself may be read-only, /tmp is not.
set -eu
mkdir -p "$NUMBA_CACHE_DIR"
cp -R /opt/headway/kernels/. "$NUMBA_CACHE_DIR"
exec headway "$@"
