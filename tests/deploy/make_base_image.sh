#!/usr/bin/env bash
# Has the image that deploy/Dockerfile starts from: pulls it, or stands in for the registry where nothing can be pulled
# and makes it, under that name, from Debian's packages. Where neither can be, the last line says what is missing.
#
#   tests/deploy/make_base_image.sh [NAME]        making it needs root and apt
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
name="${1:-$(sed -n 's/^ARG BASE=//p' "$here/../../deploy/Dockerfile")}"

if docker image inspect "$name" >/dev/null 2>&1; then
    exit 0
fi
if docker pull --quiet "$name" >/dev/null 2>&1; then exit 0; fi
if [ "$(id -u)" != 0 ]; then
    echo "$name is not here and cannot be pulled; making it takes root: sudo $0" >&2
    exit 1
fi
if ! command -v debootstrap >/dev/null &&
    ! { apt-get update -qq && apt-get -o DPkg::Lock::Timeout=120 install -y -qq debootstrap; } >/dev/null; then
    echo "$name is not here and cannot be pulled; making it takes debootstrap: apt-get install debootstrap" >&2
    exit 1
fi

root="$(mktemp -d)"
trap 'rm -rf "$root"' EXIT
# Debian 12 has the same Python 3.11 and the same C library as the official image of that name.
debootstrap --variant=minbase --include=python3-minimal,python3-venv,ca-certificates,libstdc++6 \
    bookworm "$root" >"$root.log" 2>&1 || { tail -5 "$root.log" >&2; exit 1; }
rm -f "$root.log"
# What no container needs: package lists, manuals, translations of messages. The official image has neither Python's own
# tests nor compiled modules, so this one has neither.
rm -rf "$root"/var/lib/apt/lists/* "$root"/var/cache/apt/* "$root"/var/log/* \
    "$root"/usr/share/{doc,man,info,locale}/* "$root"/usr/lib/python3*/test
find "$root" -name '*.pyc' -delete
tar -C "$root" -c . | docker import --change 'CMD ["python3"]' - "$name" >/dev/null
docker image inspect --format "{{.Size}}" "$name" | awk -v name="$name" '{printf "%s: %.0f MB\n", name, $1 / 1e6}'
