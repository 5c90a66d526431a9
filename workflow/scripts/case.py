"""Runs one case of a batch as a job of a workflow, and writes what came of it into a file.

colvis keeps the case's folder itself: it is written whole or not at all, what was made is not made again, and a failure is a record in it.
So the workflow does not know that folder. It waits for a small status file, which is written when the case is done, when it failed for
good, or after its last attempt. Any other end fails the job, and the workflow tries again with more memory and time.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

# Failures that more memory, more time or another node may mend.
PASSING = {"memory", "timeout", "killed", "output"}
# Time that colvis has less than the job, s: enough to end a case before something outside ends the job.
SPARE_S = 60
# Exit status of `colvis batch` whose cases ran: all are done, or some failed.
RAN = (0, 4)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--id", required=True)
    parser.add_argument("--status", required=True, type=Path, help="file to write")
    parser.add_argument("--cases", required=True, type=Path, help="the batch's folder")
    parser.add_argument("--attempt", required=True, type=int, help="number of this attempt, from 1")
    parser.add_argument("--attempts", required=True, type=int, help="number of the last one, which only lists the case")
    parser.add_argument("--minutes", required=True, type=float, help="time of the job")
    parser.add_argument("--memory-mb", required=True, type=int, help="memory of the case")
    parser.add_argument("batch", nargs="+", help="colvis batch MANIFEST and its options")
    return parser.parse_args()


def failure(args):
    """Returns the recorded failure of the case, or None."""
    try:
        return json.loads((args.cases / args.id / "case.json").read_text())["failure"]
    except (OSError, ValueError):
        return {"class": "killed", "line": "left no record"}


def write(args, failed):
    state = {"id": args.id, "state": "failed" if failed else "done"}
    if failed:
        state.update({"class": failed["class"], "line": failed["line"]})
    new = args.status.with_name(f".{args.status.name}.new")
    new.write_text(json.dumps(state, indent=2, ensure_ascii=False) + "\n")
    new.replace(args.status)


def main():
    args = arguments()
    # Left there if this job is ended from outside.
    running = args.status.with_name(f".{args.status.stem}.running")
    if args.attempt == args.attempts:
        if not running.exists():
            # The attempts came back with an error of their own, such as a full disk.
            print("error: every attempt failed; see the log of each", flush=True)
            return 1
        write(args, {"class": "killed", "line": "every attempt was ended from outside, with all of its job"})
        running.unlink()
        return 0
    running.touch()
    seconds = args.minutes * 60
    seconds -= min(SPARE_S, seconds / 10)
    limits = ["--jobs", "1", "--memory", f"{args.memory_mb}M", "--timeout", f"{seconds:.0f}"]
    line = [*args.batch, "--only", args.id, "--out", str(args.cases), *limits]
    status = subprocess.run(line, stdin=subprocess.DEVNULL).returncode
    if status < 0:
        print(f"error: colvis was ended by signal {-status}", flush=True)
        return 1
    # Another job, of a workflow that was killed, may have ended first.
    running.unlink(missing_ok=True)
    if status not in RAN:
        return status
    failed = failure(args) if status == 4 else None
    if failed and failed["class"] in PASSING and args.attempt + 1 < args.attempts:
        return 1
    write(args, failed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
