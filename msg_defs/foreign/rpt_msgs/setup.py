"""Built as this project's own messages are."""

import runpy
from pathlib import Path

runpy.run_path(str(Path(__file__).resolve().parents[2] / "setup.py"))
