#!/usr/bin/env python3
"""colvis as a BIDS App: bids.py BIDS_DIR OUTPUT_DIR {participant,group}.

Scans are BIDS_DIR/sub-*/[ses-*/]ct/*.nii[.gz]. `participant` makes every scan's case in OUTPUT_DIR/cases, `group` one table and one page of
all cases in OUTPUT_DIR/group. Nothing is written below BIDS_DIR unless OUTPUT_DIR lies there. The exit status is that of `colvis batch`.
"""

import argparse
import csv
import io
import json
import os
import subprocess
import sys
from pathlib import Path

BIDS_VERSION = "1.10.0"


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bids_dir", type=Path)
    parser.add_argument("output_dir", type=Path)
    parser.add_argument("analysis_level", choices=["participant", "group"])
    parser.add_argument("--participant-label", "--participant_label", nargs="+", metavar="LABEL", help="with or without sub-")
    parser.add_argument("--session-label", "--session_label", nargs="+", metavar="LABEL", help="with or without ses-")
    parser.add_argument("--skip-bids-validation", "--skip_bids_validator", action="store_true", help="accepted; nothing is validated")
    parser.add_argument("--steps", metavar="STEP,…", help="what to make of each scan, --do of colvis batch")
    parser.add_argument("--n-cpus", "--n_cpus", type=int, help="cases at once, with one thread each")
    parser.add_argument("--mem-mb", "--mem_mb", type=int, help="memory of all cases together")
    parser.add_argument("--colvis", default="colvis", help="the program")
    parser.add_argument("-v", "--version", action="version", version=version())
    return parser.parse_args()


def version():
    try:
        return subprocess.run(["colvis", "--version"], capture_output=True, text=True).stdout.strip() or "unknown"
    except OSError:
        return "unknown"


def failed(line, status):
    print(f"error: {line}", file=sys.stderr)
    sys.exit(status)


def scans(folder):
    """Returns the scans of all participants, with their names as ids."""
    found = [path for below in ("sub-*/ct", "sub-*/ses-*/ct") for path in folder.glob(f"{below}/*.nii*")]
    return [(path.name.split(".nii")[0], path) for path in sorted(found) if path.name.endswith((".nii", ".nii.gz"))]


def is_chosen(path, labels, prefix):
    """True if a folder of the path is one of the labels."""
    return labels is None or any(f"{prefix}{label.removeprefix(prefix)}" in path.parts for label in labels)


def write(path, text):
    """Writes a file whole or not at all: participants may run at once on many machines."""
    new = path.with_name(f".{path.name}.{os.uname().nodename}.{os.getpid()}")
    new.write_text(text, encoding="utf-8", newline="")
    new.replace(path)


def main():
    args = arguments()
    if not args.bids_dir.is_dir():
        failed(f"{args.bids_dir}: is no folder; give the folder with sub-*", 3)
    all_scans = scans(args.bids_dir.resolve())
    if not all_scans:
        failed(f"{args.bids_dir}: has no sub-*/[ses-*/]ct/*.nii.gz; put the scans there", 3)
    try:
        args.output_dir.mkdir(parents=True, exist_ok=True)
        manifest = args.output_dir / "scans.csv"
        table = io.StringIO()
        csv.writer(table).writerows([("id", "path"), *all_scans])
        write(manifest, table.getvalue())
        made = {"Name": "colvis", "BIDSVersion": BIDS_VERSION, "DatasetType": "derivative", "GeneratedBy": [{"Name": "colvis"}]}
        write(args.output_dir / "dataset_description.json", json.dumps(made, indent=2) + "\n")
    except OSError as error:
        failed(f"{args.output_dir}: {error.strerror}; check the folder", 5)
    line = [args.colvis, "batch", manifest]
    if args.analysis_level == "group":
        line += ["--group", args.output_dir / "cases", "--out", args.output_dir / "group"]
    else:
        line += ["--out", args.output_dir / "cases"]
        if args.participant_label or args.session_label:
            chosen = [name for name, path in all_scans
                      if is_chosen(path, args.participant_label, "sub-") and is_chosen(path, args.session_label, "ses-")]
            if not chosen:
                failed("--participant-label: no scan has these labels; see sub-* and ses-* in the folder", 2)
            line += [word for name in chosen for word in ("--only", name)]
        line += ["--do", args.steps] if args.steps else []
        line += ["--jobs", str(args.n_cpus), "--threads", "1"] if args.n_cpus else []
        line += ["--memory", f"{args.mem_mb}M"] if args.mem_mb else []
    try:
        sys.exit(subprocess.run(line).returncode)
    except OSError as error:
        failed(f"{args.colvis}: cannot be started: {error.strerror}; give its path with --colvis", 1)


if __name__ == "__main__":
    main()
