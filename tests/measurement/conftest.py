"""Boards that the photographer of `measurement.synthetic.photographer` sees in place of the screen."""

from __future__ import annotations

import pytest

from measurement.synthetic.photographer import charuco, chessboard


@pytest.fixture(scope="session")
def boards_drawn():
    """What draws boards, by the name that `setup --target` has for them."""
    return {"chessboard": chessboard, "charuco": charuco}
