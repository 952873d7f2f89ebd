import pytest

from raytwin.errors import MachineError
from raytwin.twin import activate


@pytest.fixture(autouse=True, scope="session")
def working_llvm(own_cache):
    """Dr.Jit is loaded with a libLLVM that works, whatever test is first."""
    activate()


@pytest.fixture
def compiled() -> str:
    return working("llvm_ad_rgb")


def working(variant: str) -> str:
    try:
        return activate(variant).variant
    except MachineError as error:
        pytest.skip(f"{variant} does not work here: {error.got}")
