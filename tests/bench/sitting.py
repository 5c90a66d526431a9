"""Drives the window by keys and mouse under Xvfb and takes a screenshot of each step.

    python tests/bench/sitting.py SCAN OUT/ [--size 1600x1000] [--binary target/release/colvis]

Needs Xvfb, xdotool and ImageMagick's import. The session opens the scan, flies, stops, clicks in each slice and on the wall,
measures in the flight and in a slice, changes the grey levels and drags a divider. Then it closes the window and opens it again
to show that layout and distances are restored.
"""

import argparse
import json
import os
import pathlib
import subprocess
import tempfile
import time


class Sitting:
    def __init__(self, args, home, display):
        self.args, self.home = args, pathlib.Path(home)
        self.out = pathlib.Path(args.out)
        self.out.mkdir(parents=True, exist_ok=True)
        self.env = dict(os.environ, DISPLAY=display, HOME=home, XDG_STATE_HOME=home, XDG_CONFIG_HOME=home)
        self.width, self.height = map(int, args.size.split("x"))
        self.steps = 0
        self.program = None

    def tool(self, *args):
        return subprocess.run(args, env=self.env, check=True, capture_output=True, text=True).stdout

    def open(self):
        command = [self.args.binary, "fly", self.args.scan, "--size", self.args.size]
        self.program = subprocess.Popen(command, env=self.env)
        for _ in range(120):
            time.sleep(0.5)
            found = subprocess.run(["xdotool", "search", "--name", "colvis"], env=self.env, capture_output=True, text=True)
            if found.stdout.strip():
                self.tool("xdotool", "windowfocus", found.stdout.split()[0])
                break
        time.sleep(8)

    def close(self):
        self.key("q")
        if self.program.wait(30):
            raise SystemExit("colvis exited with an error")

    def key(self, key):
        self.tool("xdotool", "key", key)
        time.sleep(0.6)

    def click(self, x, y, times=1):
        """Clicks at (x, y), given as fractions of the window's width and height."""
        self.move(x, y)
        self.tool("xdotool", "click", "--repeat", str(times), "--delay", "120", "1")
        time.sleep(1.2)

    def move(self, x, y):
        self.tool("xdotool", "mousemove", str(int(x * self.width)), str(int(y * self.height)))
        time.sleep(0.25)

    def drag(self, button, start, end):
        self.move(*start)
        self.tool("xdotool", "mousedown", button)
        for n in range(1, 9):
            self.move(*(a + (b - a) * n / 8 for a, b in zip(start, end)))
        self.tool("xdotool", "mouseup", button)
        time.sleep(1)

    def shot(self, what):
        self.steps += 1
        path = self.out / f"{self.steps:02}-{what}.png"
        self.tool("import", "-silent", "-window", "root", str(path))
        print(path)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("scan")
    parser.add_argument("out")
    parser.add_argument("--size", default="1600x1000")
    parser.add_argument("--binary", default="target/release/colvis")
    args = parser.parse_args()
    display = f":{60 + os.getpid() % 900}"
    screen = subprocess.Popen(
        ["Xvfb", display, "-screen", "0", f"{args.size}x24"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        time.sleep(2)
        with tempfile.TemporaryDirectory() as home:
            s = Sitting(args, home, display)
            s.open()
            s.shot("opened")
            time.sleep(3)
            s.shot("flying")
            s.key("space")
            time.sleep(1.5)
            s.shot("stopped")
            for name, place in [("axial", (0.84, 0.3)), ("coronal", (0.66, 0.7)), ("sagittal", (0.88, 0.66))]:
                s.click(*place)
                s.shot(f"click-{name}")
            s.click(0.2, 0.45)
            s.shot("click-wall")
            s.click(0.38, 0.6, times=2)
            time.sleep(1)
            s.shot("looks-at-wall")
            s.key("c")
            s.click(0.18, 0.4)
            s.click(0.3, 0.42)
            s.shot("measured-in-flight")
            s.click(0.72, 0.3)
            s.click(0.76, 0.32)
            s.shot("measured-in-slice")
            s.key("c")
            s.key("ctrl+2")
            s.shot("soft-tissue")
            s.drag("3", (0.7, 0.25), (0.76, 0.2))
            s.shot("greys-by-drag")
            s.key("ctrl+1")
            s.drag("1", (0.5495, 0.6), (0.45, 0.6))
            s.shot("divider")
            s.close()
            s.open()
            s.key("space")
            time.sleep(1.5)
            s.shot("opened-again")
            for key, name in [("F2", "flight"), ("F4", "slices"), ("F5", "across"), ("h", "help")]:
                s.key(key)
                time.sleep(1)
                s.shot(f"layout-{name}")
            s.key("h")
            s.key("F3")
            s.close()
            kept = next((s.home / "colvis" / "measures").iterdir())
            print(f"{len(json.loads(kept.read_text())['measures'])} distances kept")
    finally:
        screen.kill()


if __name__ == "__main__":
    main()
