"""Studies from end to end, with the checks that every study must stand."""

import json
import sys
from importlib import import_module

from panoptic_ros.io.files import known
from panoptic_ros.study.names import parsed
from panoptic_ros.study.study import Result, run_study


def run_whole(study) -> Result:
    """Run a study; its progress, its result and its lines are checked."""
    told = []
    result = run_study(study, lambda share, doing: told.append(share))
    assert result["study"] == study.name and result["rows"]
    assert told == sorted(told) and told[-1] == 1.0
    json.dumps(known(result), allow_nan=False)
    lines = list(study.lines(result))
    assert len(lines) >= 1 and all(isinstance(line, str) and "\n" not in line for line in lines)
    return result


def run_named(name, options) -> Result:
    """`run_whole` of a study and its options in one text."""
    return run_whole(parsed(name, options.split()))


def in_this_process(monkeypatch, study) -> None:
    """Let a study answer its requests here; requests and answers are JSON all the same."""
    module = sys.modules[type(study).__module__]
    monkeypatch.setattr(module, "run_child", _answer, raising=False)


def _answer(function, request):
    """See `panoptic_ros.study.child.run_child`."""
    answer = getattr(import_module(function.__module__), function.__name__)(json.loads(json.dumps(request)))
    return json.loads(json.dumps(answer))
