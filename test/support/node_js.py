"""JavaScript of the viewer's page, run by Node where there is one."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from panoptic_ros.view.page.html import STATIC

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="NODE IS MISSING: the page's JavaScript is not tested")


def run_js(code: str, data: object = None):
    """What `code`, a module that may import "#view/...", prints as JSON; `data` is there as a constant."""
    program = f"const data = {json.dumps(data)};\n{code}"
    done = subprocess.run(
        [str(NODE), "--input-type=module", "-"],
        input=program,
        cwd=STATIC,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)
