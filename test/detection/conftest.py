"""Tiny networks that see coloured blobs, for all tests of detection."""

from __future__ import annotations

import pytest
from blobs import Blobs


@pytest.fixture
def blobs() -> Blobs:
    return Blobs()
