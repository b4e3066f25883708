"""The variant that all tests run under, and a thread for each of those who run them side by side: threads
that wait for others spin."""

import os

import drjit as dr
import mitsuba as mi
import pytest

mi.set_variant("llvm_ad_rgb")
if "PYTEST_XDIST_WORKER" in os.environ:
    dr.set_thread_count(1)


@pytest.fixture
def rng():
    """A seeded NumPy generator."""
    import numpy as np

    return np.random.default_rng(20060730)
