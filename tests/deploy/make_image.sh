#!/usr/bin/env bash
# Builds the image on any machine with a Docker engine: pulls what it starts from or makes it from Debian's packages,
# and has this machine's own pip fetch the wheels.
#
#   tests/deploy/make_image.sh [NAME]
set -euo pipefail
cd "$(dirname "$0")/../.."
base="$(sed -n 's/^ARG BASE=//p' deploy/Dockerfile)"
if ! docker image inspect "$base" >/dev/null 2>&1 && ! docker pull --quiet "$base" >/dev/null 2>&1; then
    tests/deploy/make_base_image.sh "$base"
fi
tests/deploy/fetch_wheels.sh
docker build --quiet -f deploy/Dockerfile -t "${1:-aeroskein:demo}" .
