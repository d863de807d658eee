#!/usr/bin/env bash
# Brings the composed demo up, waits until it is seen to work, and leaves it running.
#
#   deploy/demo.sh          build if need be, start, check          deploy/demo.sh down       remove everything
#
# AEROSKEIN_PORT (8080) is where the page will be, on 127.0.0.1 only.
set -euo pipefail
cd "$(dirname "$0")/.."
export AEROSKEIN_IMAGE="${AEROSKEIN_IMAGE:-aeroskein:demo}" COMPOSE_PROJECT_NAME="${COMPOSE_PROJECT_NAME:-aeroskein}"
limit_s=300

if docker compose version >/dev/null 2>&1; then tool=(docker compose); else tool=(docker-compose); fi
compose() { "${tool[@]}" -f deploy/compose.yaml "$@"; }

if [ "${1:-}" = down ]; then
    compose down -v --remove-orphans
    exit
fi

tests/deploy/make_image.sh "$AEROSKEIN_IMAGE"
compose up -d --no-build

# Not healthy yet, one a line.
waiting() {
    docker ps -a --filter "label=com.docker.compose.project=$COMPOSE_PROJECT_NAME" --format '{{.Names}}: {{.Status}}' | grep -v '(healthy)'
}
# The consumer's newest point to which all sensors have contributed.
point() { compose logs --no-color --tail 2000 consumer | grep -E '"adsb":[1-9].*"radar1":[1-9]' | tail -1; }

began_s=$SECONDS
until [ -z "$(waiting)" ] && [ -n "$(point)" ]; do
    if [ $((SECONDS - began_s)) -gt "$limit_s" ]; then
        echo "not well after $limit_s s:" >&2
        waiting >&2 || true
        compose logs --tail 20 >&2
        exit 1
    fi
    sleep 2
done

echo
compose ps
echo
echo "a fused point, as the consumer got it:"
point | cut -d'|' -f2-
echo
echo "the page:          http://$(compose port web 8080)"
echo "all fused points:  ${tool[*]} -f deploy/compose.yaml logs -f consumer"
echo "the end:           deploy/demo.sh down"
