"""Small scans, runs of colvis and of the workflow over them, and what they left."""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORKFLOW = ROOT / "workflow"
COLVIS = Path(os.environ.get("COLVIS", ROOT / "target/release/colvis"))
SNAKEMAKE = Path(os.environ.get("COLVIS_SNAKEMAKE", ROOT / "target/snakemake/bin/snakemake"))
# Everything that a test writes.
PLACE = ROOT / "target" / "workflow"
# The longest that a command may take, s.
PATIENCE = 3600
# Slurm's jobs here are short: ask for their states often, and without an accounting database.
SLURM = ["--slurm-status-command", "squeue", "--slurm-init-seconds-before-status-checks", "4",
         "--seconds-between-status-checks", "1", "--latency-wait", "5", "--default-resources",
         "slurm_partition=here"]


def run(line, status=0, folder=None, environment=None):
    """Runs a command that must end with this status (None: whichever). Returns what it printed."""
    done = subprocess.run([str(word) for word in line], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE)
    if status is not None and done.returncode != status:
        sys.exit(f"FAILED: {' '.join(map(str, line))}\nends with {done.returncode}, not {status}:\n{done.stdout[-6000:]}")
    return done.stdout


def same(one, other, what):
    if one != other:
        differ = sorted(name for name in {*one, *other} if one.get(name) != other.get(name))
        sys.exit(f"FAILED: {what}: {len(differ)} differ: {differ[:10]}")


def holds(is_so, what):
    if not is_so:
        sys.exit(f"FAILED: {what}")


def lasting(folder):
    """Returns every file below a folder of cases, but for the times in their records."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        name = str(path.relative_to(folder))
        # A folder that was being written when its run was killed.
        if path.is_dir() or name.startswith(".work-"):
            continue
        data = path.read_bytes()
        if path.name == "case.json":
            record = json.loads(data)
            for step in record["steps"].values():
                step.pop("times")
            data = json.dumps(record).encode()
        found[name] = data
    return found


class Study:
    """A folder with scans and their manifest."""

    STEPS = "segment,centerline"

    def __init__(self, folder, scans):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True)
        self.rows = []
        # Names as patients' files have them.
        names = [f"DOE^JANE {n}.nii.gz" for n in range(scans)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(self.phantom, names, range(1, scans + 1)))
        for n, name in enumerate(names):
            # Ids with whatever they may have, and rows without.
            case = ["", f"A {n}", f"b,{n}", f"c'{n}{{x}}%j", f"Ä={n}"][n] if n < 5 else f"case{n}"
            self.rows.append({"path": name, "id": case, "series": "", "options": ""})

    def phantom(self, name, seed):
        kept = PLACE / "phantoms" / f"{seed}.nii.gz"
        if not kept.exists() or kept.stat().st_mtime < COLVIS.stat().st_mtime:
            kept.parent.mkdir(parents=True, exist_ok=True)
            run([COLVIS, "phantom", "--out", kept, "--size", "small", "--seed", seed, "--threads", 1])
        shutil.copyfile(kept, self.folder / name)

    def add_bad_inputs(self, every=1):
        """Adds twelve rows whose cases fail, or some of them."""
        good = self.rows[-1]["path"]
        whole = (self.folder / good).read_bytes()
        (self.folder / "empty.nii.gz").write_bytes(b"")
        (self.folder / "cut.nii.gz").write_bytes(whole[: len(whole) // 2])
        (self.folder / "garbled.nii.gz").write_bytes(whole[:2000] + bytes(2000) + whole[4000:])
        (self.folder / "text.nii").write_text("no scan\n")
        (self.folder / "text.nrrd").write_text("NRRD0004\n")
        (self.folder / "table.mha").write_text("ObjectType = Image\n")
        (self.folder / "no scans").mkdir()
        (self.folder / "notes").mkdir()
        (self.folder / "notes" / "readme.txt").write_text("no slices\n")
        bad = [(name, "") for name in ("empty.nii.gz", "cut.nii.gz", "garbled.nii.gz", "text.nii", "text.nrrd", "table.mha",
                                       "no scans", "notes", "missing.nii.gz")]
        bad += [(good, "--method nonsense"), (good, "--from 9000,0,0"), (good, "--hu x")]
        holds(len(bad) == 12, "twelve bad inputs")
        for n, (path, options) in list(enumerate(bad))[::every]:
            self.rows.append({"path": path, "id": f"bad {n}", "series": "", "options": options})

    @property
    def manifest(self):
        return self.folder / "scans.csv"

    def write(self):
        with open(self.manifest, "w", newline="") as to:
            table = csv.DictWriter(to, ["path", "id", "series", "options"])
            table.writeheader()
            table.writerows(self.rows)

    def batch(self, out, *options, status=None):
        return run([COLVIS, "batch", self.manifest, "--out", out, "--do", self.STEPS, *options], status=status)

    def line(self, out, profile, *options, **config):
        """Returns the command that runs the workflow."""
        config = {"manifest": self.manifest, "out": out, "steps": f"[{self.STEPS}]", "colvis": COLVIS, "threads": 1,
                  "least_minutes": 5, **config}
        return [SNAKEMAKE, "--snakefile", WORKFLOW / "Snakefile", "--profile", WORKFLOW / "profiles" / profile,
                "--config", *(f"{name}={value}" for name, value in config.items()), *options]

    def snakemake(self, out, *options, profile="local", status=0, environment=None, **config):
        folder = self.folder / "work"
        folder.mkdir(exist_ok=True)
        return run(self.line(out, profile, "--nocolor", *options, **config), status, folder, environment)


def jobs_of(told):
    """Returns how many jobs of the rule `case` and of the rule `group` a run had, by its own table."""
    count = lambda rule: sum(int(n) for n in re.findall(rf"^{rule} +(\d+)$", told.split("total")[0], re.M))
    return count("case"), count("group")


def missing():
    """Returns why nothing can be tested here, or None."""
    if not COLVIS.exists():
        sys.exit(f"FAILED: no {COLVIS}: cargo build --release")
    return None if SNAKEMAKE.exists() else f"no {SNAKEMAKE}; .ci/setup installs it"


def fresh(folder):
    folder = Path(folder).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def records(cases):
    """Returns the record of each case, and its age."""
    return {path.parent.name: (json.loads(path.read_text()), path.stat().st_mtime_ns) for path in Path(cases).glob("[!.]*/case.json")}


def statuses(out):
    """Returns what the workflow says of each case, by id."""
    found = [json.loads(path.read_text()) for path in (Path(out) / "status").glob("[!.]*.json")]
    return {status["id"]: status for status in found}


class Clock:
    """Tells the seconds of each part."""

    def __init__(self):
        self.begun = self.since = time.monotonic()

    def __call__(self, what):
        now = time.monotonic()
        print(f"{now - self.since:7.1f} s  {what}", flush=True)
        self.since = now

    def end(self):
        print(f"{time.monotonic() - self.begun:7.1f} s  in all", flush=True)


def changes(study, out, cases):
    """A changed scan repeats one case, a changed option only its steps, a new row makes one case; nothing else is touched."""
    told = study.snakemake(out)
    holds(jobs_of(told) == (0, 0), f"nothing is done twice:\n{told}")
    before = records(cases)
    scan, option = study.rows[0], study.rows[1]
    shutil.copyfile(study.folder / study.rows[2]["path"], study.folder / scan["path"])
    option["options"] = "--method peel"
    new = {**study.rows[3], "id": "new"}
    study.rows.insert(0, new)
    study.write()
    told = study.snakemake(out)
    holds(jobs_of(told) == (3, 1), f"three cases are made:\n{told}")
    after = records(cases)
    touched = {case for case in after if before.get(case, (0, 0))[1] != after[case][1]}
    first = next(case for case in before if case.startswith("case-"))
    same(touched, {first, option["id"], "new"}, "cases that were made again")
    kept = lambda record, step: record[option["id"]][0]["steps"][step]
    holds(kept(before, "segment") == kept(after, "segment"), "a step that does not take the option is kept, with its times")
    holds(kept(before, "centerline")["key"] != kept(after, "centerline")["key"], "a step that takes the option is made again")
    of = lambda case, step: after[case][0]["steps"][step]["outputs"]
    holds(of(first, "segment") == of(study.rows[3]["id"], "segment"), "the other scan")


def bids(study):
    """The BIDS App makes what was asked for, and leaves its input alone."""
    folder, out = study.folder / "bids", study.folder / "derivatives"
    for name, n in [("sub-01/ct/sub-01_ct.nii.gz", 0), ("sub-02/ses-a/ct/sub-02_ses-a_ct.nii.gz", 1)]:
        (folder / name).parent.mkdir(parents=True)
        shutil.copyfile(study.folder / study.rows[n]["path"], folder / name)
    seen = lambda: {str(path): path.stat().st_mtime_ns for path in folder.rglob("*")}
    before = seen()
    app = [sys.executable, WORKFLOW / "bids.py", folder, out]
    more = ["--colvis", COLVIS, "--steps", "segment"]
    run([*app, "participant", *more, "--participant-label", "02"])
    same({*records(out / "cases")}, {"sub-02_ses-a_ct"}, "the chosen participant")
    run([*app, "participant", *more, "--n-cpus", "2", "--mem-mb", "4000"])
    same({*records(out / "cases")}, {"sub-01_ct", "sub-02_ses-a_ct"}, "all participants")
    run([*app, "group", *more])
    holds("sub-01_ct" in (out / "group" / "cases.csv").read_text(), "the table of all cases")
    run([*app, "participant", *more, "--participant-label", "03"], status=2)
    run([sys.executable, WORKFLOW / "bids.py", study.folder / "none", out, "group", *more], status=3)
    same(before, seen(), "the input")
