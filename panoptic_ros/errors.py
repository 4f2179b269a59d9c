"""The exception family and its exit codes.

PanopticError (1, our own fault)
├── ContractError (1)      a promise inside the code was broken: a bug, please report it
└── UserError (2)          something that the user can mend
    ├── UsageError         arguments of a command or of a call
    ├── ConfigError        parameters: unknown, wrong type, out of range
    ├── CalibrationError   rigs and what they claim about the cameras
    ├── DataError          files, bags, messages and records with bad content
    ├── ClockError         timecode, stamps and clock models
    ├── BackendError       models, execution providers, devices
    └── EnvironmentProblem what the machine lacks: packages, disk space, permissions

Messages are one line that says what was found, where, and what to do. The command line catches
the family once, in `cli/main.py`; a node drops the item on DataError and ends on all others.
"""
from __future__ import annotations

__all__ = [
    "BackendError",
    "CalibrationError",
    "ClockError",
    "ConfigError",
    "ContractError",
    "DataError",
    "EnvironmentProblem",
    "PanopticError",
    "UsageError",
    "UserError",
]


class PanopticError(Exception):
    """Base of all errors that this package raises on purpose."""

    exit_code = 1


class ContractError(PanopticError):
    """A promise between parts of the code was broken: a bug."""


class UserError(PanopticError):
    """Something that the user can mend; the message says how."""

    exit_code = 2


class UsageError(UserError):
    """Arguments that make no sense."""


class ConfigError(UserError):
    """A parameter is unknown, of the wrong type or out of range."""


class CalibrationError(UserError):
    """A rig that cannot be right, or that does not fit the images."""


class DataError(UserError):
    """A file, bag, message or record with bad content."""


class ClockError(UserError):
    """Timecode, stamps or clock models that cannot be used."""


class BackendError(UserError):
    """A model, execution provider or device that cannot be used."""


class EnvironmentProblem(UserError):
    """The machine lacks something: a package, disk space, a permission."""
