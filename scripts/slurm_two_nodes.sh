#!/bin/bash
# Runs a job's folder on a Slurm cluster of two nodes that lives as long as this script, on this machine alone:
#   BULBFOLD=target/release/bulbfold scripts/slurm_two_nodes.sh JOB [kill]
# With `kill` the first node dies in the middle of its work, with everything that runs on it. Needs root, for nodes are process
# namespaces, and Debian's slurmctld, slurmd, slurm-client and munge. Nothing of a Slurm that is installed here is touched.
set -euo pipefail

job=$(realpath "$1")
kills=${2:-}
BULBFOLD=$(realpath "${BULBFOLD:-$(command -v bulbfold)}")
export BULBFOLD
folder=$(mktemp -d "${TMPDIR:-/tmp}/slurm.XXXXXX")
export SLURM_CONF=$folder/slurm.conf
started=()

clean() {
    for pid in "${started[@]}"; do
        [ -z "$pid" ] || kill -9 "$pid" 2>/dev/null || true
    done
    wait 2>/dev/null || true
    rm -rf "$folder"
}
trap clean EXIT

fail() {
    echo "$1" >&2
    tail -n 20 "$folder"/*.log "$job"/slurm_*.log >&2 || true
    exit 1
}

# Three ports that nobody listens at.
free=$(python3 -c 'import socket
all = [socket.socket() for _ in range(3)]
[one.bind(("127.0.0.1", 0)) for one in all]
print(*[one.getsockname()[1] for one in all])')
read -r control first second <<<"$free"

mkdir "$folder/state" "$folder/munge"
chmod 755 "$folder"
head -c 128 /dev/urandom >"$folder/munge/key"
chmod 400 "$folder/munge/key"
chmod 700 "$folder/munge"
cat >"$SLURM_CONF" <<END
ClusterName=two
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$control
SlurmUser=root
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket=$folder/socket,cred_expire=5
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool.%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.%n.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/linear
JobRequeue=1
ReturnToService=1
SlurmdTimeout=5
MessageTimeout=5
KillWait=1
SchedulerParameters=sched_interval=1,batch_sched_delay=1,sched_min_interval=100000
MailProg=/bin/true
NodeName=node1 NodeHostname=$(hostname -s) NodeAddr=127.0.0.1 Port=$first CPUs=1
NodeName=node2 NodeHostname=$(hostname -s) NodeAddr=127.0.0.1 Port=$second CPUs=1
PartitionName=two Nodes=node1,node2 Default=YES State=UP
END

munged --foreground --force --socket="$folder/socket" --key-file="$folder/munge/key" --pid-file="$folder/munge/pid" \
    --log-file="$folder/munge.log" --seed-file="$folder/munge/seed" 2>"$folder/munged.log" &
started+=($!)
for _ in $(seq 50); do
    [ -S "$folder/socket" ] && break
    sleep 0.1
done
slurmctld -D -c >/dev/null 2>&1 &
started+=($!)

# A node is a process namespace: when its first process dies, all others do.
node() {
    unshare --fork --pid --mount-proc --kill-child slurmd -D -N "$1" >/dev/null 2>&1 &
    started+=($!)
}
node node1
node1=$!
node node2
for _ in $(seq 100); do
    [ "$(sinfo --noheader --Node --format=%t 2>/dev/null | grep -c idle)" = 2 ] && break
    sleep 0.2
done
[ "$(sinfo --noheader --Node --format=%t | grep -c idle)" = 2 ] || fail "the nodes do not come up"

id=$(sh "$job/slurm_submit.sh" | tail -n 1)
id=${id%%;*}
count() { find "$job/parts" -name "*.$1" 2>/dev/null | wc -l; }
if [ "$kills" = kill ]; then
    # In the middle: some parts are there, and the first node is at another.
    for _ in $(seq 1200); do
        [ "$(count part)" -ge 2 ] && [ -n "$(squeue --noheader --nodelist=node1 --states=running)" ] && [ "$(count work)" -ge 1 ] && break
        sleep 0.05
    done
    echo "node1 dies at $(count part) parts, $(squeue --noheader --nodelist=node1 --states=running --format='task %K' | tr '\n' ' ')"
    kill -9 "$node1"
    wait "$node1" 2>/dev/null || true
    started=("${started[@]/$node1/}")
fi

state() { scontrol show job "$id" 2>/dev/null | sed -n 's/.*JobState=\([A-Z_]*\).*/\1/p' | head -n 1; }
for _ in $(seq 36000); do
    case $(state) in
        COMPLETED) break ;;
        FAILED | CANCELLED | NODE_FAIL | TIMEOUT | OUT_OF_MEMORY) fail "the join is $(state)" ;;
    esac
    sleep 0.1
done
[ "$(state)" = COMPLETED ] || fail "the join does not end: $(squeue)"
echo "requeued: $(grep -c 'requeue' "$folder/slurmctld.log" || true)"
cat "$job"/slurm_join_*.log
