#!/usr/bin/env python3
"""Measures how many faults the tests notice: changes the program at drawn places as `cargo mutants` would, and runs the tests.

    cargo install --locked cargo-mutants
    python3 tests/bench/mutants.py --out OUT/ [--seed 1 2 3] [--count 100] [--folder render] [--jobs 2] [--list]

Draws --count mutants of `src` and `systems` (settings: .cargo/mutants.toml) with each --seed, from each folder in proportion to the
square root of its number of mutants, or all from one --folder. All of them are built once into one program (see switches.py) in a copy
of the last commit below `target/mutation`, so the checkout stays as it is. Those that do not compile are replaced by the next ones
drawn. Each test runs once alone, to find which mutants' functions it calls. A mutant then meets only the tests that call its function,
one after the other, those of its own file and quick ones first, until one fails or exceeds its time, in three stages:

1. unit:        the library's unit tests
2. integration: all other tests, without those that compare a whole flight or picture with a stored one
3. digest:      those

The tests of the window take part for mutants of `host`. Results are appended to OUT/results.jsonl, where a run that was interrupted
continues, and OUT/survivors.txt and OUT/table.md are written from them at the end. Survivors that are known to change nothing are
listed with the reason in tests/bench/equivalent.txt. On two cores, building and the first run of all tests take half an hour, and a
hundred mutants about as long.

--faults FILE… also faults written by hand, one JSON object a line ("file", "before", "after", "why"), where `before` occurs
               once in the file, within a function; tests/bench/faults.jsonl and faults2.jsonl hold some by somebody who had
               not seen the tests
--stage        ends after this stage; `unit` builds the unit tests only, and then OUT cannot be used for the others
--seconds      how long a mutant meets the tests of a stage at most; without it, all of them
--list         prints the sample and runs nothing
--table OUT…   prints one table of several runs
"""

import argparse
import collections
import datetime
import json
import math
import os
import pathlib
import queue
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time

import switches

ROOT = pathlib.Path(__file__).resolve().parents[2]
TREE = ROOT / "target/mutation/tree"
EQUIVALENT = ROOT / "tests/bench/equivalent.txt"

# The roots of the program's crates, the lowest first: it holds the switches, which all others use.
LOWEST = "src/scan/lib.rs"
ROOTS = [LOWEST, "src/lib.rs", *(str(p.relative_to(ROOT)) for p in sorted(ROOT.glob("src/*/lib.rs")) if p.parent.name != "scan")]

# Folders of the table: the paths that belong to each.
FOLDERS = {
    "render": ["src/imaging/render", "src/imaging/surface"],
    "space, math": ["src/imaging/space", "src/scan/math"],
    "fields": ["src/kernels/fields"],
    "dynamics": ["src/kernels/dynamics"],
    "volume": ["src/scan/volume"],
    "systems": ["systems", "src/flight/components"],
    "app, schedule": ["src/app", "src/flight/schedule", "src/scan/error.rs", "src/scan/panics.rs", "src/scan/progress.rs", "src/scan/memory.rs"],
    "host": ["src/host"],
    "cli, output": ["src/cli", "src/scan/output"],
    "phantom": ["src/phantom"],
    "plane": ["src/plane"],
}
# Tests that compare a whole flight or picture with a stored one.
DIGESTS = ["digests", "golden", "pictures::"]
STAGES = ["unit", "integration", "digest"]
# A process of the tests may not use more, bytes: some faults ask for memory without end.
MEMORY = 8 << 30


def arguments():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--out", type=pathlib.Path)
    p.add_argument("--seed", type=int, nargs="+", default=[1])
    p.add_argument("--count", type=int, default=100)
    p.add_argument("--folder", choices=sorted({f for name in FOLDERS for f in name.split(", ")}))
    p.add_argument("--faults", type=pathlib.Path, nargs="+")
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--stage", choices=STAGES, default=STAGES[-1])
    p.add_argument("--seconds", type=float, default=math.inf)
    p.add_argument("--list", action="store_true")
    p.add_argument("--table", nargs="+", type=pathlib.Path, metavar="OUT")
    a = p.parse_args()
    if not (a.out or a.list or a.table):
        p.error("--out is needed")
    return a


# --- The sample.

def folder_of(path):
    return next((name for name, paths in FOLDERS.items() if any(path.startswith(p) for p in paths)), "app, schedule")


def all_mutants():
    listed = subprocess.run(["cargo", "mutants", "--workspace", "--list", "--json"], cwd=ROOT, check=True, stdout=subprocess.PIPE)
    mutants = json.loads(listed.stdout)
    for m in mutants:
        m["file"] = os.path.normpath(m["file"].removeprefix("src/../"))
        m["folder"] = folder_of(m["file"])
    texts = {m["file"]: (ROOT / m["file"]).read_text() for m in mutants}
    switchable = [m for m in mutants if switches.place_of(texts[m["file"]], m)]
    print(f"{len(mutants)} mutants, {len(mutants) - len(switchable)} of them cannot be switched", file=sys.stderr)
    return switchable


def hand_made(path, mutants):
    """Returns the faults of a file in the form of `cargo mutants`. Their functions are those of the mutants around them."""
    functions = collections.defaultdict(list)
    for m in mutants:
        functions[m["file"]].append(m["function"])
    faults = []
    for line in path.read_text().splitlines():
        fault = json.loads(line)
        # A test may have the same line.
        text = (ROOT / fault["file"]).read_text().partition("#[cfg(test)]\nmod tests {")[0]
        if text.count(fault["before"]) != 1:
            print(f"{fault['file']}: occurs {text.count(fault['before'])} times: {fault['before']}")
            continue
        begin = text.index(fault["before"])
        place = lambda at: {"line": text.count("\n", 0, at) + 1, "column": at - (text.rfind("\n", 0, at) + 1) + 1}
        fault["span"] = {"start": place(begin), "end": place(begin + len(fault["before"]))}
        line = fault["span"]["start"]["line"]
        around = [f for f in functions[fault["file"]] if f["span"]["start"]["line"] <= line <= f["span"]["end"]["line"]]
        fault |= {"function": around[0] if around else None, "replacement": fault["after"], "folder": folder_of(fault["file"]),
                  "name": f"{fault['file']}:{line}: {fault['why']}", "by_hand": True}
        if switches.place_of(text, fault):
            faults.append(fault)
        else:
            print("cannot be switched:", fault["name"])
    return faults


def sample(mutants, seed, count, folder):
    """Returns, for each folder, the number of mutants wanted and all its mutants in the order in which they are drawn."""
    groups = collections.defaultdict(list)
    for m in mutants:
        groups[m["folder"]].append(m)
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


def candidates(a):
    """Returns lists of mutants in the order in which they are drawn, each with the number wanted of it."""
    mutants = all_mutants()
    lists = [drawn for seed in a.seed for drawn in sample(mutants, seed, a.count, a.folder).values()]
    if a.faults:
        faults = [fault for path in a.faults for fault in hand_made(path, mutants)]
        lists.append((len(faults), faults))
    return lists


# --- Building.

def git(*args):
    return subprocess.run(["git", "-C", str(ROOT), *args], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()


def copy_of_the_last_commit():
    head = git("rev-parse", "HEAD")
    if not TREE.exists():
        git("worktree", "prune")
        git("worktree", "add", "--quiet", "--detach", str(TREE), head)
        # The dependencies need not be built again. Cargo never changes a library in place.
        for folder in ("deps", "build", ".fingerprint"):
            built = ROOT / "target/release" / folder
            if built.exists():
                link = shutil.copy2 if folder == ".fingerprint" else os.link
                shutil.copytree(built, TREE / "target/release" / folder, copy_function=link)
    subprocess.run(["git", "checkout", "--quiet", "--force", "--detach", head], cwd=TREE, check=True)
    return head


def environment(**more):
    peers = ROOT / "target/peers/bin/python"
    env = dict(os.environ, CARGO_INCREMENTAL="1", CARGO_TARGET_DIR=str(TREE / "target"), **more)
    env.setdefault("COLVIS_TEST_DATA", str(ROOT.parent / "shared/data"))
    env.setdefault("COLVIS_CHECKS", "full")
    if peers.exists():
        env.setdefault("COLVIS_PEERS", str(peers))
    return env


def write_tree(mutants):
    """Writes the files with their mutants, by number, and returns the lines of each one's body, by file."""
    by_file = collections.defaultdict(dict)
    for number, m in mutants.items():
        by_file[m["file"]][number] = m
    lines = {}
    changed = subprocess.run(["git", "diff", "--name-only"], cwd=TREE, check=True, stdout=subprocess.PIPE, text=True).stdout.split()
    for file in set(changed) - set(by_file) - set(ROOTS):
        write(TREE / file, (ROOT / file).read_text())
    for file, own in by_file.items():
        text, lines[file] = switches.switched((ROOT / file).read_text(), own)
        write(TREE / file, text)
    size = max(mutants, default=0) + 1
    for root in ROOTS:
        # The module's attributes follow the crate's documentation.
        head = re.match(r"(?://!.*\n|\s*\n)*", (TREE / root if root in lines else ROOT / root).read_text())
        module = switches.MODULE % (size, size) if root == LOWEST else switches.IMPORT
        write(TREE / root, head.string[: head.end()] + switches.ALLOW + head.string[head.end():] + module)
    return lines


def write(path, text):
    # Cargo builds again what has a newer time.
    if path.read_text() != text:
        path.write_text(text)


def compile_errors(command):
    """Runs cargo. Returns its success, the places of errors (file, line), and the programs built."""
    run = subprocess.run(["cargo", *command, "--release", "--locked", "--message-format=json"], cwd=TREE, env=environment(),
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    places, programs, texts = [], [], []
    for line in run.stdout.splitlines():
        message = json.loads(line)
        if message["reason"] == "compiler-artifact" and message["profile"]["test"] and message["executable"]:
            programs.append((message["target"]["name"], message["executable"]))
        if message["reason"] == "compiler-message" and message["message"]["level"] == "error":
            spans = message["message"]["spans"]
            places.extend((s["file_name"], s["line_start"]) for s in spans)
            texts.append(message["message"]["rendered"])
    return run.returncode == 0, places, programs, "\n".join(texts) or run.stderr


def build(lists, stage):
    """Chooses the first mutants of each list that compile, and builds them. Returns them by number, and the test programs."""
    unviable, numbers = set(), {}

    def chosen(spare):
        for wanted, order in lists:
            viable = (m for m in order if m["name"] not in unviable)
            yield from (m for m, _ in zip(viable, range(wanted + (wanted // 2 + 2 if spare else 0))))

    for spare in (True, False):
        while True:
            mutants = {numbers.setdefault(m["name"], len(numbers) + 1): m for m in chosen(spare)}
            lines = write_tree(mutants)
            fine, places, _, text = compile_errors(["check", "--lib"])
            if fine:
                break
            found = {n for file, line in places for n, (first, last) in lines.get(os.path.normpath(file.removeprefix("src/../")), {}).items()
                     if first <= line <= last}
            if not found:
                sys.exit(f"an error outside of the mutants:\n{text}")
            print(f"{len(mutants)} mutants, {len(found)} of them do not compile", flush=True)
            unviable.update(mutants[n]["name"] for n in found)
    fine, _, programs, text = compile_errors(["test", "--no-run", *(["--lib"] if stage == "unit" else [])])
    if not fine:
        sys.exit(text)
    return mutants, dict(programs)


# --- Running.

def limits():
    os.setsid()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def run_test(program, name, seconds, **env):
    """Runs one test. Returns "passed", "failed" or "time", and its seconds."""
    start = time.monotonic()
    process = subprocess.Popen([program, "--include-ignored", "--exact", name], cwd=TREE, env=environment(**env), stdin=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=limits)
    try:
        outcome = "passed" if process.wait(seconds) == 0 else "failed"
    except subprocess.TimeoutExpired:
        outcome = "time"
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
    return outcome, time.monotonic() - start


def in_parallel(jobs, work, items):
    waiting = queue.SimpleQueue()
    for item in items:
        waiting.put(item)

    def worker():
        while True:
            try:
                item = waiting.get_nowait()
            except queue.Empty:
                return
            work(item)

    threads = [threading.Thread(target=worker) for _ in range(jobs)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()


def record(programs, out, jobs):
    """Runs each test once. Returns (program, test, seconds, numbers reached) of those that pass."""
    listed = []
    for name, program in programs.items():
        run = subprocess.run([program, "--list", "--format", "terse"], cwd=TREE, stdout=subprocess.PIPE, check=True, text=True)
        listed.extend((name, t.removesuffix(": test")) for t in run.stdout.splitlines() if t.endswith(": test"))
    tests, lock = [], threading.Lock()

    def work(item):
        name, test = item
        reached = out / f"reached-{threading.get_ident()}"
        reached.unlink(missing_ok=True)
        outcome, seconds = run_test(programs[name], test, 600, COLVIS_MUTANT="record", COLVIS_REACHED=str(reached))
        numbers = sorted(set(map(int, reached.read_text().split()))) if reached.exists() else []
        reached.unlink(missing_ok=True)
        with lock:
            if outcome == "passed":
                tests.append((name, test, seconds, numbers))
            else:
                print(f"left out, because it fails without a fault: {name} {test}", flush=True)

    in_parallel(jobs, work, listed)
    return sorted(tests, key=lambda t: t[2])


def stage_of(program, test):
    if any(d in test for d in DIGESTS):
        return "digest"
    return "unit" if program.startswith("colvis") else "integration"


def module_of(file):
    """Returns the module of a file, as tests name it. A member's folder is one only where its root says so."""
    member = re.match(r"src/\w+/", file)
    if member and (ROOT / member[0] / "lib.rs").exists() and not (ROOT / member[0] / "mod.rs").exists():
        file = file.removeprefix(member[0])
    return re.sub(r"^src/|(/mod)?\.rs$", "", file).replace("/", "::")


def first_to_notice(number, mutant, plan, stages, most):
    """Returns the stage and the test that notice a mutant first, and the seconds that took; "missed" if none does."""
    start = time.monotonic()
    module = module_of(mutant["file"]) + "::"
    # First those of its own file, that are quick, and that reach little else.
    worth = lambda t: (t[2] + 0.02) * len(t[3]) / (20 if t[1].startswith(module) else 1)
    for s in stages:
        end = time.monotonic() + most
        for program, test, seconds, reached in sorted(plan["tests"], key=worth):
            if stage_of(program, test) != s or number not in reached or time.monotonic() > end:
                continue
            if program == "window" and mutant["folder"] != "host":
                continue
            outcome, _ = run_test(plan["programs"][program], test, 10 * seconds + 20, COLVIS_MUTANT=str(number))
            if outcome != "passed":
                return s, test + (" (time)" if outcome == "time" else ""), time.monotonic() - start
    return "missed", "", time.monotonic() - start


def lines_of(out):
    path = out / "results.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    # A later stage's line replaces an earlier one's.
    return list({line["mutant"]: line for line in lines}.values())


def plan_of(a):
    """Builds the sample and finds which test reaches which mutant, or reads what an earlier run found."""
    path = a.out / "plan.json"
    if path.exists():
        return json.loads(path.read_text())
    if subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "src", "systems", "tests", ":!tests/bench"], cwd=ROOT).returncode:
        sys.exit("src, systems or tests differ from the last commit: commit them first")
    commit = copy_of_the_last_commit()
    mutants, programs = build(candidates(a), a.stage)
    for m in mutants.values():
        m["source"] = (ROOT / m["file"]).read_text().splitlines()[m["span"]["start"]["line"] - 1].strip()
    tests = record(programs, a.out, a.jobs)
    plan = {"commit": commit, "date": f"{datetime.date.today()}", "seeds": a.seed, "count": a.count, "by_hand": a.faults is not None, "stage": a.stage,
            "mutants": mutants, "programs": programs, "tests": tests}
    path.write_text(json.dumps(plan))
    return json.loads(path.read_text())


def run(a):
    a.out.mkdir(parents=True, exist_ok=True)
    plan, lock = plan_of(a), threading.Lock()
    for t in plan["tests"]:
        t[3] = set(t[3])
    # The last stage that each mutant has met; those that were noticed need no other.
    done = {line["mutant"]: STAGES.index(line["stage"] if line["noticed"] == "missed" else STAGES[-1]) for line in lines_of(a.out)}

    def work(item):
        number, m = item
        stages = STAGES[done.get(m["name"], -1) + 1 : STAGES.index(a.stage) + 1]
        stage, by, seconds = first_to_notice(int(number), m, plan, stages, a.seconds)
        reached = sum(int(number) in t[3] for t in plan["tests"])
        line = {"folder": m["folder"], "mutant": m["name"], "by_hand": m.get("by_hand", False), "noticed": stage, "by": by, "stage": a.stage,
                "reached_by": reached, "seconds": round(seconds), "source": m["source"]}
        with lock:
            with open(a.out / "results.jsonl", "a") as f:
                f.write(json.dumps(line) + "\n")
            print(f"{stage:12} {m['name']}  {by}", flush=True)

    in_parallel(a.jobs, work, [(n, m) for n, m in plan["mutants"].items() if done.get(m["name"], -1) < STAGES.index(a.stage)])
    (a.out / "survivors.txt").write_text("".join(f"{key(line)} | \n" for line in lines_of(a.out) if line["noticed"] == "missed"))
    (a.out / "table.md").write_text(table([a.out]))
    print((a.out / "table.md").read_text())


# --- The table.

def key(line):
    """What names a mutant when the lines of its file have moved."""
    return re.sub(r":\d+(:\d+)?:", ":", line["mutant"], count=1) + " | " + line["source"]


def table(outs):
    """Returns a table of the drawn mutants and, if there are any, one of the faults by hand."""
    found = [line for out in outs for line in lines_of(out)]
    drawn, by_hand = ([line for line in found if line["by_hand"] == hand] for hand in (False, True))
    return "\n".join(rows_of(lines, name) for lines, name in ((drawn, "mutants"), (by_hand, "faults by hand")) if lines)


def rows_of(found, name):
    reasons = EQUIVALENT.read_text().splitlines() if EQUIVALENT.exists() else []
    equivalent = {line.rpartition(" | ")[0] for line in reasons}
    rows = collections.defaultdict(collections.Counter)
    for line in found:
        same = line["noticed"] == "missed" and key(line) in equivalent
        rows[line["folder"]]["same" if same else line["noticed"]] += 1
    lines = [f"| folder | {name} | by a unit test | by another test | by a digest alone | not noticed | that change nothing | noticed |",
             "|---|---|---|---|---|---|---|---|"]

    def row(name, n):
        count = sum(n.values())
        real = count - n["same"]
        noticed = 100 * (real - n["missed"]) / real if real else 100
        lines.append(f"| {name} | {count} | {n['unit']} | {n['integration']} | {n['digest']} | {n['missed']} | {n['same']} | {noticed:.0f} % |")

    for folder in FOLDERS:
        if folder in rows:
            row(folder, rows[folder])
    row("all", sum(rows.values(), collections.Counter()))
    return "\n".join(lines) + "\n"


def main():
    a = arguments()
    if a.table:
        print(table(a.table), end="")
    elif a.list:
        for wanted, order in candidates(a):
            for m in order[:wanted]:
                print(f"{m['folder']:14} {m['name']}")
    else:
        run(a)


if __name__ == "__main__":
    sys.exit(main())
