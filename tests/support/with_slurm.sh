#!/usr/bin/env bash
# Starts a Slurm of its own on this machine (munged, slurmctld, slurmd), runs a command with it, and ends it.
#
# Usage: tests/support/with_slurm.sh COMMAND [ARGUMENT]...
# Exit status: the command's, or 77 where Slurm is not installed or does not start here.
set -euo pipefail
for program in munged slurmctld slurmd sbatch; do
  command -v $program > /dev/null || { echo "$program is not installed" >&2; exit 77; }
done
home=$(mktemp -d)
# Its daemons look for their folders as others.
chmod 755 "$home"
stop() {
  for daemon in slurmd slurmctld munged; do
    [[ ! -f $home/$daemon.pid ]] || kill "$(cat "$home/$daemon.pid")" 2> /dev/null || true
  done
  sleep 0.5
  rm -rf "$home"
}
trap stop EXIT
mkdir -m 755 "$home/munge" "$home/state" "$home/spool"
(umask 077 && head -c 1024 /dev/urandom > "$home/munge.key")
munged --key-file="$home/munge.key" --socket="$home/munge/socket" --pid-file="$home/munged.pid" \
  --log-file="$home/munged.log" --seed-file="$home/munge.seed" --force 2> /dev/null || exit 77
# Ports that nobody listens at are likely among so many.
port=$((20000 + $$ % 20000))
host=$(hostname -s)
cat > "$home/slurm.conf" <<END
ClusterName=here
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$home/munge/socket
CredType=cred/munge
SlurmctldPort=$port
SlurmdPort=$((port + 1))
StateSaveLocation=$home/state
SlurmdSpoolDir=$home/spool
SlurmctldPidFile=$home/slurmctld.pid
SlurmdPidFile=$home/slurmd.pid
SlurmctldLogFile=$home/slurmctld.log
SlurmdLogFile=$home/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
SchedulerParameters=sched_interval=1
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=$host Default=YES State=UP
END
export SLURM_CONF=$home/slurm.conf
slurmctld && slurmd || exit 77
for ((i = 0; i < 60; ++i)); do
  [[ $(sinfo -h -o %T 2> /dev/null) == idle ]] && break
  sleep 0.25
done
[[ $(sinfo -h -o %T 2> /dev/null) == idle ]] || { tail "$home"/*.log >&2; exit 77; }
"$@"
