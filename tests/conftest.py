"""The variant that all tests run under."""

import mitsuba as mi
import pytest

mi.set_variant("llvm_ad_rgb")


@pytest.fixture
def rng():
    """A seeded NumPy generator."""
    import numpy as np

    return np.random.default_rng(20060730)
