"""Several processes that test share the files out: no file is split between two of them."""

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "domain"  # ten files whose tests take no time


def test_a_file_is_tested_by_one_process():
    words = ["--numprocesses", "2", "-o", "addopts=--import-mode=importlib", "-v", str(FOLDER)]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words], capture_output=True, text=True, cwd=FOLDER.parents[1]
    )
    processes = defaultdict(set)
    for process, file in re.findall(r"\[(gw\d)\] .* (test/\S+?)::", done.stdout):
        processes[file].add(process)
    assert len(processes) > 5 and len(set.union(*processes.values())) == 2, done.stdout[-2000:]
    assert all(len(found) == 1 for found in processes.values()), processes
