#!/usr/bin/env bash
# Puts the wheels that the locks name into build/wheels, so that the image can be built where containers reach no
# package index: this machine's own pip fetches them, with whatever index and proxy it is set up for.
set -euo pipefail
cd "$(dirname "$0")/../.."
python="${PYTHON:-.venv/bin/python}"
[ -x "$python" ] || python=python3
stamp=build/wheels/.complete
if [ -e "$stamp" ] && [ ! requirements.lock -nt "$stamp" ] && [ ! requirements-build.lock -nt "$stamp" ]; then exit 0; fi
mkdir -p build/wheels
rm -f build/wheels/*.whl
for lock in requirements.lock requirements-build.lock; do
    "$python" -m pip download --quiet --only-binary :all: --require-hashes --python-version 3.11 \
        --dest build/wheels --requirement "$lock"
done
touch "$stamp"
