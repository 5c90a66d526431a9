#!/usr/bin/env python3
"""Runs 60 small scans and 12 bad inputs through everything that runs them, kills it, and compares every file. Half an hour on two cores.

long.py [--scans N] [--seed S] [PART…] runs some of the parts: shards, local, slurm, killed, drained, changes, recipes, container.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import slurm
from study import (COLVIS, PATIENCE, PLACE, SLURM, WORKFLOW, Clock, Study, changes, fresh, holds, jobs_of, lasting, missing, run, same,
                   statuses)

KILLS = 10
# Shots that end the workflow itself.
WHOLE = {"all", "Snakemake"}


def processes(word):
    """Returns the processes whose command has this word, as {number: command}."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if word in command and int(path.name) != os.getpid():
            found[int(path.name)] = command
    return found


def kill(pids):
    for pid in pids:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            pass


class Interrupted:
    """The workflow, killed at random and run again."""

    def __init__(self, study, out, chance, profile, options=(), environment=None):
        self.study, self.out, self.chance = study, out, chance
        self.profile, self.options, self.environment = profile, options, environment
        self.told = study.folder / f"{out.name}.txt"

    def start(self):
        with open(self.told, "ab") as to:
            return subprocess.Popen([str(w) for w in self.study.line(self.out, self.profile, "--nocolor", *self.options)],
                                    cwd=self.study.folder / "work", env=self.environment, stdin=subprocess.DEVNULL, stdout=to,
                                    stderr=to, start_new_session=True)

    def unlock(self):
        self.study.snakemake(self.out, "--unlock", *self.options, profile=self.profile, environment=self.environment)

    def killed(self, shots, seconds):
        """Shoots at one of `shots`, drawn, after a drawn time, ten times, and runs the workflow again if it was hit. A whole run takes so many
        seconds. Returns what was hit."""
        hit, snakemake = [], None
        while len(hit) < KILLS:
            if snakemake is None:
                snakemake = self.start()
                # Its first seconds make no case.
                time.sleep(2)
            try:
                snakemake.wait(self.chance.uniform(0, seconds / KILLS))
                holds(False, f"it runs until {KILLS} shots were fired: {self.told}")
            except subprocess.TimeoutExpired:
                pass
            name = self.chance.choice([*shots])
            hit.append(name)
            shots[name](snakemake)
            if name in WHOLE:
                # What is not dead yet ends in its way.
                snakemake.wait()
                self.unlock()
                snakemake = None
        if snakemake is not None:
            holds(snakemake.wait(PATIENCE) == 0, f"the workflow ends well: {self.told}")
        return hit

    def finish(self):
        """Runs it to its end, and once more for cases that were killed too often."""
        told = ""
        for _ in range(2):
            told = self.study.snakemake(self.out, *self.options, profile=self.profile, environment=self.environment)
            lost = [path for path in (self.out / "status").glob("[!.]*.json")
                    if re.search(r'"class": "(killed|memory|timeout)"', path.read_text())]
            for path in lost:
                path.unlink()
            if not lost:
                break
        return told


def killed_here(study, one, chance, seconds):
    out = study.folder / "killed"
    batch = lambda: [pid for pid, line in processes(str(out)).items() if " batch " in line and "case.py" not in line]
    shots = {
        "all": lambda snakemake: os.killpg(snakemake.pid, signal.SIGKILL),
        "Snakemake": lambda snakemake: kill([snakemake.pid]),
        "colvis": lambda _: kill(batch()[:1]),
        "jobs": lambda _: kill([pid for pid, line in processes(str(out)).items() if "case.py" in line]),
    }
    workflow = Interrupted(study, out, chance, "local", ["--resources", "mem_mb=4000"])
    hit = workflow.killed(shots, seconds)
    workflow.finish()
    same(one, lasting(out / "cases"), "one run and a killed one")
    return f"{len(hit)} kills: {', '.join(hit)}"


def killed_on_slurm(study, one, chance, seconds, cluster):
    """Snakemake, jobs, nodes' processes and colvis are killed, and a node is drained in the middle."""
    out = study.folder / "killed on Slurm"
    jobs = lambda: [line.split()[0] for line in cluster.running() if " RUNNING " in line]
    batch = lambda: [pid for pid, line in processes(str(out)).items() if " batch " in line and "case.py" not in line]

    def cancel(_):
        for job in jobs()[:1]:
            cluster.run("scancel", "--signal=KILL", "--full", job)

    def end(snakemake):
        kill([snakemake.pid])
        # As README says. Those that run go on.
        cluster.run("scancel", "--state=PENDING", f"--user={os.geteuid()}")

    drained = []

    def drain(_):
        state = "resume" if drained and drained[-1] == "drain" else "drain"
        drained.append(state)
        cluster.run("scontrol", "update", "NodeName=node1", f"State={state}", "Reason=test")

    shots = {"Snakemake": end, "a job": cancel, "colvis": lambda _: kill(batch()[:1]), "a node": drain}
    workflow = Interrupted(study, out, chance, "slurm", SLURM, cluster.environment)
    hit = workflow.killed(shots, seconds)
    if drained and drained[-1] == "drain":
        drain(None)
    workflow.finish()
    same(one, lasting(out / "cases"), "one run and a killed one on Slurm")
    return f"{len(hit)} kills: {', '.join(hit)}"


def drained(study, one, cluster):
    """A node is drained while cases run on both, and comes back."""
    out = study.folder / "drained"
    workflow = Interrupted(study, out, None, "slurm", SLURM, cluster.environment)
    snakemake = workflow.start()
    nodes = lambda: {line.split()[2] for line in cluster.running() if " RUNNING " in line}
    end = time.monotonic() + 120
    while len(nodes()) < 2 and time.monotonic() < end:
        time.sleep(0.2)
    holds(len(nodes()) == 2, "cases run on both nodes")
    cluster.run("scontrol", "update", "NodeName=node1", "State=drain", "Reason=test")
    time.sleep(45)
    holds(nodes() == {"node2"}, "a drained node gets no case")
    done = len(statuses(out))
    cluster.run("scontrol", "update", "NodeName=node1", "State=resume")
    holds(snakemake.wait(3600) == 0, f"the workflow ends well: {workflow.told}")
    holds("Trying to restart job" not in workflow.told.read_text(), "no case is lost with a drained node")
    same(one, lasting(out / "cases"), "one run and Slurm with a drained node")
    return f"drained for 45 s, {done} cases were done when it came back"


def recipes(study, one):
    """The lines of README for xargs."""
    text = (WORKFLOW / "README.md").read_text().split("## xargs")[1].split("\n## ")[0]
    programs = study.folder / "bin"
    programs.mkdir()
    (programs / "colvis").symlink_to(COLVIS)
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
    for n, lines in enumerate(re.findall(r"```sh\n(.*?)```", text, re.S)):
        out = f"recipe{n}"
        script = lines.replace("cases/", f"{out}/").replace("--jobs 1", f"--do {study.STEPS} --jobs 1")
        # xargs ends with 123 if cases failed.
        run(["bash", "-o", "pipefail", "-c", script], 123, study.folder, environment)
        same(one, lasting(study.folder / out), f"one run and {script}")


def container(study):
    """The steps of Containerfile, but for the build, in a change root of the same system."""
    if not shutil.which("debootstrap"):
        print("skipped: no debootstrap for a change root")
        return
    root = study.folder / "root"
    text = (WORKFLOW / "Containerfile").read_text().replace("\\\n", " ")
    _, stage = text.rsplit("\nFROM ", 1)
    system = re.match(r"docker.io/library/debian:(\w+)-slim", stage).group(1)
    # With /proc, which is gone with the last process.
    inside = ["unshare", "--mount", "sh", "-c", 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"', root]
    try:
        run(["debootstrap", "--variant=minbase", system, root])
        for line in stage.splitlines()[1:]:
            words = line.split()
            if words[:1] == ["RUN"]:
                run([*inside, "sh", "-c", line.removeprefix("RUN ")])
            elif words[:1] == ["COPY"]:
                *_, source, target = words
                source = COLVIS if source.endswith("release/colvis") else WORKFLOW.parent / source
                shutil.copy(source, f"{root}{target}")
        scans = root / "scans"
        scans.mkdir()
        shutil.copy(study.folder / study.rows[0]["path"], scans / "a.nii.gz")
        (scans / "scans.csv").write_text("id,path\na,a.nii.gz\n")
        run([*inside, "colvis", "batch", "/scans/scans.csv", "--out", "/scans/out", "--do", "segment"])
        holds((scans / "out" / "a" / "segment.nii.gz").exists(), "a case in the container")
    finally:
        shutil.rmtree(root, ignore_errors=True)


def main():
    parts = ["shards", "local", "slurm", "killed", "drained", "changes", "recipes", "container"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("parts", nargs="*", metavar="PART")
    args = parser.parse_args()
    wanted = args.parts or parts
    if unknown := {*wanted} - {*parts}:
        parser.error(f"unknown: {', '.join(unknown)}")
    if why := missing() or slurm.missing():
        sys.exit(f"FAILED: {why}")
    chance = random.Random(args.seed)
    clock = Clock()
    study = Study(fresh(PLACE / "long"), args.scans)
    study.add_bad_inputs()
    study.write()
    (study.folder / "work").mkdir()
    clock(f"{args.scans} scans and 12 bad inputs")
    print(study.batch(study.folder / "one", status=4).splitlines()[-2])
    one = lasting(study.folder / "one")
    clock(f"one run: {len(one)} files")
    if "shards" in wanted:
        for n in range(1, 5):
            study.batch(study.folder / "shards", "--shard", f"{n}/4")
        same(one, lasting(study.folder / "shards"), "one run and shards")
        clock("four shards")
    local = study.folder / "local"
    if {"local", "changes", "killed"} & {*wanted}:
        begun = time.monotonic()
        told = study.snakemake(local, "--resources", "mem_mb=8000")
        holds(jobs_of(told) == (len(study.rows), 1), "a job for each case")
        seconds = time.monotonic() - begun
        same(one, lasting(local / "cases"), "one run and Snakemake")
        clock("Snakemake")
    if "killed" in wanted:
        clock(f"Snakemake, killed: {killed_here(study, one, chance, seconds)}")
    if {"slurm", "killed", "drained"} & {*wanted}:
        with slurm.Slurm(study.folder / "slurm") as cluster:
            if {"slurm", "killed"} & {*wanted}:
                begun = time.monotonic()
                study.snakemake(study.folder / "cluster", *SLURM, profile="slurm", environment=cluster.environment)
                seconds = time.monotonic() - begun
                same(one, lasting(study.folder / "cluster" / "cases"), "one run and Slurm")
                clock("Slurm")
            if "drained" in wanted:
                clock(f"Slurm: {drained(study, one, cluster)}")
            if "killed" in wanted:
                clock(f"Slurm, killed: {killed_on_slurm(study, one, chance, seconds, cluster)}")
    if "recipes" in wanted:
        recipes(study, one)
        clock("recipes")
    if "container" in wanted:
        container(study)
        clock("container")
    if "changes" in wanted:
        changes(study, local, local / "cases")
        clock("changes")
    clock.end()


if __name__ == "__main__":
    main()
