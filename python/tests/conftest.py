"""Tests run in the checkout's folder, so that scenarios are named as the documents name them."""

import os
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def in_checkout():
    before = Path.cwd()
    os.chdir(CHECKOUT)
    yield
    os.chdir(before)
