#!/usr/bin/env python3
"""Measures how many faults the tests notice: changes the program at drawn places with `cargo mutants`, and runs the tests.

    cargo install --locked cargo-mutants
    python3 tests/bench/mutants.py --out OUT/ [--seed 1] [--count 100] [--folder render] [--jobs 2] [--list]

Draws --count mutants of `src` and `systems` (settings: .cargo/mutants.toml) with --seed, from each folder in proportion to the
square root of its number of mutants, or all from one --folder. Each job works on a copy of the last commit, in a worktree below
`target/mutation`, with a target folder of its own, so that builds are incremental and the checkout stays as it is. The tests run in
three stages; a mutant that one stage has noticed does not meet the next:

1. unit:        the unit tests of its folder
2. integration: all other tests, without those that compare a whole flight or picture with a stored one
3. digest:      those

A mutant that does not compile is replaced by the next one drawn. A test that exceeds its time has noticed the mutant. Results are
appended to OUT/results.jsonl, where a run that was interrupted continues, and OUT/survivors.txt and OUT/table.md are written from
them at the end. On two cores a mutant takes about a minute in the first stage and five in the second.

--stage  ends after this stage
--list   prints the sample and runs nothing
--table  prints one table of several runs
"""

import argparse
import collections
import json
import math
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import threading

ROOT = pathlib.Path(__file__).resolve().parents[2]
WORK = ROOT / "target/mutation"

# Folders of the table: the paths that belong to each.
FOLDERS = {
    "render": ["src/render", "src/surface"],
    "space, math": ["src/space", "src/math"],
    "fields": ["src/fields"],
    "dynamics": ["src/dynamics"],
    "volume": ["src/volume"],
    "systems": ["systems", "src/components"],
    "app, schedule": ["src/app", "src/schedule", "src/error.rs", "src/panics.rs", "src/progress.rs", "src/memory.rs"],
    "host": ["src/host"],
    "cli, output": ["src/cli", "src/output"],
    "phantom": ["src/phantom"],
    "plane": ["src/plane"],
}
# Tests that compare a whole flight or picture with a stored one.
DIGESTS = ["digests", "golden", "pictures::"]
STAGES = ["unit", "integration", "digest"]
# Longest run of a stage's tests, seconds, with as many jobs as cores.
TIMEOUT = {"unit": 240, "integration": 1500, "digest": 400}


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--out", type=pathlib.Path)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--count", type=int, default=100)
    p.add_argument("--folder", choices=sorted({f for name in FOLDERS for f in name.split(", ")}))
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--stage", choices=STAGES, default=STAGES[-1])
    p.add_argument("--list", action="store_true")
    p.add_argument("--table", nargs="+", type=pathlib.Path, metavar="OUT")
    a = p.parse_args()
    if not (a.out or a.list or a.table):
        p.error("--out is needed")
    return a


def path_of(mutant):
    return os.path.normpath(mutant["file"]) if not mutant["file"].startswith("src/../") else mutant["file"][len("src/../"):]


def folder_of(mutant):
    path = path_of(mutant)
    for name, paths in FOLDERS.items():
        if any(path.startswith(p) for p in paths):
            return name
    return "app, schedule"


def all_mutants():
    listed = subprocess.run(["cargo", "mutants", "--list", "--json"], cwd=ROOT, check=True, stdout=subprocess.PIPE)
    mutants = json.loads(listed.stdout)
    for n, mutant in enumerate(mutants):
        # One shard for each mutant selects it. (`--re` also selects each field that can be left out of a struct.)
        mutant["shard"] = f"{n}/{len(mutants)}"
    return mutants


def sample(mutants, seed, count, folder):
    """Returns, for each folder, the number of mutants wanted and all its mutants in the order in which they are drawn."""
    groups = collections.defaultdict(list)
    for m in mutants:
        groups[folder_of(m)].append(m)
    if folder:
        groups = {name: group for name, group in groups.items() if folder in name.split(", ")}
    total = sum(math.sqrt(len(g)) for g in groups.values())
    shares = {name: count * math.sqrt(len(group)) / total for name, group in groups.items()}
    wanted = {name: int(share) for name, share in shares.items()}
    for name in sorted(shares, key=lambda n: (wanted[n] - shares[n], n))[: count - sum(wanted.values())]:
        wanted[name] += 1
    drawn = {}
    for name in sorted(groups):
        order = sorted(groups[name], key=lambda m: m["name"])
        random.Random(f"{seed} {name}").shuffle(order)
        drawn[name] = (wanted[name], order)
    return drawn


def tests_of(stage, folder):
    """Returns the test binaries of a stage, and the names of its tests."""
    modules = [re.sub(r"^src/", "", p).removesuffix(".rs").replace("/", "::") for p in FOLDERS[folder]]
    if stage == "unit":
        return ["--lib"], [*(f"{m}::" for m in modules), *(f"--skip={d}" for d in DIGESTS)]
    binaries = ["formats", "flights", "pictures", "program"] + (["window"] if folder == "host" else [])
    chosen = ["--lib"] + [f"--test={b}" for b in binaries]
    if stage == "integration":
        return chosen, [f"--skip={d}" for d in DIGESTS]
    return ["--lib", "--test=flights", "--test=pictures"], DIGESTS


class Worker(threading.Thread):
    """Runs mutants on a copy of the last commit."""

    def __init__(self, number, queue, out, write):
        super().__init__()
        self.tree = WORK / f"tree-{number}"
        self.queue, self.out, self.write, self.logs = queue, out, write, out / f"logs-{number}"

    def prepare(self):
        git = ["git", "-C", str(ROOT)]
        if not self.tree.exists():
            subprocess.run([*git, "worktree", "prune"], check=True)
            subprocess.run([*git, "worktree", "add", "--quiet", "--detach", str(self.tree), "HEAD"], check=True)
            # The dependencies need not be built again. Cargo never changes a library in place.
            for folder in ("deps", "build", ".fingerprint"):
                built = ROOT / "target/quick" / folder
                if built.exists():
                    link = shutil.copy2 if folder == ".fingerprint" else os.link
                    shutil.copytree(built, self.tree / "target/quick" / folder, copy_function=link)
        head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
        subprocess.run(["git", "checkout", "--quiet", "--force", "--detach", head], cwd=self.tree, check=True)

    def run(self):
        self.prepare()
        while (taken := self.queue()) is not None:
            stage, folder, mutant = taken
            outcome, by = self.stage(stage, mutant, folder)
            self.write({"folder": folder, "mutant": mutant["name"], "stage": stage, "outcome": outcome, "by": by})

    def stage(self, stage, mutant, folder):
        """Runs a stage's tests. Returns "noticed", "missed" or "unviable", and the first test that failed."""
        shutil.rmtree(self.logs, ignore_errors=True)
        self.logs.mkdir(parents=True)
        environment = dict(os.environ, CARGO_INCREMENTAL="1", CARGO_TARGET_DIR=str(self.tree / "target"))
        environment.setdefault("COLVIS_TEST_DATA", str(ROOT.parent / "shared/data"))
        binaries, names = tests_of(stage, folder)
        command = ["cargo", "mutants", "--in-place", "--baseline=skip", f"--timeout={TIMEOUT[stage]}", "--build-timeout=900",
                   "--shard", mutant["shard"], "--output", str(self.logs),
                   *(f"--cargo-arg={b}" for b in binaries), "--", "--", *names]
        with open(self.out / "cargo-mutants.log", "ab") as log:
            subprocess.run(command, cwd=self.tree, env=environment, stdout=log, stderr=log)
        outcomes = json.loads((self.logs / "mutants.out/outcomes.json").read_text())["outcomes"]
        if not outcomes:
            return "unviable", "not found"
        summary = outcomes[0]["summary"]
        if summary == "Unviable":
            return "unviable", ""
        if summary == "Timeout":
            return "noticed", "time"
        if summary == "MissedMutant":
            return "missed", ""
        text = (self.logs / "mutants.out" / outcomes[0]["log_path"]).read_text(errors="replace")
        failed = re.search(r"^test (\S+) (?:- should panic )?\.\.\. FAILED", text, re.M)
        return "noticed", failed.group(1) if failed else "a binary that ended"


def lines_of(out):
    path = out / "results.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def results(out):
    """Returns (folder, the stage that noticed it or "missed") of each mutant that is settled."""
    settled = {}
    for line in lines_of(out):
        if line["outcome"] == "noticed":
            settled[line["mutant"]] = (line["folder"], line["stage"])
        elif line["outcome"] == "missed" and line["stage"] == STAGES[-1]:
            settled[line["mutant"]] = (line["folder"], "missed")
    return settled


class Plan:
    """Which mutant meets which tests next."""

    def __init__(self, a):
        self.drawn = sample(all_mutants(), a.seed, a.count, a.folder)
        self.stages = STAGES[: STAGES.index(a.stage) + 1]
        self.out, self.lock = a.out, threading.Condition()
        self.done = {(line["mutant"], line["stage"]): line["outcome"] for line in lines_of(a.out)}
        self.taken = set()

    def chosen(self):
        """Returns the sample: those drawn first, without those that do not compile."""
        for name, (wanted, order) in self.drawn.items():
            viable = (m for m in order if self.done.get((m["name"], STAGES[0])) != "unviable")
            yield from ((name, m) for m, _ in zip(viable, range(wanted)))

    def next(self):
        with self.lock:
            for stage in self.stages:
                while True:
                    waits = False
                    for folder, m in self.chosen():
                        key, before = (m["name"], stage), STAGES[: STAGES.index(stage)]
                        if key in self.done or any(self.done.get((m["name"], b)) != "missed" for b in before):
                            continue
                        if key not in self.taken:
                            self.taken.add(key)
                            return stage, folder, m
                        waits = True
                    if not waits:
                        break
                    # Another worker may find that a mutant does not compile or goes on to the next stage.
                    self.lock.wait()
        return None

    def write(self, line):
        with self.lock:
            self.done[line["mutant"], line["stage"]] = line["outcome"]
            with open(self.out / "results.jsonl", "a") as f:
                f.write(json.dumps(line) + "\n")
            print(f"{line['stage']:12} {line['outcome']:8} {line['mutant']}  {line['by']}", flush=True)
            self.lock.notify_all()


def run(a):
    if subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "src", "systems"], cwd=ROOT).returncode:
        sys.exit("src or systems differ from the last commit: commit them first")
    a.out.mkdir(parents=True, exist_ok=True)
    plan = Plan(a)
    workers = [Worker(n, plan.next, a.out, plan.write) for n in range(a.jobs)]
    for w in workers:
        w.start()
    for w in workers:
        w.join()
    missed = [line["mutant"] for line in lines_of(a.out) if line["stage"] == a.stage and line["outcome"] == "missed"]
    (a.out / "survivors.txt").write_text("".join(f"{m}\n" for m in missed))
    (a.out / "table.md").write_text(table([a.out]))
    print((a.out / "table.md").read_text())


def table(outs):
    rows = collections.defaultdict(collections.Counter)
    for out in outs:
        for folder, noticed in results(out).values():
            rows[folder][noticed] += 1
    lines = ["| folder | mutants | by a unit test | by another test | by a digest alone | not noticed | noticed |",
             "|---|---|---|---|---|---|---|"]

    def row(name, n):
        count = sum(n.values())
        noticed = 100 * (count - n["missed"]) / count if count else 0
        lines.append(f"| {name} | {count} | {n['unit']} | {n['integration']} | {n['digest']} | {n['missed']} | {noticed:.0f} % |")

    for name in FOLDERS:
        if name in rows:
            row(name, rows[name])
    row("all", sum(rows.values(), collections.Counter()))
    return "\n".join(lines) + "\n"


def main():
    a = arguments()
    if a.table:
        print(table(a.table), end="")
    elif a.list:
        for name, (wanted, order) in sample(all_mutants(), a.seed, a.count, a.folder).items():
            for m in order[:wanted]:
                print(f"{name:14} {m['name']}")
    else:
        run(a)


if __name__ == "__main__":
    sys.exit(main())
