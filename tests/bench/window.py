"""Measures the size and rate of a moving window's images, on a quiet machine and beside busy threads.

    python tests/bench/window.py SCAN [--size 1600x1000] [--busy 2] [--seconds 12] [--binary target/release/colvis]
                                 [-- further options of `colvis fly`]

Opens a window under Xvfb once for each number of busy threads (0 and --busy) and prints its stats.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time


def spin():
    while True:
        pass


def main():
    own, further = sys.argv[1:], []
    if "--" in own:
        at = own.index("--")
        own, further = own[:at], own[at + 1 :]
    parser = argparse.ArgumentParser()
    parser.add_argument("scan")
    parser.add_argument("--size", default="1600x1000")
    parser.add_argument("--busy", type=int, default=2)
    parser.add_argument("--seconds", default="12")
    parser.add_argument("--binary", default="target/release/colvis")
    args = parser.parse_args(own)
    display = f":{60 + os.getpid() % 900}"
    screen = subprocess.Popen(
        ["Xvfb", display, "-screen", "0", f"{args.size}x24"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(100):
            if os.path.exists(f"/tmp/.X11-unix/X{display[1:]}"):
                break
            time.sleep(0.1)
        for busy in sorted({0, args.busy}):
            beside = [multiprocessing.Process(target=spin, daemon=True) for _ in range(busy)]
            for b in beside:
                b.start()
            with tempfile.TemporaryDirectory() as home:
                stats = os.path.join(home, "stats.json")
                command = [args.binary, "fly", args.scan, "--size", args.size, "--seconds", args.seconds]
                if "--layout" not in further:
                    command += ["--layout", "flight"]
                env = dict(os.environ, DISPLAY=display, HOME=home, XDG_STATE_HOME=home, XDG_CONFIG_HOME=home)
                subprocess.run(command + ["--stats", stats] + further, env=env, check=True, stderr=subprocess.DEVNULL)
                with open(stats) as f:
                    read = json.load(f)
            for b in beside:
                b.kill()
            ms = sorted(f["ms"] for f in read["frames"])
            print(
                json.dumps(
                    {
                        "busy_threads": busy,
                        "moving": read.get("moving"),
                        "frame_ms": {"median": ms[len(ms) // 2], "p99": ms[int(len(ms) * 0.99)]},
                        "present_ms": read.get("present_ms"),
                    }
                )
            )
    finally:
        screen.kill()


if __name__ == "__main__":
    main()
