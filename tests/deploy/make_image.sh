#!/usr/bin/env bash
# Builds the image on any machine with a Docker engine: has what it starts from, pulled or made, and has this machine's
# own pip fetch the wheels.
#
#   tests/deploy/make_image.sh [NAME]
set -euo pipefail
cd "$(dirname "$0")/../.."
tests/deploy/make_base_image.sh
tests/deploy/fetch_wheels.sh
docker build --quiet -f deploy/Dockerfile -t "${1:-aeroskein:demo}" .
