"""The estimator written a second time, in C for the speed benchmark: the same digits from other code."""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path

import pytest
from benchmarks.engine_kernel import SAME, Scene, closing_cost, compiled, filter_cost

from aeroskein.mode_bank import ModeBank

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler on this machine")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(64)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return compiled(Path(tmp_path_factory.mktemp("kernel")))


@pytest.mark.parametrize("product", ["live", "detector"])
def test_the_filters_of_three_models_agree_with_the_same_in_c(kernel: ctypes.CDLL, scene: Scene, product: str) -> None:
    state = scene.engine._state
    banks: dict[str, ModeBank] = {"live": state.live.bank, "detector": state.elements.detector}

    assert filter_cost(kernel, banks[product]).difference < SAME


def test_elements_agree_with_the_same_in_c(kernel: ctypes.CDLL, scene: Scene) -> None:
    assert closing_cost(kernel, scene).difference < SAME
