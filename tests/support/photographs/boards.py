"""A ChArUco board that the photographer sees instead of the screen."""

from __future__ import annotations

import cv2
import numpy as np

from measurement.photographer import Light, Scene, _board, _pixels, truth_of


@_board
def charuco(scene: Scene, squares: tuple[int, int], side: float, blur: float) -> Light:
    """Return a photograph (h, w, 3) of a ChArUco board about (0, 0)."""
    fine = 120
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    sheet = cv2.aruco.CharucoBoard(squares, 1.0, 0.75, markers).generateImage((squares[0] * fine, squares[1] * fine))
    sheet = cv2.copyMakeBorder(cv2.GaussianBlur(sheet, (0, 0), 1.5), fine, fine, fine, fine, cv2.BORDER_CONSTANT, value=[255])
    place = truth_of(scene).to_screen(_pixels(scene)) / side * [1, -1] + np.array(squares) / 2 + 1
    at = (place * fine - 0.5).reshape(scene.height, scene.width, 2).astype(np.float32)
    light = cv2.remap(sheet, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) * 0.75 + 20.0
    return np.asarray(cv2.GaussianBlur(light, (0, 0), blur))
