import pytest

from raytwin.twin import activate


@pytest.fixture(autouse=True)
def compiled(own_cache):
    """Dr.Jit is loaded with a libLLVM that works, whatever test is first."""
    activate("llvm_ad_rgb")
