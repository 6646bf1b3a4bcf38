#!/bin/sh
# Remove from an environment what only its making and the tests of its packages need: 150 MB of 500.
set -eu
packages=$(echo "$1"/lib/python3*/site-packages)
"$1"/bin/pip uninstall --quiet --yes setuptools pip
rm -rf "$packages"/numba/tests "$packages"/numba/cuda "$packages"/numpy/distutils
find "$packages"/numpy "$packages"/scipy -name tests -type d -prune -exec rm -rf {} +
find "$packages" -name '*.pyi' -delete
# Serving calls functions of scipy.special, and LAPACK by scipy.linalg.
find "$packages"/scipy -mindepth 1 -maxdepth 1 -type d \
    ! -name '_*' ! -name special ! -name linalg -exec rm -rf {} +
# Of the languages that a traceback could be coloured in, Python is the only one.
find "$packages"/pygments/lexers -type f ! -name '_*' ! -name 'python*' -delete
find "$packages"/pygments/lexers -name '_*_builtins*' -delete
# Names for a linker, which nobody calls at run time.
strip --strip-unneeded "$packages"/llvmlite/binding/libllvmlite.so "$packages"/zenoh/*.so
