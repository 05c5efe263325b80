#!/bin/sh
# Make what `--tls DIR` expects: ca.pem, and NAME.pem with NAME.key for every process.
#
#   deploy/certificates.sh DIR [--hosts HOST,...] [--days DAYS] ROBOT...
#   deploy/certificates.sh /tmp/tls --hosts world.lab,192.168.1.10 leader robot1 robot2
#
# `world`, `supervisor` and `router` are always made, robots by their names in the scenario. The
# name is the certificate's common name, by which router/secure.json5 knows a robot. Every
# certificate is good for 127.0.0.1, ::1, localhost and the given hosts; a client checks that the
# host it dials is among them.
#
# What is in DIR already is kept: call it again with more names to add robots, remove NAME.pem to
# have it made anew. ca.key signs; it belongs on no robot. Exit codes: 0 done, 1 openssl failed,
# 2 usage.

set -eu
umask 077 # keys are for their owner alone

days=397
hosts=127.0.0.1,::1,localhost

fail() {
    echo "certificates.sh: $1" >&2
    exit 2
}

usage="expected DIR [--hosts HOST,...] [--days DAYS] ROBOT..."
directory=
robots=
while [ $# -gt 0 ]; do
    case $1 in
        --hosts) hosts="$hosts,${2:?$usage}" && shift ;;
        --days) days=${2:?$usage} && shift ;;
        -*) fail "$usage, got $1" ;;
        *) if [ -z "$directory" ]; then directory=$1; else robots="$robots $1"; fi ;;
    esac
    shift
done
[ -n "$directory" ] || fail "$usage, got no DIR"
case $days in *[!0-9]* | 0*) fail "expected --days as a number above 0, got '$days'" ;; esac
for robot in $robots; do
    # the same names as in a scenario; they become file names and common names
    printf '%s\n' "$robot" | grep -Eqx '[a-z][a-z0-9_-]{0,31}' ||
        fail "expected a robot's name such as robot3, got '$robot'"
done

# one subjectAltName entry per host
names=
for host in $(printf '%s' "$hosts" | tr ',' ' '); do
    if printf '%s\n' "$host" | grep -Eqx '[0-9]+(\.[0-9]+){3}|[0-9a-fA-F:]*:[0-9a-fA-F:.]*'; then
        names="$names,IP:$host"
    elif printf '%s\n' "$host" | grep -Eqx '[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?'; then
        names="$names,DNS:$host"
    else
        fail "expected --hosts as names or addresses with commas between, got '$host'"
    fi
done
names=${names#,}

mkdir -p "$directory"
work=$(mktemp -d "$directory/.making.XXXXXX") # same file system, so that mv replaces in one step
trap 'rm -rf "$work"' EXIT

new_key() {
    openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out "$1" 2>"$work/said" ||
        { cat "$work/said" >&2 && exit 1; }
}

if [ ! -f "$directory/ca.pem" ] || [ ! -f "$directory/ca.key" ]; then
    [ ! -f "$directory/ca.pem" ] ||
        fail "expected $directory/ca.key beside ca.pem to sign with, got none"
    new_key "$work/ca.key"
    openssl req -x509 -new -key "$work/ca.key" -sha256 -days "$days" -out "$work/ca.pem" \
        -subj "/CN=msam-swarm authority" \
        -addext "basicConstraints=critical,CA:TRUE,pathlen:0" \
        -addext "keyUsage=critical,keyCertSign,cRLSign"
    mv "$work/ca.key" "$work/ca.pem" "$directory"
    echo "made ca.pem, ca.key"
fi

for name in world supervisor router $robots; do
    if [ -f "$directory/$name.pem" ] && [ -f "$directory/$name.key" ]; then
        echo "kept $name.pem, $name.key"
        continue
    fi
    new_key "$work/$name.key"
    openssl req -new -key "$work/$name.key" -subj "/CN=$name" -out "$work/$name.csr"
    # only these listen; with its own certificate no robot can pose as the world to another one
    case $name in
        world | router) usage_extended="serverAuth, clientAuth" ;; # a world dials with --router
        *) usage_extended=clientAuth ;;
    esac
    cat >"$work/extensions" <<END
basicConstraints = critical, CA:FALSE
keyUsage = critical, digitalSignature
extendedKeyUsage = $usage_extended
subjectAltName = $names
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
END
    openssl x509 -req -in "$work/$name.csr" -CA "$directory/ca.pem" -CAkey "$directory/ca.key" \
        -set_serial "0x$(openssl rand -hex 16)" -sha256 -days "$days" \
        -extfile "$work/extensions" -out "$work/$name.pem" 2>"$work/said" ||
        { cat "$work/said" >&2 && exit 1; }
    mv "$work/$name.key" "$work/$name.pem" "$directory"
    echo "made $name.pem, $name.key"
done
chmod 644 "$directory"/*.pem
