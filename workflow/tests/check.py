#!/usr/bin/env python3
"""Checks the workflow on eight small scans, with the installed Snakemake and a Slurm of its own, in about a minute.

`COLVIS` and `COLVIS_SNAKEMAKE` name other programs than target/release/colvis and target/snakemake/bin/snakemake.
"""

import os
import sys

import slurm
from study import COLVIS, PLACE, SLURM, Clock, Study, bids, changes, fresh, holds, lasting, missing, same, statuses

# A colvis whose job is ended from outside in case A 1, and whose first attempt has too little time in case b,2.
TROUBLED = """#!/usr/bin/env python3
import os, signal, sys
line = [{colvis!r}, *sys.argv[1:]]
only = line[line.index("--only") + 1] if "--only" in line else None
if only == "A 1":
    os.kill(os.getppid(), signal.SIGKILL)
    sys.exit(1)
first = {folder!r} + "/tried"
if only == "b,2" and not os.path.exists(first):
    open(first, "w").close()
    line[line.index("--timeout") + 1] = "0.01"
os.execv(line[0], line)
"""


def skip(part, why):
    """Tells what cannot be tested here, as tests/support/skips.rs does."""
    line = f"workflow/tests/check.py needs {part}: {why}"
    print(f"skipped: {line}")
    if "COLVIS_SKIPS" in os.environ:
        with open(os.environ["COLVIS_SKIPS"], "a") as to:
            to.write(f"{line}\n")
    kept = os.environ.get("COLVIS_NO_SKIP", "")
    exempt = kept.startswith("all-but-") and part in kept.removeprefix("all-but-").split(",")
    return 0 if exempt or not kept else 1


def troubles(study, out, one):
    """A case whose job is killed is listed, one that took too long is tried again, and the others are what they are without Snakemake."""
    troubled = study.folder / "troubled"
    troubled.write_text(TROUBLED.format(colvis=str(COLVIS), folder=str(study.folder)))
    troubled.chmod(0o755)
    told = study.snakemake(out, "--resources", "mem_mb=4000", colvis=troubled)
    holds(told.count("Trying to restart job") == 3, f"two attempts were lost with their jobs, one took too long:\n{told}")
    holds("3 of 10 cases" not in told and "10 of 10 cases have ended, 3 of them failed" in told, f"all have ended:\n{told}")
    found = statuses(out)
    holds(found["A 1"]["class"] == "killed" and found["b,2"]["state"] == "done", f"what came of them: {found}")
    table = (out / "group" / "cases.csv").read_text()
    lost = [line for line in table.splitlines() if line.startswith("A 1,")]
    holds(len(lost) == 1 and lost[0].startswith("A 1,missing,"), f"the table lists a case that left no record: {lost}")
    holds((out / "group" / "index.html").exists(), "the page is made with failures, too")
    # Tried again by hand.
    next((out / "status").glob("A_1=*.json")).unlink()
    study.snakemake(out)
    same(one, lasting(out / "cases"), "one run and Snakemake")


def main():
    if why := missing():
        return skip("snakemake", why)
    status = 0
    clock = Clock()
    study = Study(fresh(PLACE / "check"), 8)
    study.add_bad_inputs(every=6)
    study.write()
    clock("scans")
    study.batch(study.folder / "one", status=4)
    one = lasting(study.folder / "one")
    clock("one run")
    out = study.folder / "local"
    troubles(study, out, one)
    clock("Snakemake")
    study.snakemake(out, "--report", study.folder / "report.html")
    report = (study.folder / "report.html").read_text()
    holds("index.html" in report and "cases.csv" in report, "Snakemake's report has the page and the table")
    holds("DOE" not in report, "Snakemake's report names no file")
    clock("its report")
    if why := slurm.missing():
        status = skip("slurm", why)
    else:
        with slurm.Slurm(study.folder / "slurm") as cluster:
            study.snakemake(study.folder / "cluster", *SLURM, profile="slurm", environment=cluster.environment)
        same(one, lasting(study.folder / "cluster" / "cases"), "one run and Slurm")
        clock("Slurm")
    changes(study, out, out / "cases")
    clock("changes")
    bids(study)
    clock("BIDS")
    clock.end()
    return status


if __name__ == "__main__":
    sys.exit(main())
