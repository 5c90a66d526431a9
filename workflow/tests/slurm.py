"""A Slurm of its own: two nodes on this machine, in a folder of its own, with ports and keys of its own, and nothing left behind."""

import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

DAEMONS = ["munged", "slurmctld", "slurmd"]
NODES = ["node1", "node2"]


def program(name):
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


def missing():
    """Returns why there can be no Slurm here, or None."""
    lacking = [name for name in [*DAEMONS, "sbatch", "squeue", "scontrol"] if not program(name)]
    if lacking:
        return f"no {', '.join(lacking)}"
    if os.geteuid() != 0:
        return "Slurm's daemons need root"
    return None


class Slurm:
    """`with Slurm(folder, cores, memory_mb) as slurm:` runs it; `slurm.environment` is that of its clients."""

    def __init__(self, folder, cores=2, memory_mb=4000):
        self.folder = Path(folder).resolve()
        self.cores, self.memory_mb = cores, memory_mb
        self.daemons = []
        # Snakemake's plugin takes SLURM_CONF away from the srun inside of a job.
        self.programs = self.folder / "bin"
        path = f"{self.programs}:{os.environ.get('PATH', '')}"
        self.environment = {**os.environ, "SLURM_CONF": str(self.folder / "slurm.conf"), "PATH": path}

    def __enter__(self):
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, *_):
        self._stop()

    def run(self, *line):
        return subprocess.run(line, env=self.environment, check=True, capture_output=True, text=True).stdout

    def running(self):
        """Returns the jobs that are waiting or running."""
        return self.run("squeue", "--noheader", "--format=%i %T %N").splitlines()

    def _start(self):
        self.folder.mkdir(parents=True, mode=0o755)
        for name in ["state", *(f"spool.{node}" for node in NODES)]:
            (self.folder / name).mkdir()
        self.programs.mkdir()
        srun = self.programs / "srun"
        srun.write_text(f"#!/bin/sh\nSLURM_CONF='{self.folder}/slurm.conf' exec {program('srun')} \"$@\"\n")
        srun.chmod(0o755)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        sockets, ports = [socket.socket() for _ in range(3)], []
        for one in sockets:
            one.bind(("127.0.0.1", 0))
            ports.append(one.getsockname()[1])
        for one in sockets:
            one.close()
        self._write(ports)
        at = lambda name: f"{self.folder}/{name}"
        # --force: its folder may lie below one that others may write to, such as /tmp.
        self._daemon("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={at('munge.socket')}",
                     f"--pid-file={at('munged.pid')}", f"--log-file={at('munged.log')}", f"--seed-file={at('munge.seed')}")
        self._until(lambda: (self.folder / "munge.socket").exists(), "munged")
        self._daemon("slurmctld", "-D", "-i")
        for node in NODES:
            self._daemon("slurmd", "-D", "-N", node)
        self._until(lambda: self._idle() == len(NODES), "the nodes")

    def _idle(self):
        asked = subprocess.run(["sinfo", "--noheader", "--Node", "--format=%N %T"], env=self.environment,
                               capture_output=True, text=True)
        return sum(line.endswith(" idle") for line in asked.stdout.splitlines())

    def _write(self, ports):
        control, *of_nodes = ports
        lines = [
            "ClusterName=test",
            f"SlurmctldHost={socket.gethostname()}(127.0.0.1)",
            f"SlurmctldPort={control}",
            "SlurmUser=root",
            "SlurmdUser=root",
            "AuthType=auth/munge",
            "CredType=cred/munge",
            f"AuthInfo=socket={self.folder}/munge.socket",
            f"StateSaveLocation={self.folder}/state",
            f"SlurmdSpoolDir={self.folder}/spool.%n",
            f"SlurmctldPidFile={self.folder}/slurmctld.pid",
            f"SlurmdPidFile={self.folder}/slurmd.%n.pid",
            f"SlurmctldLogFile={self.folder}/slurmctld.log",
            f"SlurmdLogFile={self.folder}/slurmd.%n.log",
            "ProctrackType=proctrack/linuxproc",
            "TaskPlugin=task/none",
            "MpiDefault=none",
            "AccountingStorageType=accounting_storage/none",
            "JobAcctGatherType=jobacct_gather/linux",
            "JobAcctGatherFrequency=task=1",
            "SelectType=select/cons_tres",
            "SelectTypeParameters=CR_CPU_Memory",
            "SlurmdParameters=config_overrides",
            "SchedulerParameters=sched_interval=1,batch_sched_delay=0,sched_min_interval=0",
            "ReturnToService=2",
            "KillWait=2",
        ]
        for node, port in zip(NODES, of_nodes):
            # The machine's cores, shared by both.
            lines.append(f"NodeName={node} NodeHostname={socket.gethostname()} NodeAddr=127.0.0.1 Port={port} "
                         f"CPUs={self.cores} RealMemory={self.memory_mb} State=UNKNOWN")
        lines.append("PartitionName=here Nodes=ALL Default=YES MaxTime=INFINITE State=UP")
        (self.folder / "slurm.conf").write_text("\n".join(lines) + "\n")

    def _daemon(self, name, *options):
        with open(self.folder / f"{name}.out", "ab") as out:
            self.daemons.append(subprocess.Popen([program(name), *options], env=self.environment, stdin=subprocess.DEVNULL,
                                                 stdout=out, stderr=out, start_new_session=True))

    def _until(self, is_so, what, seconds=30):
        end = time.monotonic() + seconds
        while not is_so():
            ended = [d.args[0] for d in self.daemons if d.poll() is not None]
            if ended or time.monotonic() > end:
                logs = [p.read_text(errors="replace")[-2000:] for p in self.folder.glob("*.[lo][ou][gt]")]
                raise RuntimeError(f"Slurm does not start: {what}; ended: {ended}\n" + "\n".join(logs))
            time.sleep(0.1)

    def _stop(self):
        if (self.folder / "slurm.conf").exists():
            subprocess.run(["scancel", "--state=PENDING,RUNNING", f"--user={os.geteuid()}"], env=self.environment,
                           capture_output=True, timeout=30)
            end = time.monotonic() + 15
            while self.daemons and time.monotonic() < end:
                left = subprocess.run(["squeue", "--noheader"], env=self.environment, capture_output=True, text=True)
                if left.returncode != 0 or not left.stdout.strip():
                    break
                time.sleep(0.2)
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        self.daemons = []


if __name__ == "__main__":
    # For trying things out: slurm.py FOLDER COMMAND…
    with Slurm(sys.argv[1]) as slurm:
        sys.exit(subprocess.run(sys.argv[2:], env=slurm.environment).returncode)
