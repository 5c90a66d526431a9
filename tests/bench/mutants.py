#!/usr/bin/env python3
"""Measures how many faults the tests notice: changes the program at drawn places with `cargo mutants`, and runs the tests.

    cargo install --locked cargo-mutants
    python3 tests/bench/mutants.py --out OUT/ [--seed 1] [--count 100] [--folder render] [--jobs 2] [--list]

Draws --count mutants of `src` and `systems` (settings: .cargo/mutants.toml) with --seed, from each folder in proportion to the
square root of its number of mutants, or all from one --folder. Each job works on a copy of the last commit, in a worktree below
`target/mutants`, with a target folder of its own, so that builds are incremental and the checkout stays as it is. Each mutant meets
the tests in this order, until one fails:

1. unit:        the unit tests of its folder
2. integration: all other tests, without those that compare a whole flight or picture with a stored one
3. digest:      those

A mutant that does not compile is replaced by the next one drawn. A test that exceeds its time has noticed the mutant. Results are
appended to OUT/results.jsonl, where a run that was interrupted continues, and OUT/survivors.txt and OUT/table.md are written from
them at the end. About a minute a mutant on two cores, five if only digests or nothing notices it.

--list prints the sample and runs nothing. --table OUT... prints one table of several runs.
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
WORK = ROOT / "target/mutants"

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
    """Returns the arguments of `cargo test` for a stage."""
    modules = [re.sub(r"^src/", "", p).removesuffix(".rs").replace("/", "::") for p in FOLDERS[folder]]
    if stage == "unit":
        return ["--lib", "--", *(f"{m}::" for m in modules), *(f"--skip={d}" for d in DIGESTS)]
    binaries = ["formats", "flights", "pictures", "program"] + (["window"] if folder == "host" else [])
    chosen = ["--lib"] + [f"--test={b}" for b in binaries]
    if stage == "integration":
        return [*chosen, "--", *(f"--skip={d}" for d in DIGESTS)]
    return ["--lib", "--test=flights", "--test=pictures", "--", *DIGESTS]


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
                built = ROOT / "target/release" / folder
                if built.exists():
                    link = shutil.copy2 if folder == ".fingerprint" else os.link
                    shutil.copytree(built, self.tree / "target/release" / folder, copy_function=link)
        head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
        subprocess.run(["git", "checkout", "--quiet", "--force", "--detach", head], cwd=self.tree, check=True)

    def run(self):
        self.prepare()
        while (taken := self.queue()) is not None:
            folder, mutant = taken
            noticed, by = "missed", ""
            for stage in STAGES:
                outcome, by = self.stage(stage, folder, mutant)
                if outcome == "unviable":
                    noticed = outcome
                    break
                if outcome != "missed":
                    noticed = stage
                    break
            self.write({"folder": folder, "mutant": mutant["name"], "noticed": noticed, "by": by}, folder)

    def stage(self, stage, folder, mutant):
        """Runs a stage's tests. Returns the outcome, and the first test that failed."""
        shutil.rmtree(self.logs, ignore_errors=True)
        self.logs.mkdir(parents=True)
        environment = dict(os.environ, CARGO_INCREMENTAL="1", CARGO_TARGET_DIR=str(self.tree / "target"))
        environment.setdefault("COLVIS_TEST_DATA", str(ROOT.parent / "shared/data"))
        command = ["cargo", "mutants", "--in-place", "--baseline=skip", f"--timeout={TIMEOUT[stage]}", "--build-timeout=900",
                   "--shard", mutant["shard"], "--output", str(self.logs), "--", *tests_of(stage, folder)]
        with open(self.out / "cargo-mutants.log", "ab") as log:
            subprocess.run(command, cwd=self.tree, env=environment, stdout=log, stderr=log)
        outcomes = json.loads((self.logs / "mutants.out/outcomes.json").read_text())["outcomes"]
        if not outcomes:
            return "unviable", "not found"
        summary = outcomes[0]["summary"]
        if summary == "Unviable":
            return "unviable", ""
        if summary == "Timeout":
            return stage, "time"
        if summary == "MissedMutant":
            return "missed", ""
        text = (self.logs / "mutants.out" / outcomes[0]["log_path"]).read_text(errors="replace")
        failed = re.search(r"^test (\S+) (?:- should panic )?\.\.\. FAILED", text, re.M)
        return stage, failed.group(1) if failed else "a binary that ended"


def results(out):
    path = out / "results.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def run(a):
    a.out.mkdir(parents=True, exist_ok=True)
    if subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "src", "systems"], cwd=ROOT).returncode:
        sys.exit("src or systems differ from the last commit: commit them first")
    drawn = sample(all_mutants(), a.seed, a.count, a.folder)
    done = results(a.out)
    known = {r["mutant"] for r in done}
    counted = collections.Counter(r["folder"] for r in done if r["noticed"] != "unviable")
    waiting = {name: [m for m in order if m["name"] not in known] for name, (_, order) in drawn.items()}
    lock = threading.Lock()

    def queue():
        with lock:
            for name in sorted(drawn, key=lambda n: -(drawn[n][0] - counted[n])):
                if counted[name] < drawn[name][0] and waiting[name]:
                    counted[name] += 1
                    return name, waiting[name].pop(0)
        return None

    def write(result, folder):
        with lock:
            if result["noticed"] == "unviable":
                counted[folder] -= 1
            with open(a.out / "results.jsonl", "a") as f:
                f.write(json.dumps(result) + "\n")
            print(f"{result['noticed']:12} {result['mutant']}  {result['by']}", flush=True)

    workers = [Worker(n, queue, a.out, write) for n in range(a.jobs)]
    for w in workers:
        w.start()
    for w in workers:
        w.join()
    (a.out / "table.md").write_text(table([a.out]))
    missed = [r["mutant"] for r in results(a.out) if r["noticed"] == "missed"]
    (a.out / "survivors.txt").write_text("".join(f"{m}\n" for m in missed))
    print((a.out / "table.md").read_text())


def table(outs):
    rows = collections.defaultdict(collections.Counter)
    for out in outs:
        for r in results(out):
            if r["noticed"] != "unviable":
                rows[r["folder"]][r["noticed"]] += 1
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
