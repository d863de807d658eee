#!/usr/bin/env bash
# Makes an authority and a certificate for every participant, for tests and for sites without an authority of their own.
#
#   make_certificates.sh FOLDER NAME...      make what is missing; NAME is the identity in the access rules
#   make_certificates.sh --renew FOLDER NAME...    new certificates for these names, same authority
#   make_certificates.sh --check FOLDER [DAYS]     fail if one of them expires within DAYS (30)
#
# `docker compose --profile secure` runs it in a container (service `certificates`), with a volume for each participant.
# FOLDER/NAME/ gets ca.pem, cert.pem and key.pem: what is mounted into that participant's container, and nothing else.
# FOLDER/authority/ holds the authority's key; it belongs on another machine, and in no container.
# AUTHORITY_DAYS (3650), DAYS (365) and ROUTER_NAMES (router, localhost and 127.0.0.1) may be set.
set -euo pipefail

mode=make
case "${1:-}" in --renew | --check) mode="${1#--}"; shift ;; esac
folder="${1:?a folder is missing}"
shift
authority="$folder/authority"
days="${DAYS:-365}"
router_names="${ROUTER_NAMES:-DNS:router,DNS:localhost,IP:127.0.0.1}"
umask 077

new_key() { openssl ecparam -name prime256v1 -genkey -noout -out "$1"; }

if [ "$mode" = check ]; then
    within=$(("${1:-30}" * 86400))
    failed=0
    for certificate in "$folder"/*/cert.pem "$folder"/*/ca.pem; do
        if ! openssl x509 -checkend "$within" -noout -in "$certificate" >/dev/null; then
            echo "$certificate: $(openssl x509 -enddate -noout -in "$certificate")" >&2
            failed=1
        fi
    done
    exit "$failed"
fi

wanted=()
for name in "$@"; do
    if [ "$mode" = renew ] || [ ! -e "$folder/$name/cert.pem" ]; then wanted+=("$name"); fi
done
if [ "${#wanted[@]}" = 0 ]; then exit; fi

if [ ! -e "$folder" ]; then
    mkdir -p "$folder"
    chmod 0711 "$folder"
fi
if [ ! -e "$authority/ca.key" ]; then
    mkdir -p "$authority"
    new_key "$authority/ca.key"
    openssl req -x509 -new -sha256 -key "$authority/ca.key" -days "${AUTHORITY_DAYS:-3650}" \
        -subj "/CN=aeroskein authority" -addext "basicConstraints=critical,CA:TRUE,pathlen:0" \
        -addext "keyUsage=critical,keyCertSign,cRLSign" -out "$authority/ca.pem"
fi

for name in "${wanted[@]}"; do
    own="$folder/$name"
    mkdir -p "$own"
    new_key "$own/key.pem.new"
    usage=clientAuth
    names="DNS:$name"
    # The router is a server too, and is called by the names in the endpoints of the others.
    if [ "$name" = router ]; then
        usage=serverAuth,clientAuth
        names="$router_names"
    fi
    openssl req -new -sha256 -key "$own/key.pem.new" -subj "/CN=$name" |
        openssl x509 -req -sha256 -days "$days" -CA "$authority/ca.pem" -CAkey "$authority/ca.key" \
            -set_serial "0x$(openssl rand -hex 16)" -out "$own/cert.pem.new" -extfile <(
            printf 'basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\n'
            printf 'extendedKeyUsage=%s\nsubjectAltName=%s\n' "$usage" "$names"
        ) 2>/dev/null
    mv "$own/key.pem.new" "$own/key.pem"
    mv "$own/cert.pem.new" "$own/cert.pem"
    cp "$authority/ca.pem" "$own/ca.pem"
done

# The containers' user has to read its key: by the group, which is the containers' own where we may set it.
group=10001
if [ "$(id -u)" != 0 ]; then
    group="$(id -g)"
    echo "export AEROSKEIN_KEY_GROUP=$group    # for compose.yaml"
fi
for name in "${wanted[@]}"; do
    chgrp -R "$group" "$folder/$name"
    chmod 0750 "$folder/$name"
    chmod 0640 "$folder/$name"/*.pem
done
