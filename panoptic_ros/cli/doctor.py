"""`panoptic doctor`: check this machine, and print remedies for failed checks."""

from __future__ import annotations

import argparse
import json

from panoptic_ros.running.doctor.checks import CHECKS
from panoptic_ros.running.doctor.finding import LEVELS, Finding, run_checks


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb."""
    parser.add_argument("--json", action="store_true", help="print one JSON document instead of lines")


def run(args: argparse.Namespace) -> int:
    """Run all checks; return exit code 2 if one failed, else 0."""
    findings = run_checks(CHECKS)
    print(as_json(findings) if args.json else as_lines(findings))
    return 2 if any(finding.level == "FAIL" for finding in findings.values()) else 0


def as_lines(findings: dict[str, Finding]) -> str:
    """Return one line per check with level, name, finding and remedy, and a line with the counts."""
    width = max(map(len, findings))
    lines = []
    for name, finding in findings.items():
        remedy = f"; remedy: {finding.remedy}" if finding.remedy else ""
        lines.append(f"{finding.level:4}  {name:{width}}  {finding.found}{remedy}")
    levels = [finding.level for finding in findings.values()]
    lines.append(", ".join(f"{levels.count(level)} {level}" for level in LEVELS))
    return "\n".join(lines)


def as_json(findings: dict[str, Finding]) -> str:
    """Return the findings as JSON: {"healthy": bool, "checks": [{check, level, found, remedy}]}."""
    checks = [
        {"check": name, "level": finding.level, "found": finding.found, "remedy": finding.remedy}
        for name, finding in findings.items()
    ]
    healthy = all(finding.level != "FAIL" for finding in findings.values())
    return json.dumps({"healthy": healthy, "checks": checks}, indent=2)
