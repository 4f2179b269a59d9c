"""How long `panoptic view` takes from the command to people and images in a headless Chromium.

    python test/support/first_picture.py RESULTS|BAG|FOLDER [--live] [--seek 10,1000]
        [--layers patches] [--picture view.png]

The browser runs before the command is given, as it does on a desk. `repeated_bag.py` makes long recordings.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from browser import Browser, find_browser

NEAR = "(t) => t !== null && Math.abs(t - SECOND * 1e9) < 0.2e9"
SEEK = f"""new Promise((done) => {{
    const begin = performance.now(), near = {NEAR};
    const there = () => near(panoptic.page.instant?.t ?? null) && panoptic.ready
        && panoptic.stats().tiles.every(([, image]) => near(image));
    const drawn = () => {{ // also by what draws in place of a graphics card
        const gl = document.getElementById("stage").getContext("webgl2");
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        requestAnimationFrame(() => done(performance.now() - begin));
    }};
    const look = () => requestAnimationFrame(there() ? drawn : look);
    panoptic.seek(SECOND * 1e9);
    look();
}})"""


def main() -> int:
    """Print one line per thing that is waited for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?")
    parser.add_argument("--live", action="store_true", help="the graph that runs now")
    parser.add_argument("--seek", default="", help="seconds to go to, with commas between them")
    parser.add_argument("--pause", type=float, default=0.0, help="seconds between them")
    parser.add_argument("--layers", default="", help="to switch, on or off, with commas between them")
    parser.add_argument("--picture", type=Path, help="a PNG of the page at the end")
    parser.add_argument("--wait", type=float, default=1.0, help="seconds before the picture")
    args = parser.parse_args()
    if find_browser() is None:
        print("NO BROWSER: apt-get install chromium", file=sys.stderr)
        return 2
    what = ["--live"] if args.live else [args.path]
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile)) as browser:
        begin = time.monotonic()
        program = [sys.executable, "-m", "panoptic_ros.cli.main", "view"]
        command = [*program, *what, "--port", "0", "--no-browser"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            address = next(word for word in server.stdout.readline().split() if word.startswith("http"))
            _tell("the program listens", begin)
            page = browser.open(address)
            page.wait("panoptic.ready", 60)
            _tell("people are drawn", begin)
            page.wait("panoptic.stats().images > 0", 60)
            _tell("images are drawn", begin)
            took, before = [], browser.processor_s()
            for second in filter(None, args.seek.split(",")):
                took.append(page.evaluate(SEEK.replace("SECOND", str(float(second)))) * 1e-3)
                print(f"people at {second + ' s':<14}{took[-1]:7.2f} s", flush=True)
                time.sleep(args.pause)
            if took:
                each = (browser.processor_s() - before) / len(took)
                print(
                    f"{len(took)} seeks: median {median(took):.2f} s, most {max(took):.2f} s; "
                    f"{each:.2f} s of a processor each in the browser; load {os.getloadavg()[0]:.1f}"
                )
            for layer in filter(None, args.layers.split(",")):
                page.evaluate(f"panoptic.switchLayer({layer!r})")
            if args.picture:
                time.sleep(args.wait)
                page.screenshot(args.picture)
            complaints, hosts = page.complaints(), page.hosts()
            print(f"complaints of the console: {complaints or 'none'}; asked: {', '.join(sorted(hosts))}")
            return 1 if complaints or hosts - {"127.0.0.1"} else 0
        finally:
            server.terminate()
            server.wait(10)


def _tell(what: str, begin: float) -> None:
    print(f"{what:<24}{time.monotonic() - begin:7.2f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
